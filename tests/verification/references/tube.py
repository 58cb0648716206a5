"""Thick tube of any law, electrodes on its inner and outer face, pressure in the bore.

With r^2 = a^2 + (R^2 - A^2)/lz, lt = r/R and the true field e = V/(r ln(b/a)), the differences of
the total true stresses are st - sr = lt W_t - eps e^2 and sz - sr = lz W_z - eps e^2, W(lt, lz).
The radial balance, sr(a) = -P, sr(b) = 0, and the axial force on the wall's ring are

    P = int_a^b (st - sr) dr/r,    N = pi P a^2 + pi int_a^b [2 (sz - sr) - (st - sr)] r dr.

Ends: `open` N = 0 (the bore's pressure acts through sliding seals), `capped` N = pi a^2 P, `held`
at a given lz. At a given a both equations are linear in V^2.
Dorfmann and Ogden, Acta Mech. 174 (2005) 167; Zhu, Stoyanov, Kofod and Suo, J. Appl. Phys. 108
(2010) 074113.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq, root

from verification.references import continuation
from verification.references.laws import Energy, in_range, shear_modulus, slopes

Ends = Literal["open", "capped", "held"]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)


@dataclass(frozen=True)
class Tube:
    """Unstretched radii (mm), law (MPa), permittivity (N/kV^2)."""

    law: Energy
    inner: float
    outer: float
    permittivity: float = 1.0

    @property
    def unit_voltage(self) -> float:
        """(B - A) sqrt(G/eps), kV."""
        scale = shear_modulus(self.law) / self.permittivity
        return float((self.outer - self.inner) * scale**0.5)


@dataclass(frozen=True)
class State:
    """Radii (mm), axial stretch, voltage (kV), pressure (MPa), axial force N on the wall (N).

    The capacitance (nF/mm) and the energy (elastic, mJ/mm) are a unit of unstretched length.
    """

    inner: float
    outer: float
    stretch: float
    voltage: float
    pressure: float
    force: float
    capacitance: float
    energy: float


def balance(tube: Tube, a: float, lz: float) -> tuple[float, float, float, float]:
    """(P at V = 0, its change a unit of V^2, N - pi a^2 P at V = 0, its change a unit of V^2)."""
    A, B = tube.inner, tube.outer
    R = (A + B) / 2 + (B - A) / 2 * _NODES
    w = (B - A) / 2 * _WEIGHTS * R / lz  # r dr
    r = np.sqrt(a * a + (R * R - A * A) / lz)
    lt = r / R
    Wt, Wz = slopes(tube.law, lt, np.full_like(lt, lz))
    hoop, axial = lt * Wt, lz * Wz
    b = _outer(tube, a, lz)
    log = np.log(b / a)
    pressure = float(w @ (hoop / r**2))
    excess = float(np.pi * (w @ (2 * axial - hoop)))
    eps = tube.permittivity
    return pressure, -eps / 2 * (a**-2 - b**-2) / log**2, excess, -np.pi * eps / log


def at_voltage(
    tube: Tube, voltage: float, pressure: float = 0.0, ends: Ends = "open", stretch: float = 1.0
) -> State | None:
    """The state reached by raising the pressure, then the voltage; None if that is not possible.

    Args:
        tube: The tube.
        voltage: kV.
        pressure: In the bore, MPa.
        ends: See the module.
        stretch: lz of held ends.
    """
    x = np.array([tube.inner / stretch**0.5, stretch])
    steps = 12
    loads = [(pressure * k / steps, 0.0) for k in range(1, steps + 1)] if pressure else []
    loads += [(pressure, voltage * (k / steps) ** 0.5) for k in range(1, steps + 1)]
    for P, V in loads:

        def miss(x: np.ndarray, P: float = P, V: float = V) -> list[float]:
            return _residual(tube, x[0], x[1], V, P, ends, stretch)

        found = root(miss, x, tol=1e-13)
        far = np.abs(found.x / x - 1).max() > 0.5
        if np.abs(found.fun).max() > 1e-9 or far or not (found.x > 0).all():
            return None
        x = found.x
    return _state(tube, float(x[0]), float(x[1]), voltage, pressure)


def at_radius(
    tube: Tube, a: float, pressure: float = 0.0, ends: Ends = "open", stretch: float = 1.0
) -> State:
    """The state at an inner radius, of any point of the path; the voltage is NaN without one."""

    def squared(lz: float) -> float:
        P0, slope = balance(tube, a, lz)[:2]
        return (pressure - P0) / slope

    lz = stretch
    if ends != "held":

        def miss(lz: float) -> float:
            excess, change = balance(tube, a, lz)[2:]
            capped = ends == "capped"
            return excess + change * squared(lz) + (0 if capped else np.pi * a * a * pressure)

        low, high = 0.3, 1.0
        while miss(high) < 0:
            high *= 1.2
        lz = float(brentq(miss, low, high, xtol=1e-14))
    V2 = squared(lz)
    return _state(tube, a, lz, float(np.sqrt(V2)) if V2 >= 0 else np.nan, pressure)


def limit_point(
    tube: Tube,
    pressure: float = 0.0,
    ends: Ends = "open",
    stretch: float = 1.0,
    step: float = 0.05,
    count: int = 60,
) -> State | None:
    """The first limit point of the voltage at a pressure, by continuation; None without one."""
    unit = tube.unit_voltage
    start = at_voltage(tube, 0.05 * unit, pressure, ends, stretch)
    if start is None:
        return None

    def residual(x: np.ndarray) -> list[float]:
        return _residual(tube, x[0] * tube.inner, x[1], x[2] * unit, pressure, ends, stretch)

    def inside(x: np.ndarray) -> bool:
        return in_range(tube.law, x[0], x[1])

    path = [start.inner / tube.inner, start.stretch, 0.05]
    x = next(continuation.limit_points(residual, path, step, count, inside), None)
    if x is None:
        return None
    return _state(tube, float(x[0] * tube.inner), float(x[1]), float(x[2] * unit), pressure)


def _residual(
    tube: Tube, a: float, lz: float, V: float, P: float, ends: Ends, stretch: float
) -> list[float]:
    """Of the radial balance over G ln(B/A), and of the ends."""
    P0, P2, N0, N2 = balance(tube, a, lz)
    modulus = shear_modulus(tube.law)
    radial = (P0 + P2 * V * V - P) / modulus / np.log(tube.outer / tube.inner)
    if ends == "held":
        return [radial, lz - stretch]
    area = np.pi * (tube.outer**2 - tube.inner**2)
    force = N0 + N2 * V * V + (np.pi * a * a * P if ends == "open" else 0.0)
    return [radial, force / modulus / area]


def _outer(tube: Tube, a: float, lz: float) -> float:
    return float(np.sqrt(a * a + (tube.outer**2 - tube.inner**2) / lz))


def _state(tube: Tube, a: float, lz: float, voltage: float, pressure: float) -> State:
    b = _outer(tube, a, lz)
    _, _, N0, N2 = balance(tube, a, lz)
    A, B = tube.inner, tube.outer
    R = (A + B) / 2 + (B - A) / 2 * _NODES
    lt = np.sqrt(a * a + (R * R - A * A) / lz) / R
    energy = 2 * np.pi * float((B - A) / 2 * _WEIGHTS * R @ tube.law(lt, np.full_like(lt, lz)))
    return State(
        a,
        b,
        lz,
        voltage,
        pressure,
        force=N0 + N2 * voltage**2 + np.pi * a * a * pressure,
        capacitance=float(2 * np.pi * tube.permittivity * lz / np.log(b / a)),
        energy=energy,
    )
