"""Local quantities from nodal u and phi, in numpy: deformation, field, stresses.

Tensors have the components of the device's kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.config.schema import Config
from dealib.device.kinematics import Kinematics
from dealib.materials import Invariants, Law, thickness_stretch
from dealib.materials.branches import Branch
from dealib.materials.evolution import inverted, unpack
from dealib.results.elements import Array, Cell, determinant, gradients, inverse
from dealib.results.mesh import ResultMesh
from dealib.units import EPSILON_0


@dataclass(frozen=True)
class Deformation:
    """What follows from the nodal values alone, at points of cells.

    Attributes:
        F: Deformation gradient from the mesh, (cells, points, 3, 3).
        J: det F.
        inverse: F^-1.
        e: True electric field, (cells, points, 3), kV/mm = MV/m.
    """

    F: Array
    J: Array
    inverse: Array
    e: Array


@dataclass(frozen=True)
class Points:
    """Points of cells, with what does not change while the body deforms.

    Attributes:
        kinematics: The space.
        position: In the mesh, (cells, points, axes), mm.
        N: Shape functions (points, nodes).
        dN: Their gradients (cells, points, nodes, axes).
    """

    kinematics: Kinematics
    position: Array
    N: Array
    dN: Array

    @classmethod
    def of(cls, kinematics: Kinematics, cell: Cell, nodes: Array, points: Array) -> Points:
        """Reference points (points, dim) in cells of given nodes (cells, nodes, axes)."""
        position, dN = gradients(cell, nodes, points)
        return cls(kinematics, position, cell.shape(points)[0], dN)

    def deformation(self, nodal: Array) -> Deformation:
        """Deformation and field from nodal values (cells, nodes, columns)."""
        k, n = self.kinematics, self.kinematics.dim
        F = k.deformation(nodal[..., :n], self.N, self.dN, self.position)
        E = k.field(nodal[..., n], self.dN)
        inner = inverse(F)
        return Deformation(F, determinant(F), inner, np.einsum("...ji,...j", inner, E))

    def pressure(self, nodal: Array) -> Array | None:
        """The mixed form's p at the points, if there is one."""
        last = self.kinematics.dim + 1
        return nodal[..., last] @ self.N.T if nodal.shape[-1] > last else None


def second_pk(
    law: Law, F: Array, prestretch: Array | None = None, pressure: Array | None = None
) -> Array:
    """Elastic second Piola-Kirchhoff stress per mesh area, S = 2 dW/dC, shape of F.

    Args:
        law: The law.
        F: Deformation gradient from the mesh, (..., 3, 3).
        prestretch: Stretches before the mesh along the components; None for none.
        pressure: The mixed form's p, of shape F.shape[:-2], in place of the law's dW/dJ, which
            near incompressibility is rounding error times the bulk modulus.
    """
    P = np.ones(3) if prestretch is None else np.asarray(prestretch)
    total = F * P
    C = np.swapaxes(total, -1, -2) @ total
    J = determinant(total)
    q = J ** (-2 / 3)
    trace, square = np.trace(C, axis1=-2, axis2=-1), np.einsum("...ij,...ij", C, C)
    second = (trace * trace - square) / 2
    hoop = C[..., 2, 2]
    d = _derivatives(law, Invariants(q * trace, q * q * second, J, q * hoop))
    # S = unit 1 + inner C^-1 - bend C, and what the last direction adds
    unit, bend, along = 2 * q * d.I1, 2 * q * q * d.I2, 2 * q * d.hoop
    inner = (d.J if pressure is None else pressure) * J
    inner = inner - (unit * trace + bend * 2 * second + along * hoop) / 3
    S = inner[..., None, None] * inverse(C) - bend[..., None, None] * C
    diagonal = np.arange(3)
    S[..., diagonal, diagonal] += (unit + bend * trace)[..., None]
    S[..., 2, 2] += along
    return np.asarray(S * (P[:, None] * P / P.prod()))


def branches_pk(
    branches: tuple[Branch, ...], F: Array, internal: Array, prestretch: Array | None = None
) -> Array:
    """What Maxwell branches add to the second Piola-Kirchhoff stress per mesh area, shape of F.

    Args:
        branches: The branches.
        F: Deformation gradient from the mesh, (..., 3, 3).
        internal: Their C_i, packed (see `materials.evolution`), (..., branches, 4).
        prestretch: As for `second_pk`.
    """
    P = np.ones(3) if prestretch is None else np.asarray(prestretch)
    total = F * P
    C = np.swapaxes(total, -1, -2) @ total
    C_inverse, S = inverse(C), np.zeros_like(C)
    scale = determinant(total)[..., None, None] ** (-2 / 3)
    for k, branch in enumerate(branches):
        inner = unpack(inverted(internal[..., k, :]))
        trace = np.einsum("...ij,...ij", C, inner)[..., None, None]
        S += branch.shear_modulus * scale * (inner - trace / 3 * C_inverse)
    return np.asarray(S * (P[:, None] * P / P.prod()))


def branch_cells(config: Config, mesh: ResultMesh) -> Any:
    """Indices of the cells that have Maxwell branches."""
    return mesh.in_region(*(n for n, m in region_materials(config).items() if m.branches))


def _derivatives(law: Law, i: Invariants) -> Invariants:
    """Derivatives of W by complex steps, exact to rounding."""
    p, h = law.values, 1e-30
    found = {}
    for name in vars(i):
        moved: dict[str, Any] = dict(vars(i))  # the others stay real, which is faster
        moved[name] = moved[name] + 1j * h
        energy = law.energy(Invariants(**moved), p) + 0j
        found[name] = np.broadcast_to(np.imag(energy) / h, i.J.shape)
    return Invariants(**found)


