"""Sound of a baffled piston with an axisymmetric velocity profile w(r), amplitude, exp(+i omega t).

Rayleigh's integral p = (i omega rho/2 pi) int w exp(-i k R)/R dS, k = omega/c, is one integral on
the axis: with s^2 = r^2 + z^2, r dr/s = ds. In the far field at the angle theta

    p = i omega rho exp(-i k R)/R D,    D(theta) = int_0^a w J0(k r sin theta) r dr,

so that the radiated power is P = (pi rho omega^2/c) int_0^(pi/2) |D|^2 sin theta dtheta. Where
ka << 1, D = Q/(2 pi) with Q = int w dS: P = rho omega^2 |Q|^2/(4 pi c), and p on the axis, far
away, is i omega rho Q exp(-i k z)/(2 pi z). Rayleigh, Theory of Sound, 1896, 278 and 302.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import j0

Profile = Callable[[np.ndarray], Any]


@dataclass(frozen=True)
class Air:
    """Density (t/mm^3) and speed of sound (mm/s)."""

    density: float = 1.2e-12
    speed: float = 3.43e5


def volume_velocity(profile: Profile, radius: float) -> complex:
    """Q, mm^3/s, for w in mm/s."""
    r, weight = _rule(0.0, radius, 100)
    return complex(2 * np.pi * (weight @ (profile(r) * r)))


def on_axis(profile: Profile, radius: float, omega: float, z: float, air: Air = Air()) -> complex:
    """Complex pressure at the height z, MPa."""
    k = omega / air.speed
    end = np.hypot(radius, z)
    s, weight = _rule(z, end, 100 + int(k * (end - z)))
    r = np.sqrt(np.maximum(s * s - z * z, 0))
    return complex(1j * omega * air.density * (weight @ (profile(r) * np.exp(-1j * k * s))))


def directivity(profile: Profile, radius: float, omega: float, theta: Any, air: Air = Air()) -> Any:
    """D(theta), mm^3/s: the far field over i omega rho exp(-i k R)/R."""
    k = omega / air.speed
    r, weight = _rule(0.0, radius, 100 + int(k * radius))
    return j0(np.multiply.outer(k * np.sin(theta), r)) @ (weight * r * profile(r))


def power(profile: Profile, radius: float, omega: float, air: Air = Air()) -> float:
    """Radiated into the half space, mean over time, N mm/s (mW)."""
    theta, weight = _rule(0.0, np.pi / 2, 100 + int(omega / air.speed * radius))
    D = directivity(profile, radius, omega, theta, air)
    integral = weight @ (np.abs(D) ** 2 * np.sin(theta))
    return float(np.pi * air.density * omega**2 / air.speed * integral)


def compact_power(Q: complex, omega: float, air: Air = Air()) -> float:
    """The limit of the power where ka << 1."""
    return float(air.density * omega**2 * abs(Q) ** 2 / (4 * np.pi * air.speed))


def _rule(start: float, end: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(count)
    return start + (end - start) / 2 * (1 + x), (end - start) / 2 * w
