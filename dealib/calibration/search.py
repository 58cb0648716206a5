"""The least-squares search: residuals of all data, their derivatives, and what they leave open."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import lmfit
import numpy as np
from scipy.stats import t as student

from dealib.calibration.statistics import Uncertainty, directions, uncertainty
from dealib.calibration.task import Data, Estimate, Found, History, Task, Values
from dealib.data.measured import Array
from dealib.errors import NotConverged

_FAILED = 1e3  # residual, in standard deviations, of a case that does not converge
_NEAR = 1e-3  # of its range: a parameter is at its bound
_BENT = 1.4  # sum of squares at an end of an interval over that of a parabola: it misleads


class _Objective:
    """Residuals in standard deviations, and their derivatives by what is searched for."""

    def __init__(self, task: Task, progress: Callable[[str], None]) -> None:
        self.task, self.progress, self.evaluations = task, progress, 0
        self.names = {key: f"p{i}" for i, key in enumerate(task.free)}  # that lmfit takes
        self._shown: Values = {}

    def parameters(self) -> lmfit.Parameters:
        found = lmfit.Parameters()
        for key, free in self.task.free.items():
            low, high = free.range
            found.add(self.names[key], value=free.inner(free.start), min=low, max=high)
        return found

    def numbers(self, parameters: lmfit.Parameters) -> Array:
        return np.array([parameters[name].value for name in self.names.values()])

    def values(self, numbers: Array) -> Values:
        pairs = zip(self.task.free.items(), numbers, strict=True)
        return {key: free.outer(number) for (key, free), number in pairs}

    def residual(self, parameters: lmfit.Parameters) -> Array:
        values = self.values(self.numbers(parameters))
        self.evaluations += 1
        residual = self.residuals([values])[0]
        if values != self._shown:  # lmfit asks more than once
            self._shown = values
            free = self.task.free
            where = ", ".join(
                f"{_short(key, free)} {value:.6g} {free[key].unit}".strip()
                for key, value in values.items()
            )
            self.progress(f"sum of squares {float(residual @ residual):<11.6g}  {where}")
        return residual

    def varied(self, parameters: lmfit.Parameters) -> Array:
        """Derivatives by those that lmfit varies."""
        vary = np.array([parameters[name].vary for name in self.names.values()])
        return self.jacobian(self.numbers(parameters), vary)

    def jacobian(self, numbers: Array, vary: Array | None = None) -> Array:
        """Derivatives by differences, (points, parameters)."""
        sets, steps = [self.values(numbers)], []
        for i, (key, free) in enumerate(self.task.free.items()):
            if vary is not None and not vary[i]:
                continue
            step = self.task.difference * free.scale(numbers[i])
            moved = numbers[i] + step if numbers[i] + step <= free.range[1] else numbers[i] - step
            sets.append(sets[0] | {key: free.outer(moved)})
            steps.append(moved - numbers[i])
        base, *others = self.residuals(sets)
        return np.column_stack([(m - base) / h for m, h in zip(others, steps, strict=True)])

    def residuals(self, sets: list[Values]) -> list[Array]:
        return [
            np.concatenate([_residual(*p) for p in zip(self.task.series, found, strict=True)])
            for found in self.task.solve(sets)
        ]

    def squares(self, numbers: Sequence[Array]) -> list[float]:
        """Sums of squares."""
        return [float(r @ r) for r in self.residuals([self.values(n) for n in numbers])]


def _residual(series: Data, history: History | NotConverged) -> Array:
    if isinstance(history, NotConverged):
        x = series.measured.columns[series.measured.x]
        return np.full(len(series.measured.curves) * len(x), _FAILED)
    return series.weight * series.residual(history)


def search(task: Task, progress: Callable[[str], None] = lambda line: None) -> Found:
    """Find the parameters.

    Args:
        task: What is searched for.
        progress: Told each evaluation in one line.
    """
    objective = _Objective(task, progress)
    minimizer = lmfit.Minimizer(
        objective.residual,
        objective.parameters(),
        max_nfev=task.max_evaluations,
        Dfun=objective.varied,
        col_deriv=False,
        ftol=task.tolerance,
        xtol=task.tolerance,
    )
    result = minimizer.minimize(method="leastsq")
    numbers = objective.numbers(result.params)
    best = objective.values(numbers)
    J, r = objective.jacobian(numbers), objective.residuals([best])[0]
    found = uncertainty(J, r, _blocks(task.series))
    comparisons = [
        [] if isinstance(history, NotConverged) else series.against(history)
        for series, history in zip(task.series, task.solve([best])[0], strict=True)
    ]
    rest = iter(found.noise)
    size = np.sqrt(np.nanmax([*found.inflation, 1e-300]))
    message = " ".join(str(result.message).split())
    return Found(
        task,
        _estimates(objective, minimizer, result, J, found),
        _correlation(found.covariance),
        comparisons,
        [[next(rest) for _ in series.measured.curves] for series in task.series],
        float(r @ r),
        len(r),
        objective.evaluations,
        unseen(task, J / size, numbers),
        # 5: too many evaluations; 6 to 8: nothing to gain within rounding
        result.ier in (1, 2, 3, 4, 6, 7, 8) and not result.aborted and bool(np.all(r < _FAILED)),
        message,
    )


def blind(task: Task) -> list[str]:
    """What the data hardly see at the start of a search, for noise as it is assumed."""
    objective = _Objective(task, lambda line: None)
    numbers = objective.numbers(objective.parameters())
    return unseen(task, objective.jacobian(numbers), numbers)


def unseen(task: Task, J: Array, numbers: Array) -> list[str]:
    """Combinations of parameters that are uncertain by more than 10 %, in words.

    Args:
        task: What is searched for.
        J: Derivatives of the residuals in units of their noise.
        numbers: What is searched for, as in `Free.inner`.
    """
    free = task.free.values()
    scale = np.array([f.scale(n) for f, n in zip(free, numbers, strict=True)])
    found = []
    for error, change in directions(J, scale):
        if error > 0.1:
            change = change * np.sign(change[np.argmax(np.abs(change) > 0.05)])
            parts = [
                f"{_short(key, task.free)} {value:+.0%}".replace("%", " %")
                for key, value in zip(task.free, 0.1 * change, strict=True)
                if abs(value) >= 0.005
            ]
            together = " together move" if len(parts) > 1 else " moves"
            found.append(
                f"{', '.join(parts)}{together} the curves by {0.1 / error:.2g} standard deviations "
                "in all: the data hardly see it."
            )
    return found


def _short(key: str, keys: Any) -> str:
    """The end of a key that tells it from the others."""
    parts = key.split(".")
    for n in range(1, len(parts)):
        end = ".".join(parts[-n:])
        if not parts[-n].isdigit() and sum(("." + k).endswith("." + end) for k in keys) == 1:
            return end
    return key


def _blocks(series: Sequence[Data]) -> list[slice]:
    sizes = [len(s.measured.columns[s.measured.x]) for s in series for _ in s.measured.curves]
    ends = np.cumsum([0, *sizes])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def _correlation(covariance: Array) -> Array:
    with np.errstate(invalid="ignore"):
        scale = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(scale, scale))


def _estimates(
    objective: _Objective, minimizer: Any, result: Any, J: Array, found: Uncertainty
) -> list[Estimate]:
    task, numbers = objective.task, objective.numbers(result.params)
    errors = np.sqrt(np.diag(found.covariance))
    reach = student.ppf((1 + task.confidence) / 2, found.freedom) * errors
    ends = np.stack([numbers - reach, numbers + reach], axis=1)
    ranges = np.array([free.range for free in task.free.values()])
    bent = _bent(objective, numbers, ends, ranges, J, float(result.chisqr))
    low, high = ranges.T
    spread = np.where(np.isfinite(high - low), high - low, 1.0)
    at_bound = np.minimum(numbers - low, high - numbers) < _NEAR * spread
    opened = ~np.isfinite(reach) | ((ends[:, 0] <= low) & (ends[:, 1] >= high))
    if len(errors) > 1 and not np.any(at_bound | opened):  # else there is nothing to refine
        every = task.intervals == "profile"
        for i in range(len(errors)) if task.intervals != "linear" else ():
            if not (every or bent[i]):
                continue
            ends[i] = _profile(minimizer, result, i, errors, found, task.confidence)
            bent[i] = False
    estimates = []
    for i, (key, free) in enumerate(task.free.items()):
        value = free.outer(numbers[i])
        error = float(errors[i]) * (value if free.log else 1.0)
        first, last = (free.outer(end) for end in np.clip(ends[i], low[i], high[i]))
        flags = (bool(at_bound[i]), bool(opened[i]), bool(bent[i]))
        shown = error if np.isfinite(error) else float("nan")
        estimates.append(Estimate(key, free.unit, value, shown, first, last, *flags))
    return estimates


def _bent(
    objective: _Objective, numbers: Array, ends: Array, ranges: Array, J: Array, best: float
) -> Array:
    """Whether at an end of a parameter's interval the sum of squares is far from its parabola.

    The other parameters follow as they would on the parabola.
    """
    steps, owners = [], []
    for i in range(len(numbers)):
        along = np.linalg.lstsq(np.delete(J, i, axis=1), -J[:, i], rcond=None)[0]
        for end in ends[i] if np.isfinite(ends[i]).all() else ():
            moved = numbers + (end - numbers[i]) * np.insert(along, i, 1.0)
            steps.append(np.clip(moved, *ranges.T) - numbers)
            owners.append(i)
    bent = np.zeros(len(numbers), dtype=bool)
    squares = objective.squares([numbers + step for step in steps])
    for i, step, found in zip(owners, steps, squares, strict=True):
        expected = float(np.sum((J @ step) ** 2))
        if expected > 1e-9 * best:
            bent[i] |= not 1 / _BENT < (found - best) / expected < _BENT
    return bent


def _profile(
    minimizer: Any, result: Any, index: int, errors: Array, found: Uncertainty, level: float
) -> tuple[float, float]:
    """Interval from the profile of the sum of squares: the other parameters are fitted again."""
    name = list(result.params)[index]
    result.params[name].stderr = float(errors[index])

    def probability(best: Any, moved: Any) -> float:
        rise = max(moved.chisqr - best.chisqr, 0.0) / found.inflation[index]
        return float(2 * student.cdf(np.sqrt(rise), found.freedom[index]) - 1)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an interval without an end is told by us
        found_ends = lmfit.conf_interval(
            minimizer, result, p_names=[name], sigmas=[level], prob_func=probability, maxiter=20
        )[name]
    return float(found_ends[0][1]), float(found_ends[-1][1])
