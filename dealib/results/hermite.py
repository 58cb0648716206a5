"""Piecewise cubic Hermite interpolation on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from dealib.arrays import Array


def nodal(
    grids: Sequence[Array], values: Array, slopes: Sequence[Array] = ()
) -> dict[tuple[bool, ...], Array]:
    """Values and mixed first derivatives of a function at the nodes of a grid.

    The key (True, False), for instance, is the derivative with respect to the first axis.

    Args:
        grids: The axes of the grid.
        values: Values of the function, (*grid, ...).
        slopes: First derivatives by axis, if they are known. Derivatives that are not given come
            from cubic splines.
    """
    found = {}
    for of in product((False, True), repeat=len(grids)):
        if not any(of):
            found[of] = values
        elif sum(of) == 1 and slopes:
            found[of] = slopes[of.index(True)]
        else:  # the mean over the orders of differentiation
            ways = [
                spline_slope(grids[k], found[(*of[:k], False, *of[k + 1 :])], k)
                for k, differentiated in enumerate(of)
                if differentiated
            ]
            found[of] = np.mean(ways, axis=0)
    return found


def spline_slope(grid: Array, values: Array, axis: int) -> Array:
    """Derivatives at the nodes of a grid along one of its axes, by cubic splines."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(grid, values, axis=axis)(grid, 1))


def basis(grid: Array, x: Array, order: int, name: str, unit: str) -> tuple[Any, Any]:
    """Cubic Hermite functions of an axis at points, or their derivatives.

    Args:
        grid: Nodes of the axis, ascending.
        x: Points.
        order: Order of the derivative.
        name: Name of the variable, for messages.
        unit: Its unit, for messages.

    Returns:
        The index of the node below each point, and a pair of lists: the functions that multiply the
        values, and those that multiply the slopes, at the node below and at the node above.

    Raises:
        ValueError: If a point is outside the grid.
    """
    slack = 1e-12 * (grid[-1] - grid[0])
    if (x < grid[0] - slack).any() or (x > grid[-1] + slack).any() or np.isnan(x).any():
        raise ValueError(f"the tables hold for a {name} of {grid[0]:g} .. {grid[-1]:g} {unit} only")
    k = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, len(grid) - 2)
    h = grid[k + 1] - grid[k]
    t = (x - grid[k]) / h
    cubics = ((1, 0, -3, 2), (0, 0, 3, -2)), ((0, 1, -2, 1), (0, 0, -1, 1))
    values, slopes = (
        [np.polynomial.Polynomial(c).deriv(order)(t) / h**order for c in pair] for pair in cubics
    )
    return k, (values, [s * h for s in slopes])
