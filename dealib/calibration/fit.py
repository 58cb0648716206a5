"""The fit of a config to measured curves; its cases are solved in parallel."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from dealib.calibration.cases import CaseRequest, Cases, History
from dealib.calibration.reach import check_reach
from dealib.calibration.report import Fitted
from dealib.calibration.schema import FitPlan
from dealib.calibration.search import blind, search
from dealib.calibration.task import Free, Series, Task, Values
from dealib.config import Case, resolved
from dealib.data.measured import Measured, measured
from dealib.data.names import split_unit
from dealib.design.slopes import known
from dealib.errors import ConfigError, NotConverged


def run_search(plan: FitPlan, cases: Cases, progress: Callable[[str], None]) -> Fitted:
    """Fit the parameters.

    Args:
        plan: The fit.
        cases: Solver of cases.
        progress: Called with lines of text: combinations of parameters that the data hardly
            determine, then one line per evaluation.

    Raises:
        ConfigError: If the data do not fit the runs, or are fewer than the parameters.
        NotConverged: If the case at the start does not converge.
    """
    fit, method, n = plan.fit, plan.fit.method, len(plan.fit.data)

    def solve(sets: list[Values]) -> list[list[History | NotConverged]]:
        chosen = [[plan.case(i, values) for i in range(len(fit.data))] for values in sets]
        wanted = [
            _wanted(plan, i, case, k == 0)
            for k, of in enumerate(chosen)
            for i, case in enumerate(of)
        ]
        found = iter(cases.histories([case for of in chosen for case in of], wanted))
        return [[next(found) for _ in of] for of in chosen]

    def slopes(values: Values) -> list[dict[str, History]]:
        chosen = [plan.case(i, values) for i in range(n)]
        return [cases.slopes(c, _wanted(plan, i, c, True)) for i, c in enumerate(chosen)]

    free = {key: Free(p.unit, p.start[0], *p.range) for key, p in fit.parameters.items()}
    series = []
    for i, history in enumerate(solve([{key: f.start for key, f in free.items()}])[0]):
        if isinstance(history, NotConverged):
            raise NotConverged(f"the case at the start does not converge: {history}")
        series.append(_series(plan, i, history))
        progress(series[i].measured.account)
        check_reach(series[i], history)
    points = sum(s.measured.points for s in series)
    if points <= len(free):
        raise ConfigError(
            f"{plan.source.path}: {points} data points are too few for {len(free)} parameters"
        )
    task = Task(
        free, series, solve, method.difference, method.tolerance, method.max_evaluations,
        method.confidence, method.intervals, slopes,
    )  # fmt: skip
    for line in (before := blind(task)):
        progress(f"at the start: {line}")
    found = search(task, progress)
    from dealib.plots.compare import draw_comparison

    pairs = zip(series, found.comparisons, strict=True)
    titled = [(s.title, c) for s, comparisons in pairs for c in comparisons]
    draw = functools.partial(
        draw_comparison, [c for _, c in titled], titles=[title for title, _ in titled]
    )
    best = {"best.yaml": resolved(plan.case(0, found.values).config)}
    notes = [f"{cases.solved} cases solved."]
    return Fitted(fit.name, fit.description, found, before, notes, {}, best, draw)


def _wanted(plan: FitPlan, index: int, case: Case, first: bool) -> CaseRequest:
    """What a case computes; derivatives only at the current point of the search (`first`)."""
    data = plan.fit.data[index]
    if data.spectrum:
        return CaseRequest((data.spectrum, data.stage))
    return CaseRequest(slopes=tuple(plan.fit.parameters) if first and known(case.config) else ())


def _series(plan: FitPlan, index: int, history: History) -> Series:
    data = plan.fit.data[index]
    numeric = [name for name, values in history.items() if values.dtype.kind in "fi"]
    found = measured(plan.files[index], numeric, data)
    stage = None if data.spectrum else data.stage
    return Series(data.file, found, _sigma(plan, index, found), data.weight, stage)


def _sigma(plan: FitPlan, index: int, measured: Measured) -> dict[str, float]:
    """Standard deviations of the columns; of the abscissa only if it is given."""
    columns = {split_unit(name)[0]: name for name in (measured.x, *measured.curves)}
    given = plan.fit.data[index].sigma
    for quantity in given:
        if quantity not in columns:
            where = ("data", index, "sigma", quantity)
            problem = f"no curve of this file; it has {', '.join(columns)}"
            raise ConfigError(plan.source.message(where, problem, "key"))
    found = {}
    for quantity, name in columns.items():
        if name != measured.x or quantity in given:
            values = measured.columns[name]
            spread = float(np.nanmax(values) - np.nanmin(values)) or 1.0
            found[name] = plan.sigma(index, quantity, split_unit(name)[1], spread)
    return found
