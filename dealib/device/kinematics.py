"""How displacements and potential on a mesh become 3 x 3 tensors, in UFL and in numpy.

Every space embeds the gradient of the displacement into a deformation gradient F of shape (3, 3)
and that of the potential into a nominal field E of shape (3,), so that all energies, margins and
fields are written once. UFL and numpy read the same description.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
_ON_AXIS = 1e-9  # mm; nearer to the axis u_R / R is rounding


@dataclass(frozen=True)
class Kinematics:
    """One space: axisymmetric, plane strain, or three dimensions.

    Attributes:
        space: Its name in the config.
        axes: Names of the mesh's coordinates and of the displacement's components.
        components: Names of the tensors' components.
        multiple: Volume of the whole device over that of the mesh: the width in plane strain, 2 pi
            times the radius (which is left to the methods) in a body of revolution, the number of
            symmetric parts in 3-D.
    """

    space: str
    axes: tuple[str, ...]
    components: tuple[str, str, str]
    multiple: float = 1.0

    @property
    def dim(self) -> int:
        """Number of displacement components."""
        return len(self.axes)

    @property
    def packed(self) -> int:
        """Number of components of symmetric tensors that can be other than zero."""
        return 6 if self.dim == 3 else 4

    @property
    def lies(self) -> tuple[int, ...]:
        """Numbers of the axes in which the mesh lies."""
        return tuple(range(self.dim))

    @property
    def sheet(self) -> bool:
        """Whether the mesh is a middle surface."""
        return False

    @property
    def revolved(self) -> bool:
        """Whether it is a body of revolution, whose first coordinate is the radius."""
        return self.space == "axisymmetric"

    def times(self, multiple: float) -> Kinematics:
        """The same space with another `multiple`."""
        return replace(self, multiple=multiple)

    # --- UFL -------------------------------------------------------------------------------------

    def volume(self, position: Any) -> Any:
        """Volume of the device per size of the mesh at a position."""
        return self.multiple * position[0] if self.revolved else self.multiple

    def deformation_gradient(self, u: Any, position: Any) -> Any:
        """F of shape (3, 3).

        Args:
            u: Displacement, a UFL vector of the mesh's axes.
            position: The mesh's coordinates.
        """
        import ufl

        assert u.ufl_shape == (self.dim,), "the displacement needs one component for each axis"
        return ufl.Identity(3) + self.gradient(u, position)

    def gradient(self, v: Any, position: Any) -> Any:
        """Gradient of a displacement, real or virtual, shape (3, 3)."""
        import ufl

        H = ufl.grad(v)
        if self.dim == 3:
            return H
        hoop = v[0] / position[0] if self.revolved else 0
        return ufl.as_matrix([[H[0, 0], H[0, 1], 0], [H[1, 0], H[1, 1], 0], [0, 0, hoop]])

    def nominal_field(self, phi: Any) -> Any:
        """E = -Grad phi, shape (3,), per length of the mesh."""
        import ufl

        return -self.vector(ufl.grad(phi))

    def vector(self, v: Any) -> Any:
        """A vector of the mesh's axes with three components."""
        import ufl

        return v if self.dim == 3 else ufl.as_vector([v[0], v[1], 0])

    # --- numpy -----------------------------------------------------------------------------------

    def volumes(self, position: Array) -> Array:
        """The same as `volume`, at positions (..., axes)."""
        if self.revolved:
            return np.asarray(self.multiple * position[..., 0])
        return np.full(position.shape[:-1], self.multiple)

    def deformation(self, u: Array, N: Array, dN: Array, position: Array) -> Array:
        """F at points of cells, (cells, points, 3, 3).

        Args:
            u: Nodal displacements (cells, nodes, axes).
            N: Shape functions (points, nodes).
            dN: Their gradients (cells, points, nodes, axes).
            position: The points (cells, points, axes).
        """
        n, F = self.dim, by_component(np.zeros((3, 3, *position.shape[:2])))
        F[..., :n, :n] = at_points(u, dN)
        for k in range(3):
            F[..., k, k] += 1
        if self.revolved:
            F[..., 2, 2] = _hoop(F, u, N, position)
        return F

    def field(self, phi: Array, dN: Array) -> Array:
        """E at points of cells, (cells, points, 3), from nodal potentials (cells, nodes)."""
        E = np.zeros((*dN.shape[:2], 3))
        E[..., : self.dim] = -at_points(phi[..., None], dN)[..., 0, :]
        return E


