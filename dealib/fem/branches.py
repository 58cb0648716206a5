"""Incremental potentials of networks: Maxwell branches over a time step, and permanent set.

A time step of a branch ends at C_i = unimodular(H + w C), with H and w fixed at its start (see
`evolution.Multiplicative`). This C_i minimises G/2 tr((C + H/w) C_i^-1) over unimodular tensors;
the minimum,

    3 G / (2 w) det(H + w C)^(1/3),

is the branch's potential: its derivative by C is G/2 C_i^-1, the branch's stress. A transient
network ends at C_i^-1 = H + w C^-1, where the term in C^-1 is a pressure; its potential is
G/2 tr(H C). So no unknown is added, and the tangent is symmetric. For the network of a permanent
set, whose clock is the law's energy, H is C_i^-1 at the state of the residual; the derivative of H
by that state is left out of the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from dealib.fem import compat
from dealib.fem.energies import Energy, Hyperelastic, Point, Scalars, constant
from dealib.materials.branches import Network
from dealib.materials.evolution import INDICES


def step_terms(mesh: Any, degree: int, branches: int, size: int) -> Any:
    """A function for H and w of all branches at the quadrature points, with relaxed branches.

    Args:
        mesh: The mesh.
        degree: Quadrature degree.
        branches: Number of branches.
        size: Number of packed components of H (see `materials.evolution`).
    """
    element = compat.quadrature_element(mesh, degree, (size + 1) * branches)
    terms = fem.Function(compat.functionspace(mesh, element), name="branches")
    terms.x.array.reshape(-1, size + 1)[:] = [*np.zeros(size), 1]
    return terms


@dataclass(frozen=True)
class NetworkStep:
    """The potential of one network over a step.

    Attributes:
        solid: The solid that it belongs to.
        modulus: Its shear modulus, MPa, as a constant.
        evolution: Name of the evolution of its internal metric.
        terms: The function of `step_terms`.
        index: Number of the network in `terms`.
        size: Number of packed components.
    """

    solid: Hyperelastic
    modulus: Any
    evolution: str
    terms: Any
    index: int
    size: int

    @property
    def on(self) -> str:
        """See `Energy`."""
        return self.solid.on

    @property
    def _weight(self) -> Any:
        return self.terms[(self.size + 1) * self.index + self.size]

    def scalars(self, point: Point) -> Scalars:
        """See `Energy`: det F and H : C; or det F, cof(H) : C, H : cof(C) and det H."""
        first = (self.size + 1) * self.index
        known = {INDICES[k]: self.terms[first + k] for k in range(self.size)}
        H = ufl.as_matrix(
            [[known.get((min(i, j), max(i, j)), 0) for j in range(3)] for i in range(3)]
        )
        total = self.solid.total(point.F)
        C, J = total.T * total, ufl.det(total)
        if self.evolution == "network":
            return J, ufl.inner(H, C)
        return J, _mixed(H, C), _mixed(C, H), ufl.det(H)

    def of(self, *scalars: Any) -> Any:
        """See `Energy`."""
        J, first = scalars[:2]
        q = J ** (-2.0 / 3.0)
        if self.evolution == "network":
            return self.modulus / 2 * q * first / self.solid.volume
        _, _, second, rest = scalars
        s = q * self._weight  # det(H + s C) as a cubic in s
        det = rest + s * (first + s * (second + s * J * J))
        return 1.5 * self.modulus / self._weight * det ** (1.0 / 3.0) / self.solid.volume


def _mixed(A: Any, B: Any) -> Any:
    """Cof(A) : B of symmetric matrices, the part of det(A + B) that is linear in B."""
    trace = ufl.tr(A)
    square = A * A
    return ufl.inner(square - trace * A, B) + (trace**2 - ufl.tr(square)) / 2 * ufl.tr(B)


def network_steps(
    solid: Hyperelastic, networks: tuple[Network, ...], terms: Any, size: int, first: int = 0
) -> list[Energy]:
    """The potentials of a solid's networks.

    Args:
        solid: The solid.
        networks: Their parameters.
        terms: The function of `step_terms`.
        size: Number of packed components.
        first: Number of the first network in `terms`.
    """
    if not networks:
        return []
    mesh = terms.function_space.mesh
    return [
        NetworkStep(solid, constant(mesh, n.shear_modulus), n.evolution, terms, first + i, size)
        for i, n in enumerate(networks)
    ]
