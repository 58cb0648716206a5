"""Local quantities from nodal u and phi, in numpy: deformation, field, stresses.

Tensors have components (R, Z, theta); only RZ is off the diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.config.schema import Config
from dealib.materials import Invariants, Law, thickness_stretch
from dealib.materials.branches import Branch
from dealib.materials.evolution import inverted, unpack
from dealib.results.elements import Array, Cell, gradients, inverse
from dealib.results.mesh import ResultMesh
from dealib.units import EPSILON_0


@dataclass(frozen=True)
class Kinematics:
    """What follows from the nodal values alone, at points of cells.

    Attributes:
        F: Deformation gradient from the mesh, (cells, points, 3, 3).
        J: det F.
        e: True electric field, (cells, points, 3), kV/mm = MV/m.
    """

    F: Array
    J: Array
    e: Array


def kinematics(cell: Cell, corners: Array, points: Array, u: Array, phi: Array) -> Kinematics:
    """Deformation and field at reference points.

    Args:
        cell: Reference cell.
        corners: Corner coordinates (cells, corners, 2), mm.
        points: Reference points (points, 2).
        u: Nodal displacements (cells, nodes, 2), mm.
        phi: Nodal potentials (cells, nodes), kV.
    """
    return Points.of(cell, corners, points).kinematics(u, phi)


@dataclass(frozen=True)
class Points:
    """Points of cells, with what does not change while the body deforms.

    Attributes:
        position: (R, Z) in the mesh, (cells, points, 2), mm.
        N: Shape functions (points, nodes).
        dN: Their gradients (cells, points, nodes, 2).
    """

    position: Array
    N: Array
    dN: Array

    @classmethod
    def of(cls, cell: Cell, corners: Array, points: Array) -> Points:
        """Reference points (points, 2) in cells of given corners (cells, corners, 2)."""
        position, dN = gradients(cell, corners, points)
        return cls(position, cell.shape(points)[0], dN)

    def kinematics(self, u: Array, phi: Array) -> Kinematics:
        """Deformation and field from nodal u (cells, nodes, 2) and phi (cells, nodes)."""
        F = np.zeros((*self.position.shape[:2], 3, 3))
        F[..., :2, :2] = np.swapaxes(u, 1, 2)[:, None] @ self.dN + np.eye(2)
        F[..., 2, 2] = 1 + u[..., 0] @ self.N.T / self.position[..., 0]
        d = F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]
        E = -(phi[:, None, None] @ self.dN)[..., 0, :]
        e = np.zeros((*E.shape[:2], 3))  # F^-T E
        e[..., 0] = (F[..., 1, 1] * E[..., 0] - F[..., 1, 0] * E[..., 1]) / d
        e[..., 1] = (F[..., 0, 0] * E[..., 1] - F[..., 0, 1] * E[..., 0]) / d
        return Kinematics(F, d * F[..., 2, 2], e)


def second_pk(
    law: Law, F: Array, prestretch: Array | None = None, pressure: Array | None = None
) -> Array:
    """Elastic second Piola-Kirchhoff stress per mesh area, S = 2 dW/dC, shape of F.

    Args:
        law: The law.
        F: Deformation gradient from the mesh, (..., 3, 3).
        prestretch: Stretches (radial, thickness, hoop) before the mesh; None for none.
        pressure: The mixed form's p, of shape F.shape[:-2], in place of the law's dW/dJ, which
            near incompressibility is rounding error times the bulk modulus.
    """
    radial, thickness, hoop = (1.0, 1.0, 1.0) if prestretch is None else map(float, prestretch)
    # the components RR, RZ, ZZ, theta-theta of C, of the unstretched state
    a = radial**2 * (F[..., 0, 0] ** 2 + F[..., 1, 0] ** 2)
    g = radial * thickness * (F[..., 0, 0] * F[..., 0, 1] + F[..., 1, 0] * F[..., 1, 1])
    c = thickness**2 * (F[..., 0, 1] ** 2 + F[..., 1, 1] ** 2)
    h = (hoop * F[..., 2, 2]) ** 2
    J = radial * thickness * hoop * determinant(F)
    area, trace = (J * J) / h, a + c + h  # a c - g^2
    second = area + h * (a + c)
    q = J ** (-2 / 3)
    i = Invariants(q * trace, q * q * second, J, q * h)
    d = _derivatives(law, i)
    # S = unit 1 + inner C^-1 - bend C, and what the hoop direction adds
    unit, inner = 2 * q * d.I1, (d.J if pressure is None else pressure) * J
    bend, along = 2 * q * q * d.I2, 2 * q * d.hoop
    inner = inner - (unit * trace + bend * 2 * second + along * h) / 3
    unit, scaled = unit + bend * trace, inner / area
    S = np.zeros(F.shape)
    S[..., 0, 0] = (unit + scaled * c - bend * a) * (radial / (thickness * hoop))
    S[..., 1, 1] = (unit + scaled * a - bend * c) * (thickness / (radial * hoop))
    S[..., 0, 1] = S[..., 1, 0] = -(scaled + bend) * g / hoop
    S[..., 2, 2] = (unit + inner / h - bend * h + along) * (hoop / (radial * thickness))
    return S


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
    P = np.diag(np.ones(3) if prestretch is None else prestretch)
    total = F @ P
    C = np.swapaxes(total, -1, -2) @ total
    C_inverse, S = inverse(C), np.zeros_like(C)
    scale = np.linalg.det(total)[..., None, None] ** (-2 / 3)
    for k, branch in enumerate(branches):
        inner = unpack(inverted(internal[..., k, :]))
        trace = np.einsum("...ij,...ij", C, inner)[..., None, None]
        S += branch.shear_modulus * scale * (inner - trace / 3 * C_inverse)
    return np.asarray(P @ S @ P / np.linalg.det(P))


def branch_cells(config: Config, mesh: ResultMesh) -> Any:
    """Indices of the cells that have Maxwell branches."""
    found = [mesh.in_region(n) for n, m in region_materials(config).items() if m.branches]
    return np.sort(np.concatenate([np.empty(0, np.int64), *found]))


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


def determinant(F: Array) -> Array:
    """Determinants of tensors of shape (..., 3, 3), of which only RZ is off the diagonal."""
    return np.asarray((F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]) * F[..., 2, 2])


def maxwell(permittivity: float | Array, e: Array) -> Array:
    """Maxwell stress eps (e (x) e - e.e I / 2), MPa (thesis, section 2.3)."""
    ee = np.einsum("...i,...j->...ij", e, e)
    square = np.einsum("...i,...i", e, e)[..., None, None]
    eps = np.asarray(permittivity)[..., None, None]
    return np.asarray(eps * (ee - square / 2 * np.eye(3)))


def electrostriction(slope: float, stretch: Array, F: Array, e: Array) -> Array:
    """Stress of a permittivity that depends on the area stretch l, MPa.

    At a given field the energy -(eps/2) J e.e gives -(e.e/2) (d eps/dF) F^T besides Maxwell's
    stress; dl/dF F^T = l/2 (t (x) t + i (x) i), t along the film and i the hoop direction.

    Args:
        slope: d eps / dl, N/kV^2.
        stretch: l, (...).
        F: Deformation gradient, (..., 3, 3).
        e: True field, (..., 3).
    """
    t = F[..., 0] / np.linalg.norm(F[..., 0], axis=-1)[..., None]
    in_plane = t[..., :, None] * t[..., None, :] + np.diag([0.0, 0.0, 1.0])
    size = -np.einsum("...i,...i", e, e) * slope * stretch / 4
    return np.asarray(size[..., None, None] * in_plane)


@dataclass(frozen=True)
class RegionMaterial:
    """What a region is made of, for local quantities.

    Attributes:
        law: Its law; None for air and rigid blocks.
        permittivity: eps in N/kV^2; 0 for a conductor.
        prestretch: Stretches (radial, thickness, hoop) of the mounted state, or None.
        slope: Change of eps a unit of area stretch, N/kV^2.
        branches: Its Maxwell branches.
    """

    law: Law | None
    permittivity: float
    prestretch: Array | None = None
    slope: float = 0.0
    branches: tuple[Branch, ...] = ()

    def area_stretch(self, F: Array) -> Array:
        """Square root of the growth in area of layers that were normal to Z."""
        radial, _, hoop = np.ones(3) if self.prestretch is None else self.prestretch
        along = np.linalg.norm(F[..., 0], axis=-1)
        return np.asarray(np.sqrt(radial * along * hoop * F[..., 2, 2]))

    def permittivity_at(self, F: Array) -> Array:
        """Eps at deformation gradients, N/kV^2."""
        return self.permittivity + self.slope * self.area_stretch(F)


def region_materials(config: Config) -> dict[str, RegionMaterial]:
    """Materials of all regions that a config can have."""
    film, g = config.materials.film, config.geometry
    eps = film.permittivity
    radial, hoop = film.prestretch
    mounted = np.array([radial, thickness_stretch(film, radial, hoop), hoop])
    stiff = config.materials.electrode
    electrode = RegionMaterial(stiff, 0.0, branches=() if stiff is None else stiff.branches)
    block = RegionMaterial(None, EPSILON_0 * (g.clamps.relative_permittivity if g.clamps else 1))
    return {
        "film": RegionMaterial(
            *(film, EPSILON_0 * eps.intercept, mounted, EPSILON_0 * eps.slope, film.branches)
        ),
        "top_electrode": electrode,
        "bottom_electrode": electrode,
        "air": RegionMaterial(None, EPSILON_0),
        "mount_block": block,
        "frame_block": block,
    }
