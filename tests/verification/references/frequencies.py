"""Natural frequencies: membranes on Bessel functions, a cantilever of two layers.

A flat membrane under the total (elastic and Maxwell) tension T, N/mm, with the mass mu, t/mm^2, has
omega = k sqrt(T/mu), at constant voltage; T and mu are the mounted film's (`Film.tension`). Between
r = a and r = b its shape is Z_n(kr) cos(n theta), where Z_n of J_n and Y_n is zero at b.
Balloons are in `balloon`. Rayleigh, Theory of Sound, 1894, chapters VIII and IX.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count as integers

import numpy as np
from scipy.optimize import brentq
from scipy.special import jn_zeros, jv, jvp, yv, yvp


def disc(n: int, count: int, radius: float) -> np.ndarray:
    """k (1/mm) of a disc clamped at its edge, n nodal diameters."""
    return np.asarray(jn_zeros(n, count) / radius)


def annulus(n: int, count: int, a: float, b: float) -> np.ndarray:
    """k (1/mm) of an annulus clamped at both edges."""
    return _roots(lambda k: _shape(n, k, a, b), count, np.pi / (b - a))


def plunging_plate(count: int, a: float, b: float, mass: float) -> np.ndarray:
    """k (1/mm) of an annulus with a rigid plate inside that moves along the axis.

    M w'' = 2 pi a T w_r gives M k^2/mu w(a) = -2 pi a w_r(a).

    Args:
        count: Number of roots.
        a: Plate's radius, mm.
        b: Frame's radius, mm.
        mass: M/mu, mm^2: the plate's mass over the membrane's mass a unit of area.
    """

    def miss(k: float) -> float:
        return mass * k * k * _shape(0, k, a, b) + 2 * np.pi * a * _rise(0, k, a, b)

    return _roots(miss, count, np.pi / (b - a))


def rocking_plate(count: int, a: float, b: float, inertia: float) -> np.ndarray:
    """k (1/mm) of the same where the plate rocks about a diameter: w = f(r) cos(theta).

    Its edge is pulled up by T f' cos(theta) and outwards by T at the height f cos(theta):
    J k^2/mu f(a)/a = -pi a^2 (f'(a) - f(a)/a).

    Args:
        count: Number of roots.
        a: Plate's radius, mm.
        b: Frame's radius, mm.
        inertia: J/mu, mm^4; J is about a diameter.
    """

    def miss(k: float) -> float:
        f, rise = _shape(1, k, a, b), _rise(1, k, a, b)
        return inertia * k * k * f / a + np.pi * a * a * (rise - f / a)

    return _roots(miss, count, np.pi / (b - a))


def bilayer_stiffness(G1: float, G2: float, h1: float, h2: float) -> float:
    """D a unit of width, N mm: both layers with 4 G (plane strain, incompressible)."""
    layers = ((4 * G1, h1, h2 + h1 / 2), (4 * G2, h2, h2 / 2))
    neutral = sum(Y * h * z for Y, h, z in layers) / sum(Y * h for Y, h, _ in layers)
    return float(sum(Y * (h**3 / 12 + h * (z - neutral) ** 2) for Y, h, z in layers))


def cantilever(count: int, length: float, stiffness: float, mass: float) -> np.ndarray:
    """omega (1/s) of a slender cantilever: x^2/L^2 sqrt(D/mu), cos x cosh x = -1.

    Args:
        count: Number of modes.
        length: mm.
        stiffness: D a unit of width, N mm.
        mass: mu, t/mm^2.
    """
    x = [
        brentq(lambda x: np.cos(x) + 1 / np.cosh(x), n * np.pi, (n + 1) * np.pi, xtol=1e-14)
        for n in range(count)
    ]
    return np.square(x) / length**2 * np.sqrt(stiffness / mass)


def _shape(n: int, k: float, r: float, b: float) -> float:
    """Z_n(kr), zero at r = b."""
    return float(jv(n, k * r) * yv(n, k * b) - yv(n, k * r) * jv(n, k * b))


def _rise(n: int, k: float, r: float, b: float) -> float:
    """Its derivative by r."""
    return float(k * (jvp(n, k * r) * yv(n, k * b) - yvp(n, k * r) * jv(n, k * b)))


def _roots(function: Callable[[float], float], count: int, spacing: float) -> np.ndarray:
    """The first roots, looked for in steps of a fortieth of their distance at large k."""
    step = spacing / 40
    found: list[float] = []
    last = function(1e-3 * step)
    for j in integers(1):
        value = function(j * step)
        if value * last < 0:
            low = (j - 1) * step if j > 1 else 1e-3 * step
            found.append(float(brentq(function, low, j * step, xtol=1e-15, rtol=1e-14)))
            if len(found) == count:
                break
        last = value
    return np.array(found)
