"""Preformed conical membrane between a rigid plate (radius a) and a frame (radius b), of any law.

It is free of stress as a cone of height h; a force F pulls the plate along the axis, away from the
frame. S counts along the unstretched generator from the plate, R = a + S (b - a)/L with its length
L, l1 = |(r', z')|, l2 = r/R, and s1, s2 are the total nominal stresses of a film of thickness H:

    (R s1 cos t)' = s2,    R s1 sin t = F/(2 pi H),    r(0) = a, r(L) = b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from verification.references.laws import Film, shear_modulus
from verification.references.meridian import meridional_stretch


@dataclass(frozen=True)
class Cone:
    """The device as moulded: film (without pre-stretch), both radii and the height, mm."""

    film: Film
    inner: float
    outer: float
    height: float


@dataclass(frozen=True)
class State:
    """Displacement of the plate (mm), capacitance (nF), elastic energy (mJ)."""

    displacement: float
    capacitance: float
    energy: float


def pull(cone: Cone, force: float, voltage: float = 0.0) -> State:
    """The state under a force on the plate, N, larger than 0."""
    film, a, b = cone.film, cone.inner, cone.outer
    length = float(np.hypot(b - a, cone.height))
    axial, field = force / (2 * np.pi * film.thickness), film.pull(voltage)
    modulus = shear_modulus(film.law)

    def run(radial: float) -> np.ndarray:
        near = [1.0, 4 * modulus]

        def slopes(S: float, y: np.ndarray) -> list[float]:
            r, _, N = y[:3]
            R = a + S * (b - a) / length
            T = float(np.hypot(N, axial))
            l2 = r / R
            near[:] = meridional_stretch(film, T / R, l2, field, (near[0], near[1]))
            l1 = near[0]
            hoop = film.stress(l2, l1, voltage)
            circle = 2 * np.pi * R
            return [
                *(l1 * N / T, l1 * axial / T, hoop),
                circle * film.permittivity / film.thickness * (l1 * l2) ** 2,
                circle * film.thickness * film.law(l1, l2),
            ]

        start = [a, 0.0, radial, 0.0, 0.0]
        return solve_ivp(slopes, (0, length), start, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]

    along = axial * (b - a) / cone.height  # of a film in the generator's direction
    radial = brentq(lambda N: run(N)[0] - b, 0.1 * along, 1.2 * along, xtol=1e-13 * along)
    _, z, _, capacitance, energy = run(radial)
    return State(float(z - cone.height), float(capacitance), float(energy))
