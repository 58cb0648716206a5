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
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.optimize import minimize_scalar, root

from dealib.fem.device import build_device
from dealib.fem.problem import problem_on
from dealib.geometry import names
from dealib.geometry.supports import Support
from dealib.units import EPSILON_0
from verification.bench import Bench, config
from verification.table import Row

RADII, THICKNESS, MU = (5.0, 10.0), 0.5, 1.0
EPSILON = 3 * EPSILON_0
FREE = [
    Support("u_Z", names.FILM_BOTTOM),
    Support("phi", names.FILM_TOP, "terminal"),
    Support("phi", names.FILM_BOTTOM),
]
Energy = Callable[[Any, Any, float], Any]


def law(second: float, kappa: float) -> dict[str, Any]:
    """Parameters: the share of the second Mooney-Rivlin constant in mu/2, the bulk modulus."""
    if second == 0:
        return {"law": "neo_hookean", "shear_modulus": MU, "bulk_modulus": kappa}
    c10, c01 = MU / 2 * (1 - second), MU / 2 * second
    return {"law": "mooney_rivlin", "c10": c10, "c01": c01, "bulk_modulus": kappa}


def closed_form(
    second: float, kappa: float, charge: float, start: float
) -> tuple[float, float, float]:
    """Voltage (kV), stretch l and C/C0 of the block at a charge (uC), searched from a stretch."""
    area = np.pi * (RADII[1] ** 2 - RADII[0] ** 2)

    def capacitance(l: Any, lz: Any) -> Any:
        return EPSILON * area / THICKNESS * l * l / lz

    def energy(l: Any, lz: Any) -> Any:  # elastic and electric at a given charge
        J, trace = l * l * lz, 2 * l * l + lz * lz
        minors = l**4 + 2 * l * l * lz * lz
        w = MU / 2 * (1 - second) * (J ** (-2 / 3) * trace - 3)
        w += MU / 2 * second * (J ** (-4 / 3) * minors - 3) + kappa / 2 * (J - 1) ** 2
        return area * THICKNESS * w + charge**2 / (2 * capacitance(l, lz))

    def forces(x: Any) -> list[float]:
        h = 1e-30
        return [energy(x[0] + 1j * h, x[1]).imag / h, energy(x[0], x[1] + 1j * h).imag / h]

    found = root(forces, [start, start**-2], tol=1e-13)
    l, lz = found.x
    assert np.abs(found.fun).max() < 1e-9 * kappa * area * THICKNESS, found.message
    return charge / capacitance(l, lz), float(l), float(l * l / lz)


def block(second: float, kappa: float) -> Bench:
    """The block in finite elements."""
    given = config(
        dict(inner_radius=RADII[0], outer_radius=RADII[1], film_thickness=THICKNESS),
        law(second, kappa),
        mesh={"columns": 4, "film_rows": 1, "grading": "uniform"},
    )
    return Bench(problem_on(build_device(given, MPI.COMM_WORLD), given, FREE))


def normalised(voltage: float) -> float:
    """phi~ = (V/H) sqrt(eps/mu)."""
    return float(voltage / THICKNESS * np.sqrt(EPSILON / MU))


def charge_at(phi: float, stretch: float) -> float:
    """Charge of the incompressible block at phi~ and l, uC."""
    area = np.pi * (RADII[1] ** 2 - RADII[0] ** 2)
    return float(phi * np.sqrt(MU * EPSILON) * area * stretch**4)


def stretch(bench: Bench) -> float:
    """In-plane stretch, from the displacement of the outer end."""
    return 1 + bench.largest("u_R", names.OUTER) / RADII[1]


def _rows(name: str, second: float, peak: tuple[float, float]) -> Iterator[Row]:
    phi_peak, l_peak = peak
    # the compressible closed form at the same bulk modulus, before, at and beyond the peak
    kappa = 50.0
    bench = block(second, kappa)
    for l in (1.15, 1.26, 1.6):
        phi = np.sqrt((l**-2 - l**-8) * (1 - second + second * l**2))
        charge = charge_at(phi, l)
        bench.load(terminal=charge)
        voltage, exact, gain = closed_form(second, kappa, charge, l)
        case = f"free block, {name}, kappa/mu = 50, l = {exact:.3f}"
        computed = charge / bench.voltage / (EPSILON * np.pi * 75 / THICKNESS)
        for quantity, reference, value in (
            ("phi~", normalised(voltage), normalised(bench.voltage)),
            ("stretch l", exact, stretch(bench)),
            ("C/C0", gain, computed),
        ):
            yield Row(case, quantity, reference, value, 1e-6, "homogeneous state, scipy")
    # the incompressible limit and its peak
    bench = block(second, 1e5)
    top = charge_at(phi_peak, l_peak)

    def drop(charge: float) -> float:
        return -normalised(bench.load(terminal=charge).voltage)

    best = minimize_scalar(drop, bounds=(0.9 * top, 1.1 * top), method="bounded")
    case = f"free block, {name}, kappa/mu = 1e5"
    yield Row(case, "peak phi~", phi_peak, -best.fun, 1e-5, "closed form, incompressible")
    bench.load(terminal=top)
    for quantity, reference, value in (
        ("l at the peak's charge", l_peak, stretch(bench)),
        ("C/C0 at the peak's charge", l_peak**4, top / bench.voltage / charge_at(1, 1) * _kv()),
    ):
        yield Row(case, quantity, reference, value, 2e-5, "closed form, incompressible")


def _kv() -> float:
    return THICKNESS * float(np.sqrt(MU / EPSILON))  # voltage of phi~ = 1


neo_hookean = partial(_rows, "neo-Hooke", 0.0, (0.687365, 2 ** (1 / 3)))
mooney_rivlin = partial(_rows, "Mooney-Rivlin C2/(C1+C2) = 0.2", 0.2, (0.731118, 1.32077))