@dataclass(frozen=True)
class SheetKinematics(Kinematics):
    """A sheet on a line or in a plane: its middle surface moves in space.

    The deformation gradient is determined up to a rotation, which changes no energy. Within the
    sheet it is the triangular Cholesky factor of the metric, across it the thickness stretch.

    Attributes:
        inside: Numbers of the axes in which the mesh lies.
        normal: Number of the component across it.
        offset: Coordinate of the mesh across it, mm.
    """

    inside: tuple[int, ...] = (0,)
    normal: int = 1
    offset: float = 0.0

    @property
    def packed(self) -> int:
        """See `Kinematics`: nothing is sheared across a sheet."""
        return 4

    @property
    def lies(self) -> tuple[int, ...]:
        """See `Kinematics`."""
        return self.inside

    @property
    def sheet(self) -> bool:
        """See `Kinematics`."""
        return True

    def volume(self, position: Any) -> Any:
        """See `Kinematics`: the radius is that of the mesh, or of the tube."""
        radius = position[0] if self.lies[0] == 0 else self.offset
        return self.multiple * radius if self.revolved else self.multiple

    def tangents(self, u: Any) -> list[Any]:
        """Tangents of the deformed sheet along the mesh's coordinates, UFL vectors of the axes."""
        import ufl

        H = ufl.grad(u)
        found = []
        for k, axis in enumerate(self.lies):
            parts = [H[i, k] + (1 if i == axis else 0) for i in range(self.dim)]
            found.append(ufl.as_vector(parts))
        return found

    def around(self, u: Any, position: Any) -> Any:
        """Stretch out of the plane of the mesh: the hoop stretch, or 1 in plane strain."""
        if not self.revolved:
            return 1
        return 1 + u[0] / (position[0] if self.lies[0] == 0 else self.offset)

    def gradient_square(self, u: Any, position: Any) -> Any:
        """Square of the displacement's gradient in the sheet, as a UFL expression."""
        import ufl

        return ufl.inner(ufl.grad(u), ufl.grad(u)) + (self.around(u, position) - 1) ** 2

    def metric(self, u: Any, position: Any) -> tuple[Any, ...]:
        """Components of the metric C = F^T F in the sheet that can change, as UFL expressions.

        11, 22 and 12 in three dimensions; along and around the axis; along only in plane strain.
        """
        import ufl

        tangents = self.tangents(u)
        if self.dim == 3:
            a, b = tangents
            return ufl.dot(a, a), ufl.dot(b, b), ufl.dot(a, b)
        along = ufl.dot(tangents[0], tangents[0])
        return (along, self.around(u, position) ** 2) if self.revolved else (along,)

    @property
    def plane(self) -> tuple[int, int]:
        """Components of tensors that the metric's components 1 and 2 belong to."""
        return (self.lies[0], self.lies[1]) if self.dim == 3 else (self.lies[0], 2)

    def sheet_gradient(self, metric: tuple[Any, ...], across: Any) -> Any:
        """F of shape (3, 3) up to a rotation (see the class).

        Args:
            metric: Components of `metric`.
            across: Thickness stretch.
        """
        import ufl

        first = ufl.sqrt(metric[0])
        F = [[0 if i != j else 1 for j in range(3)] for i in range(3)]
        one, two = self.plane
        F[self.normal][self.normal] = across
        F[one][one] = first
        if len(metric) == 3:
            F[one][two] = metric[2] / first
            F[two][two] = ufl.sqrt(metric[1] - metric[2] ** 2 / metric[0])
        elif len(metric) == 2:
            F[two][two] = ufl.sqrt(metric[1])
        return ufl.as_matrix(F)

    def area_vector(self, u: Any, position: Any) -> Any:
        """Area vector (normal times area) after deformation per area of the mesh, shape (3,)."""
        import ufl

        tangents = self.tangents(u)
        if self.dim == 3:
            return ufl.cross(*tangents)
        (t,), sign = tangents, 1 if self.lies[0] == 0 else -1
        around = self.around(u, position)
        return ufl.as_vector([-sign * t[1] * around, sign * t[0] * around, 0])

    def in_space(self, position: Any) -> Any:
        """Position in space of the mesh's coordinates, a UFL vector of the axes."""
        import ufl

        found: list[Any] = [self.offset if k == self.normal else 0.0 for k in range(self.dim)]
        for k, axis in enumerate(self.lies):
            found[axis] = position[k]
        return ufl.as_vector(found)

    def across(self) -> Any:
        """Unit vector across the mesh, of shape (3,)."""
        import ufl

        return ufl.as_vector([1.0 if k == self.normal else 0.0 for k in range(3)])

    def positions(self, mesh: Array) -> Array:
        """Positions in space, (..., axes), of coordinates in the mesh."""
        found = np.zeros((*mesh.shape[:-1], self.dim))
        found[..., self.normal] = self.offset
        for k, axis in enumerate(self.lies):
            found[..., axis] = mesh[..., k]
        return found

    def sheet_deformation(self, u: Array, N: Array, dN: Array, position: Array) -> Array:
        """F at points of cells, (cells, points, 3, 3), with the unit normal as its column across.

        Args:
            u: Nodal displacements (cells, nodes, axes).
            N: Shape functions (points, nodes).
            dN: Their gradients in the mesh (cells, points, nodes, mesh's coordinates).
            position: The points in space (cells, points, axes).
        """
        F = by_component(np.zeros((3, 3, *position.shape[:2])))
        H = at_points(u, dN)
        for k, axis in enumerate(self.lies):
            F[..., : self.dim, axis] = H[..., k]
            F[..., axis, axis] += 1
        if self.dim == 3:
            n = np.cross(F[..., 0], F[..., 1])
        else:
            F[..., 2, 2] = 1.0
            if self.revolved:
                F[..., 2, 2] = _hoop(F, u, N, position)
            t, sign = F[..., self.lies[0]], 1 if self.lies[0] == 0 else -1
            n = np.stack([-sign * t[..., 1], sign * t[..., 0], 0 * t[..., 0]], axis=-1)
        F[..., self.normal] = n / np.linalg.norm(n, axis=-1)[..., None]
        return F


