"""Stresses at points from their deformation and field, in numpy.

Tensors have the components of the device's kinematics.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.materials import Invariants, Law
from dealib.materials.branches import Branch, Network
from dealib.materials.evolution import inverted, unpack
from dealib.materials.softening import Mullins, softening
from dealib.results.elements import determinant, dot, inverse, metric


@dataclass(frozen=True)
class Deformation:
    """Deformation and electric field at points of cells.

    Attributes:
        F: Deformation gradient from the mesh, (cells, points, 3, 3).
        J: det F, (cells, points).
        inverse: F^-1, (cells, points, 3, 3).
        e: True electric field, (cells, points, 3), kV/mm = MV/m.
    """

    F: Array
    J: Array
    inverse: Array
    e: Array

    @cached_property
    def C(self) -> Array:
        """F^T F."""
        return metric(self.F)


def second_pk(
    law: Law,
    F: Array,
    prestretch: Array | None = None,
    pressure: Array | None = None,
    soften: Callable[[Array], Array] | None = None,
) -> Array:
    """Elastic second Piola-Kirchhoff stress per mesh area, S = 2 dW/dC, shape of F.

    Args:
        law: The law.
        F: Deformation gradient from the mesh, (..., 3, 3).
        prestretch: Pre-stretches of the mesh along the components, (3,); None for none.
        pressure: The mixed form's p, of shape F.shape[:-2]. It replaces the law's dW/dJ, which
            near incompressibility is rounding error times the bulk modulus.
        soften: Factor on the isochoric stress as a function of the isochoric energy density.
    """
    P = np.ones(3) if prestretch is None else np.asarray(prestretch)
    total = F * P
    C, J = metric(total), determinant(total)
    unit, inner, bend, along = _isotropic(law, C, J, pressure, soften)
    S = inner[..., None, None] * inverse(C) - bend[..., None, None] * C
    diagonal = np.arange(3)
    S[..., diagonal, diagonal] += unit[..., None]
    S[..., 2, 2] += along
    return np.asarray(S * (P[:, None] * P / P.prod()))


def _isotropic(
    law: Law,
    C: Array,
    J: Array,
    pressure: Array | None,
    soften: Callable[[Array], Array] | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Factors a, b, c, d of S = a 1 + b C^-1 - c C + d e (x) e, e being the third direction."""
    q = J ** (-2 / 3)
    trace, hoop = C[..., 0, 0] + C[..., 1, 1] + C[..., 2, 2], C[..., 2, 2]
    known = not (C[..., 0, 2].any() or C[..., 1, 2].any())  # e is a principal direction
    reads, second = law.reads(known), np.zeros(())
    if "I2" in reads:
        second = (trace * trace - np.einsum("...ij,...ij", C, C)) / 2
    i = Invariants(q * trace, q * q * second, J, q * hoop if known else None)
    d = _derivatives(law, i, reads if pressure is None else reads - {"J"})
    if soften is not None:
        eta = soften(law.isochoric_energy(i, law.values))
        d = Invariants(eta * d.I1, eta * d.I2, d.J, eta * d.hoop)
    unit, bend, along = 2 * q * d.I1, 2 * q * q * d.I2, 2 * q * d.hoop
    inner = (d.J if pressure is None else pressure) * J
    inner = inner - (unit * trace + bend * 2 * second + along * hoop) / 3
    return unit + bend * trace, inner, bend, along


def in_plane(
    law: Law,
    k: Deformation,
    x: Array,
    y: Array,
    prestretch: Array | None = None,
    pressure: Array | None = None,
) -> list[Array]:
    """Elastic true stresses xx, yy and xy for orthogonal unit vectors x and y, (..., 3).

    With a = F^T x and b = F^T y the component xy is a . S . b / J. Its term with C^-1 is x . y, so
    that no tensor needs to be computed. The other arguments are those of `second_pk`.
    """
    total, J, C = k.F, k.J, k.C
    if prestretch is not None:
        P = np.asarray(prestretch)
        total, J, C = total * P, J * P.prod(), C * (P[:, None] * P)
    unit, inner, bend, along = _isotropic(law, C, J, pressure)
    a, b = (np.einsum("...ij,...i->...j", total, v) for v in (x, y))
    pairs = ((a, a), (b, b), (a, b))
    found = [unit * dot(p, q) for p, q in pairs]
    found[0] += inner
    found[1] += inner
    if along.any():
        for value, (p, q) in zip(found, pairs, strict=True):
            value += along * p[..., 2] * q[..., 2]
    if bend.any():
        a, b = (np.einsum("...ij,...j", total, v) for v in (a, b))
        for value, (p, q) in zip(found, ((a, a), (b, b), (a, b)), strict=True):
            value -= bend * dot(p, q)
    return [value / J for value in found]


