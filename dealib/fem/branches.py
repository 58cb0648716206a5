"""Networks beside a law as energies: the potentials of Maxwell branches over a time step.

A time step of a branch ends at C_i = unimodular(H + w C), H and w fixed at its start
(`evolution.Multiplicative`). It is the minimum over unimodular C_i of G/2 tr((C + H/w) C_i^-1),

    3 G / (2 w) det(H + w C)^(1/3).

Its derivative in C is G/2 C_i^-1, the branch's stress. A transient network ends at
C_i^-1 = H + w C^-1, where the term in C^-1 is a pressure: its potential is G/2 tr(H C). So one
potential stands behind each step, no unknown is added, and the tangent is symmetric. Of the network
of a permanent set, whose clock is the law's energy, H is C_i^-1 at the state that the residual is
taken at; what it changes with that state is left out of the tangent.
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
    """A function that holds H and w of all branches at the quadrature points: relaxed ones.

    Args:
        mesh: The mesh.
        degree: Of the quadrature.
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
        modulus: Its shear modulus, as a constant.
        evolution: Of its internal metric.
        terms: The function of `step_terms`.
        index: Its number.
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
        """See `Energy`: det F, H : C, and of another evolution cof(H) : C and H : cof(C)."""
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
    """Cof(A) : B of symmetric matrices: what is linear in B of det(A + B)."""
    trace = ufl.tr(A)
    square = A * A
    return ufl.inner(square - trace * A, B) + (trace**2 - ufl.tr(square)) / 2 * ufl.tr(B)


def network_steps(
    solid: Hyperelastic, networks: tuple[Network, ...], terms: Any, size: int, first: int = 0
) -> list[Energy]:
    """The potentials of a solid's networks, which are those from a first one in the terms."""
    if not networks:
        return []
    mesh = terms.function_space.mesh
    return [
        NetworkStep(solid, constant(mesh, n.shear_modulus), n.evolution, terms, first + i, size)
        for i, n in enumerate(networks)
    ]
