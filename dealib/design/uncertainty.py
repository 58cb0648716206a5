"""Scatter of the results of a config whose numbers have distributions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dealib.arrays import Array
from dealib.cases.job import Ended, Job, run
from dealib.cases.workers import Pool
from dealib.design.designs import as_model
from dealib.design.distributions import Joint
from dealib.design.evaluate import Evaluation, job, read
from dealib.design.goals import goals
from dealib.design.plan import DesignPlan
from dealib.design.propagation import Samples
from dealib.errors import ConfigError, NotConverged, did_you_mean
from dealib.units import convert

if TYPE_CHECKING:
    import pandas

Solve = Callable[[Sequence[Job]], Iterable[Ended]]
UNSOLVED = "no result"  # name of the summary's row for samples without a result


class UncertaintyTables(NamedTuple):
    """Rows of `samples.csv`, `summary.csv` and `sobol.csv`."""

    samples: list[dict[str, Any]]
    summary: list[dict[str, Any]]
    sobol: list[dict[str, Any]]


def uncertainty(
    path: str | Path, jobs: int = 1, cache: str | Path = "runs/studies/cases"
) -> tuple[pandas.DataFrame, pandas.DataFrame, pandas.DataFrame]:
    """Quantiles, Sobol indices and probabilities of a design whose variables scatter.

    Args:
        path: The YAML file of the design.
        jobs: Number of processes; with more than one, a script needs the guard
            `if __name__ == "__main__":`.
        cache: Folder of solved cases.

    Returns:
        The tables of `summary.csv`, `sobol.csv` and `samples.csv`.

    Raises:
        ConfigError: If the file is wrong, with its place.
        NotConverged: If too few samples have a result.
    """
    import pandas as pd

    with Pool(jobs) as pool:
        solve: Solve = pool.solve if jobs > 1 else lambda missing: map(run, missing)
        found = find(DesignPlan(Path(path)), Path(cache), solve)
    return pd.DataFrame(found.summary), pd.DataFrame(found.sobol), pd.DataFrame(found.samples)


def joint(plan: DesignPlan) -> Joint:
    """The joint distribution of a design, in the units of its variables.

    Raises:
        ConfigError: If a distribution or a correlation is wrong, with its place in the file.
    """
    names = tuple(plan.design.variables)
    matrix = np.eye(len(names))
    for k, pair in enumerate(plan.design.correlations):
        where = ("correlations", k, "between")
        for name in pair.between:
            if name not in names:
                raise plan.fault(where, f"{name!r} is not a variable{did_you_mean(name, names)}")
        i, j = map(names.index, pair.between)
        if matrix[i, j]:
            raise plan.fault(where, "expected two different variables, and each pair once")
        matrix[i, j] = matrix[j, i] = pair.coefficient
    if np.linalg.eigvalsh(matrix)[0] < 1e-9:
        raise plan.fault(
            ("correlations",), "these coefficients contradict each other; reduce some", "key"
        )
    return Joint(names, tuple(map(plan.spread, names)), matrix)


def find(plan: DesignPlan, cache: Path, solve: Solve, retry: bool = False) -> UncertaintyTables:
    """Solve the samples of a design, and compute the statistics of its quantities.

    Args:
        plan: The design.
        cache: Folder of solved cases.
        solve: Solves the missing cases.
        retry: Solve cases again that have no result.

    Raises:
        ConfigError: If the design is wrong, with the place in the file.
        NotConverged: If too few samples have a result.
    """
    variables, asked = joint(plan), goals(plan, searched=False)
    if not asked.asked:
        raise plan.fault((), "name at least one quantity, in quantities or subject_to")
    of, least = plan.design.sampling, 2 * len(variables.names) + 2
    if of.samples < least:
        said = f"{of.samples} samples are too few for these variables; take {least} or more"
        raise plan.fault(("sampling", "samples"), said)
    errors: dict[int, str] = {}
    at_means: list[Evaluation] = []

    def model(x: Array) -> dict[str, Array]:
        points = [variables.means, *x]
        jobs = [_job(plan, k, point, asked.asked, cache) for k, point in enumerate(points)]
        known = {j.key: read(j) for j in jobs}
        missing = [j for j in jobs if (e := known[j.key]) is None or (retry and e.error)]
        for ended in solve(missing):
            known[ended.job.key] = read(ended.job) or Evaluation({}, {}, ended.error)
        found = [known[j.key] or Evaluation({}, {}, "not solved") for j in jobs]
        errors.update((k, one.error) for k, one in enumerate(found) if one.error)
        at_means.append(found[0])
        return {q: np.array([e.values.get(q, np.nan) for e in found[1:]]) for q in asked.asked}

    try:
        samples = Samples(variables, model, of.samples, of.seed, of.quantiles)
    except NotConverged as error:
        raise NotConverged(f"{error}; the first error: {errors[min(errors)]}") from None
    slopes, summary, sobol = at_means[0].slopes, list[dict[str, Any]](), list[dict[str, Any]]()
    for name in asked.asked:
        known = samples.known(name)
        told = {k: value for k, (value, _) in known.numbers.items()}
        told |= {f"{k}_error": error for k, (_, error) in known.numbers.items()}
        told["linear_deviation"] = _linear(plan, variables, slopes.get(name, {}))
        summary.append({"quantity": name, **told, "explained": known.explained})
        for key, (first, off) in known.first.items():
            total, by = known.total[key]
            indices = {"first": first, "first_error": off, "total": total, "total_error": by}
            sobol.append({"quantity": name, "key": key, **indices})
    for limit in asked.limits:
        text = f"{limit.name} {'<=' if limit.sign > 0 else '>='} {limit.bound:g}"
        chance = samples.beyond(limit.name, limit.bound, limit.sign)
        summary.append({"quantity": text, **chance._asdict()})
    summary.append({"quantity": UNSOLVED, **samples.unsolved._asdict()})
    units = ((n, plan.unit(n)) for n in variables.names)
    columns = [*(f"{n} [{unit}]" if unit else n for n, unit in units), *samples.values]
    rows = np.column_stack([samples.x, *samples.values.values()]).tolist()
    table = [
        {"sample": k, **dict(zip(columns, row, strict=True)), "error": errors.get(k, "")}
        for k, row in enumerate(rows, start=1)
    ]
    return UncertaintyTables(table, summary, sobol)


def _job(plan: DesignPlan, k: int, point: Array, asked: Mapping[str, str], cache: Path) -> Job:
    """The job of sample k; number 0 is that of the means, which computes slopes as well."""
    names = tuple(plan.design.variables)
    model = {} if plan.design.model == "auto" else as_model(plan, plan.design.model)
    try:
        case = plan.case(dict(zip(names, point.tolist(), strict=True)), **model)
    except ConfigError as error:
        said = f"sample {k} is impossible; limit its variables by min and max: {error}"
        raise plan.fault(("variables",), said, "key") from None
    label = f"{plan.name}: {f'sample {k}' if k else 'means'}"
    return job(label, case, cache, asked, () if k else names)


def _linear(plan: DesignPlan, variables: Joint, slopes: Mapping[str, float]) -> float:
    """Standard deviation by linear propagation of slopes; NaN if a variable has no slope."""
    factors = [convert((1.0, plan.unit(n)), plan.keys[n].unit) for n in variables.names]
    along = np.array([slopes.get(n, np.nan) for n in variables.names])
    parts = along * factors * variables.deviations
    return float(np.sqrt(parts @ variables.correlation @ parts))