def networks_pk(
    networks: tuple[Network, ...], F: Array, internal: Array, prestretch: Array | None = None
) -> Array:
    """Second Piola-Kirchhoff stress of Maxwell branches and networks per mesh area, shape of F.

    Args:
        networks: The networks.
        F: Deformation gradient from the mesh, (..., 3, 3).
        internal: Their C_i, packed (see `materials.evolution`), (..., entries, 4).
        prestretch: As for `second_pk`.
    """
    P = np.ones(3) if prestretch is None else np.asarray(prestretch)
    total = F * P
    C = metric(total)
    C_inverse, S = inverse(C), np.zeros_like(C)
    scale = determinant(total)[..., None, None] ** (-2 / 3)
    for k, network in enumerate(networks):
        inner = unpack(inverted(internal[..., k, :]))
        trace = np.einsum("...ij,...ij", C, inner)[..., None, None]
        S += network.shear_modulus * scale * (inner - trace / 3 * C_inverse)
    return np.asarray(S * (P[:, None] * P / P.prod()))


def _derivatives(law: Law, i: Invariants, reads: Collection[str]) -> Invariants:
    """Derivatives of W with respect to what it reads by complex steps, exact to rounding."""
    p, h = law.values, 1e-30
    found = {}
    for name, value in vars(i).items():
        if name not in reads:
            found[name] = np.zeros(())
            continue
        moved: dict[str, Any] = dict(vars(i))  # the others stay real, which is faster
        moved[name] = value + 1j * h
        found[name] = np.imag(law.energy(Invariants(**moved), p)) / h
    return Invariants(**found)


def cauchy(F: Array, S: Array) -> Array:
    """Sigma = F S F^T / J."""
    f, s = (np.ascontiguousarray(np.moveaxis(x, (-2, -1), (0, 1))) for x in (F, S))
    found = np.einsum("ik...,kj...->ij...", f, np.einsum("kl...,jl...->kj...", s, f))
    return np.asarray(np.moveaxis(found, (0, 1), (-2, -1)) / determinant(F)[..., None, None])


def maxwell(permittivity: float | Array, e: Array) -> Array:
    """Maxwell stress eps (e (x) e - e.e I / 2), MPa (thesis, section 2.3)."""
    ee = np.einsum("...i,...j->...ij", e, e)
    square = np.einsum("...i,...i", e, e)[..., None, None]
    eps = np.asarray(permittivity)[..., None, None]
    return np.asarray(eps * (ee - square / 2 * np.eye(3)))


