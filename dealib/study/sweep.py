"""Solve all cases of studies that are not in the cache yet."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from dealib.config.schema import Config
from dealib.study.cache import DONE, FAILED, Cache
from dealib.study.job import Job, Outcome
from dealib.study.plan import Plan, Planned

Solve = Callable[[Sequence[Job]], Iterable[Outcome]]


@dataclass(frozen=True)
class CaseStatus:
    """Where a case stands.

    Attributes:
        case: The case.
        status: 'done', 'not converged', 'failed', 'crashed' or 'missing'.
        error: What went wrong.
    """

    case: Planned
    status: str
    error: str = ""


def missing(plans: Sequence[Plan], cache: Cache, retry: bool = False) -> list[Job]:
    """The jobs that remain: one a key, those that did not converge only if told.

    Args:
        plans: The studies.
        cache: Where solved cases are.
        retry: Solve again what did not converge.
    """
    settled = {DONE} if retry else {DONE, FAILED}
    jobs: dict[str, Job] = {}
    for plan in plans:
        for case in plan.cases:
            if not isinstance(case.work, Config) or case.key in jobs:
                continue
            if cache.status(case.key) not in settled:
                label = f"{plan.study.name}: {case.label}"
                where = cache.directory(case.key), cache.log(case.key)
                jobs[case.key] = Job(label, case.key, case.kind, case.base, case.overrides, *where)
    return list(jobs.values())


def statuses(plan: Plan, cache: Cache, failures: dict[str, Outcome]) -> list[CaseStatus]:
    """Where each case of a study stands now.

    Args:
        plan: The study.
        cache: Where solved cases are.
        failures: Outcomes by key of what failed just now.
    """
    found = []
    for case in plan.cases:
        if not isinstance(case.work, Config):
            found.append(CaseStatus(case, DONE))
            continue
        info = cache.info(case.key)
        status, error = str(info.get("status", "missing")), str(info.get("error", ""))
        if case.key in failures:
            status, error = failures[case.key].status, failures[case.key].error
        found.append(CaseStatus(case, status, error))
    return found


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def solve(jobs: Sequence[Job], how: Solve) -> Iterator[Outcome]:
    """Solve jobs, and clear what an earlier attempt left that is no run.

    Yields:
        Outcomes as they come.
    """
    for job in jobs:
        job.directory.parent.mkdir(parents=True, exist_ok=True)
        _clear(job.directory)
    yield from how(jobs)


def _clear(directory: Path) -> None:
    """A kill in the first moment leaves a directory that `simulate` would not overwrite."""
    from dealib.results.store import INFO

    if directory.exists() and not (directory / INFO).is_file():
        shutil.rmtree(directory)
