"""The data of a coupon fit: stress over stretch or time, and the load path of each test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_lsq_spline

from dealib.arrays import Array
from dealib.calibration.coupon_schema import Coupon, Test
from dealib.calibration.statistics import distances
from dealib.calibration.task import History
from dealib.config.messages import validate
from dealib.config.source import Source
from dealib.data.branches import branches
from dealib.data.compare import Comparison
from dealib.data.measured import Measured, measured
from dealib.data.names import split_unit
from dealib.data.schema import Selection
from dealib.errors import ConfigError, Place
from dealib.materials import coupon
from dealib.units import convert

STRETCH, STRESS, TIME = "stretch", "stress_MPa", "time_s"
# columns that a file may have, with the dimensions of the specimen by which they are divided
_STRETCHES = {
    STRETCH: (),
    "strain": (),
    "elongation_mm": ("length",),
    "displacement_mm": ("length",),
}
_STRESSES = {STRESS: (), "true_stress_MPa": (), "force_N": ("width", "thickness")}
Ints = npt.NDArray[np.intp]
_LARGEST = 20.0  # stretch above which data are refused
_CORNERS = 300  # largest number of corners of a path that is read from a file


@dataclass(frozen=True)
class CouponTest:
    """A test that is ready for comparison (see `task.FitData`).

    Attributes:
        title: Name in reports.
        measured: The data: stress over stretch or time.
        sigma: Standard deviation of both columns.
        weight: Factor on the residuals.
        path: The load path.
        at: Position of each point on the path, as a fractional number of a state, (points,).
        first: First state of the straight piece of the path to which the point belongs, (points,).
        last: Last state of that piece, (points,).
    """

    title: str
    measured: Measured
    sigma: dict[str, float]
    weight: float
    path: coupon.Path
    at: Array
    first: Ints
    last: Ints

    def history(self, stress: Array) -> History:
        """A computed stress, (states,), as the history of a run."""
        return {TIME: self.path.time, STRETCH: self.path.stretch, STRESS: stress}

    def at_points(self, stress: Array) -> Array:
        """A stress along the path, (..., states), at the measured points, (..., points)."""
        before = np.clip(np.floor(self.at).astype(int), self.first, self.last - 1)
        low, high = stress[..., before], stress[..., before + 1]
        return low + (self.at - before) * (high - low)

    def residual(self, history: History) -> Array:
        """See `FitData`; orthogonal distances if the stretch has a standard deviation."""
        sigma, stress, y = self.sigma, history[STRESS], self.measured.columns[STRESS]
        off = (self.at_points(stress) - y) / sigma[STRESS]
        for k in np.unique(self.first) if sigma.get(STRETCH) else ():
            on = self.first == k
            curve = np.stack([self.path.stretch, stress])[:, k : self.last[on][0] + 1]
            x = self.measured.columns[STRETCH][on]
            off[on] = distances(curve, x, y[on], sigma[STRETCH], sigma[STRESS])
        return off

    def against(self, history: History) -> list[Comparison]:
        """See `FitData`."""
        name, stress = self.measured.x, history[STRESS]
        x, y = self.measured.columns[name], self.measured.columns[STRESS]
        slack = 0.01 * len(stress)  # noise may move a point beyond the end
        beyond = (self.at < self.first - slack) | (self.at > self.last + slack)
        branch = np.searchsorted(np.unique(self.first), self.first)
        return [Comparison(name, STRESS, x, y, self.at_points(stress), beyond, branch)]


class CouponPlan:
    """A validated coupon fit and its data.

    Args:
        path: The YAML file.

    Raises:
        ConfigError: If the file or its data are wrong; the message names the place.
    """

    def __init__(self, path: Path) -> None:
        self.source = Source(path)
        self.coupon = validate(Coupon, self.source)
        self.library = self.coupon.library(path)
        self.specimens = [self._read(i, test) for i, test in enumerate(self.coupon.tests)]

    def _error(self, index: int, key: str, problem: str) -> ConfigError:
        where: Place = ("tests", index, *key.split("."))
        return ConfigError(self.source.message(where, problem, "value"))

    def _read(self, index: int, test: Test) -> CouponTest:
        file = self.source.path.parent / Path(test.file).expanduser()
        if not file.is_file():
            raise self._error(index, "file", f"there is no file {file}")
        found = measured(file, [TIME, *_STRETCHES, *_STRESSES], Selection.of(test))
        whole = np.all([np.isfinite(values) for values in found.columns.values()], axis=0)
        columns = {name: values[whole] for name, values in found.columns.items()}
        stress, stress_name = self._one(index, test, columns, _STRESSES, STRESS)
        held = test.relaxation
        if held is not None and TIME not in columns:
            raise self._error(index, "relaxation", f"{file.name} has no column of time")
        stretch, stretch_name = np.empty(0), ""
        if held is None:
            stretch, stretch_name = self._one(index, test, columns, _STRETCHES, STRETCH)
            if stretch.min() <= 0 or stretch.max() > _LARGEST:
                worst = stretch.min() if stretch.min() <= 0 else stretch.max()
                problem = f"{file.name} has a stretch of {worst:.4g}, which no elastomer bears; "
                raise self._error(index, "file", problem + "a strain in percent is 'strain [%]'")
        if stress_name.startswith("true"):
            stress = stress / (stretch if held is None else held.stretch)
        if np.sum(stress * ((stretch if held is None else held.stretch) - 1)) <= 0:
            problem = f"{file.name} does no work: its stress is zero, or has the opposite sign"
            raise self._error(index, "file", problem)
        timed = TIME in columns
        if timed and test.rate is not None:
            raise self._error(index, "rate", f"{file.name} has a column of time; drop rate")
        if timed:
            x, name = columns[TIME] - (columns[TIME][0] if held is None else 0.0), TIME
            if np.any(np.diff(x) <= 0):
                raise self._error(index, "file", "time does not grow from row to row")
        else:
            x, name = stretch, STRETCH
        sigma = self._sigma(index, test, {split_unit(n)[0]: n for n in columns})
        sigmas = {STRESS: sigma.get(stress_name, 0.01 * (float(np.ptp(stress)) or 1.0))}
        if not timed:
            sigmas[STRETCH] = sigma.get(stretch_name, 0.0)
        data = Measured(file, name, {name: x, STRESS: stress}, found.account)
        own = (test.file, data, sigmas, test.weight)
        wanted = self.coupon.material
        step = coupon.FINE if wanted.mullins or wanted.permanent_set else coupon.STEP
        if timed:
            if held is not None:
                end = max(float(x[-1]), 2 * held.ramp)
                corners = [0.0, held.ramp, end], [1.0, held.stretch, held.stretch]
            elif abs(stretch[0] - 1) <= 0.05 * np.max(np.abs(stretch - 1)):
                corners = polyline(x, stretch, sigma.get(stretch_name, 0.0))
            else:
                problem = f"{file.name} starts at the stretch {stretch[0]:.4g}: give relaxation: "
                problem += "{stretch: .., ramp: ..} if it was held there, or data from 1 on"
                raise self._error(index, "file", problem)
            t, l, _ = coupon.refined(*corners, step)
            at, last = np.interp(x, t, np.arange(len(t))), np.full(len(x), len(t) - 1)
            return CouponTest(*own, coupon.Path(test.mode, t, l), at, 0 * last, last)
        driven, rows = turns(stretch, sigmas[STRETCH])
        given = list(test.path) or driven
        t, l, states = coupon.refined(*_driven(given, test.rate), step)
        at, first, last = np.empty(len(x)), np.empty(len(x), int), np.empty(len(x), int)
        ways, own_ways, k = np.sign(np.diff(given)), np.sign(np.diff(driven))[-len(rows) :], 0
        for row, end, way in zip(rows, [*rows[1:], len(x)], own_ways, strict=True):
            while k < len(ways) and ways[k] != way:
                k += 1
            if k == len(ways):
                turned = ", ".join(f"{value:.4g}" for value in driven)
                problem = f"{file.name} turns more often than this: [{turned}]"
                raise self._error(index, "path", problem)
            (a, b), on = states[k : k + 2], slice(row, end)
            at[on] = a + (x[on] - l[a]) / (l[b] - l[a]) * (b - a)
            first[on], last[on], k = a, b, k + 1
        return CouponTest(*own, coupon.Path(test.mode, t, l), at, first, last)

    def _one(
        self, index: int, test: Test, columns: dict[str, Array], kinds: dict[str, tuple[str, ...]],
        what: str,
    ) -> tuple[Array, str]:  # fmt: skip
        """The column of a kind as stretch or nominal stress, and its name in the file."""
        what = split_unit(what)[0]
        names = [name for name in kinds if name in columns]
        if len(names) != 1:
            known = ", ".join(split_unit(k)[0] for k in kinds)
            has = f"more than one column of {what}" if names else f"no column of {what}"
            raise self._error(index, "file", f"{test.file} has {has}; one of {known}")
        values = columns[names[0]] / self._size(index, test, kinds[names[0]])
        return (values if names[0] in (STRETCH, *_STRESSES) else 1 + values), names[0]

    def _size(self, index: int, test: Test, dimensions: tuple[str, ...]) -> float:
        size = 1.0
        for dimension in dimensions:
            given = getattr(test.specimen, dimension)
            if given is None:
                key = f"specimen.{dimension}"
                raise self._error(index, key, f"this key is missing; {test.file} needs it")
            size *= given
        return size

    def _sigma(self, index: int, test: Test, columns: dict[str, str]) -> dict[str, float]:
        """Standard deviations by column, of stretch and nominal stress."""
        found = {}
        for quantity, amount in test.sigma.items():
            if quantity not in columns:
                problem = f"no column of {test.file}; it has {', '.join(columns)}"
                where = ("tests", index, "sigma", quantity)
                raise ConfigError(self.source.message(where, problem, "key"))
            name = columns[quantity]
            try:
                value = convert(amount, split_unit(name)[1])
            except ValueError as error:
                raise self._error(index, f"sigma.{quantity}", str(error)) from None
            if not 0 < value < np.inf:
                raise self._error(index, f"sigma.{quantity}", "must be above 0")
            found[name] = value / self._size(index, test, {**_STRETCHES, **_STRESSES}[name])
        return found


def turns(stretch: Array, sigma: float = 0.0) -> tuple[list[float], list[int]]:
    """Stretches at which a test turned, and the first row of the data after each turn.

    A turn is the intersection of lines through the five points before and after it, since the
    maximum of noisy values would be too large.

    Args:
        stretch: In the order of measurement.
        sigma: Standard deviation of its noise.

    Returns:
        Stretches, beginning with 1, and rows, beginning with 0. If the data begin with unloading,
        there is one row less than there are pieces between the stretches.
    """
    pieces = branches(stretch, hold=False)
    found, rows = [1.0], [0]
    for k, piece in enumerate(pieces):
        part = stretch[max(piece.start - 1, 0) : piece.stop]
        rising = part[-1] >= part[0]
        if k == 0 and (1 - part[0] if rising else part[0] - 1) > 0.05 * np.ptp(stretch):
            found.append(float(part[0]))  # they begin with unloading
        end, row, n = float(part.max() if rising else part.min()), piece.stop - 1, 5
        if n <= row < len(stretch) - n and k + 1 < len(pieces):
            before, after = np.arange(row - n, row), np.arange(row + 1, row + n + 1)
            (a, b), (c, d) = (np.polyfit(r - row, stretch[r], 1) for r in (before, after))
            at = float(np.clip((d - b) / (a - c), -1, 1)) if a != c else 0.0
            row = int(np.floor(row + at + 1e-6))
            if sigma > 0:
                reach = 4 * sigma + max(abs(a), abs(c))  # between two rows
                end = float(np.clip(b + a * at, end - reach, end + reach))
        found.append(end)
        rows.append(row + 1)
    return found, rows[:-1]


def _driven(stretch: list[float], rate: float | None) -> tuple[list[float], list[float]]:
    """Corners of a path at a constant rate; without one, in infinite time."""
    steps = np.abs(np.diff(stretch)) / rate if rate else np.full(len(stretch) - 1, np.inf)
    return [0.0, *np.cumsum(steps).tolist()], stretch


def polyline(t: Array, y: Array, sigma: float) -> tuple[list[float], list[float]]:
    """Corners of a polyline through noisy points, by Ramer, Douglas and Peucker, then fitted.

    Args:
        t: Ascending abscissae, (points,).
        y: Values, (points,).
        sigma: Standard deviation of the values; the estimate from second differences is used if it
            is larger.
    """
    rough = np.median(np.abs(np.diff(y, 2))) / 0.6745 / np.sqrt(6) if len(y) > 9 else 0.0
    noise = max(sigma, float(rough))
    tolerance = max(4 * noise, 1e-4 * float(np.ptp(y)))
    corners = sorted({0, len(t) - 1, *_corners(t, y, tolerance)})
    while len(corners) > _CORNERS:
        tolerance *= 2
        corners = sorted({0, len(t) - 1, *_corners(t, y, tolerance)})
    if noise > 0 and len(t) > 2 * len(corners):  # average the noise between the corners
        corners = sorted({*corners, *range(0, len(t), max(25, len(t) // _CORNERS))})
        knots = t[corners]
        y = make_lsq_spline(t, y, np.r_[knots[0], knots, knots[-1]], k=1)(t)
    return t[corners].tolist(), y[corners].tolist()


def _corners(t: Array, y: Array, tolerance: float) -> Iterator[int]:
    pieces = [(0, len(t) - 1)]
    while pieces:
        a, b = pieces.pop()
        off = np.abs(y[a : b + 1] - np.interp(t[a : b + 1], t[[a, b]], y[[a, b]]))
        k = a + int(np.argmax(off))
        if off[k - a] > tolerance:
            yield k
            pieces += [(a, k), (k, b)]
