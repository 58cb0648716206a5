"""What a search is for and what it finds: parameters, data, estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from dealib.calibration.statistics import Noise, distances
from dealib.data.compare import Comparison, compare
from dealib.data.measured import Array, Measured
from dealib.errors import NotConverged

History = dict[str, Array]
Values = dict[str, float]


@dataclass(frozen=True)
class Free:
    """A parameter of the search.

    Attributes:
        unit: Its unit.
        start: Where the search starts.
        low: Lower bound.
        high: Upper bound.
        log: Search by its logarithm: it is positive.
    """

    unit: str
    start: float
    low: float = -np.inf
    high: float = np.inf
    log: bool = False

    def inner(self, value: float) -> float:
        """The number that is searched for."""
        return float(np.log(value)) if self.log else value

    def outer(self, number: float) -> float:
        """Inverse of `inner`."""
        return float(np.exp(number)) if self.log else float(number)

    @property
    def range(self) -> tuple[float, float]:
        """Bounds of that number."""
        if not self.log:
            return self.low, self.high
        return (-np.inf if self.low <= 0 else np.log(self.low)), float(np.log(self.high))

    def scale(self, number: float) -> float:
        """What counts as a change of it by 100 %."""
        low, high = self.range
        spread = (high - low) / 100 if np.isfinite(high - low) else 1e-3
        return 1.0 if self.log else max(abs(number), spread)


class Data(Protocol):
    """Curves of one file, and how a history is compared with them."""

    @property
    def title(self) -> str:
        """Shown name."""

    @property
    def measured(self) -> Measured:
        """The data."""

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each column; none or 0 of an exact abscissa."""

    @property
    def weight(self) -> float:
        """Factor on the residuals."""

    def residual(self, history: History) -> Array:
        """(computed - measured) / sigma of all points of all curves."""

    def against(self, history: History) -> list[Comparison]:
        """The curves against a history."""


@dataclass(frozen=True)
class Series:
    """Curves of one file that belong to a run (see `Data`).

    Attributes:
        title: Shown name.
        measured: The data.
        sigma: Standard deviation of each column.
        weight: Factor on the residuals.
        stage: Part of the run that they belong to; None: all of it.
    """

    title: str
    measured: Measured
    sigma: dict[str, float]
    weight: float
    stage: str | None

    def residual(self, history: History) -> Array:
        """See `Data`; orthogonal distances where the abscissa has a standard deviation."""
        parts = []
        for c in self.against(history):
            sigma_x, sigma_y = self.sigma.get(c.x_name, 0.0), self.sigma[c.y_name]
            off = (c.computed - c.measured) / sigma_y
            for k in range(len(c.curves) if sigma_x > 0 else 0):
                on = c.branch == k
                off[on] = distances(c.curves[k], c.x[on], c.measured[on], sigma_x, sigma_y)
            parts.append(off)
        return np.concatenate(parts)

    def against(self, history: History) -> list[Comparison]:
        """See `Data`."""
        # beyond the run's end its curve goes on straight: the number of points must not change
        return compare(history, self.measured, self.stage, extrapolate=True)


@dataclass(frozen=True)
class Task:
    """What is searched for.

    Attributes:
        free: Parameters by name.
        series: The data.
        solve: Histories of all series at each set of values; the first is where the search is.
        difference: Relative step of the finite differences.
        tolerance: Relative, on sum of squares and parameters.
        max_evaluations: Most evaluations of the residuals.
        confidence: Level of the intervals.
        intervals: How they are found; auto: by the profile where the linear ones mislead.
        slopes: Of the first set that was solved last, derivatives of each series' history by the
            logarithms of parameters; those that lack are found by differences.
    """

    free: dict[str, Free]
    series: Sequence[Data]
    solve: Callable[[list[Values]], list[list[History | NotConverged]]]
    difference: float
    tolerance: float
    max_evaluations: int
    confidence: float
    intervals: Literal["auto", "linear", "profile"]
    slopes: Callable[[Values], list[dict[str, History]]] | None = None


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter.

    Attributes:
        key: Its name: the dotted key of the config.
        unit: Its unit.
        value: Best value.
        error: Standard error; NaN if it cannot be estimated.
        low: Lower end of the confidence interval.
        high: Upper end.
        bound: Whether it is at its bound.
        open: Whether the interval is all of its range.
        bent: Whether a linear interval is shown that misleads.
    """

    key: str
    unit: str
    value: float
    error: float
    low: float
    high: float
    bound: bool
    open: bool
    bent: bool


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes:
        task: What was searched for.
        estimates: The parameters.
        correlation: Correlation matrix of the parameters.
        comparisons: Measured curves against the best run, by series.
        noise: Of each of these curves, likewise.
        sum_of_squares: Of all residuals.
        points: Number of data points.
        evaluations: Evaluations of all residuals.
        unseen: Combinations of parameters that the data hardly see, in words.
        converged: Whether the search came to its end.
        message: How it ended.
    """

    task: Task
    estimates: list[Estimate]
    correlation: Array
    comparisons: list[list[Comparison]]
    noise: list[list[Noise]]
    sum_of_squares: float
    points: int
    evaluations: int
    unseen: list[str]
    converged: bool
    message: str

    @property
    def values(self) -> Values:
        """Best values by name."""
        return {e.key: e.value for e in self.estimates}

    @property
    def reduced_chi2(self) -> float:
        """Sum of squares over the degrees of freedom; 1 if noise as assumed explains it."""
        return self.sum_of_squares / max(self.points - len(self.estimates), 1)