def by_component(components: Array) -> Array:
    """Tensors (..., n, n) at many points from (n, n, ...), without a copy.

    numpy works through points that lie side by side in memory several times as fast.
    """
    return np.moveaxis(components, (0, 1), (-2, -1))


def at_points(nodal: Array, dN: Array) -> Array:
    """Gradients at points of cells, (cells, points, columns, axes), from (cells, nodes, columns).

    It takes one matrix product for each cell; one for each point takes twice as long.
    """
    cells, points, nodes, axes = dN.shape
    flat = np.swapaxes(dN, 1, 2).reshape(cells, nodes, points * axes)
    found = np.swapaxes(nodal, 1, 2) @ flat
    return np.swapaxes(found.reshape(cells, nodal.shape[2], points, axes), 1, 2)


def _hoop(F: Array, u: Array, N: Array, position: Array) -> Array:
    """Hoop stretch at points; on the axis itself it equals the radial stretch."""
    R = position[..., 0]
    on_axis = np.abs(R) < _ON_AXIS
    around = 1 + u[..., 0] @ N.T / np.where(on_axis, 1.0, R)
    return np.where(on_axis, F[..., 0, 0], around)


AXISYMMETRIC = Kinematics("axisymmetric", ("R", "Z"), ("R", "Z", "theta"), 2 * np.pi)
PLANE_STRAIN = Kinematics("plane_strain", ("X", "Z"), ("X", "Z", "Y"))
SOLID = Kinematics("3d", ("X", "Y", "Z"), ("X", "Y", "Z"))
SPACES = {k.space: k for k in (AXISYMMETRIC, PLANE_STRAIN, SOLID)}
