"""Local quantities from nodal u and phi, in numpy: deformation, field, stresses.

Tensors have the components of the device's kinematics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dealib.config.schema import Config
from dealib.device.kinematics import Kinematics, SheetKinematics
from dealib.materials import Invariants, Law, thickness_stretch
from dealib.materials.branches import Branch, Network
from dealib.materials.evolution import inverted, unpack
from dealib.materials.softening import Mullins, softening
from dealib.materials.wrinkling import crests, extended
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
        prestretch: Stretches before the mesh along the components; None for none.
        pressure: The mixed form's p, of shape F.shape[:-2], in place of the law's dW/dJ, which
            near incompressibility is rounding error times the bulk modulus.
        soften: Factor on all but that, from the energy density without its volumetric part.
    """
    P = np.ones(3) if prestretch is None else np.asarray(prestretch)
    total = F * P
    C = np.swapaxes(total, -1, -2) @ total
    J = determinant(total)
    q = J ** (-2 / 3)
    trace, square = np.trace(C, axis1=-2, axis2=-1), np.einsum("...ij,...ij", C, C)
    second = (trace * trace - square) / 2
    hoop = C[..., 2, 2]
    known = not (C[..., 0, 2].any() or C[..., 1, 2].any())  # it is a principal direction
    i = Invariants(q * trace, q * q * second, J, q * hoop if known else None)
    d = _derivatives(law, i)
    if soften is not None:
        eta = soften(law.isochoric_energy(i, law.values))
        d = Invariants(eta * d.I1, eta * d.I2, d.J, eta * d.hoop)
    # S = unit 1 + inner C^-1 - bend C, and what the last direction adds
    unit, bend, along = 2 * q * d.I1, 2 * q * q * d.I2, 2 * q * d.hoop
    inner = (d.J if pressure is None else pressure) * J
    inner = inner - (unit * trace + bend * 2 * second + along * hoop) / 3
    S = inner[..., None, None] * inverse(C) - bend[..., None, None] * C
    diagonal = np.arange(3)
    S[..., diagonal, diagonal] += (unit + bend * trace)[..., None]
    S[..., 2, 2] += along
    return np.asarray(S * (P[:, None] * P / P.prod()))


def networks_pk(
    networks: tuple[Network, ...], F: Array, internal: Array, prestretch: Array | None = None
) -> Array:
    """What networks add to the second Piola-Kirchhoff stress per mesh area, shape of F.

    Args:
        networks: The networks.
        F: Deformation gradient from the mesh, (..., 3, 3).
        internal: Their C_i, packed (see `materials.evolution`), (..., entries, 4).
        prestretch: As for `second_pk`.
    """
    P = np.ones(3) if prestretch is None else np.asarray(prestretch)
    total = F * P
    C = np.swapaxes(total, -1, -2) @ total
    C_inverse, S = inverse(C), np.zeros_like(C)
    scale = determinant(total)[..., None, None] ** (-2 / 3)
    for k, network in enumerate(networks):
        inner = unpack(inverted(internal[..., k, :]))
        trace = np.einsum("...ij,...ij", C, inner)[..., None, None]
        S += network.shear_modulus * scale * (inner - trace / 3 * C_inverse)
    return np.asarray(S * (P[:, None] * P / P.prod()))


def cells_with_memory(config: Config, mesh: ResultMesh) -> Any:
    """Indices of the cells whose stress depends on what came before."""
    return mesh.in_region(*(n for n, m in region_materials(config).items() if m.remembers))