@dataclass(frozen=True)
class RegionMaterial:
    """The material of a region, with what its local stresses depend on.

    Attributes:
        law: The law; None for air and rigid blocks.
        permittivity: Permittivity eps, N/kV^2; 0 for a conductor.
        prestretch: Stretches of the mounted state along the components, (3,), or None.
        slope: Derivative of eps with respect to the area stretch, N/kV^2.
        networks: Maxwell branches, and the network of a permanent set.
        mullins: Mullins softening, or None.
        normal: Number of the component across the layer.
        thickness: Mounted thickness of a sheet's layer, mm; 0 for a solid.
    """

    law: Law | None
    permittivity: float
    prestretch: Array | None = None
    slope: float = 0.0
    networks: tuple[Network, ...] = ()
    mullins: Mullins | None = None
    normal: int = 1
    thickness: float = 0.0

    @property
    def branches(self) -> tuple[Branch, ...]:
        """Its Maxwell branches."""
        return tuple(n for n in self.networks if isinstance(n, Branch))

    @property
    def remembers(self) -> bool:
        """Whether its stress depends on the history of the deformation."""
        return bool(self.networks) or self.mullins is not None

    @property
    def plane(self) -> tuple[int, int]:
        """Components in the plane of the layer."""
        first, second = (k for k in range(3) if k != self.normal)
        return first, second

    @property
    def stretch(self) -> Array:
        """Stretches of the mounted state."""
        return np.ones(3) if self.prestretch is None else self.prestretch

    def area_stretch(self, k: Deformation) -> Array:
        """Square root of the layer's area over its unstretched area, (cells, points)."""
        a, b = self.plane
        area = k.J * np.linalg.norm(k.inverse[..., self.normal, :], axis=-1)
        return np.asarray(np.sqrt(self.stretch[a] * self.stretch[b] * area))

    def permittivity_at(self, k: Deformation) -> float | Array:
        """Eps at a deformation, N/kV^2."""
        if not self.slope:
            return self.permittivity
        return np.asarray(self.permittivity + self.slope * self.area_stretch(k))

    def normal_at(self, k: Deformation) -> Array:
        """Unit normal of the deformed layer, (..., 3)."""
        n = k.inverse[..., self.normal, :]
        return np.asarray(n / np.linalg.norm(n, axis=-1)[..., None])

    def electric_stress(self, k: Deformation) -> Array:
        """Maxwell stress and electrostriction, (cells, points, 3, 3), MPa.

        With eps = a + slope l, l being the area stretch, the derivative of the energy
        -(eps/2) J e.e is Maxwell's stress plus -(e.e/2) slope (dl/dF) F^T, in which
        dl/dF F^T = l/2 (I - n (x) n).
        """
        stress = maxwell(self.permittivity_at(k), k.e)
        if self.slope:
            n, square = self.normal_at(k), np.einsum("...i,...i", k.e, k.e)
            in_plane = np.eye(3) - n[..., :, None] * n[..., None, :]
            size = -square * self.slope * self.area_stretch(k) / 4
            stress += size[..., None, None] * in_plane
        return stress

    def true_stress(self, k: Deformation, pressure: Array | None, internal: Array | None) -> Array:
        """Cauchy stress of law and networks, MPa (arguments as for `elastic_stress`)."""
        return cauchy(k.F, self.elastic_stress(k, pressure, internal))

    def in_plane(
        self, k: Deformation, x: Array, y: Array, pressure: Array | None, internal: Array | None
    ) -> Array:
        """True stresses xx, yy and xy with those of the field, (..., 3), MPa.

        Args:
            k: Deformation and field.
            x: Unit vectors, (..., 3).
            y: Unit vectors orthogonal to x.
            pressure: As for `elastic_stress`.
            internal: As for `elastic_stress`.
        """
        assert self.law is not None
        if internal is None:
            found = in_plane(self.law, k, x, y, self.prestretch, pressure)
        else:
            sigma = self.true_stress(k, pressure, internal)
            pairs = ((x, x), (y, y), (x, y))
            found = [np.einsum("...i,...ij,...j", p, sigma, q) for p, q in pairs]
        if not k.e.any():
            return np.stack(found, axis=-1)
        eps, square, a, b = self.permittivity_at(k), dot(k.e, k.e), dot(k.e, x), dot(k.e, y)
        both = -eps / 2 * square
        parts = [both + eps * a * a, both + eps * b * b, eps * a * b]
        if self.slope:
            n, size = self.normal_at(k), -square * self.slope * self.area_stretch(k) / 4
            a, b = dot(n, x), dot(n, y)
            more = (1 - a * a, 1 - b * b, -a * b)
            parts = [part + size * m for part, m in zip(parts, more, strict=True)]
        return np.stack([f + part for f, part in zip(found, parts, strict=True)], axis=-1)

    def elastic_stress(
        self, k: Deformation, pressure: Array | None, internal: Array | None
    ) -> Array:
        """Second Piola-Kirchhoff stress of law and networks per mesh area.

        Args:
            k: Deformation.
            pressure: The mixed form's p, MPa; None in the displacement form.
            internal: Internal variables, packed (see `Viscosity.gather`), (..., entries, 4).
        """
        assert self.law is not None
        if internal is None:
            return second_pk(self.law, k.F, self.prestretch, pressure)
        soften = None
        if self.mullins is not None:
            soften = partial(softening, W_max=internal[..., len(self.networks), 0], p=self.mullins)
        S = second_pk(self.law, k.F, self.prestretch, pressure, soften)
        return S + networks_pk(self.networks, k.F, internal, self.prestretch)
