"""Spacings of nodes along an edge, as fractions from 0 to 1."""

from __future__ import annotations

import numpy as np

from dealib.arrays import Array


def geometric(cells: int, first: float) -> Array:
    """Cells that grow by one ratio from a first one.

    Args:
        cells: Number of cells.
        first: Size of the first cell as a fraction of the edge; if that is not below 1 / cells,
            the spacing is uniform.

    Returns:
        Nodes of shape (cells + 1,), from 0 to 1.
    """
    if cells * first >= 1 - 1e-9:
        return np.linspace(0, 1, cells + 1)
    low, high = 1.0 + 1e-12, (1 / first) ** (1 / max(cells - 1, 1)) + 1
    for _ in range(200):  # bisection: the sum grows with the ratio
        ratio = (low + high) / 2
        total = first * (ratio**cells - 1) / (ratio - 1)
        low, high = (ratio, high) if total < 1 else (low, ratio)
    nodes = np.concatenate([[0.0], np.cumsum(ratio ** np.arange(cells))])
    return np.asarray(nodes / nodes[-1])


def ends(cells: int, first: float) -> Array:
    """Cells that grow from both ends, of size `first` there, to the middle (`cells` even)."""
    half = geometric(cells // 2, 2 * first) / 2
    return np.concatenate([half, 1 - half[-2::-1]])


def tanh(cells: int) -> Array:
    """The grading of the benchmark: x = (1 + Tanh(4 (s - 1/2)) / Tanh(2)) / 2 at equal s."""
    s = np.linspace(0, 1, cells + 1)
    return np.asarray((1 + np.tanh(4 * (s - 0.5)) / np.tanh(2.0)) / 2)


def growing_cells(length: float, first: float, ratio: float) -> int:
    """Even number of cells that reach a length when each is `ratio` times the one before."""
    cells = np.log(1 + length / first * (ratio - 1)) / np.log(ratio)
    return max(2, 2 * int(np.ceil(cells / 2)))
