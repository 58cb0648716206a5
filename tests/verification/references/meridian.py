"""The differential equations of a membrane of revolution of any incompressible law.

R is the unstretched radius, (r, z) the meridian, l1 = |(r', z')|, l2 = r/R, t the slope's angle,
and s1, s2 the total nominal stresses of the film (unstretched thickness H0, field V/H0 between
electrodes). A pressure p acts towards +z, following the film; F is an axial force from inside:

    (R s1 cos t)' = s2 + (p/H0) r z',    R s1 sin t = F/(2 pi H0) - (p/H0) r^2/2.

The second is the first integral of the balance along the axis. At each radius l1 follows from s1
and l2. Adkins and Rivlin, Phil. Trans. R. Soc. A 244 (1952) 505, without a voltage.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from verification.references.laws import Film, slope, slopes


@dataclass(frozen=True)
class Meridian:
    """A piece of a membrane, from its inner to its outer radius.

    Attributes:
        R: Unstretched radii, mm, in the order asked for; the last is the outer one.
        r: Radii, mm.
        z: Heights, mm.
        radial: R s1 cos t, N/mm.
        l1: Meridional stretches.
        l2: Hoop stretches.
        s1: Total nominal stresses along the meridian, MPa.
        s2: The same along the hoop.
        capacitance: Of an electrode on the whole piece, nF.
        energy: Elastic, mJ.
        volume: Integral of -pi r^2 dz, mm^3: below a dome, down to its edge.
    """

    R: np.ndarray
    r: np.ndarray
    z: np.ndarray
    radial: np.ndarray
    l1: np.ndarray
    l2: np.ndarray
    s1: np.ndarray
    s2: np.ndarray
    capacitance: float
    energy: float
    volume: float


def meridional_stretch(
    film: Film, stress: float, l2: float, pull: float, near: tuple[float, float]
) -> tuple[float, float]:
    """l1 at a total nominal stress s1 and a hoop stretch, by secants; NaN if there is none.

    `near` is the l1 and the ds1/dl1 to start from; those at the solution are returned.
    """
    l1, stiffness = near
    miss = slope(film.law, l1, l2) - pull * l1 * l2**2 - stress
    if not math.isfinite(miss):
        return math.nan, math.nan
    for _ in range(60):
        change = max(-miss / stiffness, -l1 / 2)
        new = slope(film.law, l1 + change, l2) - pull * (l1 + change) * l2**2 - stress
        while not math.isfinite(new):  # beyond the limit of the law
            if abs(change) < 1e-14 * l1:
                return math.nan, math.nan
            change /= 2
            new = slope(film.law, l1 + change, l2) - pull * (l1 + change) * l2**2 - stress
        if abs(change) > 1e-7 * l1:
            stiffness = (new - miss) / change
        l1, miss = l1 + change, new
        if abs(change) < 1e-11 * l1:
            break
    return l1, stiffness


def integrate(
    film: Film,
    span: tuple[float, float],
    start: tuple[float, float, float],
    guess: float,
    *,
    voltage: float = 0.0,
    force: float = 0.0,
    pressure: float = 0.0,
    at: np.ndarray | None = None,
    totals: bool = True,
) -> Meridian:
    """Integrate outwards.

    Args:
        film: The film.
        span: Inner and outer unstretched radius, mm.
        start: r, z (mm) and R s1 cos t (N/mm) at the inner radius.
        guess: l1 there.
        voltage: kV, between electrodes on the whole piece.
        force: Axial force from inside, N.
        pressure: MPa.
        at: Radii wanted besides the outer one.
        totals: Whether capacitance, energy and volume are wanted; they are NaN otherwise.

    Raises:
        ArithmeticError: If there is no such state.
    """
    pull, thickness = film.pull(voltage), film.unstretched
    axial, push = force / (2 * np.pi * thickness), pressure / thickness
    first = slope(film.law, guess * 1.001, guess) - slope(film.law, guess, guess)
    rest = near = (guess, first / (0.001 * guess))

    def local(R: float, r: float, radial: float) -> tuple[float, ...]:
        nonlocal near
        vertical = axial - push * r * r / 2
        total = math.hypot(radial, vertical) if vertical else radial
        l2 = r / R
        near = meridional_stretch(film, total / R, l2, pull, near)
        if not near[1] > 0:
            raise ArithmeticError(f"the film has no stable stretch at radius {R}")
        cosine, sine = (radial / total, vertical / total) if vertical else (1.0, 0.0)
        return near[0], l2, total / R, cosine, sine

    def rates(R: float, state: np.ndarray) -> list[float]:
        r, _, radial = state[:3].tolist()
        l1, l2, _, cosine, sine = local(R, r, radial)
        s2 = slope(film.law, l2, l1) - pull * l2 * l1**2
        rise = l1 * sine
        balance = [l1 * cosine, rise, s2 + push * r * rise]
        if not totals:
            return balance
        return [*balance, (l1 * l2) ** 2 * R, film.law(l1, l2) * R, -np.pi * r * r * rise]

    wanted = np.append([] if at is None else at, span[1])
    outer = span[1]
    sizes = np.array([outer, outer, outer, outer**2, outer**2, outer**3])
    begin = [*start, 0.0, 0.0, 0.0]
    n = 6 if totals else 3
    done = solve_ivp(rates, span, begin[:n], "DOP853", wanted, rtol=1e-10, atol=1e-13 * sizes[:n])
    if not done.success or not np.isfinite(done.y).all():
        raise ArithmeticError(f"the membrane has no state from {start}: {done.message}")
    r, z, radial = done.y[:3]
    near = rest
    local_values = np.array([local(*x)[:3] for x in zip(wanted, r, radial, strict=True)])
    l1, l2, s1 = local_values.T
    s2 = slopes(film.law, l1, l2)[1] - pull * l2 * l1**2
    squares, energy, volume = done.y[3:, -1] if totals else np.full(3, np.nan)
    return Meridian(
        wanted, r, z, radial, l1, l2, s1, s2,
        capacitance=float(2 * np.pi * film.permittivity / thickness * squares),
        energy=float(2 * np.pi * thickness * energy),
        volume=float(volume),
    )  # fmt: skip
