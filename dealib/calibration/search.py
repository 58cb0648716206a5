"""The least-squares search: residuals of all data, their derivatives, and what they leave open."""

from __future__ import annotations

import itertools
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

    def parameters(self, numbers: Array | None = None) -> lmfit.Parameters:
        """Parameters at the start, or at other numbers."""
        found = lmfit.Parameters()
        for i, (key, free) in enumerate(self.task.free.items()):
            low, high = free.range
            value = free.inner(free.start) if numbers is None else numbers[i]
            found.add(self.names[key], value=value, min=low, max=high)
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
        """Derivatives of the residuals, (points, parameters).

        By differences: of histories with a parameter moved, which are solved, or told by slopes.
        """
        values = self.values(numbers)
        (here,) = self.task.solve([values])
        slopes, sets, steps = self._slopes(values, here), [], []
        for i, (key, free) in enumerate(self.task.free.items()):
            if vary is not None and not vary[i]:
                continue
            step = self.task.difference * free.scale(numbers[i])
            moved = numbers[i] + step if numbers[i] + step <= free.range[1] else numbers[i] - step
            sets.append((key, values | {key: free.outer(moved)}))
            steps.append(moved - numbers[i])
        rest = [of for key, of in sets if key not in slopes]
        solved = iter(self.task.solve([values, *rest])[1:] if rest else [])
        there = [
            _moved(here, slopes[key], of[key] / values[key] - 1) if key in slopes else next(solved)
            for key, of in sets
        ]
        base = self._residuals(here)
        columns = [(self._residuals(m) - base) / h for m, h in zip(there, steps, strict=True)]
        return np.column_stack(columns)

    def _slopes(
        self, values: Values, here: list[History | NotConverged]
    ) -> dict[str, list[History]]:
        """Derivatives of all series' histories by the logarithms of parameters, where all have."""
        if self.task.slopes is None or any(isinstance(h, NotConverged) for h in here):
            return {}
        found, needed = self.task.slopes(values), [s.measured for s in self.task.series]
        return {
            key: [of[key] for of in found]
            for key in self.task.free
            if all(
                key in of and {data.x, *data.curves} <= {"time_s", *of[key]}
                for of, data in zip(found, needed, strict=True)
            )
        }

    def residuals(self, sets: list[Values]) -> list[Array]:
        return [self._residuals(found) for found in self.task.solve(sets)]

    def _residuals(self, found: Sequence[History | NotConverged]) -> Array:
        return np.concatenate([_residual(*p) for p in zip(self.task.series, found, strict=True)])

    def squares(self, numbers: Sequence[Array]) -> list[float]:
        """Sums of squares."""
        return [float(r @ r) for r in self.residuals([self.values(n) for n in numbers])]


def _moved(
    histories: Sequence[History | NotConverged], slopes: Sequence[History], change: float
) -> list[History | NotConverged]:
    """Histories after a relative change of a parameter."""
    return [
        history
        if isinstance(history, NotConverged)
        else history | {name: history[name] + change * s for name, s in slope.items()}
        for history, slope in zip(histories, slopes, strict=True)
    ]


def _residual(series: Data, history: History | NotConverged) -> Array:
    if isinstance(history, NotConverged):
        x = series.measured.columns[series.measured.x]
        return np.full(len(series.measured.curves) * len(x), _FAILED)
    return series.weight * series.residual(history)


def _minimizer(objective: _Objective, tolerance: float, evaluations: int) -> Any:
    return lmfit.Minimizer(
        objective.residual,
        None,
        max_nfev=evaluations,
        Dfun=objective.varied,
        col_deriv=False,
        ftol=tolerance,
        xtol=tolerance,
    )


def search(task: Task, progress: Callable[[str], None] = lambda line: None) -> Found:
    """Find the parameters.

    Args:
        task: What is searched for.
        progress: Told each evaluation in one line.
    """
    objective = _Objective(task, progress)
    minimizer = _minimizer(objective, task.tolerance, task.max_evaluations)
    result = minimizer.minimize("leastsq", objective.parameters())
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
        _estimates(objective, numbers, float(r @ r), J, found),
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
    objective: _Objective, numbers: Array, best: float, J: Array, found: Uncertainty
) -> list[Estimate]:
    task = objective.task
    errors = np.sqrt(np.diag(found.covariance))
    quantile = student.ppf((1 + task.confidence) / 2, found.freedom)
    reach = quantile * errors
    ends = np.stack([numbers - reach, numbers + reach], axis=1)
    ranges = np.array([free.range for free in task.free.values()])
    bent = _bent(objective, numbers, ends, ranges, J, best)
    low, high = ranges.T
    spread = np.where(np.isfinite(high - low), high - low, 1.0)
    at_bound = np.minimum(numbers - low, high - numbers) < _NEAR * spread
    opened = ~np.isfinite(reach) | ((ends[:, 0] <= low) & (ends[:, 1] >= high))
    if len(errors) > 1 and not np.any(at_bound | opened):  # else there is nothing to refine
        every = task.intervals == "profile"
        for i in range(len(errors)) if task.intervals != "linear" else ():
            if not (every or bent[i]):
                continue
            rise = found.inflation[i] * quantile[i] ** 2
            ends[i] = [_profile(objective, numbers, i, end, J, rise) for end in ends[i]]
            bent[i], opened[i] = False, not np.isfinite(ends[i]).all()
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
    objective: _Objective, numbers: Array, index: int, end: float, J: Array, rise: float
) -> float:
    """Where the sum of squares, the other parameters fitted again, has risen by an amount.

    Its root is nearly straight there: a few secant steps from the linear end do.

    Args:
        objective: The residuals.
        numbers: The best fit.
        index: The parameter.
        end: End of its linear interval.
        J: Derivatives at the best fit.
        rise: The amount.

    Returns:
        The end; infinite if the sum of squares does not rise so far.
    """
    ranges = np.array([free.range for free in objective.task.free.values()])
    name = list(objective.names.values())[index]
    best, origin = objective.squares([numbers])[0], numbers[index]
    along = np.insert(np.linalg.lstsq(np.delete(J, index, 1), -J[:, index], None)[0], index, 1.0)
    at, last, guess = end, (origin, 0.0), numbers + (end - origin) * along
    for _ in range(10):
        at = float(np.clip(at, *ranges[index]))
        guess[index] = at
        parameters = objective.parameters(np.clip(guess, *ranges.T))
        parameters[name].vary = False
        result = _minimizer(objective, 1e-5, 30).minimize("leastsq", parameters)
        guess = objective.numbers(result.params)
        z = float(np.sqrt(max(result.chisqr - best, 0.0) / rise))
        if abs(z - 1) < 0.01:
            return at
        if z < 1 and at in ranges[index]:
            return float(np.copysign(np.inf, at - origin))
        slope = (z - last[1]) / (at - last[0]) if at != last[0] else 0.0
        step = (1 - z) / slope if slope * (at - origin) > 0 else at - origin
        last, near = (at, z), abs(at - origin)
        at += float(np.clip(step, -0.8 * near, 2 * near))
        guess = guess + (at - last[0]) * (guess - numbers) / (last[0] - origin)
    return float(np.copysign(np.inf, at - origin)) if z < 1 else at
