"""Energies of regions; their sum is the potential that the solver makes stationary.

An energy is a function of a few scalars, each a polynomial of the deformation gradient and the
field at a point, such as tr C, det F and |cof(F) E|^2. A device is modelled by composing energies.
Residual and tangent follow by the chain rule through the scalars: UFL differentiates the
polynomials and the functions of scalars apart, which gives much shorter code than the whole.
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
from dealib.materials.softening import withheld

Scalars = tuple[Any, ...]


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
        principal: Whether the direction of the last component is a principal one, as it is except
            in three dimensions.
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
        """Group of regions that it lives on."""

    def scalars(self, point: Point) -> Scalars:
        """The scalars on which it depends: polynomials of F, E and other unknowns at a point."""

    def of(self, *scalars: Any) -> Any:
        """Energy per mesh volume as a function of `scalars`, MPa = mJ/mm^3."""


def density(energy: Energy, point: Point) -> Any:
    """Energy per mesh volume at a point, MPa = mJ/mm^3."""
    return energy.of(*energy.scalars(point))


def first_variation(energy: Energy, point: Point, state: Any, test: Any) -> Any:
    """Derivative of the density by the state, in a direction."""
    scalars, slopes = _slopes(energy, point)
    parts = zip(slopes, scalars, strict=True)
    return sum(slope * ufl.derivative(x, state, test) for slope, x in parts)


def second_variation(energy: Energy, point: Point, state: Any, test: Any, trial: Any) -> Any:
    """Second derivative of the density by the state, in two directions."""
    scalars, slopes = _slopes(energy, point)
    by_test, by_trial = ([ufl.derivative(x, state, d) for x in scalars] for d in (test, trial))
    total = 0
    for i, slope in enumerate(slopes):
        total += slope * ufl.derivative(by_test[i], state, trial)
        for j, x in enumerate(scalars):
            total += ufl.diff(slope, x) * by_test[i] * by_trial[j]
    return total


def _slopes(energy: Energy, point: Point) -> tuple[list[Any], list[Any]]:
    """The scalars as UFL variables, and the derivatives of the density by them."""
    scalars = [ufl.variable(x) for x in energy.scalars(point)]
    value = energy.of(*scalars)
    return scalars, [ufl.diff(value, x) for x in scalars]


def constant(mesh: Any, value: Any) -> Any:
    """A number or an array as a constant; forms need not be compiled anew for another value."""
    return fem.Constant(mesh, np.array(value, dtype=PETSc.ScalarType))


def parameters(mesh: Any, law: Law) -> SimpleNamespace:
    """A law's parameters as constants."""
    values = {k: constant(mesh, v) for k, v in law.parameters.items()}
    return SimpleNamespace(**values, **law.fixed)


def strain_scalars(F: Any, principal: bool = True) -> Scalars:
    """Tr C, (tr(C)^2 - tr(C^2))/2, det F, and the last principal value of C if it is known.

    Args:
        F: Deformation gradient, (3, 3).
        principal: Whether the last component's direction is known to be a principal one.
    """
    C = F.T * F
    trace = ufl.tr(C)
    found = (trace, (trace**2 - ufl.inner(C, C)) / 2, ufl.det(F))
    return (*found, C[2, 2]) if principal else found


def isochoric(trace: Any, second: Any, J: Any, hoop: Any = None) -> Invariants:
    """Isochoric invariants from `strain_scalars`."""
    a = J ** (-2.0 / 3.0)
    return Invariants(a * trace, a**2 * second, J, None if hoop is None else a * hoop)


@dataclass(frozen=True)
class Hyperelastic:
    """A law on regions, optionally pre-stretched: W(F F_p) / det F_p.

    Attributes:
        on: Group of regions.
        law: The law.
        parameters: Its parameters, as constants.
        prestretch: Stretches of F_p along the components, as a constant; None for none.
        mullins: Parameters of its softening, as constants; None for none.
        peak: Largest energy density so far, at the quadrature points; None without softening.
    """

    on: str
    law: Law
    parameters: SimpleNamespace
    prestretch: Any = None
    mullins: SimpleNamespace | None = None
    peak: Any = None

    def scalars(self, point: Point) -> Scalars:
        """See `Energy`."""
        return strain_scalars(self.total(point.F), point.principal)

    def of(self, *scalars: Any) -> Any:
        """See `Energy`."""
        i = isochoric(*scalars)
        return (self.law.energy(i, self.parameters) - self.withheld(i)) / self.volume

    def withheld(self, i: Invariants) -> Any:
        """Reduction of the energy per unstretched volume by softening, MPa; 0 without softening."""
        if self.mullins is None:
            return 0
        W = self.law.isochoric_energy(i, self.parameters)
        return withheld(W, self.peak, self.mullins)

    def extension(self, point: Point) -> Any:
        """Used share of the law's extensibility (see `Law.extension`)."""
        return self.law.extension(isochoric(*self.scalars(point)), self.parameters)

    @property
    def volume(self) -> Any:
        """Mesh volume per unstretched volume, det F_p."""
        p = self.prestretch
        return 1 if p is None else p[0] * p[1] * p[2]

    def total(self, F: Any) -> Any:
        """F F_p: the deformation since the unstretched state."""
        if self.prestretch is None:
            return F
        return ufl.as_matrix([[F[i, j] * self.prestretch[j] for j in range(3)] for i in range(3)])


