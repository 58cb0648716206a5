"""Paths of equilibria: roots along a line, pseudo-arclength continuation, limit points.

A limit point of the voltage is pull-in under voltage control: beyond it the path goes on at a
falling voltage. Method: H. B. Keller's pseudo-arclength continuation; the fold itself is where the
tangent of the path has no component along the control.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq

Function = Callable[[float], float]
Residual = Callable[[Any], Any]
Point = tuple[np.ndarray, np.ndarray, np.ndarray]  # unknowns, unit tangent, Jacobian


def first_root(function: Function, start: float, step: float, end: float) -> float | None:
    """The first root of a function from `start` on, or None up to `end`.

    It is looked for by steps, so two roots within a step are missed. A value that is not finite
    ends the search.
    """
    x, value = start, function(start)
    while value != 0 and abs(x - start) < abs(end - start):
        after = x + step
        new = function(after)
        if not np.isfinite(new):
            return None
        if new * value <= 0:
            return float(brentq(function, x, after, xtol=1e-14, rtol=1e-13))
        x, value = after, new
    return x if value == 0 else None


def jacobian(residual: Residual, x: Any, here: Any) -> Any:
    """Forward differences from the residual `here` at x, shape (equations, unknowns)."""
    columns = []
    for k in range(len(x)):
        h = np.zeros_like(x)
        h[k] = 1e-6 * max(1.0, abs(x[k]))
        columns.append((_values(residual, x + h) - here) / h[k])
    return np.column_stack(columns)


def follow(residual: Residual, start: Any, step: float, count: int) -> Iterator[Point]:
    """Points of the path residual(x) = 0, from near `start`.

    Args:
        residual: n equations in n + 1 unknowns, all of about size 1; the last unknown is the
            control, and the path starts with the control growing.
        start: Unknowns near the first point; its control is kept.
        step: Arc length between points; halved where Newton's method fails.
        count: Number of points after the first.

    Raises:
        ArithmeticError: If the path cannot be followed.
    """
    x = np.array(start, dtype=float)
    control = np.eye(len(x))[-1]
    J = jacobian(residual, x, _values(residual, x))
    x, tangent, J = _correct(residual, x, control, float(x[-1]), J)
    yield x, tangent, J
    for _ in range(count):
        x, tangent, J = _advance(residual, x, tangent, J, step)
        yield x, tangent, J


def limit_points(
    residual: Residual,
    start: Any,
    step: float,
    count: int,
    inside: Callable[[Any], bool] = lambda x: True,
) -> Iterator[np.ndarray]:
    """Unknowns at the limit points of the control along a path.

    Args:
        residual: As for `follow`, and so are `start`, `step` and `count`.
        start: See there.
        step: See there.
        count: See there.
        inside: Whether unknowns are in the range of the problem; the path ends where not.

    Raises:
        ArithmeticError: If the path cannot be followed.
    """
    last = None
    for point in follow(residual, start, step, count):
        if last is not None and point[1][-1] * last[1][-1] < 0:
            yield _fold(residual, last, point)
        if not inside(point[0]):
            return
        last = point


def _fold(residual: Residual, before: Point, after: Point) -> np.ndarray:
    """By secants of the tangent's last component over the arc length."""
    length = float((after[0] - before[0]) @ before[1])
    enough = 1e-5 * length
    for _ in range(20):
        here = after[1][-1]
        length *= -here / (here - before[1][-1])
        before, after = after, _advance(residual, *after, length)
        if abs(length) < enough:
            return after[0]
    raise ArithmeticError(f"the limit point near {after[0]} cannot be found")


def _advance(residual: Residual, x: Any, tangent: Any, J: Any, step: float) -> Point:
    if step == 0:
        return x, tangent, J
    for _ in range(8):
        try:
            return _correct(residual, x + step * tangent, tangent, float(x @ tangent + step), J)
        except ArithmeticError:
            step /= 2
    raise ArithmeticError(f"the path cannot be followed beyond {x}")


def _correct(residual: Residual, x: Any, normal: Any, level: float, J: Any) -> Point:
    """The point of the path in the plane normal . x = level, its tangent and Jacobian there.

    Newton's method with Broyden's updates of the Jacobian J.
    """
    value = _values(residual, x)
    for _ in range(20):
        change = np.linalg.solve(np.vstack([J, normal]), -np.append(value, normal @ x - level))
        x = x + change
        value = _values(residual, x)
        if not np.isfinite(value).all():
            break
        if np.abs(change).max() < 1e-7:  # convergence is faster than linear
            J = jacobian(residual, x, value)
            tangent = np.linalg.svd(J)[2][-1]
            return x, tangent if tangent @ normal > 0 else -tangent, J
        J = J + np.outer(value, change) / (change @ change)
    raise ArithmeticError(f"Newton's method fails near {x}")


def _values(residual: Residual, x: Any) -> Any:
    return np.atleast_1d(np.asarray(residual(x), dtype=float))
