"""Branches of a curve: pieces between the turning points of its abscissa, despite noise."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array

_TURN = 0.05  # share of the range of x: moving back by less begins no new branch
_MOST = 0.45  # share of the range: moving back by more always begins one
_LOOKED_AT = 20_000  # blocks of a long sequence, of which only the extremes are searched


def noise(x: Array) -> float:
    """Standard deviation of the noise of a sequence, from the median of its second differences.

    Second differences are free of slow changes, and the median of rare turns.
    """
    if len(x) < 8:
        return 0.0
    second = np.diff(x, 2)
    return float(1.4826 * np.median(np.abs(second - np.median(second))) / np.sqrt(6))


def least_turn(x: Array) -> float:
    """How far x must move back to begin a new branch.

    The largest difference of n values with normal noise s is about 2 s sqrt(2 ln n).
    """
    reach = float(np.ptp(x))
    of_noise = noise(x) * (1 + 2 * np.sqrt(2 * np.log(max(len(x), 2))))
    return float(np.clip(of_noise, _TURN * reach, _MOST * reach))


def branches(x: Array, hold: bool = True, turn: float | None = None) -> list[slice]:
    """Pieces of an abscissa between its turning points, each of at least one point.

    Args:
        x: Abscissa in the order of measurement, (points,).
        hold: Whether points that stay at a turn belong to the branch before it, not after it.
        turn: How far x must move back to begin a new branch; default `least_turn`.
    """
    least = least_turn(x) if turn is None else turn
    turns, extreme, direction = [0], 0, 0.0
    looked_at = _extremes(x)
    for i in looked_at[1:].tolist():
        step = x[i] - x[extreme]
        if direction == 0:
            if abs(step) > least:
                direction, extreme = float(np.sign(step)), i
        elif step * direction > 0 or (hold and step == 0):
            extreme = i
        elif -step * direction > least:
            turns.append(extreme)
            direction, extreme = -direction, i
    starts = [0, *(t + 1 for t in turns[1:])]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(x)], strict=True)]


def _extremes(x: Array) -> npt.NDArray[np.int64]:
    """Rows that can be turning points: all, or the minima and maxima of blocks."""
    if len(x) <= 2 * _LOOKED_AT:
        return np.arange(len(x))
    size = len(x) // _LOOKED_AT
    blocks = x[: len(x) // size * size].reshape(-1, size)
    at = np.arange(len(blocks)) * size
    found = [at + blocks.argmin(1), at + blocks.argmax(1), np.arange(len(blocks) * size, len(x))]
    return np.unique(np.concatenate([[0], *found]))