def cauchy(F: Array, S: Array) -> Array:
    """Sigma = F S F^T / J."""
    return np.asarray(F @ S @ np.swapaxes(F, -1, -2) / determinant(F)[..., None, None])


def maxwell(permittivity: float | Array, e: Array) -> Array:
    """Maxwell stress eps (e (x) e - e.e I / 2), MPa (thesis, section 2.3)."""
    ee = np.einsum("...i,...j->...ij", e, e)
    square = np.einsum("...i,...i", e, e)[..., None, None]
    eps = np.asarray(permittivity)[..., None, None]
    return np.asarray(eps * (ee - square / 2 * np.eye(3)))


@dataclass(frozen=True)
class Frame:
    """Unit vectors across and in a film, in the mesh, (..., 3).

    Attributes:
        n: Across it.
        a: In it.
        b: In it, the last component of the kinematics in a plane.
    """

    n: Array
    a: Array
    b: Array

    @classmethod
    def across(cls, normal: int) -> Frame:
        """Along the components."""
        a, b = (np.eye(3)[k] for k in range(3) if k != normal)
        return cls(np.eye(3)[normal], a, b)

    @classmethod
    def of_normals(cls, n: Array, plane: bool) -> Frame:
        """At normals (..., 3), which have no last component where the mesh is plane."""
        last = np.eye(3)[2] if plane else np.eye(3)[np.abs(n).argmin(axis=-1)]
        a = np.cross(np.broadcast_to(last, n.shape), n)
        a = a / np.linalg.norm(a, axis=-1)[..., None]
        return cls(n, a, np.cross(n, a))


def deformed(F: Array, v: Array) -> Array:
    """F v at points."""
    return np.einsum("...ij,...j", F, v)


@dataclass(frozen=True)
class RegionMaterial:
    """What a region is made of, for local quantities.

    Attributes:
        law: Its law; None for air and rigid blocks.
        permittivity: eps in N/kV^2; 0 for a conductor.
        prestretch: Stretches of the mounted state along the components, or None.
        slope: Change of eps a unit of area stretch, N/kV^2.
        branches: Its Maxwell branches.
        normal: Component across the layer.
    """

    law: Law | None
    permittivity: float
    prestretch: Array | None = None
    slope: float = 0.0
    branches: tuple[Branch, ...] = ()
    normal: int = 1

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
        """Square root of the growth in area of the layer since its unstretched state."""
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
        """All that the field adds to the stress, electrostriction included, MPa.

        With eps = a + slope l, l the area stretch, the energy -(eps/2) J e.e gives
        -(e.e/2) slope (dl/dF) F^T besides Maxwell's stress, and dl/dF F^T = l/2 (I - n (x) n).
        """
        stress = maxwell(self.permittivity_at(k), k.e)
        if self.slope:
            n, square = self.normal_at(k), np.einsum("...i,...i", k.e, k.e)
            in_plane = np.eye(3) - n[..., :, None] * n[..., None, :]
            size = -square * self.slope * self.area_stretch(k) / 4
            stress += size[..., None, None] * in_plane
        return stress

    def elastic_stress(
        self, k: Deformation, pressure: Array | None, internal: Array | None
    ) -> Array:
        """Second Piola-Kirchhoff stress of law and branches per mesh area.

        Args:
            k: Deformation.
            pressure: The mixed form's p.
            internal: C_i of Maxwell branches, (..., branches, 4), if it has some.
        """
        assert self.law is not None
        S = second_pk(self.law, k.F, self.prestretch, pressure)
        if self.branches and internal is not None:
            S = S + branches_pk(self.branches, k.F, internal, self.prestretch)
        return S


def region_materials(config: Config) -> dict[str, RegionMaterial]:
    """Materials of all regions; regions of one material and direction share theirs."""
    found: dict[str, RegionMaterial] = {}
    known: dict[tuple[str | None, float | None, int | None], RegionMaterial] = {}
    across = config.device.kinematics.components.index("Z")
    for region in config.device.regions:
        key = (region.material, region.permittivity, region.normal)
        if key not in known:
            normal = across if region.normal is None else region.normal
            known[key] = _material(config, region.material, region.permittivity, normal)
        found[region.name] = known[key]
    return found


def _material(
    config: Config, name: str | None, permittivity: float | None, normal: int
) -> RegionMaterial:
    if name is None:
        assert permittivity is not None
        return RegionMaterial(None, EPSILON_0 * permittivity, normal=normal)
    material = config.materials[name]
    mounted = None
    if not config.conducts(name) or material.prestretch != (1.0, 1.0):
        a, b = material.prestretch
        mounted = np.insert(np.array([a, b]), normal, thickness_stretch(material, a, b))
    if config.conducts(name):
        return RegionMaterial(material, 0.0, mounted, 0.0, material.branches, normal)
    eps = material.permittivity
    return RegionMaterial(
        material,
        EPSILON_0 * eps.intercept,
        mounted,
        EPSILON_0 * eps.slope,
        material.branches,
        normal,
    )


def film_groups(config: Config) -> dict[str, tuple[RegionMaterial, tuple[str, ...]]]:
    """Dielectric solids by material: the material, and the regions of it."""
    found: dict[int, tuple[RegionMaterial, list[str]]] = {}
    for name, material in region_materials(config).items():
        if material.law is not None and material.permittivity:
            found.setdefault(id(material), (material, []))[1].append(name)
    return {names[0]: (material, tuple(names)) for material, names in found.values()}
