"""A free block, stretched equally in its plane by a voltage across it.

An annulus with free ends, whose film faces are the electrodes, deforms homogeneously. Its stretches
l (in the plane) and lz (across) make the potential stationary,

    W(l, l, lz) - (eps/2) (V/H)^2 l^2 / lz,

two equations that scipy solves here for the same bulk modulus. In the incompressible limit
phi~^2 = (V/H)^2 eps/mu = l^-2 - l^-8 (neo-Hooke), with its peak, the pull-in voltage, beyond which
the block is followed by its charge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar, root

from dealib.units import EPSILON_0
from verification.bench import Bench, config
from verification.table import Row

RADII, THICKNESS, MU = (5.0, 10.0), 0.5, 1.0
EPSILON = 3 * EPSILON_0
FREE: dict[str, Any] = {"mounts": {}, "holds": [{"on": "film_bottom", "fix": "Z"}]}


@dataclass(frozen=True)
class Rubber:
    """A law of the block with the shear modulus MU.

    Attributes:
        name: As the table shows it.
        isochoric: Its energy by the isochoric invariants I1 and I2, without the volumetric part.
        given: Its parameters as in a config, MPa.
        stiffening: phi~^2 over the neo-Hookean l^-2 - l^-8, by l, when incompressible.
        permittivity: Relative permittivity at l = 0 and its slope; 3 at rest.
    """

    name: str
    isochoric: Callable[[Any, Any], Any]
    given: dict[str, Any]
    stiffening: Callable[[float], float]
    permittivity: tuple[float, float] = (3.0, 0.0)

    def gain(self, l: Any) -> Any:
        """Permittivity over that at rest."""
        a, b = self.permittivity
        return (a + b * l) / 3


def mooney_rivlin_of(second: float) -> Rubber:
    """Mooney-Rivlin (neo-Hookean at 0) by the share of the second constant in mu/2."""
    c10, c01 = MU / 2 * (1 - second), MU / 2 * second
    given = {"law": "mooney_rivlin", "c10": c10, "c01": c01}
    if second == 0:
        given = {"law": "neo_hookean", "shear_modulus": MU}
    return Rubber(
        f"Mooney-Rivlin C2/(C1+C2) = {second:g}" if second else "neo-Hooke",
        lambda I1, I2: c10 * (I1 - 3) + c01 * (I2 - 3),
        given,
        lambda l: 1 - second + second * l**2,
    )


def gent_of(limit: float) -> Rubber:
    """Gent's law by the limit of I1 - 3."""
    return Rubber(
        f"Gent J_lim = {limit:g}",
        lambda I1, I2: -MU / 2 * limit * np.log(1 - (I1 - 3) / limit),
        {"law": "gent", "shear_modulus": MU, "j_lim": limit},
        lambda l: limit / (limit + 3 - 2 * l**2 - l**-4),
    )


def by_stretch(a: float, b: float) -> Rubber:
    """Neo-Hookean with the permittivity a + b l.

    At a given voltage W - (eps/2) (V/H)^2 l^4 is stationary, with W' = 2 mu (l - l^-5).
    """
    return replace(
        mooney_rivlin_of(0.0),
        name=f"neo-Hooke, eps_r = {a:g} - {-b:g} l",
        permittivity=(a, b),
        stiffening=lambda l: 3 / (a + b * l + b * l / 4),
    )


def closed_form(
    rubber: Rubber, kappa: float, charge: float, start: float
) -> tuple[float, float, float]:
    """Voltage (kV), stretch l and C/C0 of the block at a charge (uC), searched from a stretch."""
    area = np.pi * (RADII[1] ** 2 - RADII[0] ** 2)

    def capacitance(l: Any, lz: Any) -> Any:
        return EPSILON * rubber.gain(l) * area / THICKNESS * l * l / lz

    def energy(l: Any, lz: Any) -> Any:  # elastic and electric at a given charge
        J, trace = l * l * lz, 2 * l * l + lz * lz
        minors = l**4 + 2 * l * l * lz * lz
        w = rubber.isochoric(J ** (-2 / 3) * trace, J ** (-4 / 3) * minors)
        w += kappa / 2 * (J - 1) ** 2
        return area * THICKNESS * w + charge**2 / (2 * capacitance(l, lz))

    def forces(x: Any) -> list[float]:
        h = 1e-30
        return [energy(x[0] + 1j * h, x[1]).imag / h, energy(x[0], x[1] + 1j * h).imag / h]

    found = root(forces, [start, start**-2], tol=1e-13)
    l, lz = found.x
    assert np.abs(found.fun).max() < 1e-9 * kappa * area * THICKNESS, found.message
    return charge / capacitance(l, lz), float(l), float(rubber.gain(l) * l * l / lz)


