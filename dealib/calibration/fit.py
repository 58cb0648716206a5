"""The least-squares fit: residuals and their derivatives from cases solved in parallel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import lmfit
import numpy as np

from dealib.calibration.cases import Cases, History
from dealib.calibration.schema import Plan
from dealib.data.compare import Comparison, compare
from dealib.data.measured import Array, Measured, measured
from dealib.data.names import split_unit
from dealib.errors import ConfigError, NotConverged

_FAILED = 1e3  # residual, in standard deviations, of a case that does not converge


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter.

    Attributes:
        key: Dotted key of the config.
        unit: Its unit.
        value: Best value.
        error: Standard error; NaN if it cannot be estimated.
        low: Lower end of the confidence interval.
        high: Upper end.
    """

    key: str
    unit: str
    value: float
    error: float
    low: float
    high: float


@dataclass(frozen=True)
class Fitted:
    """The result of a fit.

    Attributes:
        plan: What was fitted.
        estimates: The parameters.
        correlation: Correlation matrix of the parameters.
        comparisons: Measured curves against the best run, by data set.
        reduced_chi2: Sum of squares over the degrees of freedom; 1 if the noise explains it.
        points: Number of data points.
        evaluations: Evaluations of all residuals.
        solved: Cases solved.
        message: How the search ended.
    """

    plan: Plan
    estimates: list[Estimate]
    correlation: Array
    comparisons: list[list[Comparison]]
    reduced_chi2: float
    points: int
    evaluations: int
    solved: int
    message: str


class Objective:
    """Residuals of all data in standard deviations, and their derivatives.

    Args:
        plan: What is fitted.
        cases: Solver of cases.
        progress: Told each new sum of squares with its parameters.
    """

    def __init__(self, plan: Plan, cases: Cases, progress: Callable[[str], None]) -> None:
        self.plan, self.cases, self.progress = plan, cases, progress
        self.keys = list(plan.fit.parameters)
        self.evaluations = 0
        self._shown: dict[str, float] = {}
        start = {key: p.start[0] for key, p in plan.fit.parameters.items()}
        histories = self._histories([start])[0]
        for history in histories:
            if isinstance(history, NotConverged):
                raise NotConverged(f"the case at the start does not converge: {history}")
        self.data = [self._read(i, h) for i, h in enumerate(histories)]  # type: ignore[arg-type]
        self.sigma = [self._sigma(i, measured) for i, measured in enumerate(self.data)]

    def names(self) -> dict[str, str]:
        """Names that lmfit takes, by dotted key."""
        return {key: f"p{i}" for i, key in enumerate(self.keys)}

    def parameters(self) -> lmfit.Parameters:
        """The parameters with their bounds."""
        found = lmfit.Parameters()
        for key, name in self.names().items():
            p = self.plan.fit.parameters[key]
            low, high = p.range
            found.add(name, value=p.start[0], min=low, max=high)
        return found

    def values(self, parameters: lmfit.Parameters) -> dict[str, float]:
        """Values by dotted key."""
        return {key: float(parameters[name].value) for key, name in self.names().items()}

    def residual(self, parameters: lmfit.Parameters) -> Array:
        """(computed - measured) / sigma of all points (points,)."""
        values = self.values(parameters)
        self.evaluations += 1
        residual = self._residuals([values])[0]
        if values != self._shown:  # lmfit asks more than once
            self._shown = values
            where = ", ".join(
                f"{key.rsplit('.', 1)[-1]} {value:.6g} {self.plan.fit.parameters[key].unit}".strip()
                for key, value in values.items()
            )
            self.progress(f"sum of squares {float(residual @ residual):<11.6g}  {where}")
        return residual

    def jacobian(self, parameters: lmfit.Parameters) -> Array:
        """Derivatives by the varied parameters, (points, parameters), by differences."""
        values = self.values(parameters)
        sets, steps = [values], []
        for key, name in self.names().items():
            if parameters[name].vary:
                method, parameter = self.plan.fit.method, self.plan.fit.parameters[key]
                moved_to = parameter.moved(values[key], method.difference)
                sets.append(values | {key: moved_to})
                steps.append(moved_to - values[key])
        base, *moved = self._residuals(sets)
        return np.column_stack([(m - base) / h for m, h in zip(moved, steps, strict=True)])

    def comparisons(self, values: dict[str, float]) -> list[list[Comparison]]:
        """All data against the run at parameter values."""
        return [
            self._compare(i, history)
            for i, history in enumerate(self._histories([values])[0])
            if not isinstance(history, NotConverged)
        ]

    def _histories(self, sets: list[dict[str, float]]) -> list[list[History | NotConverged]]:
        n = len(self.plan.fit.data)
        wanted = [self.plan.case(i, values) for values in sets for i in range(n)]
        found = self.cases.histories(wanted)
        return [found[k * n : (k + 1) * n] for k in range(len(sets))]

    def _residuals(self, sets: list[dict[str, float]]) -> list[Array]:
        return [
            np.concatenate([self._residual(i, h) for i, h in enumerate(histories)])
            for histories in self._histories(sets)
        ]

    def _residual(self, index: int, history: History | NotConverged) -> Array:
        measured, sigma = self.data[index], self.sigma[index]
        if isinstance(history, NotConverged):
            return np.full(measured.points, _FAILED)
        weight = self.plan.fit.data[index].weight
        parts = [
            weight * (c.computed - c.measured) / sigma[c.y_name]
            for c in self._compare(index, history)
        ]
        return np.concatenate(parts)

    def _compare(self, index: int, history: History) -> list[Comparison]:
        # beyond the run's end its curve goes on straight: the number of points must not change
        return compare(history, self.data[index], self.plan.fit.data[index].stage, extrapolate=True)

    def _read(self, index: int, history: History) -> Measured:
        numeric = [name for name, values in history.items() if values.dtype.kind in "fi"]
        found = measured(self.plan.files[index], numeric, self.plan.fit.data[index])
        self.progress(found.account)
        return found

    def _sigma(self, index: int, measured: Measured) -> dict[str, float]:
        quantities = {split_unit(name)[0]: name for name in measured.curves}
        for quantity in self.plan.fit.data[index].sigma:
            if quantity not in quantities:
                where = ("data", index, "sigma", quantity)
                problem = f"no curve of this file; it has {', '.join(quantities)}"
                raise ConfigError(self.plan.source.message(where, problem, "key"))
        found = {}
        for quantity, name in quantities.items():
            values = measured.columns[name]
            spread = float(np.nanmax(values) - np.nanmin(values)) or 1.0
            found[name] = self.plan.sigma(index, quantity, split_unit(name)[1], spread)
        return found


