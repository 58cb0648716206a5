"""The least-squares search, its confidence intervals, and what the data do not determine."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import lmfit
import numpy as np
from scipy.stats import t as student

from dealib.arrays import Array
from dealib.calibration.objective import FAILED, Objective, short
from dealib.calibration.statistics import Uncertainty, directions, uncertainty
from dealib.calibration.task import Estimate, FitData, FitResult, Task
from dealib.errors import NotConverged

_NEAR = 1e-3  # share of its range within which a parameter counts as at its bound
_BENT = 1.4  # ratio of the sum of squares at an interval's end to its parabola that misleads


def _minimizer(objective: Objective, tolerance: float, evaluations: int) -> Any:
    return lmfit.Minimizer(
        objective.residual,
        None,
        max_nfev=evaluations,
        Dfun=objective.varied,
        col_deriv=False,
        ftol=tolerance,
        xtol=tolerance,
    )


def search(task: Task, progress: Callable[[str], None] = lambda line: None) -> FitResult:
    """Find the parameters.

    Args:
        task: Parameters and data of the search.
        progress: Called with one line for each evaluation.
    """
    objective = Objective(task, progress)
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
    return FitResult(
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
        result.ier in (1, 2, 3, 4, 6, 7, 8) and not result.aborted and bool(np.all(r < FAILED)),
        message,
    )


def blind(task: Task) -> list[str]:
    """What the data hardly determine at the start (see `unseen`), for the assumed noise."""
    objective = Objective(task, lambda line: None)
    numbers = objective.numbers(objective.parameters())
    return unseen(task, objective.jacobian(numbers), numbers)


def unseen(task: Task, J: Array, numbers: Array) -> list[str]:
    """Combinations of parameters that are uncertain by more than 10 %, in words.

    Args:
        task: Parameters and data of the search.
        J: Derivatives of the residuals in units of their noise, (points, parameters).
        numbers: Search variables (see `Free.inner`), (parameters,).
    """
    free = task.free.values()
    scale = np.array([f.scale(n) for f, n in zip(free, numbers, strict=True)])
    found = []
    for error, change in directions(J, scale):
        if error > 0.1:
            change = change * np.sign(change[np.argmax(np.abs(change) > 0.05)])
            parts = [
                f"{short(key, task.free)} {value:+.0%}".replace("%", " %")
                for key, value in zip(task.free, 0.1 * change, strict=True)
                if abs(value) >= 0.005
            ]
            together = " together move" if len(parts) > 1 else " moves"
            found.append(
                f"{', '.join(parts)}{together} the curves by {0.1 / error:.2g} standard deviations "
                "in all: the data hardly see it."
            )
    return found


def _blocks(series: Sequence[FitData]) -> list[slice]:
    sizes = [len(s.measured.columns[s.measured.x]) for s in series for _ in s.measured.curves]
    ends = np.cumsum([0, *sizes])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def _correlation(covariance: Array) -> Array:
    with np.errstate(invalid="ignore"):
        scale = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(scale, scale))


def _estimates(
    objective: Objective, numbers: Array, best: float, J: Array, found: Uncertainty
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
    objective: Objective, numbers: Array, ends: Array, ranges: Array, J: Array, best: float
) -> Array:
    """Whether the sum of squares at an interval's end is far from its quadratic approximation.

    The other parameters are moved to the minimum of the approximation.
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
    objective: Objective, numbers: Array, index: int, end: float, J: Array, rise: float
) -> float:
    """End of a profile interval: where the sum of squares has risen by a given amount.

    The other parameters are fitted again. The square root of the rise is nearly linear, so that a
    few secant steps from the end of the linear interval suffice.

    Args:
        objective: The residuals.
        numbers: Search variables of the best fit, (parameters,).
        index: Number of the parameter.
        end: End of its linear interval.
        J: Derivatives at the best fit, (points, parameters).
        rise: Amount by which the sum of squares has risen at the end.

    Returns:
        The end; infinite if the sum of squares does not rise that far.
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
