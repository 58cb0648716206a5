"""Input and result of a search: parameters, data, estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from dealib.arrays import Array
from dealib.calibration.statistics import Noise, distances
from dealib.data.compare import Comparison, compare
from dealib.data.measured import Measured
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
        log: Whether its logarithm is searched for; it must be positive.
    """

    unit: str
    start: float
    low: float = -np.inf
    high: float = np.inf
    log: bool = False

    def inner(self, value: float) -> float:
        """The search variable: the value or its logarithm."""
        return float(np.log(value)) if self.log else value

    def outer(self, number: float) -> float:
        """Inverse of `inner`."""
        return float(np.exp(number)) if self.log else float(number)

    @property
    def range(self) -> tuple[float, float]:
        """Bounds of the search variable."""
        if not self.log:
            return self.low, self.high
        return (-np.inf if self.low <= 0 else np.log(self.low)), float(np.log(self.high))

    def scale(self, number: float) -> float:
        """Change of the search variable that counts as 100 %."""
        low, high = self.range
        spread = (high - low) / 100 if np.isfinite(high - low) else 1e-3
        return 1.0 if self.log else max(abs(number), spread)


class FitData(Protocol):
    """Curves of one file, and how a history is compared with them."""

    @property
    def title(self) -> str:
        """Name in reports."""

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
        """(computed - measured) / sigma of all points of all curves, (points,)."""

    def against(self, history: History) -> list[Comparison]:
        """Comparisons of the curves with a history."""


@dataclass(frozen=True)
class Series:
    """Curves of one file that are compared with a run (see `FitData`).

    Attributes:
        title: Name in reports.
        measured: The data.
        sigma: Standard deviation of each column.
        weight: Factor on the residuals.
        stage: Stage of the run with which they are compared; None for the whole run.
    """

    title: str
    measured: Measured
    sigma: dict[str, float]
    weight: float
    stage: str | None

    def residual(self, history: History) -> Array:
        """See `FitData`; orthogonal distances where the abscissa has a standard deviation."""
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
        """See `FitData`."""
        # extrapolated, because the number of residuals must not change during the search
        return compare(history, self.measured, self.stage, extrapolate=True)


@dataclass(frozen=True)
class Task:
    """Parameters, data and settings of a search.

    Attributes:
        free: Parameters by name.
        series: The data.
        solve: Function that returns the histories of all series at each set of values; the first
            set is the current point of the search.
        difference: Relative step of the finite differences.
        tolerance: Relative tolerance on sum of squares and parameters.
        max_evaluations: Largest number of evaluations of the residuals.
        confidence: Level of the intervals.
        intervals: Method of the intervals; auto takes the profile where linear ones mislead.
        slopes: Function that returns, at the current point, derivatives of each series' history by
            the logarithms of parameters. Missing ones are found by differences.
    """

    free: dict[str, Free]
    series: Sequence[FitData]
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
        key: Dotted key of the config.
        unit: Unit.
        value: Best value.
        error: Standard error; NaN if it cannot be estimated.
        low: Lower end of the confidence interval.
        high: Upper end of the confidence interval.
        bound: Whether the value is at its bound.
        open: Whether the interval covers the whole range.
        bent: Whether the interval is a linear one that misleads.
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
class FitResult:
    """The result of a search.

    Attributes:
        task: The task.
        estimates: The parameters.
        correlation: Correlation matrix, (parameters, parameters).
        comparisons: Comparisons of the measured curves with the best run, by series.
        noise: Noise of these curves, by series.
        sum_of_squares: Sum of squares of all residuals.
        points: Number of data points.
        evaluations: Number of evaluations of the residuals.
        unseen: Combinations of parameters that the data hardly determine, in words.
        converged: Whether the search converged.
        message: The optimiser's message on how it ended.
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
        """Sum of squares over the degrees of freedom; about 1 if the noise is as assumed."""
        return self.sum_of_squares / max(self.points - len(self.estimates), 1)
