"""Points of cells, and their deformation and field from nodal u and phi, in numpy.

Tensors have the components of the device's kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.device.kinematics import Kinematics
from dealib.device.sheet_kinematics import SheetKinematics
from dealib.materials import thickness_stretch
from dealib.materials.wrinkling import crests, extended
from dealib.results.elements import Cell, determinant, gradients, inverse, inverted
from dealib.results.mesh import ResultMesh
from dealib.results.stress import Deformation, RegionMaterial
from dealib.units import EPSILON_0

_ITERATIONS = 40  # at most, of Newton's method for a thickness stretch


def cells_with_memory(config: Config, mesh: ResultMesh) -> Any:
    """Indices of the cells whose material has internal variables, (cells,)."""
    return mesh.in_region(*(n for n, m in region_materials(config).items() if m.remembers))


@dataclass(frozen=True)
class Frame:
    """Orthogonal unit vectors of a film in the mesh, (..., 3).

    Attributes:
        n: Normal of the film.
        a: First tangent.
        b: Second tangent; in plane problems the out-of-plane direction.
    """

    n: Array
    a: Array
    b: Array

    @classmethod
    def across(cls, normal: int) -> Frame:
        """The frame whose vectors are the components' axes, with the normal along one of them."""
        a, b = (np.eye(3)[k] for k in range(3) if k != normal)
        return cls(np.eye(3)[normal], a, b)

    @classmethod
    def of_normals(cls, n: Array, plane: bool) -> Frame:
        """Frames of given normals (..., 3), whose last component is 0 if the mesh is plane."""
        last = np.eye(3)[2] if plane else np.eye(3)[np.abs(n).argmin(axis=-1)]
        a = np.cross(np.broadcast_to(last, n.shape), n)
        a = a / np.linalg.norm(a, axis=-1)[..., None]
        return cls(n, a, np.cross(n, a))


def deformed(F: Array, v: Array) -> Array:
    """Products F v, with F (..., 3, 3) and v (..., 3) or (3,)."""
    return np.einsum("...ij,...j", F, v)


@dataclass(frozen=True)
class CellPoints:
    """Points in cells of one material, with their shape functions.

    Attributes:
        kinematics: Kinematics of the device.
        material: Material of the cells.
        position: Position in the mesh, (cells, points, axes), mm.
        N: Shape functions, (points, nodes).
        dN: Gradients of the shape functions, (cells, points, nodes, coordinates of the mesh), 1/mm.
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
    ) -> CellPoints:
        """Reference points (points, dim) in cells of given nodes (cells, nodes, axes)."""
        mesh = nodes[..., list(kinematics.lies)]
        N, dN = cell.shape(points)[0], gradients(cell, mesh, points)[1]
        dN = np.swapaxes(np.swapaxes(dN, 1, 2).copy(), 1, 2)  # as `at_points` takes it
        return cls(kinematics, material, N @ nodes, N, dN)

    def deformation(self, nodal: Array, internal: Array | None = None) -> Deformation:
        """Deformation and field from nodal values (cells, nodes, columns).

        Args:
            nodal: Displacements by axis and potential. For sheets the voltage across the layer
                takes the place of the potential, followed by the excess metric of a tension field.
            internal: Internal variables of a sheet, packed, (cells, points, entries, 4).
        """
        k, n = self.kinematics, self.kinematics.dim
        F = self.gradient(nodal)
        if isinstance(k, SheetKinematics):
            E = np.zeros(F.shape[:-1])
            E[..., k.normal] = nodal[..., :1, n] / self.material.thickness
            F[..., k.normal] *= thickness_stretches(self.material, F, E, internal)[..., None]
        else:
            E = k.field(nodal[..., n], self.dN)
        inner, J = inverted(F)
        return Deformation(F, J, inner, np.einsum("...ji,...j", inner, E))

    def gradient(self, nodal: Array, across: Array | None = None) -> Array:
        """Deformation gradients, (cells, points, 3, 3).

        Args:
            nodal: As for `deformation`.
            across: Thickness stretch of a sheet, (cells, points); default 1.
        """
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


def volumes(
    kinematics: Kinematics, cell: Cell, nodes: Array, points: Array, weights: Array | float
) -> Array:
    """Size of the device's mesh at reference points of cells with given nodes, (cells, points)."""
    N, dN = cell.shape(points)
    mesh = nodes[..., list(kinematics.lies)]
    size = np.abs(determinant(np.swapaxes(mesh, 1, 2)[:, None] @ dN))
    return np.asarray(kinematics.volumes(N @ nodes) * size * weights)


def thickness_stretches(
    material: RegionMaterial, F: Array, E: Array, internal: Array | None
) -> Array:
    """Thickness stretches at which the total stress across a layer vanishes, shape F.shape[:-2].

    Args:
        material: Material of the layer.
        F: Deformation gradient, whose column across the layer is the unit normal.
        E: Nominal field, across the layer, kV/mm.
        internal: Internal variables, packed.
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
    for _ in range(_ITERATIONS):
        with np.errstate(all="ignore"):
            here, h = stress(log), 1e-5
            slope = (stress(log + h) - stress(log - h)) / (2 * h)
        step = np.clip(here / slope, -0.5, 0.5)
        step = np.where(np.isfinite(step), step, -0.02)  # away from where the law locks
        log = log - step
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    return np.asarray(np.exp(log))


def region_materials(config: Config) -> dict[str, RegionMaterial]:
    """Materials by region; regions of equal material, normal and thickness share one object."""
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
    intercept, slope = 0.0, 0.0
    if not conducts:
        relative: Any = material.permittivity
        intercept, slope = EPSILON_0 * relative.intercept, EPSILON_0 * relative.slope
    return RegionMaterial(
        *(material, intercept, mounted, slope, material.networks, material.mullins, normal)
    )


def film_groups(config: Config) -> dict[str, tuple[RegionMaterial, tuple[str, ...]]]:
    """Dielectric solids by material: the material, and the regions of it."""
    found: dict[int, tuple[RegionMaterial, list[str]]] = {}
    for name, material in region_materials(config).items():
        if material.law is not None and material.permittivity:
            found.setdefault(id(material), (material, []))[1].append(name)
    return {names[0]: (material, tuple(names)) for material, names in found.values()}