def _derivatives(law: Law, i: Invariants) -> Invariants:
    """Derivatives of W by complex steps, exact to rounding."""
    p, h = law.values, 1e-30
    found = {}
    for name, value in vars(i).items():
        if value is None:
            found[name] = np.zeros(i.J.shape)
            continue
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
        networks: Its Maxwell branches, and the network of a permanent set.
        mullins: Its softening.
        normal: Component across the layer.
        thickness: Of a sheet's layer as mounted, mm; 0 for a solid.
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
        """Whether its stress depends on what came before."""
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
        """Second Piola-Kirchhoff stress of law and networks per mesh area.

        Args:
            k: Deformation.
            pressure: The mixed form's p.
            internal: What it remembers, packed (see `Viscosity.gather`), (..., entries, 4).
        """
        assert self.law is not None
        if internal is None:
            return second_pk(self.law, k.F, self.prestretch, pressure)
        soften = None
        if self.mullins is not None:
            soften = partial(softening, W_max=internal[..., len(self.networks), 0], p=self.mullins)
        S = second_pk(self.law, k.F, self.prestretch, pressure, soften)
        return S + networks_pk(self.networks, k.F, internal, self.prestretch)


@dataclass(frozen=True)
class Points:
    """Points of cells of one material, with what does not change while the body deforms.

    Attributes:
        kinematics: The space.
        material: What the cells are made of.
        position: In the mesh, (cells, points, axes), mm.
        N: Shape functions (points, nodes).
        dN: Their gradients (cells, points, nodes, coordinates of the mesh).
    """

    kinematics: Kinematics
    material: RegionMaterial
    position: Array
    N: Array
    dN: Array

    @classmethod
    def of(
        cls,
        kinematics: Kinematics,
        material: RegionMaterial,
        cell: Cell,
        nodes: Array,
        points: Array,
    ) -> Points:
        """Reference points (points, dim) in cells of given nodes (cells, nodes, axes)."""
        mesh = nodes[..., list(kinematics.lies)]
        N, dN = cell.shape(points)[0], gradients(cell, mesh, points)[1]
        return cls(kinematics, material, N @ nodes, N, dN)

    def deformation(self, nodal: Array, internal: Array | None = None) -> Deformation:
        """Deformation and field from nodal values (cells, nodes, columns).

        Args:
            nodal: Displacements by axis and potential; of sheets the voltage across the layer, and
                the excess metric of a tension field.
            internal: What a sheet remembers, packed, (cells, points, entries, 4).
        """
        k, n = self.kinematics, self.kinematics.dim
        F = self.gradient(nodal)
        if isinstance(k, SheetKinematics):
            E = np.zeros(F.shape[:-1])
            E[..., k.normal] = nodal[..., :1, n] / self.material.thickness
            F[..., k.normal] *= thickness_stretches(self.material, F, E, internal)[..., None]
        else:
            E = k.field(nodal[..., n], self.dN)
        inner = inverse(F)
        return Deformation(F, determinant(F), inner, np.einsum("...ji,...j", inner, E))

    def gradient(self, nodal: Array, across: Array | None = None) -> Array:
        """Deformation gradients, of sheets with a stretch across, or 1, (cells, points)."""
        k = self.kinematics
        u = nodal[..., : k.dim]
        if not isinstance(k, SheetKinematics):
            return np.asarray(k.deformation(u, self.N, self.dN, self.position))
        F = k.sheet_deformation(u, self.N, self.dN, self.position)
        if (excess := self._excess(nodal)) is not None:
            F = extended(F, excess, self.material.plane)
        if across is not None:
            F[..., k.normal] *= across[..., None]
        return np.asarray(F)

    def _excess(self, nodal: Array) -> Array | None:
        first = self.kinematics.dim + 1
        if not self.kinematics.sheet or nodal.shape[-1] == first:
            return None
        return np.asarray(np.einsum("pn,cnk->cpk", self.N, nodal[..., first:]))

    def crests(self, nodal: Array) -> tuple[Array, Array] | None:
        """Wrinkles of a tension field at the points (see `wrinkling.crests`)."""
        k, excess = self.kinematics, self._excess(nodal)
        if not isinstance(k, SheetKinematics) or excess is None:
            return None
        u = nodal[..., : k.dim]
        F = k.sheet_deformation(u, self.N, self.dN, self.position)
        return crests(F, excess, self.material.plane)

    def pressure(self, nodal: Array) -> Array | None:
        """The mixed form's p at the points, if there is one."""
        last = self.kinematics.dim + 1
        if self.kinematics.sheet:
            return None
        return nodal[..., last] @ self.N.T if nodal.shape[-1] > last else None