def block(rubber: Rubber, kappa: float) -> Bench:
    """The block in finite elements."""
    a, b = rubber.permittivity
    permittivity = {"intercept": a, "slope": b} if b else a
    given = config(
        dict(inner_radius=RADII[0], outer_radius=RADII[1], film_thickness=THICKNESS),
        rubber.given | {"bulk_modulus": kappa, "relative_permittivity": permittivity},
        mesh={"columns": 4, "film_rows": 1, "grading": "uniform"},
        **FREE,
    )
    return Bench(given)


def normalised(voltage: float) -> float:
    """phi~ = (V/H) sqrt(eps/mu)."""
    return float(voltage / THICKNESS * np.sqrt(EPSILON / MU))


def charge_at(phi: float, stretch: float) -> float:
    """Charge of the incompressible block at phi~ and l, uC."""
    area = np.pi * (RADII[1] ** 2 - RADII[0] ** 2)
    return float(phi * np.sqrt(MU * EPSILON) * area * stretch**4)


def stretch(bench: Bench) -> float:
    """In-plane stretch, from the displacement of the outer end."""
    return 1 + bench.largest("u_R", "outer") / RADII[1]


def _rows(rubber: Rubber, top_of: tuple[float, float]) -> Iterator[Row]:
    name, (phi_peak, l_peak) = rubber.name, top_of
    # the compressible closed form at the same bulk modulus, before, at and beyond the peak
    kappa = 50.0
    bench = block(rubber, kappa)
    for l in (1.15, 1.26, 1.6):
        phi = np.sqrt((l**-2 - l**-8) * rubber.stiffening(l))
        charge = charge_at(phi, l) * rubber.gain(l)
        bench.load(terminal=charge)
        voltage, exact, gain = closed_form(rubber, kappa, charge, l)
        case = f"free block, {name}, kappa/mu = 50, l = {exact:.3f}"
        computed = charge / bench.voltage / (EPSILON * np.pi * 75 / THICKNESS)
        for quantity, reference, value in (
            ("phi~", normalised(voltage), normalised(bench.voltage)),
            ("stretch l", exact, stretch(bench)),
            ("C/C0", gain, computed),
        ):
            yield Row(case, quantity, reference, value, 1e-6, "homogeneous state, scipy")
    # the incompressible limit and its peak
    bench = block(rubber, 1e5)
    top = charge_at(phi_peak, l_peak) * rubber.gain(l_peak)

    def drop(charge: float) -> float:
        return -normalised(bench.load(terminal=charge).voltage)

    best = minimize_scalar(drop, bounds=(0.9 * top, 1.1 * top), method="bounded")
    case = f"free block, {name}, kappa/mu = 1e5"
    yield Row(case, "peak phi~", phi_peak, -best.fun, 1e-5, "closed form, incompressible")
    bench.load(terminal=top)
    for quantity, reference, value in (
        ("l at the peak's charge", l_peak, stretch(bench)),
        (
            "C/C0 at the peak's charge",
            l_peak**4 * rubber.gain(l_peak),
            top / bench.voltage / charge_at(1, 1) * _kv(),
        ),
    ):
        yield Row(case, quantity, reference, value, 2e-5, "closed form, incompressible")


def peak(rubber: Rubber) -> tuple[float, float]:
    """Peak of phi~ over l, and where it is, in the incompressible limit."""
    found = minimize_scalar(
        lambda l: -(l**-2 - l**-8) * rubber.stiffening(l),
        bounds=(1.05, 2),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return float(np.sqrt(-found.fun)), float(found.x)


def _kv() -> float:
    return THICKNESS * float(np.sqrt(MU / EPSILON))  # voltage of phi~ = 1


neo_hookean = partial(_rows, mooney_rivlin_of(0.0), (0.687365, 2 ** (1 / 3)))
mooney_rivlin = partial(_rows, mooney_rivlin_of(0.2), (0.731118, 1.32077))
permittivity = partial(_rows, by_stretch(3.5, -0.5), peak(by_stretch(3.5, -0.5)))
gent = partial(_rows, gent_of(90.0), (0.689590, 1.26426))
