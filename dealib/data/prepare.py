"""Preparation of measured columns: signs, zeros, outliers, smoothing, plateaus, fewer points."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dealib.arrays import Array
from dealib.data.branches import branches, noise
from dealib.data.names import split_unit
from dealib.data.schema import Plateaus, Preparation
from dealib.units import convert

Columns = dict[str, Array]

_WINDOW = 11  # rows of the running median
_FLOOR = 1e-3  # share of the range: lower bound of the standard deviation
_LEAST = 3  # least number of rows of a plateau


def prepare(columns: Columns, wanted: Mapping[str, Preparation]) -> tuple[Columns, list[str]]:
    """Prepare columns one by one, then leave out the rows that are outside a range.

    Args:
        columns: Values by column of the history, (rows,), NaN where there is none.
        wanted: Preparation by column.

    Returns:
        The columns, and notes on what was done.

    Raises:
        ValueError: If units do not fit, or a shift is given but there is no column of times.
    """
    found, notes = dict(columns), []
    kept = np.ones(len(next(iter(columns.values()))), dtype=bool)
    for name, p in wanted.items():
        values, unit = columns[name], split_unit(name)[1]
        if p.outliers is not None:
            values, count = without_outliers(values, p.outliers)
            notes.append(f"{count} outliers of {name} left out")
        if p.smooth is not None:
            values = smoothed(values, p.smooth)
            notes.append(f"{name} smoothed over {p.smooth | 1} rows")
        values = p.sign * p.factor * values
        if (p.sign, p.factor) != (1, 1.0):
            notes.append(f"{name} times {p.sign * p.factor:g}")
        if p.offset is not None:
            values = values + convert(p.offset, unit)
            notes.append(f"{name} plus {p.offset[0]:g} {p.offset[1]}".rstrip())
        if p.zero is not None:
            rows = 1 if p.zero == "start" else max(p.zero, 1)
            level = float(np.mean(values[np.isfinite(values)][:rows]))
            values = values - level
            notes.append(f"zero of {name} at {level:.6g} {unit}".rstrip())
        if p.shift is not None:
            values = shifted(columns.get("time_s"), values, p.shift)
            notes.append(f"{name} {p.shift:g} s later")
        if p.range is not None:
            low, high = (convert(end, unit) for end in p.range)
            kept &= (values >= low) & (values <= high)
        found[name] = values
    if not kept.all():
        notes.append(f"{int((~kept).sum())} rows outside a range left out")
    return {name: values[kept] for name, values in found.items()}, notes


def without_outliers(values: Array, limit: float) -> tuple[Array, int]:
    """Values with NaN for outliers from the running median (Hampel), and the number of outliers."""
    import pandas as pd

    half = _WINDOW // 2
    ends = np.pad(values, half, mode="reflect", reflect_type="odd")  # continues the slope
    running = pd.Series(ends).rolling(_WINDOW, center=True, min_periods=half).median()
    away = np.abs(values - running.to_numpy(float)[half:-half])
    good = values[np.isfinite(values)]
    of_median = 1.4826 * float(np.nanmedian(away))  # too small: many values are their own median
    sigma = max(of_median, noise(good), _FLOOR * float(np.ptp(good)))
    far = away > limit * sigma
    return np.where(far, np.nan, values), int(far.sum())


def smoothed(values: Array, window: int) -> Array:
    """Values through a Savitzky-Golay filter of second order; NaN stays.

    Raises:
        ValueError: If there are fewer values than rows in the window.
    """
    from scipy.signal import savgol_filter

    good = np.flatnonzero(np.isfinite(values))
    if len(good) < (window | 1):
        raise ValueError(f"{len(good)} values are too few to smooth over {window | 1} rows")
    found = np.full(len(values), np.nan)
    found[good] = savgol_filter(values[good], window | 1, 2)
    return found


def shifted(time: Array | None, values: Array, shift: float) -> Array:
    """Values moved to later times by a shift (s); NaN where they were not measured.

    Raises:
        ValueError: If there are no times, or they do not increase.
    """
    good = np.isfinite(values) if time is None else np.isfinite(values) & np.isfinite(time)
    if time is None or (np.diff(time[good]) < 0).any():
        raise ValueError("a shift needs a column of times that increase")
    return np.asarray(np.interp(time - shift, time[good], values[good], left=np.nan, right=np.nan))


def averaged(columns: Columns, over: str, wanted: Plateaus) -> tuple[Columns, list[str]]:
    """Means over the plateaus of one of the columns, without the start of each.

    A plateau ends where the column jumps by more than its noise and 5 % of its range.

    Raises:
        ValueError: If the column has no plateaus.
    """
    switched = columns[over]
    good = np.isfinite(switched)
    level, rows = switched[good], np.flatnonzero(good)
    reach = float(np.ptp(level)) if len(level) else 0.0
    jump = max(0.05 * reach, 8 * noise(level))
    starts = np.flatnonzero(np.abs(np.diff(level, prepend=np.nan)) > jump)
    pieces = [p for p in np.split(rows, starts) if len(p) >= _LEAST]
    if len(pieces) < 2 or max(np.ptp(switched[p]) for p in pieces) > max(2 * jump, 0.5 * reach):
        raise ValueError(f"{over} has no plateaus of at least {_LEAST} rows")
    late = [p[int(wanted.settle * len(p)) :] for p in pieces]
    means = {n: np.array([_mean(values[p]) for p in late]) for n, values in columns.items()}
    return means, [f"means over {len(pieces)} plateaus of {over}"]


def resampled(
    columns: Columns, x: str, points: int, turn: float | None
) -> tuple[Columns, list[str]]:
    """Means of consecutive rows on each branch of x, about `points` rows in all."""
    total = len(columns[x])
    if total <= points:
        return columns, []
    pieces = branches(columns[x], turn=turn)
    starts = []
    for piece in pieces:
        bins = max(round(points * (piece.stop - piece.start) / total), 1)
        starts.append(np.unique(np.linspace(piece.start, piece.stop, bins + 1).astype(int))[:-1])
    at = np.concatenate(starts)
    means = {}
    for name, values in columns.items():
        good = np.isfinite(values)
        count = np.add.reduceat(good, at, dtype=float)
        with np.errstate(invalid="ignore"):
            means[name] = np.add.reduceat(np.where(good, values, 0.0), at) / count
    return means, [f"{len(at)} means of {total} rows"]


def _mean(values: Array) -> float:
    good = values[np.isfinite(values)]
    return float(good.mean()) if len(good) else float("nan")
