"""Spherical balloon of any law, thick or thin, electrodes on its inner and outer face.

Thick: r^3 = a^3 + R^3 - A^3, lt = r/R = l, e = V a b/((b - a) r^2), and with w(l) = W(l, l) the
difference of the total true stresses is st - sr = l w'(l)/2 - eps e^2; sr(a) = -P, sr(b) = 0:

    P = int_a^b 2 (st - sr) dr/r.

Thin (thickness H, radius A): P A/H = w'(l)/l^2 - 2 eps (V/H)^2 l. Both are explicit in P and V^2.
Radial motion of the thin balloon, which is a thin film of density rho: with w_e = eps (V/H)^2 l^4/2

    rho A^2 l'' + w'(l) - 2 eps (V/H)^2 l^3 - (P A/H) l^2 = 0.

Zhu, Cai and Suo, Polym. Int. 59 (2010) 378; Rudykh, Bhattacharya and deBotton, Int. J. Non-Linear
Mech. 47 (2012) 206 (thick).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from verification.references import continuation
from verification.references.laws import Energy, biaxial_slope, derivative, in_range, unit_voltage

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)


@dataclass(frozen=True)
class Balloon:
    """A balloon.

    Attributes:
        law: MPa.
        radius: Unstretched, mm; of the inner face of a thick balloon.
        thickness: Unstretched, mm.
        permittivity: N/kV^2.
        thick: Whether the thickness counts.
        density: t/mm^3.
    """

    law: Energy
    radius: float
    thickness: float
    permittivity: float = 1.0
    thick: bool = False
    density: float = 1.0


def pressure(balloon: Balloon, l: float, voltage: float = 0.0) -> float:
    """Pressure, MPa, at a stretch l = a/A of the (inner) radius."""
    elastic, pull = _terms(balloon, l)
    return elastic - pull * voltage**2


def voltage(balloon: Balloon, l: float, pressure: float) -> float:
    """Voltage, kV, at a stretch and a pressure; NaN if there is none."""
    elastic, pull = _terms(balloon, l)
    squared = (elastic - pressure) / pull
    return float(np.sqrt(squared)) if squared >= 0 else np.nan


def capacitance(balloon: Balloon, l: float) -> float:
    """In nF."""
    eps = balloon.permittivity
    if not balloon.thick:
        return float(4 * np.pi * eps * balloon.radius**2 * l**4 / balloon.thickness)
    a, b = l * balloon.radius, _outer(balloon, l)
    return float(4 * np.pi * eps * a * b / (b - a))


def volume(balloon: Balloon, l: float) -> float:
    """Enclosed, mm^3."""
    return float(4 / 3 * np.pi * (l * balloon.radius) ** 3)


def energy(balloon: Balloon, l: float) -> float:
    """Elastic, mJ."""
    A, H = balloon.radius, balloon.thickness
    if not balloon.thick:
        return float(4 * np.pi * A**2 * H * balloon.law(l, l))
    R = A + H / 2 * (1 + _NODES)
    lt = np.cbrt((l * A) ** 3 + R**3 - A**3) / R
    return float(4 * np.pi * H / 2 * (_WEIGHTS * R**2) @ balloon.law(lt, lt))


def at(balloon: Balloon, pressure: float = 0.0, voltage: float = 0.0) -> float | None:
    """The stretch reached by raising pressure and voltage; None beyond a limit point."""

    def miss(l: float) -> float:
        elastic, pull = _terms(balloon, l)
        return elastic - pull * voltage**2 - pressure

    if pressure == voltage == 0:
        return 1.0
    return continuation.first_root(miss, 1.0, 0.01, 20.0)


def limit_pressures(balloon: Balloon, voltage: float = 0.0, end: float = 6.0) -> list[float]:
    """Stretches up to `end` at which the pressure at a voltage is stationary."""

    def slope(l: float) -> float:
        return float(derivative(lambda x: _pressure_at(balloon, x, voltage), l))

    return _roots(slope, 1.02, end)


def limit_voltages(
    balloon: Balloon, pressure: float = 0.0, step: float = 0.05, count: int = 60
) -> list[tuple[float, float]]:
    """(Stretch, voltage) at the limit points of the voltage at a pressure, by continuation."""
    unit = unit_voltage(balloon.law, balloon.permittivity, balloon.thickness)
    scale = _terms(balloon, 1.05)[0]
    start = at(balloon, pressure, 0.02 * unit)
    if start is None:
        return []

    def residual(x: np.ndarray) -> float:
        elastic, pull = _terms(balloon, x[0])
        return (elastic - pull * (x[1] * unit) ** 2 - pressure) / scale

    def inside(x: np.ndarray) -> bool:
        return in_range(balloon.law, x[0], x[0])

    path = continuation.limit_points(residual, [start, 0.02], step, count, inside)
    return [(float(x[0]), float(x[1] * unit)) for x in path]


def angular_frequency(balloon: Balloon, l: float, voltage: float = 0.0) -> float:
    """Of small breathing of a thin balloon about equilibrium at l, 1/s; negative: growth rate."""
    squared = derivative(lambda x: _force(balloon, x, pressure(balloon, l, voltage), voltage), l)
    squared /= balloon.density * balloon.radius**2
    return float(np.sign(squared) * np.sqrt(abs(squared)))


def release(
    balloon: Balloon, pressure: float, voltage: float, start: float = 1.0
) -> tuple[float, float] | None:
    """(Largest stretch, period in s) of the undamped motion from rest at `start`; None: unbounded.

    The loads come on at once and stay: rho A^2 l'^2/2 + U(l) = U(start).
    """
    A, H = balloon.radius, balloon.thickness
    pull = balloon.permittivity * (voltage / H) ** 2

    def gain(l: float) -> float:  # U(start) - U(l)
        work = pressure * A / H / 3 * (l**3 - start**3) + pull / 2 * (l**4 - start**4)
        return float(work - balloon.law(l, l) + balloon.law(start, start))

    if gain(start + 1e-6) <= 0:
        return None
    turn = continuation.first_root(gain, start + 1e-6, 0.01, 20.0)
    if turn is None:
        return None
    # l = mean - half cos(angle) makes both turning points smooth, and the midpoint rule spectral
    angle = (np.arange(64) + 0.5) / 64 * np.pi
    half = (turn - start) / 2
    gains = np.array([gain(l) for l in (turn + start) / 2 - half * np.cos(angle)])
    rate = np.sqrt(2 * gains / (balloon.density * A * A)) / (half * np.sin(angle))
    return turn, float(2 * np.pi * np.mean(1 / rate))


def motion(balloon: Balloon, l: float, pressure: float, voltage: float) -> float:
    """l'' of a thin balloon, 1/s^2, for integrating in time."""
    return -_force(balloon, l, pressure, voltage) / (balloon.density * balloon.radius**2)


def _force(balloon: Balloon, l: float, pressure: float, voltage: float) -> float:
    A, H = balloon.radius, balloon.thickness
    pull = balloon.permittivity * (voltage / H) ** 2
    return float(biaxial_slope(balloon.law, l) - 2 * pull * l**3 - pressure * A / H * l * l)


def _terms(balloon: Balloon, l: float) -> tuple[float, float]:
    """Pressure at no voltage, and its fall a unit of V^2."""
    A, H, eps = balloon.radius, balloon.thickness, balloon.permittivity
    if not balloon.thick:
        return float(biaxial_slope(balloon.law, l) / l**2 * H / A), 2 * eps * l / (H * A)
    a, b = l * A, _outer(balloon, l)
    R = A + H / 2 * (1 + _NODES)
    r = np.cbrt(a**3 + R**3 - A**3)
    w = H / 2 * _WEIGHTS * R**2 / r**2  # dr
    lt = r / R
    elastic = float(w @ (lt * biaxial_slope(balloon.law, lt) / r))
    return elastic, eps / 2 * (a * b / (b - a)) ** 2 * (a**-4 - b**-4)


def _outer(balloon: Balloon, l: float) -> float:
    A, B = balloon.radius, balloon.radius + balloon.thickness
    return float(np.cbrt((l * A) ** 3 + B**3 - A**3))


def _pressure_at(balloon: Balloon, l: float, voltage: float) -> float:
    return pressure(balloon, l, voltage)


def _roots(function: continuation.Function, start: float, end: float) -> list[float]:
    """All roots between two points, a hundredth or more apart."""
    x = np.arange(start, end, 0.01)
    values = [function(v) for v in x]
    return [
        float(brentq(function, x[k], x[k + 1], xtol=1e-12))
        for k in range(len(x) - 1)
        if np.isfinite(values[k + 1]) and values[k] * values[k + 1] < 0
    ]