def thickness_stretches(
    material: RegionMaterial, F: Array, E: Array, internal: Array | None
) -> Array:
    """Stretches of a layer at which its total stress across vanishes, shape F.shape[:-2].

    Args:
        material: The layer's.
        F: Deformation gradient, its column across the layer being the unit normal.
        E: Nominal field, across.
        internal: What it remembers, packed.
    """
    normal = material.normal
    square = E[..., normal] ** 2

    def stress(log: Array) -> Array:
        """Total true stress across at ln s."""
        s = np.exp(log)
        moved = F.copy()
        moved[..., normal] *= s[..., None]
        k = Deformation(moved, determinant(moved), moved, moved)
        S = material.elastic_stress(k, None, internal)
        eps: Any = material.permittivity
        if material.slope:
            k = Deformation(moved, k.J, inverse(moved), moved)
            eps = material.permittivity_at(k)
        return np.asarray(s * s * S[..., normal, normal] / k.J + eps / 2 * square / s**2)

    log = -np.log(determinant(F))
    for _ in range(_MOST):
        here, h = stress(log), 1e-5
        slope = (stress(log + h) - stress(log - h)) / (2 * h)
        step = np.clip(here / slope, -0.5, 0.5)
        log = log - step
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    return np.asarray(np.exp(log))


_MOST = 40  # steps of Newton's method for a thickness stretch


def region_materials(config: Config) -> dict[str, RegionMaterial]:
    """Materials of all regions; regions of one material and direction share theirs."""
    found: dict[str, RegionMaterial] = {}
    known: dict[Any, RegionMaterial] = {}
    device = config.device
    across, layers = device.kinematics.components.index("Z"), {}
    if device.kinematics.sheet and device.laminate is not None:
        layers = {layer.name: layer.thickness for layer in device.laminate.layers}
    for region in device.regions:
        thickness = layers.get(region.name, 0.0)
        key = (region.material, region.permittivity, region.normal, thickness)
        if key not in known:
            normal = across if region.normal is None else region.normal
            made = _material(config, region.material, region.permittivity, normal)
            known[key] = replace(made, thickness=thickness)
        found[region.name] = known[key]
    return found


def _material(
    config: Config, name: str | None, permittivity: float | None, normal: int
) -> RegionMaterial:
    if name is None:
        assert permittivity is not None
        return RegionMaterial(None, EPSILON_0 * permittivity, normal=normal)
    material = config.materials[name]
    conducts = config.conducts(name)
    mounted = None
    if not conducts or material.prestretch != (1.0, 1.0):
        a, b = material.prestretch
        mounted = np.insert(np.array([a, b]), normal, thickness_stretch(material, a, b))
    intercept, slope = (0.0, 0.0) if conducts else _permittivity(material)
    return RegionMaterial(
        *(material, intercept, mounted, slope, material.networks, material.mullins, normal)
    )


def _permittivity(material: Any) -> tuple[float, float]:
    eps = material.permittivity
    return EPSILON_0 * eps.intercept, EPSILON_0 * eps.slope


def film_groups(config: Config) -> dict[str, tuple[RegionMaterial, tuple[str, ...]]]:
    """Dielectric solids by material: the material, and the regions of it."""
    found: dict[int, tuple[RegionMaterial, list[str]]] = {}
    for name, material in region_materials(config).items():
        if material.law is not None and material.permittivity:
            found.setdefault(id(material), (material, []))[1].append(name)
    return {names[0]: (material, tuple(names)) for material, names in found.values()}
