"""Circular diaphragm: a film clamped at r = b under a pressure, electrodes on all of it.

The equations of `meridian` from the apex (l1 = l2 = l0, z' = 0) to the clamp. They are singular at
the apex; the first terms of the series there lead to a small radius. With s1 = s2 = s0, A = ds1/dl1
and B = ds1/dl2 at the apex, the slope is t = k R with k = -p l0^2/(2 H0 s0) and

    l2 = l0 + m R^2,  l1 = l0 + (3 m + l0 k^2/2) R^2,  m = -k^2 (s0 + (3 A - B) l0)/(16 A).

Adkins and Rivlin, Phil. Trans. R. Soc. A 244 (1952) 505, without a voltage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

from verification.references import continuation
from verification.references.laws import Film, derivative, unit_voltage
from verification.references.meridian import Meridian, integrate

_APEX = 3e-3  # radius up to which the series serves, over the outer one


@dataclass(frozen=True)
class Diaphragm:
    """The device as mounted: film and radius, mm."""

    film: Film
    radius: float


@dataclass(frozen=True)
class State:
    """Equilibrium.

    Attributes:
        pressure: MPa.
        voltage: kV.
        apex: l1 = l2 at the apex, since the unstretched state.
        height: Of the apex above the clamp, mm.
        volume: Below the dome, mm^3.
        edge: l1 at the clamp.
        slope: Of the meridian at the clamp, degrees, negative.
        capacitance: nF.
        energy: Elastic, mJ.
        meridian: The shape; z is 0 at the apex.
    """

    pressure: float
    voltage: float
    apex: float
    height: float
    volume: float
    edge: float
    slope: float
    capacitance: float
    energy: float
    meridian: Meridian


def at_pressure(
    diaphragm: Diaphragm, pressure: float, voltage: float = 0.0, step: float = 0.05
) -> State | None:
    """The state reached by raising the pressure at a voltage; None beyond the limit point."""
    lp = diaphragm.film.prestretch
    apex = lp
    if pressure:
        found = continuation.first_root(
            lambda l: _miss(diaphragm, l, pressure, voltage), lp, step * lp, 4 * lp
        )
        if found is None:
            return None
        apex = found
    return _state(diaphragm, apex, pressure, voltage)


def at_apex(diaphragm: Diaphragm, apex: float, voltage: float = 0.0) -> State:
    """The state at a stretch of the apex, of any point of the path at a voltage."""
    film = diaphragm.film
    unit = film.tension(voltage) / diaphragm.radius
    pressure = continuation.first_root(
        lambda p: _miss(diaphragm, apex, p, voltage), 1e-6 * unit, 0.4 * unit, 20 * unit
    )
    if pressure is None:
        raise ArithmeticError(f"no pressure gives the apex a stretch of {apex}")
    return _state(diaphragm, apex, pressure, voltage)


def at_height(diaphragm: Diaphragm, height: float, voltage: float = 0.0) -> State:
    """The state at a height of the apex, mm."""
    b, lp = diaphragm.radius, diaphragm.film.prestretch
    unit = diaphragm.film.tension(voltage) / b
    steps = int(np.ceil(5 * height / b))
    # of a shallow cap: p = 4 T w/b^2, and a stretch of about (2/3)(w/b)^2
    x = np.array([lp * (1 + 2 / 3 * (height / b / steps) ** 2), 4 * height / b / steps])
    for target in height * np.arange(1, steps + 1) / steps:

        def miss(x: np.ndarray, target: float = target) -> np.ndarray:
            end = _integrate(diaphragm, x[0], x[1] * unit, voltage)
            return np.array([end.r[-1] - b, end.z[-1] + target]) / b

        found = root(miss, x, tol=1e-11)
        if np.abs(found.fun).max() > 1e-8:
            raise ArithmeticError(found.message)
        x = found.x
    return _state(diaphragm, float(x[0]), float(x[1] * unit), voltage)


def limit_pressure(diaphragm: Diaphragm, voltage: float, step: float = 0.4) -> State | None:
    """The first limit point of the pressure at a voltage, on the path from the flat state."""
    unit = diaphragm.film.tension() / diaphragm.radius
    start = at_pressure(diaphragm, 0.1 * unit, voltage)
    if start is None:
        raise ArithmeticError("the limit pressure is very small")

    def residual(x: np.ndarray) -> float:
        return _miss(diaphragm, x[0], x[1] * unit, voltage) / diaphragm.radius

    x = next(continuation.limit_points(residual, [start.apex, 0.1], step, 30), None)
    return None if x is None else _state(diaphragm, x[0], x[1] * unit, voltage)


def limit_voltage(diaphragm: Diaphragm, pressure: float, step: float = 0.2) -> State | None:
    """The first limit point of the voltage at a pressure: pull-in of an inflated diaphragm."""
    film = diaphragm.film
    unit = unit_voltage(film.law, film.permittivity, film.thickness)
    start = at_pressure(diaphragm, pressure, 0.02 * unit)
    if start is None:
        raise ArithmeticError("the pressure is beyond its limit point")

    def residual(x: np.ndarray) -> float:
        return _miss(diaphragm, x[0], pressure, x[1] * unit) / diaphragm.radius

    x = next(continuation.limit_points(residual, [start.apex, 0.02], step, 30), None)
    return None if x is None else _state(diaphragm, x[0], pressure, x[1] * unit)


def _integrate(
    diaphragm: Diaphragm, apex: float, pressure: float, voltage: float, *, shape: bool = False
) -> Meridian:
    film = diaphragm.film
    outer = diaphragm.radius / film.prestretch
    d = _APEX * outer
    start = _near_apex(film, d, apex, pressure, voltage)
    at = np.linspace(0.0, outer, 81)[1:-1] if shape else None
    return integrate(
        film, (d, outer), start, apex, voltage=voltage, pressure=pressure, at=at, totals=shape
    )


def _near_apex(
    film: Film, R: float, apex: float, pressure: float, voltage: float
) -> tuple[float, float, float]:
    """r, z and R s1 cos t at a small radius; errors are of the order R^5, R^4, R^5."""
    s0 = float(film.stress(apex, apex, voltage))
    A = derivative(lambda l: film.stress(l, apex, voltage), apex)
    B = derivative(lambda l: film.stress(apex, l, voltage), apex)
    k = -pressure * apex**2 / (2 * film.unstretched * s0)
    m = -(k**2) * (s0 + (3 * A - B) * apex) / (16 * A)
    rise = A * (3 * m + apex * k**2 / 2) + B * m - s0 * k**2 / 2
    return apex * R + m * R**3, apex * k * R**2 / 2, s0 * R + rise * R**3


def _miss(diaphragm: Diaphragm, apex: float, pressure: float, voltage: float) -> float:
    try:
        return float(_integrate(diaphragm, apex, pressure, voltage).r[-1] - diaphragm.radius)
    except ArithmeticError:
        return np.nan


def _state(diaphragm: Diaphragm, apex: float, pressure: float, voltage: float) -> State:
    film = diaphragm.film
    found = _integrate(diaphragm, apex, pressure, voltage, shape=True)
    vertical = -pressure * diaphragm.radius**2 / (2 * film.unstretched)
    cap = np.pi * (_APEX * diaphragm.radius / film.prestretch) ** 2
    return State(
        pressure,
        voltage,
        apex,
        height=float(-found.z[-1]),
        volume=found.volume,
        edge=float(found.l1[-1]),
        slope=float(np.degrees(np.arctan2(vertical, found.radial[-1]))),
        capacitance=found.capacitance + cap * film.permittivity / film.unstretched * apex**4,
        energy=float(found.energy + cap * film.unstretched * film.law(apex, apex)),
        meridian=found,
    )
