"""Residuals of all data of a search, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import lmfit
import numpy as np

from dealib.arrays import Array
from dealib.calibration.task import FitData, History, Task, Values
from dealib.errors import NotConverged

FAILED = 1e3  # residual, in standard deviations, of a case that does not converge


class Objective:
    """Residuals in standard deviations, and their derivatives by the search variables.

    Attributes:
        task: Parameters and data of the search.
        progress: Called with one line for each evaluation.
        evaluations: Number of evaluations so far.
        names: Names for lmfit, by key.

    Args:
        task: See above.
        progress: See above.
    """

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
        """The search variables (see `Free.inner`), (parameters,)."""
        return np.array([parameters[name].value for name in self.names.values()])

    def values(self, numbers: Array) -> Values:
        """Values of the parameters, as in the config."""
        pairs = zip(self.task.free.items(), numbers, strict=True)
        return {key: free.outer(number) for (key, free), number in pairs}

    def residual(self, parameters: lmfit.Parameters) -> Array:
        """Residuals of all points in standard deviations, (points,); reported to `progress`."""
        values = self.values(self.numbers(parameters))
        self.evaluations += 1
        residual = self.residuals([values])[0]
        if values != self._shown:  # lmfit asks more than once
            self._shown = values
            free = self.task.free
            where = ", ".join(
                f"{short(key, free)} {value:.6g} {free[key].unit}".strip()
                for key, value in values.items()
            )
            self.progress(f"sum of squares {float(residual @ residual):<11.6g}  {where}")
        return residual

    def varied(self, parameters: lmfit.Parameters) -> Array:
        """Derivatives by the variables that lmfit varies."""
        vary = np.array([parameters[name].vary for name in self.names.values()])
        return self.jacobian(self.numbers(parameters), vary)

    def jacobian(self, numbers: Array, vary: Array | None = None) -> Array:
        """Derivatives of the residuals, (points, parameters), by finite differences.

        The history at a changed parameter is extrapolated by its derivative where the solver gives
        one, and solved otherwise.
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
        """Derivatives of the histories by the logarithms of parameters that all series have."""
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
        """Residuals for each set of values, which are solved side by side."""
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


def _residual(series: FitData, history: History | NotConverged) -> Array:
    if isinstance(history, NotConverged):
        x = series.measured.columns[series.measured.x]
        return np.full(len(series.measured.curves) * len(x), FAILED)
    return series.weight * series.residual(history)


def short(key: str, keys: Any) -> str:
    """The shortest end of a key that distinguishes it from the others."""
    parts = key.split(".")
    for n in range(1, len(parts)):
        end = ".".join(parts[-n:])
        if not parts[-n].isdigit() and sum(("." + k).endswith("." + end) for k in keys) == 1:
            return end
    return key
