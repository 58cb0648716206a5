"""Evaluation of a design in a worker: its quantities and their slopes from one run."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from dealib.cases.cache import key
from dealib.cases.job import Job, Report, reuse
from dealib.config import Case, load
from dealib.errors import ConfigError, NotConverged, ValueAt
from dealib.files import write_text
from dealib.reading import read_text


@dataclass(frozen=True)
class Evaluation:
    """Result of the evaluation of a design.

    Attributes:
        values: Value of each quantity; empty if there is an error.
        slopes: By quantity and key: the derivative by the key in dealib's internal unit. Keys
            without a derivative are left out.
        error: Why there are no values; empty if there are.
    """

    values: dict[str, float]
    slopes: dict[str, dict[str, float]]
    error: str = ""


def evaluate(case: Case, quantities: Mapping[str, str], names: Sequence[str] = ()) -> Evaluation:
    """Quantities of a case, and their slopes by numbers of its config, from one run.

    Args:
        case: The case.
        quantities: Expressions over the history, by name.
        names: Keys of the numbers; programs that `sensitivity.refuse` refuses have no slopes.

    Raises:
        ConfigError: If the value of a quantity is not a number.
        NotConverged: If a step failed.
    """
    from mpi4py import MPI

    from dealib.design.sensitivity import find, refuse

    wanted: Sequence[str] | None = names or None
    try:
        refuse(case.config)
    except ValueAt:
        wanted = None
    found = find(
        case, list(quantities.values()), wanted, comm=MPI.COMM_SELF, rough=True, reuse=reuse()
    )
    slopes: dict[str, dict[str, float]] = {name: {} for name in quantities}
    for name, text in quantities.items():
        of = (row for row in found.rows if row["quantity"] == text)
        slopes[name] = {row["key"]: row["derivative"] for row in of}
    return Evaluation({name: found.values[text] for name, text in quantities.items()}, slopes)


def job(
    label: str,
    case: Case,
    folder: Path,
    quantities: Mapping[str, str],
    names: Sequence[str] = (),
) -> Job:
    """The job that evaluates a design and writes the result to a folder (see `read`)."""
    asked = json.dumps([key(case.config, "none"), dict(quantities), sorted(names)])
    name = hashlib.sha256(asked.encode()).hexdigest()[:16]
    work = functools.partial(_evaluated, dict(quantities), tuple(names))
    return Job(label, name, case.path, case.overrides, folder, work=work)


def read(job: Job) -> Evaluation | None:
    """The result of a job; None if there is none, or its file is damaged."""
    try:
        return Evaluation(**json.loads(read_text(_file(job), "evaluation", 1_000_000)))
    except (ConfigError, TypeError, ValueError):
        return None


def _file(job: Job) -> Path:
    return job.folder / f"{job.key}.json"


def _evaluated(
    quantities: dict[str, str], names: tuple[str, ...], job: Job, report: Report | None
) -> None:
    """Evaluate a design in a worker; an impossible design gives a result with its error."""
    try:
        found = evaluate(load(job.base, job.overrides), quantities, names)
    except (ConfigError, NotConverged) as error:
        found = Evaluation({}, {}, str(error))
    write_text(_file(job), json.dumps(asdict(found)))
