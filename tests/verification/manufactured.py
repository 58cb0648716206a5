"""Manufactured solutions: the orders at which the elements converge.

On a patch of the meridian plane u and phi are given; the body force and the charge that belong to
them are the divergences, in cylinder coordinates, of the stress P = dW/dF and of the electric
displacement D = -dW/dE of dealib's own energies, taken by UFL. Added to the potential as one more
energy, they make the given fields the exact solution.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from dealib.config.schema import Config
from dealib.fem import compat
from dealib.fem.energies import MixedHyperelastic, Point, density
from dealib.fem.problem import Problem, build_problem
from verification.bench import Bench, config
from verification.table import Row

EDGES = ["inner", "outer", "film_top", "film_bottom"]
HELD: dict[str, Any] = {
    "mounts": {},
    "holds": [{"on": EDGES, "fix": ["R", "Z"]}],
    "terminals": {"ground": {"on": EDGES, "ground": True}},
}


@dataclass(frozen=True)
class Sources:
    """Work of body force and charge, as an energy (see `dealib.fem.energies.Energy`)."""

    work: Any
    on: str = "film"

    def scalars(self, point: Point) -> tuple[Any, ...]:
        """What the energy depends on."""
        return (self.work,)

    def of(self, work: Any) -> Any:
        """Negative work per mesh volume."""
        return -work


def exact(mesh: Any) -> tuple[Any, Any]:
    """The given u (mm) and phi (kV), zero on the edges of the patch R = 1..2, Z = -1/2..1/2."""
    R, Z = ufl.SpatialCoordinate(mesh)
    bubble = ufl.sin(ufl.pi * (R - 1)) * ufl.cos(ufl.pi * Z)
    u = ufl.as_vector([0.08 * bubble, 0.06 * bubble * (1 + Z) * R])
    return u, 30 * bubble * (2 - R + Z / 2)


def add_sources(problem: Problem) -> None:
    """Add the body force and the charge of the given fields to a problem."""
    mesh, k = problem.domain.mesh, problem.kinematics
    x = ufl.SpatialCoordinate(mesh)
    R, (u, phi) = x[0], exact(mesh)
    F = ufl.variable(k.deformation_gradient(u, x))
    E = ufl.variable(k.nominal_field(phi))
    # the mixed form is given by the energy of its solid: at the exact p they are the same
    parts = [getattr(part, "solid", part) for part in problem.elastic + problem.electric]
    W = sum(density(part, Point(x, u, F, E)) for part in parts)
    P, D = ufl.diff(W, F), -ufl.diff(W, E)
    force = ufl.as_vector(
        [
            -(P[0, 0].dx(0) + P[0, 1].dx(1) + (P[0, 0] - P[2, 2]) / R),
            -(P[1, 0].dx(0) + P[1, 1].dx(1) + P[1, 0] / R),
        ]
    )
    charge = D[0].dx(0) + D[1].dx(1) + D[0] / R  # the work of -charge * phi
    u_h, phi_h = ufl.split(problem.spaces.w)[:2]
    problem.elastic.append(Sources(ufl.dot(force, u_h) - charge * phi_h))


def exact_pressure(problem: Problem) -> Any:
    """The p of the mixed form at the given u: kappa (J - 1), J since the unstretched state."""
    solid = next(part.solid for part in problem.elastic if isinstance(part, MixedHyperelastic))
    mesh = problem.domain.mesh
    F = problem.kinematics.deformation_gradient(exact(mesh)[0], ufl.SpatialCoordinate(mesh))
    J = ufl.det(solid.total(F))
    return solid.parameters.bulk_modulus * (J - 1)


def patch(film: dict[str, Any], cells: int, order: int, mixed: bool = False) -> Config:
    """The patch, with as many cells either way."""
    return config(
        dict(inner_radius=1.0, outer_radius=2.0, film_thickness=1.0),
        film,
        mesh={"columns": cells, "film_rows": cells, "grading": "uniform", "order": order},
        physics={"formulation": "mixed" if mixed else "displacement"},
        **HELD,
    )


def errors(film: dict[str, Any], cells: int, order: int, mixed: bool) -> list[float]:
    """L2 errors of u, phi and, if mixed, p over the norms of the given fields."""
    problem = build_problem(patch(film, cells, order, mixed), MPI.COMM_WORLD)
    problem.set_prestretch(1.0)
    add_sources(problem)
    Bench(problem)
    mesh = problem.domain.mesh
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 10})

    def norm(f: Any) -> float:
        return float(np.sqrt(fem.assemble_scalar(compat.form(ufl.inner(f, f) * dx))))

    wanted = [*exact(mesh), *([exact_pressure(problem)] if mixed else [])]
    pairs = zip(ufl.split(problem.spaces.w), wanted, strict=True)
    return [norm(found - given) / norm(given) for found, given in pairs]


def orders(
    film: dict[str, Any], order: int, cells: tuple[int, int], mixed: bool = False
) -> Iterator[Row]:
    """Measured orders of u, phi and, if mixed, p in the L2 norm between two meshes."""
    coarse, fine = (errors(film, n, order, mixed) for n in cells)
    case = f"manufactured, {film['law']}, order {order}, {cells[0]} to {cells[1]} cells"
    if mixed:
        case += f", mixed, kappa/mu = {film['bulk_modulus'] / film['shear_modulus']:g}"
    theory = {"u": order + 1, "phi": order + 1} | ({"p": order} if mixed else {})
    for (name, expected), before, after in zip(theory.items(), coarse, fine, strict=True):
        measured = float(np.log2(before / after) / np.log2(cells[1] / cells[0]))
        quantity = f"order of {name} in L2, error {after:.1e} of its norm"
        yield Row(case, quantity, expected, measured, 0.15, "theory", "absolute")


NEO_HOOKEAN = {
    "law": "neo_hookean",
    "shear_modulus": 1.0,
    "bulk_modulus": 10.0,
    "prestretch": [1.2, 1.1],
}
MOONEY_RIVLIN = {"law": "mooney_rivlin", "c10": 0.4, "c01": 0.1, "bulk_modulus": 10.0}

neo_hookean = partial(orders, NEO_HOOKEAN, 2, (16, 32))
mooney_rivlin = partial(orders, MOONEY_RIVLIN, 2, (8, 16))
linear = partial(orders, NEO_HOOKEAN, 1, (16, 32))
mixed = partial(orders, NEO_HOOKEAN, 2, (64, 128), mixed=True)  # u comes from a higher order
