"""The thickness stretch of a film that is stretched in its plane and free across."""

from __future__ import annotations

import math
from collections.abc import Callable

from dealib.materials.laws import Law, invariants_of_stretches


def thickness_stretch(law: Law, radial: float, hoop: float) -> float:
    """Stretch across the film at zero thickness stress: dW/d(lz) = 0 at fixed in-plane stretches.

    Args:
        law: Law with its parameters.
        radial: Radial stretch.
        hoop: Hoop stretch.

    Raises:
        ValueError: If the law has no such state between half and twice the isochoric stretch.
    """
    if radial == hoop == 1:
        return 1.0  # exactly: every law is stress-free at rest
    ends = thickness_range(law, radial, hoop)
    if ends is None:
        raise ValueError(
            f"{law.name()}: no thickness stretch without thickness stress at the pre-stretch "
            f"({radial:g}, {hoop:g})"
        )
    stress, (low, high) = _thickness_stress(law, radial, hoop), ends
    # bisection: merely importing SciPy's solver takes longer
    while low < (middle := (low + high) / 2) < high:
        low, high = (low, middle) if stress(middle) > 0 else (middle, high)
    return middle


def thickness_range(law: Law, radial: float, hoop: float) -> tuple[float, float] | None:
    """Thickness stretches below and above the one without thickness stress; None without one."""
    return bracket(_thickness_stress(law, radial, hoop), 1 / (radial * hoop), 2.0)


def _thickness_stress(law: Law, radial: float, hoop: float) -> Callable[[float], float]:
    p, h = law.values, 1e-30

    def stress(lz: float) -> float:  # by a complex step, exact to rounding
        return float(law.energy(invariants_of_stretches(radial, hoop, lz + 1j * h), p).imag / h)

    return stress


def bracket(
    stress: Callable[[float], float], guess: float, width: float
) -> tuple[float, float] | None:
    """Two stretches between which a stress that grows with the stretch changes sign; None if none.

    Args:
        stress: Stress at a stretch; NaN beyond a law's locking stretch.
        guess: Stretch near the change of sign.
        width: The search goes from guess / width to guess * width.
    """
    low = _end(lambda x: -stress(x), guess, guess / width)
    high = _end(stress, guess, guess * width)
    return None if low is None or high is None else (low, high)


def _end(stress: Callable[[float], float], inner: float, outer: float) -> float | None:
    """A stretch between two at which a stress is positive; None if there is none.

    While the stress is NaN, the outer stretch moves inwards by bisection.
    """
    x = outer
    for _ in range(60):
        found = stress(x)
        if found > 0:
            return x
        if math.isnan(found):
            outer = x
        elif x == outer:
            return None
        else:
            inner = x
        x = (inner + outer) / 2
    return None