@dataclass(frozen=True)
class MixedHyperelastic:
    """A solid with the volumetric energy p (J - 1) - p^2/(2 kappa) in place of kappa/2 (J - 1)^2.

    The perturbed Lagrangian of Simo, Taylor and Pister, Comput. Methods Appl. Mech. Engrg. 51
    (1985) 177. It is stationary in p at p = kappa (J - 1), where both energies are equal.

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

    def scalars(self, point: Point) -> Scalars:
        """See `Energy`."""
        return (self.pressure, *self.solid.scalars(point))

    def of(self, p: Any, *scalars: Any) -> Any:
        """See `Energy`."""
        i, of = isochoric(*scalars), self.solid.parameters
        shape = self.solid.law.isochoric_energy(i, of) - self.solid.withheld(i)
        return (shape + p * (i.J - 1) - p**2 / (2 * of.bulk_modulus)) / self.solid.volume


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

    def scalars(self, point: Point) -> Scalars:
        """See `Energy`: |cof(F) E|^2 and det F."""
        flux = cofactor_times(point.F, point.E)
        return ufl.dot(flux, flux), ufl.det(point.F)

    def of(self, *scalars: Any) -> Any:
        """See `Energy`."""
        square, J = scalars
        return -self.permittivity / 2 * square / J


@dataclass(frozen=True)
class StretchedDielectric(IdealDielectric):
    """A dielectric with eps = permittivity + slope * stretch (see `StretchPermittivity`).

    It is linear in the field, but its energy gives electrostriction besides Maxwell's stress, as in
    X. Zhao, Z. Suo, J. Appl. Phys. 104, 123530 (2008).

    Attributes:
        slope: Change of the permittivity per unit of stretch, N/kV^2, as a constant.
        prestretch: Stretches before the mesh along the components, as a constant.
        normal: Component across the layer.
    """

    slope: Any
    prestretch: Any
    normal: int

    def at(self, F: Any) -> Any:
        """See `IdealDielectric`."""
        return self._at(self._area(F))

    def scalars(self, point: Point) -> Scalars:
        """See `Energy`; the last scalar is the square of the area ratio since mounting."""
        return (*super().scalars(point), self._area(point.F))

    def of(self, *scalars: Any) -> Any:
        """See `Energy`."""
        square, J, area = scalars
        return -self._at(area) / 2 * square / J

    def _at(self, area: Any) -> Any:
        p = [self.prestretch[k] for k in in_plane(self.normal)]
        return self.permittivity + self.slope * (p[0] * p[1] * ufl.sqrt(area)) ** 0.5

    def _area(self, F: Any) -> Any:
        across = ufl.as_vector([1.0 if k == self.normal else 0.0 for k in range(3)])
        area = cofactor_times(F, across)
        return ufl.dot(area, area)


def cofactor_times(F: Any, E: Any) -> Any:
    """Cof(F) E = J F^-T E, by cross products of F's columns."""
    f = [ufl.as_vector([F[i, j] for i in range(3)]) for j in range(3)]
    pairs = (ufl.cross(f[1], f[2]), ufl.cross(f[2], f[0]), ufl.cross(f[0], f[1]))
    return sum(E[k] * pair for k, pair in enumerate(pairs))


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

    def scalars(self, point: Point) -> Scalars:
        """See `Energy`."""
        return strain_scalars(point.F)[::2]

    def of(self, *scalars: Any) -> Any:
        """See `Energy`."""
        trace, J = scalars
        return self.stiffness / 2 * (J ** (-2.0 / 3.0) * trace - 3 + (J - 1) ** 2)
