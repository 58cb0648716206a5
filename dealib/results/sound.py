"""Sound of a flat, axisymmetric face in a baffle, by Rayleigh's integral.

With the amplitude w(r) of its velocity, the factor exp(i omega t) and k = omega/c, the pressure on
the axis is

    p = i omega rho int w exp(-i k s)/s r dr,  s^2 = r^2 + z^2,

and in the far field, at the angle theta to the axis, p = i omega rho exp(-i k R)/R D(theta) with
D = int w J0(k r sin theta) r dr. The radiated power is
P = pi rho omega^2/c int |D|^2 sin theta dtheta (Rayleigh, Theory of Sound, 1896, 278 and 302).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dealib.arrays import Array

DENSITY, SPEED = 1.204e-12, 3.432e5  # of air at 20 degrees, t/mm^3 and mm/s
_POINTS = 200  # of the quadrature; more if the face is many wavelengths wide


def on_axis(r: Array, velocity: Any, omega: float, z: float) -> complex:
    """Complex amplitude of the pressure on the axis, MPa.

    Args:
        r: Radii, ascending, mm; within the first one the velocity is that of the first one.
        velocity: Complex amplitudes at the radii, mm/s; linear in between.
        omega: Angular frequency, 1/s.
        z: Distance, mm.
    """
    x, weight, w = _rule(r, velocity, omega)
    s, k = np.hypot(x, z), omega / SPEED
    return complex(1j * omega * DENSITY * ((weight * w * x) @ (np.exp(-1j * k * s) / s)))


def power(r: Array, velocity: Any, omega: float) -> float:
    """Power radiated into the half space, mean over time, mW (arguments as for `on_axis`)."""
    from scipy.special import j0

    x, weight, w = _rule(r, velocity, omega)
    k = omega / SPEED
    nodes, shares = np.polynomial.legendre.leggauss(_POINTS + int(k * r[-1]))
    theta, shares = np.pi / 4 * (1 + nodes), np.pi / 4 * shares
    D = j0(k * np.multiply.outer(np.sin(theta), x)) @ (weight * w * x)
    total = shares @ (np.abs(D) ** 2 * np.sin(theta))
    return float(np.pi * DENSITY * omega**2 / SPEED * total)


def _rule(r: Array, velocity: Any, omega: float) -> tuple[Array, Array, Any]:
    """Points, weights and velocities of a quadrature that is exact between the radii."""
    edges = np.unique(np.concatenate([[0.0], r]))
    waves = omega / SPEED * r[-1] / (2 * np.pi)
    count = max(2, int(np.ceil((_POINTS + 20 * waves) / len(edges))))
    nodes, shares = np.polynomial.legendre.leggauss(count)
    half = np.diff(edges)[:, None] / 2
    x = (edges[:-1, None] + half * (1 + nodes)).ravel()
    return x, (half * shares).ravel(), np.interp(x, r, velocity)
