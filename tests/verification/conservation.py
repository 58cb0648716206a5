"""What a potential implies: duals are its derivatives, reciprocity, no net work in a closed cycle.

At equilibrium Pi(U, V) = elastic - electric energy, with F = dPi/dU and Q = -dPi/dV. Derivatives
are central differences of fourth order. The cycle is a rectangle in (U, V); the work of the mount
along its sides of constant V is a Gauss-Legendre integral of F, that of the terminal along the
sides of constant U is [V Q] less that of Q.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from verification.bench import Bench, config
from verification.table import Row

GEOMETRY = {
    "inner_radius": 8.35,
    "outer_radius": 12.35,
    "film_thickness": 0.03,
    "electrode_thickness": 0.01,
}
U, V = -2.0, 2.0  # mm, kV
POINTS = 12


def device(permittivity: Any = 3.0, **geometry: float) -> Bench:
    """A coarse device with electrodes."""
    film = {"law": "neo_hookean", "youngs_modulus": 1.0, "prestretch": 1.15}
    film |= {"relative_permittivity": permittivity}
    electrode = {"law": "mooney_rivlin", "youngs_modulus": 2.0}
    mesh = {"columns": 20, "film_rows": 2, "grading": "ends"}
    materials = {"electrode": electrode}
    solver = {"tolerance": 1e-12}
    given = config(GEOMETRY | geometry, film, materials=materials, mesh=mesh, solver=solver)
    return Bench(given)


def derivative(f: Callable[[float], float], at: float, h: float) -> float:
    """Central difference of fourth order."""
    return (8 * (f(at + h) - f(at - h)) - f(at + 2 * h) + f(at - 2 * h)) / (12 * h)


def by_stretch() -> Iterator[Row]:
    """The same where the permittivity depends on stretch."""
    yield from derivatives({"intercept": 4.15, "slope": -1.0}, ", eps_r = 4.15 - l")


def derivatives(permittivity: Any = 3.0, note: str = "") -> Iterator[Row]:
    """Duals and reciprocity, by finite differences."""
    bench = device(permittivity).move(steps=6, mount=U).move(steps=2, terminal=V)
    force, charge = bench.force, bench.charge
    case, source = f"conservation, U = {U:g} mm, V = {V:g} kV{note}", "finite differences"

    def at(port: str, quantity: str) -> Callable[[float], float]:
        rest = {"mount": U, "terminal": V}
        return lambda x: getattr(bench.move(**{**rest, port: x}), quantity)

    d_U = derivative(at("mount", "potential"), U, 0.02)
    d_V = derivative(at("terminal", "potential"), V, 0.02)
    yield Row(case, "F = dPi/dU, N", d_U, force, 1e-7, source)
    yield Row(case, "Q = -dPi/dV, uC", -d_V, charge, 1e-7, source)
    cross = derivative(at("terminal", "force"), V, 0.02)
    yield Row(
        case, "dF/dV at constant U = -dQ/dU at constant V, N/kV",
        -derivative(at("mount", "charge"), U, 0.02), cross, 1e-7, "reciprocity",
    )  # fmt: skip


def cycle() -> Iterator[Row]:
    """Net work of a closed cycle over its largest elastic energy."""
    bench = device().move(steps=3, mount=-1.0)
    start = bench.force, bench.charge, bench.potential
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    work = largest = 0.0
    corners = [(-1.0, 0.0), (U, 0.0), (U, V), (-1.0, V), (-1.0, 0.0)]
    for (u0, v0), (u1, v1) in pairwise(corners):
        charge = bench.charge
        for x, w in zip(points, weights, strict=True):
            s = (1 + x) / 2
            bench.move(mount=u0 + s * (u1 - u0), terminal=v0 + s * (v1 - v0))
            work += w / 2 * (bench.force * (u1 - u0) - bench.charge * (v1 - v0))
        bench.move(mount=u1, terminal=v1)
        work += v1 * bench.charge - v0 * charge
        largest = max(largest, bench.elastic)
    case = f"closed cycle, U = -1 .. {U:g} mm, V = 0 .. {V:g} kV"
    source = "conservation of energy"
    quantity = "net work of both ports over the elastic energy"
    yield Row(case, quantity, 0.0, work / largest, 1e-8, source, "absolute")
    for text, before, after in zip(
        ("F, N", "Pi, mJ"), start[::2], (bench.force, bench.potential), strict=True
    ):
        yield Row(case, f"{text}, after the cycle", before, after, 1e-9, "itself before")
