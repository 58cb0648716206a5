"""A law's own response: homogeneous stretching, and where the law stops being stable.

Stretches are principal stretches from the unstretched state, stresses are in MPa.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.materials.law import Invariants
from dealib.materials.laws import Law, invariants_of_stretches
from dealib.materials.prestretch import bracket, thickness_stretch

_LARGEST = 10.0  # stretch up to which stability is examined


def nominal_stress(law: Law, stretches: Any) -> Array:
    """Principal nominal stresses dW/dl_i, shape (..., 3), by complex steps (exact to rounding)."""
    l, p, h = np.asarray(stretches, dtype=complex), law.values, 1e-30
    out = np.empty(l.shape)
    for i in range(3):
        moved = l.copy()
        moved[..., i] += 1j * h
        out[..., i] = np.imag(law.energy(invariants_of_stretches(*np.moveaxis(moved, -1, 0)), p))
    return out / h


def uniaxial(law: Law, stretch: float) -> tuple[float, float, float]:
    """Stretches of a bar that is free sideways.

    Raises:
        ValueError: If the law has no such state near the isochoric one.
    """
    from scipy.optimize import brentq

    def lateral(t: float) -> float:
        return float(nominal_stress(law, (stretch, t, t))[1])

    guess = stretch**-0.5
    if stretch == 1:
        return 1.0, 1.0, 1.0
    ends = bracket(lateral, guess, 1.4)
    if ends is None:
        raise ValueError(f"no lateral stretch without stress at the stretch {stretch:g}")
    t = float(brentq(lateral, *ends, xtol=1e-14))
    return stretch, t, t


def equal_biaxial(law: Law, stretch: float) -> tuple[float, float, float]:
    """Stretches of a film that is stretched equally in its plane."""
    return stretch, stretch, thickness_stretch(law, stretch, stretch)


def pure_shear(law: Law, stretch: float) -> tuple[float, float, float]:
    """Stretches of a wide film that keeps its width."""
    return stretch, 1.0, thickness_stretch(law, stretch, 1.0)


Mode = Callable[[Law, float], tuple[float, float, float]]
MODES: dict[str, Mode] = {
    "uniaxial": uniaxial,
    "equal-biaxial": equal_biaxial,
    "pure shear": pure_shear,
}
_SECOND: dict[str, Callable[[Array], Array]] = {  # second in-plane stretch at constant volume
    "uniaxial": lambda l: l**-0.5,
    "equal-biaxial": lambda l: l,
    "pure shear": lambda l: np.ones_like(l),
}


def response(law: Law, mode: str, stretches: Any) -> tuple[Array, Array, Array]:
    """A law's response in one mode, with its own bulk modulus.

    Args:
        law: Law with its parameters.
        mode: A key of `MODES`.
        stretches: Stretches in the loaded direction.

    Returns:
        Nominal and true stress in the loaded direction, and J, of the states that exist; NaN
        elsewhere.
    """
    states = np.full((len(stretches), 3), np.nan)
    for k, stretch in enumerate(stretches):
        try:
            states[k] = MODES[mode](law, float(stretch))
        except ValueError:
            continue
    J = states.prod(axis=1)
    nominal = nominal_stress(law, states)[:, 0]
    return nominal, nominal * states[:, 0] / J, J


def stiffness(law: Law, first: Any, second: Any) -> Array:
    """Smallest eigenvalue of the tangent for changes of shape, MPa.

    The tangent relates the Kirchhoff stresses to the logarithmic principal stretches,
    d2W / d(ln l_i) d(ln l_j), restricted to constant volume at l3 = 1 / (l1 l2). Where it is not
    positive the law violates Hill's inequality dtau : dlne > 0 (R. Hill, Proc. R. Soc. Lond. A 314,
    457-472, 1970): stress falls with further stretching. In equal-biaxial stretching this begins at
    the peak of the true stress.

    Args:
        law: Law with its parameters.
        first: In-plane stretches.
        second: The others.
    """
    _, (xx, yy, xy) = curvature(law, first, second)
    # orthonormal directions at constant volume: (1, -1, 0) and (1, 1, -2)
    aa, bb, ab = (xx + yy) / 2 - xy, (xx + yy + 2 * xy) / 6, (xx - yy) / np.sqrt(12)
    return np.asarray((aa + bb) / 2 - np.sqrt((aa - bb) ** 2 / 4 + ab**2))


def curvature(law: Law, first: Any, second: Any) -> tuple[Array, Array]:
    """First and second derivatives of W by x = ln l1 and y = ln l2, at l3 = 1 / (l1 l2), MPa.

    First derivatives are complex steps, exact to rounding; second ones are central differences of
    these, with a relative error of 1e-10.

    Args:
        law: Law with its parameters.
        first: In-plane stretches.
        second: The others.

    Returns:
        (W_x, W_y), shape (2, ...), and (W_xx, W_yy, W_xy), shape (3, ...); NaN beyond a law's
        locking stretch, where there is no energy.
    """
    p, step, h = law.values, 3e-6, 1e-30
    first, second = np.asarray(first, dtype=float) ** 2, np.asarray(second, dtype=float) ** 2
    third = 1 / (first * second)

    # columns: W_x at x +- step, W_y at y +- step, W_y at x +- step
    x, y = step * np.array([[1, -1, 0, 0, 1, -1], [0, 0, 1, -1, 0, 0]])
    along = 1j * h * np.array([[1, 1, 0, 0, 0, 0], [0, 0, 1, 1, 1, 1]])
    a, b = (np.exp(2 * z).reshape(-1, *[1] * third.ndim) for z in (x + along[0], y + along[1]))
    with np.errstate(all="ignore"):
        l1, l2, l3 = first * a, second * b, third / (a * b)  # squared
        known = "I2" in law.reads(hoop=True)
        i = Invariants(l1 + l2 + l3, l1 * l2 + (l1 + l2) * l3 if known else 3.0, 1.0, l3)
        slopes = np.broadcast_to(np.imag(law.energy(i, p)) / h, l3.shape)
        x1, x0, y1, y0, up, down = slopes
        second_derivatives = np.stack([x1 - x0, y1 - y0, up - down]) / (2 * step)
        return np.stack([x1 + x0, y1 + y0]) / 2, second_derivatives


def stability_limit(law: Law, mode: str) -> float:
    """Smallest stretch above 1 at which the law is not stable in a mode (see `stiffness`).

    Returns:
        The stretch; infinity if there is none up to 10.
    """

    def value(l: Any) -> Array:
        return stiffness(law, l, _SECOND[mode](np.asarray(l, dtype=float)))

    stretches = np.geomspace(1.0, _LARGEST, 1000)
    found = value(stretches)
    lost = np.flatnonzero(found <= 0)
    locked = np.flatnonzero(~np.isfinite(found))
    # right before locking the central differences are unreliable
    if len(lost) == 0 or (len(locked) and locked[0] <= lost[0] + 1):
        return float("inf")
    if lost[0] == 0:
        return 1.0  # not even at rest
    from scipy.optimize import brentq  # to import it takes longer than all the above

    return float(brentq(value, stretches[lost[0] - 1], stretches[lost[0]], xtol=1e-9))


def softens(law: Law) -> bool:
    """Whether a law loses stability in some mode (see `stability_limit`)."""
    return any(np.isfinite(stability_limit(law, mode)) for mode in MODES)


def locking_stretch(law: Law, mode: str, largest: float = 10.0) -> float:
    """Stretch above 1 at which an incompressible law locks in a mode; infinity up to `largest`."""
    from scipy.optimize import brentq

    def left(l: float) -> float:
        second = float(_SECOND[mode](np.asarray(l)))
        return 1 - float(
            law.extension(invariants_of_stretches(l, second, 1 / l / second), law.values)
        )

    return float("inf") if left(largest) > 0 else float(brentq(left, 1.0, largest, xtol=1e-12))
