"""Annular membrane between a rigid disc (radius a) and a frame (radius b), electrodes on all of it.

The disc is pushed along the axis by u; any law. The equations are those of `meridian`, with the
first integral R s1 sin t = F/(2 pi H0). Where u is small the mounted tension T carries the disc:
T (r w')' = 0 gives w = u ln(b/r)/ln(b/a) and F = 2 pi T u/ln(b/a).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

from verification.references import continuation
from verification.references.laws import Film, slopes
from verification.references.meridian import Meridian, integrate


@dataclass(frozen=True)
class Annulus:
    """The device as mounted: film, disc's and frame's radius, mm."""

    film: Film
    inner: float
    outer: float


@dataclass(frozen=True)
class State:
    """Equilibrium.

    Attributes:
        displacement: Of the disc along the axis, mm.
        voltage: kV.
        force: On the disc, along its displacement, N.
        capacitance: nF.
        energy: Elastic, mJ.
        meridian: The shape; z is the distance from the disc, against its displacement.
    """

    displacement: float
    voltage: float
    force: float
    capacitance: float
    energy: float
    meridian: Meridian


def stiffness(annulus: Annulus, voltage: float = 0.0) -> float:
    """F/u at small displacements, N/mm."""
    ratio = annulus.outer / annulus.inner
    return float(2 * np.pi * annulus.film.tension(voltage) / np.log(ratio))


def shape(annulus: Annulus, radius: np.ndarray, displacement: float) -> np.ndarray:
    """Deflection at small displacements, mm, by the mounted radius."""
    share = np.log(annulus.outer / radius) / np.log(annulus.outer / annulus.inner)
    return displacement * share


def capacitance_change(annulus: Annulus, displacement: float) -> float:
    """C(u) - C(0) at small displacements and no voltage to second order in u, nF.

    From reciprocity, Q = -dPi/dV with Pi = K(V) u^2/2 - C(0) V^2/2: -(u^2/2) dK/d(V^2/2).
    """
    film = annulus.film
    slope = -2 * film.permittivity / film.unstretched**2 * film.prestretch**4 * film.thickness
    ratio = annulus.outer / annulus.inner
    return float(-(displacement**2) / 2 * 2 * np.pi * slope / np.log(ratio))


def push(annulus: Annulus, displacement: float, voltage: float = 0.0) -> State:
    """The state at a displacement of the disc, mm, reached from the flat one."""
    film, a, b = annulus.film, annulus.inner, annulus.outer
    steps = int(np.ceil(2 * abs(displacement) / (b - a)))
    flat = film.tension(voltage) / film.tension()
    x = np.array([flat, 0.0])
    for target in displacement * np.arange(1, steps + 1) / max(steps, 1):
        if x[1] == 0:
            x[1] = flat * target / (a * np.log(b / a))

        def miss(x: np.ndarray, target: float = target) -> np.ndarray:
            end = _run(annulus, x[0], x[1], voltage)
            return np.array([end.r[-1] - b, end.z[-1] - target]) / a

        found = root(miss, x, tol=1e-11)
        if np.abs(found.fun).max() > 1e-8:
            raise ArithmeticError(found.message)
        x = found.x
    return _state(annulus, x[0], x[1], voltage)


def tension_loss(annulus: Annulus, force: float) -> State:
    """The state under a dead load on the disc (N) in which the film begins to wrinkle at the disc.

    Raising the voltage, the hoop tension vanishes there (s2 = 0, l2 = lp) before any limit point of
    the voltage is met. Its l1 gives the voltage and s1; it is found such that r = b at the frame.
    """
    film, lp = annulus.film, annulus.film.prestretch
    across = 2 * np.pi * film.unstretched * annulus.inner / lp

    def pulled(l1: float) -> tuple[float, float]:  # force along the meridian, voltage
        W1, W2 = slopes(film.law, l1, lp)
        pull = W2 / (lp * l1**2)
        return across * (W1 - W2 * lp / l1), film.unstretched * (pull / film.permittivity) ** 0.5

    def arguments(l1: float) -> tuple[float, float, float]:
        along, voltage = pulled(l1)
        scale = _scale(annulus)
        return max(along**2 - force**2, 0.0) ** 0.5 / scale, force / scale, voltage

    def miss(l1: float) -> float:
        try:
            return float(_run(annulus, *arguments(l1)).r[-1] - annulus.outer)
        except ArithmeticError:  # with little tension the film does not come as far as the frame
            return -annulus.outer

    upright = continuation.first_root(lambda l1: pulled(l1)[0] - force, lp, 0.02 * lp, 9 * lp)
    found = None
    if upright is not None:
        found = continuation.first_root(miss, upright + 1e-9, 0.02 * lp, 9 * lp)
    if found is None:
        raise ArithmeticError(f"the film does not carry {force} N where it begins to wrinkle")
    return _state(annulus, *arguments(found))


def _scale(annulus: Annulus) -> float:
    """2 pi a T without a voltage, N."""
    return 2 * np.pi * annulus.inner * annulus.film.tension()


def _run(
    annulus: Annulus, radial: float, axial: float, voltage: float, at: np.ndarray | None = None
) -> Meridian:
    """The shape by the film's radial and axial force at the disc, over 2 pi a T."""
    film, lp = annulus.film, annulus.film.prestretch
    A, B = annulus.inner / lp, annulus.outer / lp
    scale = _scale(annulus)
    start = (annulus.inner, 0.0, radial * scale / (2 * np.pi * film.unstretched))
    loads = {"voltage": voltage, "force": axial * scale}
    return integrate(film, (A, B), start, lp, **loads, at=at, totals=at is not None)


def _state(annulus: Annulus, radial: float, axial: float, voltage: float) -> State:
    lp = annulus.film.prestretch
    at = np.linspace(annulus.inner / lp, annulus.outer / lp, 41)[:-1]
    end = _run(annulus, radial, axial, voltage, at)
    force = axial * _scale(annulus)
    return State(float(end.z[-1]), voltage, force, end.capacitance, end.energy, end)
