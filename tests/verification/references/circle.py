"""Expanding circle: a film clamped at r = b with electrodes in r < a, plane and of any law.

Uniform V/H0 makes the active part homogeneous (l1 = l2 = l, the only regular solution at the
centre); the ring around it obeys the membrane equations of `meridian` without a field. At r = a
both r and the total stress R s1 are continuous. It holds while the active part is in tension.
Device: Pelrine, Kornbluh, Pei and Joseph, Science 287 (2000) 836.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from verification.references import continuation
from verification.references.laws import Film, biaxial_slope, derivative, slope, unit_voltage
from verification.references.meridian import Meridian, integrate


@dataclass(frozen=True)
class Circle:
    """The device as mounted: film, its radius b and the electrodes' radius a, mm."""

    film: Film
    radius: float
    electrode: float


@dataclass(frozen=True)
class State:
    """Equilibrium.

    Attributes:
        voltage: kV.
        stretch: l of the active part since the unstretched state.
        edge: Radius of the electrodes, mm.
        thickness: Of the active part, mm.
        stress: Nominal, of the active part, MPa.
        capacitance: nF.
        energy: Elastic, mJ.
        ring: The passive part; its last point is at the clamp.
    """

    voltage: float
    stretch: float
    edge: float
    thickness: float
    stress: float
    capacitance: float
    energy: float
    ring: Meridian


def at_voltage(circle: Circle, voltage: float, step: float = 0.02) -> State | None:
    """The state reached by raising the voltage; None if tension is lost or pull-in comes before."""
    lp = circle.film.prestretch

    def miss(stretch: float) -> float:
        stress = float(circle.film.stress(stretch, stretch, voltage))
        return _miss(circle, stretch, stress) if stress >= 0 else np.nan

    stretch = lp if voltage == 0 else continuation.first_root(miss, lp, step * lp, 10 * lp)
    return None if stretch is None else _state(circle, stretch, voltage)


def at_stretch(circle: Circle, stretch: float) -> State:
    """The state at a stretch of the active part, of any point of its path."""
    film = circle.film
    # from a little compression, for the state at tension loss itself
    top = 1.2 * float(film.stress(stretch, stretch))
    stress = brentq(lambda s: _miss(circle, stretch, s), -1e-3 * top, top, xtol=1e-14 * top)
    pull = (biaxial_slope(film.law, stretch) / 2 - stress) / stretch**3
    return _state(circle, stretch, _voltage(film, pull))


def tension_loss(circle: Circle) -> State:
    """The state in which the active part has lost its tension: it wrinkles at a higher voltage."""
    film, lp = circle.film, circle.film.prestretch
    stretch = continuation.first_root(lambda l: _miss(circle, l, 0.0), lp, 0.05 * lp, 20 * lp)
    if stretch is None:
        raise ArithmeticError("the ring keeps the electrodes in tension at all stretches")
    return _state(
        circle, stretch, _voltage(film, biaxial_slope(film.law, stretch) / 2 / stretch**3)
    )


def limit_point(circle: Circle, step: float = 0.1, count: int = 60) -> State | None:
    """The first limit point of the voltage; None if the active part loses its tension before.

    Args:
        circle: The device.
        step: Arc length of the path in (stretch, voltage over its unit).
        count: Largest number of steps.
    """
    film = circle.film
    unit = unit_voltage(film.law, film.permittivity, film.unstretched)

    def stress(x: np.ndarray) -> float:
        return float(film.stress(x[0], x[0], x[1] * unit))

    def residual(x: np.ndarray) -> float:
        return _miss(circle, x[0], stress(x)) / circle.radius

    start = at_voltage(circle, 0.02 * unit)
    if start is None:
        return None
    path = [start.stretch, 0.02]
    x = next(continuation.limit_points(residual, path, step, count, lambda x: stress(x) > 0), None)
    return None if x is None or stress(x) < 0 else _state(circle, x[0], x[1] * unit)


def small_signal(circle: Circle, voltage: float) -> float:
    """Displacement of the electrodes' edge at a small voltage, mm.

    Increments of the mounted state, with A = W11 and B = W12 at (lp, lp): ds1 = lp (A u' + B u/r),
    so that u = c r inside and d (r - b^2/r) in the ring. Continuity of u at a gives c = d (1 - q),
    q = b^2/a^2; that of ds1, less eps (V/H0)^2 lp^3 inside, 2 A q d = -eps (V/H0)^2 lp^2.
    """
    film, lp = circle.film, circle.film.prestretch
    A = derivative(lambda l: slope(film.law, l, lp), lp)
    q = (circle.radius / circle.electrode) ** 2
    d = -film.pull(voltage) * lp**2 / (2 * A * q)
    return float(d * (1 - q) * circle.electrode)


def _ring(circle: Circle, stretch: float, stress: float, at: np.ndarray | None = None) -> Meridian:
    lp = circle.film.prestretch
    A, B = circle.electrode / lp, circle.radius / lp
    return integrate(
        circle.film, (A, B), (stretch * A, 0.0, A * stress), lp, at=at, totals=at is not None
    )


def _miss(circle: Circle, stretch: float, stress: float) -> float:
    return float(_ring(circle, stretch, stress).r[-1] - circle.radius)


def _state(circle: Circle, stretch: float, voltage: float) -> State:
    film, lp = circle.film, circle.film.prestretch
    A, B = circle.electrode / lp, circle.radius / lp
    stress = float(film.stress(stretch, stretch, voltage))
    ring = _ring(circle, stretch, stress, np.linspace(A, B, 81)[:-1])
    thickness = film.unstretched / stretch**2
    return State(
        voltage,
        stretch,
        stretch * A,
        thickness,
        stress,
        film.permittivity * np.pi * (stretch * A) ** 2 / thickness,
        ring.energy + np.pi * A**2 * film.unstretched * float(film.law(stretch, stretch)),
        ring,
    )


def _voltage(film: Film, pull: float) -> float:
    return float(film.unstretched * (pull / film.permittivity) ** 0.5)
