"""Unimorph in plane strain: an active layer on a passive one, bent by a voltage; any laws.

Small strain (`curvature`): both layers have the plane-strain modulus 4 G, the active one also the
total stress -eps E^2 (the whole, since its faces are free of total traction); force and moment of
the section vanish. This is Timoshenko's bimetal, J. Opt. Soc. Am. 11 (1925) 233.

Finite bending (`bend`; Rivlin, Proc. R. Soc. A 195 (1949) 463): X counts from the interface into
the active layer, k is the angle a unit of unstretched length, r^2 = (li^2 + 2 k X)/k^2 = q/k^2,
lt^2 = q, lr = 1/lt, e = V/(r ln(r2/r1)) in the active layer, S = st - sr = lt W_t(lt, 1) - eps e^2.
Free faces and no moment:  int S/q dX = 0,  int S dX = 0;  the first makes the net force vanish too.
The active layer is on the convex side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

from verification.references import continuation
from verification.references.laws import Energy, in_range, shear_modulus, slope, unit_voltage

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)


@dataclass(frozen=True)
class Unimorph:
    """Laws (MPa) and thicknesses (mm) of the active and the passive layer, permittivity."""

    active: Energy
    passive: Energy
    h1: float
    h2: float
    permittivity: float = 1.0


@dataclass(frozen=True)
class State:
    """Finite bending.

    Attributes:
        voltage: kV.
        k: Angle a unit of unstretched length, 1/mm.
        stretch: Of the interface, li.
        curvature: Of the interface as bent, k/li, 1/mm.
        middle: Stretch lt in the middle of the active layer.
        capacitance: A unit of unstretched area, nF/mm^2.
        energy: Elastic, a unit of unstretched area, MPa mm.
    """

    voltage: float
    k: float
    stretch: float
    curvature: float
    middle: float
    capacitance: float
    energy: float


def curvature(unimorph: Unimorph, voltage: float) -> float:
    """Small-strain curvature, 1/mm, by Timoshenko's formula with the free strain eps E^2/(4 G1)."""
    G1, G2 = shear_modulus(unimorph.active), shear_modulus(unimorph.passive)
    strain = unimorph.permittivity * (voltage / unimorph.h1) ** 2 / (4 * G1)
    m, n, h = unimorph.h1 / unimorph.h2, G1 / G2, unimorph.h1 + unimorph.h2
    lower = 3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n))
    return float(6 * strain * (1 + m) ** 2 / (h * lower))


def laminate(unimorph: Unimorph, voltage: float, poisson: float = 0.5) -> float:
    """The same curvature from the layers' moments, at any Poisson's ratio.

    With nu < 1/2 the modulus is 2 G/(1 - nu) and the active stress eps E^2/(2 (1 - nu)): the free
    faces leave the elastic thickness stress -eps E^2/2, of which nu/(1 - nu) acts along the layer.
    """
    G1, G2 = shear_modulus(unimorph.active), shear_modulus(unimorph.passive)
    h1, h2 = unimorph.h1, unimorph.h2
    y = 2 / (1 - poisson)
    stress = unimorph.permittivity * (voltage / h1) ** 2 / (2 * (1 - poisson))
    stretch = y * (G1 * h1 + G2 * h2)
    mixed = y * (G1 * h1**2 - G2 * h2**2) / 2
    bend = y * (G1 * h1**3 + G2 * h2**3) / 3
    return float(
        np.linalg.solve([[stretch, mixed], [mixed, bend]], [stress * h1, stress * h1**2 / 2])[1]
    )


def bend(unimorph: Unimorph, voltage: float, steps: int = 4) -> State:
    """The state reached by raising the voltage."""
    x = np.array([1e-9, 1.0])
    for V in voltage * np.arange(1, steps + 1) / steps:
        guess = [max(x[0], curvature(unimorph, V)), x[1]]
        found = root(lambda x, V=V: _residual(unimorph, x[0], x[1], V), guess, tol=1e-13)
        if np.abs(found.fun).max() > 1e-10:
            raise ArithmeticError(found.message)
        x = found.x
    return _state(unimorph, float(x[0]), float(x[1]), voltage)


def limit_point(unimorph: Unimorph, step: float = 0.1, count: int = 60) -> State | None:
    """The first limit point of the voltage, by continuation; None if there is none on the path."""
    unit = unit_voltage(unimorph.active, unimorph.permittivity, unimorph.h1)
    h = unimorph.h1 + unimorph.h2
    start = bend(unimorph, 0.05 * unit)

    def residual(x: np.ndarray) -> list[float]:
        return _residual(unimorph, x[0] / h, x[1], x[2] * unit)

    def inside(x: np.ndarray) -> bool:
        return in_range(unimorph.active, np.sqrt(x[1] ** 2 + 2 * x[0] * unimorph.h1 / h), 1.0)

    path = [start.k * h, start.stretch, 0.05]
    x = next(continuation.limit_points(residual, path, step, count, inside), None)
    return None if x is None else _state(unimorph, x[0] / h, float(x[1]), float(x[2] * unit))


def energy(unimorph: Unimorph, k: float, stretch: float) -> float:
    """Elastic energy a unit of unstretched area, MPa mm."""
    total = 0.0
    for law, X, w in _layers(unimorph):
        lt = np.sqrt(stretch**2 + 2 * k * X)
        total += float(w @ law(lt, np.ones_like(lt)))
    return total


def capacitance(unimorph: Unimorph, k: float, stretch: float) -> float:
    """A unit of unstretched area, nF/mm^2: eps k/ln(r2/r1)."""
    # ln(1 + x)/k has the limit h1/li^2 for a flat layer
    log = np.log1p(2 * k * unimorph.h1 / stretch**2) / 2
    return float(unimorph.permittivity * k / log)


def _layers(unimorph: Unimorph) -> tuple[tuple[Energy, np.ndarray, np.ndarray], ...]:
    h1, h2 = unimorph.h1, unimorph.h2
    return (
        (unimorph.active, h1 / 2 * (1 + _NODES), h1 / 2 * _WEIGHTS),
        (unimorph.passive, -h2 / 2 * (1 + _NODES), h2 / 2 * _WEIGHTS),
    )


def _residual(unimorph: Unimorph, k: float, stretch: float, voltage: float) -> list[float]:
    """The two integrals over G1 h1 and G1 h1^2, the second less its part in the first."""
    G1, h1 = shear_modulus(unimorph.active), unimorph.h1
    log = np.log1p(2 * k * h1 / stretch**2) / 2
    force = moment = 0.0
    for n, (law, X, w) in enumerate(_layers(unimorph)):
        q = stretch**2 + 2 * k * X
        lt = np.sqrt(q)
        S = lt * slope(law, lt, np.ones_like(lt))
        if n == 0:
            S = S - unimorph.permittivity * (voltage * k / log) ** 2 / q
        force += float(w @ (S / q))
        moment += float(w @ (S / q * X))  # int S dX = li^2 int S/q dX + 2 k int X S/q dX
    return [force / (G1 * h1), moment / (G1 * h1**2)]


def _state(unimorph: Unimorph, k: float, stretch: float, voltage: float) -> State:
    return State(
        voltage,
        k,
        stretch,
        curvature=k / stretch,
        middle=float(np.sqrt(stretch**2 + k * unimorph.h1)),
        capacitance=capacitance(unimorph, k, stretch),
        energy=energy(unimorph, k, stretch),
    )
