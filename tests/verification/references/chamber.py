"""An isothermal chamber of gas with an orifice to the outside.

The mass m = p V/(R T) changes by the flow through the orifice, d(p V)/dt = -R T mdot, where V may
depend on time and on the pressure (a membrane that gives way). From the side of higher pressure pu
to that of pd, with C A the discharge coefficient times the area:

    nozzle (Saint-Venant and Wantzel, 1839; compressible, isentropic in the orifice)
        mdot = C A pu sqrt(2 g/((g - 1) R T) (x^(2/g) - x^((g + 1)/g))),  x = pd/pu,
        choked, x = (2/(g + 1))^(g/(g - 1)), where pd is lower than that;
    incompressible, with the density of the side of higher pressure
        mdot = C A sqrt(2 pu (pu - pd)/(R T)).

Below a relative difference of 1e-7 the flow is taken as linear: a root has no derivative at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

_LINEAR = 1e-7
Volume = Callable[[float, float], float]


@dataclass(frozen=True)
class Orifice:
    """Orifice and gas.

    Attributes:
        area: C A, mm^2.
        outside: Pressure outside, MPa.
        law: See the module.
        ratio: g = cp/cv.
        specific: R T, mm^2/s^2: 287.05 J/(kg K) * 293.15 K.
    """

    area: float
    outside: float = 0.101325
    law: Literal["nozzle", "incompressible"] = "nozzle"
    ratio: float = 1.4
    specific: float = 287.05e6 * 293.15


def flow(orifice: Orifice, pressure: float) -> float:
    """Mass flow out of the chamber, t/s; negative: into it."""
    high, low = max(pressure, orifice.outside), min(pressure, orifice.outside)
    drop = (high - low) / high
    share = np.copysign(min(drop / _LINEAR, 1.0), pressure - orifice.outside)
    drop = max(drop, _LINEAR)
    g, RT = orifice.ratio, orifice.specific
    if orifice.law == "incompressible":
        return float(share * orifice.area * high * np.sqrt(2 * drop / RT))
    x = max(1 - drop, (2 / (g + 1)) ** (g / (g - 1)))
    # x^(2/g) - x^((g+1)/g) without cancellation near x = 1
    inside = -(x ** (2 / g)) * np.expm1((g - 1) / g * np.log(x))
    return float(share * orifice.area * high * np.sqrt(2 * g / ((g - 1) * RT) * inside))


def transient(
    orifice: Orifice, volume: Volume, pressure: float, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure (MPa) and mass (t) at times (s), the first the start.

    Args:
        orifice: Orifice and gas.
        volume: V(t, p), mm^3; it must not shrink as p grows.
        pressure: At the start, MPa.
        times: Growing.
    """
    RT = orifice.specific

    def pressure_of(t: float, mass: float) -> float:
        product = mass * RT
        guess = product / volume(t, orifice.outside)
        low, high = sorted((guess, orifice.outside))
        if high - low < 1e-15 * high:
            return guess
        low, high = low * (1 - 1e-12), high * (1 + 1e-12)
        return float(brentq(lambda p: p * volume(t, p) - product, low, high, xtol=1e-16))

    mass = pressure * volume(times[0], pressure) / RT

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [-flow(orifice, pressure_of(t, y[0] * mass)) / mass]

    done = solve_ivp(rate, (times[0], times[-1]), [1.0], "LSODA", times, rtol=1e-10, atol=1e-12)
    masses = done.y[0] * mass
    pressures = [pressure_of(t, m) for t, m in zip(times, masses, strict=True)]
    return np.array(pressures), masses
