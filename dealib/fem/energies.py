"""Energies of regions and of faces; their sum is the potential that the solver makes stationary.

An energy takes a point of the body and gives its density per mesh volume or mesh area. Composing
energies is all that it takes to model a device.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from dealib.materials.laws import Invariants, Law


@dataclass(frozen=True)
class Point:
    """A point of the body, as UFL expressions.

    Attributes:
        x: Position in the mesh, of the mesh's axes.
        u: Displacement, of the mesh's axes.
        F: Deformation gradient from the mesh, (3, 3).
        E: Nominal field -Grad phi, (3,), kV/mm.
        N: Outer normal of a face in the mesh, (3,); None inside.
        area: Deformed area of a face per area of the mesh, (3,), outwards; None inside.
        principal: Whether the last component's direction is a principal one, as it is but in solids
            of three dimensions.
    """

    x: Any
    u: Any
    F: Any
    E: Any
    N: Any = None
    area: Any = None
    principal: bool = True


class Energy(Protocol):
    """One part of the potential."""

    @property
    def on(self) -> str:
        """Group of regions, or boundary, that it lives on."""

    def density(self, point: Point) -> Any:
        """Energy per mesh volume (MPa = mJ/mm^3) or per mesh area (N/mm)."""


def constant(mesh: Any, value: Any) -> Any:
    """A number, or an array of them, that forms refer to without being compiled for it."""
    return fem.Constant(mesh, np.array(value, dtype=PETSc.ScalarType))


def parameters(mesh: Any, law: Law) -> SimpleNamespace:
    """A law's parameters as constants."""
    values = {k: constant(mesh, v) for k, v in law.parameters.items()}
    return SimpleNamespace(**values, **law.fixed)


def invariants(F: Any, principal: bool = True) -> Invariants:
    """Isochoric invariants of a (3, 3) deformation gradient in UFL.

    Args:
        F: The deformation gradient.
        principal: Whether the last component's direction is known to be a principal one.
    """
    J = ufl.det(F)
    C = F.T * F
    trace = ufl.tr(C)
    a = J ** (-2.0 / 3.0)
    hoop = a * C[2, 2] if principal else None
    return Invariants(a * trace, a**2 * (trace**2 - ufl.inner(C, C)) / 2, J, hoop)


@dataclass(frozen=True)
class Hyperelastic:
    """A law on regions, optionally pre-stretched: W(F F_p) / det F_p.

    Attributes:
        on: Group of regions.
        law: The law.
        parameters: Its parameters, as constants.
        prestretch: Stretches of F_p along the components, as a constant; None for none.
    """

    on: str
    law: Law
    parameters: SimpleNamespace
    prestretch: Any = None

    def density(self, point: Point) -> Any:
        """See `Energy`."""
        i = invariants(self.total(point.F), point.principal)
        return self.law.energy(i, self.parameters) / self.volume

    def extension(self, point: Point) -> Any:
        """Share of the law's extensibility that is used (see `Law.extension`)."""
        return self.law.extension(invariants(self.total(point.F)), self.parameters)

    @property
    def volume(self) -> Any:
        """Mesh volume per unstretched volume, det F_p."""
        p = self.prestretch
        return 1 if p is None else p[0] * p[1] * p[2]

    def total(self, F: Any) -> Any:
        """F F_p: the deformation since the unstretched state."""
        if self.prestretch is None:
            return F
        p = self.prestretch
        return F * ufl.as_matrix([[p[0], 0, 0], [0, p[1], 0], [0, 0, p[2]]])


@dataclass(frozen=True)
class MixedHyperelastic:
    """A solid whose volumetric energy bulk_modulus/2 (J - 1)^2 is p (J - 1) - p^2/(2 bulk_modulus).

    The perturbed Lagrangian (Simo, Taylor and Pister, Comput. Methods Appl. Mech. Engrg. 51 (1985)
    177): stationary in p at p = bulk_modulus (J - 1), where it is the solid's own energy.

    Attributes:
        solid: The solid; J counts from its unstretched state.
        pressure: The unknown p = dU/dJ, MPa (positive in tension), as an expression of the state.
    """

    solid: Hyperelastic
    pressure: Any

    @property
    def on(self) -> str:
        """See `Energy`."""
        return self.solid.on

    def density(self, point: Point) -> Any:
        """See `Energy`."""
        solid, p = self.solid, self.pressure
        i = invariants(solid.total(point.F), point.principal)
        isochoric = solid.law.isochoric_energy(i, solid.parameters)
        volumetric = p * (i.J - 1) - p**2 / (2 * solid.parameters.bulk_modulus)
        return (isochoric + volumetric) / solid.volume


@dataclass(frozen=True)
class IdealDielectric:
    """Linear dielectric: W_e = -(eps/2) J e.e with the true field e = F^-T E.

    Attributes:
        on: Group of regions.
        permittivity: eps0 eps_r in N/kV^2, as a constant.
    """

    on: str
    permittivity: Any

    def at(self, F: Any) -> Any:
        """Permittivity at a deformation."""
        return self.permittivity

    def density(self, point: Point) -> Any:
        """See `Energy`."""
        e = ufl.inv(point.F).T * point.E
        return -self.at(point.F) / 2 * ufl.det(point.F) * ufl.dot(e, e)


@dataclass(frozen=True)
class StretchedDielectric(IdealDielectric):
    """The same with eps = permittivity + slope * stretch (see `StretchPermittivity`).

    It is linear in the field, but the derivative of its energy gives electrostriction besides
    Maxwell's stress, as in X. Zhao, Z. Suo, J. Appl. Phys. 104, 123530 (2008).

    Attributes:
        slope: Change of the permittivity a unit of stretch, N/kV^2, as a constant.
        prestretch: Stretches before the mesh along the components, as a constant.
        normal: Component across the layer.
    """

    slope: Any
    prestretch: Any
    normal: int

    def at(self, F: Any) -> Any:
        """See `IdealDielectric`."""
        one, other = (ufl.as_vector([F[i, k] for i in range(3)]) for k in in_plane(self.normal))
        area = ufl.cross(one, other)  # of layers that were normal to that component
        p = [self.prestretch[k] for k in in_plane(self.normal)]
        return self.permittivity + self.slope * (p[0] * p[1] * ufl.sqrt(ufl.dot(area, area))) ** 0.5


def in_plane(normal: int) -> tuple[int, int]:
    """Components in the plane of a layer."""
    first, second = (k for k in range(3) if k != normal)
    return first, second


@dataclass(frozen=True)
class MeshElasticity:
    """Fictitious neo-Hookean medium (G = kappa) that carries the air's mesh.

    Attributes:
        on: Group of regions.
        stiffness: G = kappa in MPa, as a constant.
    """

    on: str
    stiffness: Any

    def density(self, point: Point) -> Any:
        """See `Energy`."""
        i = invariants(point.F)
        return self.stiffness / 2 * (i.I1 - 3 + (i.J - 1) ** 2)