def run_search(plan: Plan, cases: Cases, progress: Callable[[str], None]) -> Fitted:
    """Fit the parameters.

    Args:
        plan: What is fitted.
        cases: Solver of cases.
        progress: Told each evaluation in one line.

    Raises:
        ConfigError: If the data do not fit the runs, or are fewer than the parameters.
        NotConverged: If the case at the start does not converge.
    """
    objective = Objective(plan, cases, progress)
    method = plan.fit.method
    points = sum(m.points for m in objective.data)
    if points <= len(objective.keys):
        raise ConfigError(
            f"{plan.source.path}: {points} data points are too few for "
            f"{len(objective.keys)} parameters"
        )
    minimizer = lmfit.Minimizer(
        objective.residual,
        objective.parameters(),
        max_nfev=method.max_evaluations,
        Dfun=objective.jacobian,
        col_deriv=False,
        ftol=method.tolerance,
        xtol=method.tolerance,
    )
    result = minimizer.minimize(method="leastsq")
    best = objective.values(result.params)
    return Fitted(
        plan,
        _estimates(objective, minimizer, result),
        _correlation(result, len(objective.keys)),
        objective.comparisons(best),
        float(result.redchi),
        points,
        objective.evaluations,
        cases.solved,
        " ".join(str(result.message).split()),
    )


def _estimates(objective: Objective, minimizer: Any, result: Any) -> list[Estimate]:
    from scipy.stats import t

    level = objective.plan.fit.method.confidence
    quantile = float(t.ppf((1 + level) / 2, result.nfree))
    profile: dict[str, Any] = {}
    if objective.plan.fit.method.profile and result.errorbars:
        profile = lmfit.conf_interval(minimizer, result, sigmas=[level])
    found = []
    for key, name in objective.names().items():
        parameter = objective.plan.fit.parameters[key]
        value = float(result.params[name].value)
        error = result.params[name].stderr
        error = float("nan") if error is None else float(error)
        ends = [value - quantile * error, value + quantile * error]
        if name in profile:
            ends = [profile[name][0][1], profile[name][-1][1]]
        low, high = np.clip(ends, *parameter.range)
        found.append(Estimate(key, parameter.unit, value, error, float(low), float(high)))
    return found


def _correlation(result: Any, size: int) -> Array:
    covariance = getattr(result, "covar", None)
    if covariance is None:
        return np.full((size, size), np.nan)
    scale = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(scale, scale))
