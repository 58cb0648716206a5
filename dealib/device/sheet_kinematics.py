"""Kinematics of sheets, whose middle surface moves in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dealib.arrays import Array
from dealib.device.kinematics import Kinematics, at_points, by_component, hoop


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
    sheet: ClassVar[bool] = True

    @property
    def packed(self) -> int:
        """See `Kinematics`: nothing is sheared across a sheet."""
        return 4

    @property
    def lies(self) -> tuple[int, ...]:
        """See `Kinematics`."""
        return self.inside

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
                F[..., 2, 2] = hoop(F, u, N, position)
            t, sign = F[..., self.lies[0]], 1 if self.lies[0] == 0 else -1
            n = np.stack([-sign * t[..., 1], sign * t[..., 0], 0 * t[..., 0]], axis=-1)
        F[..., self.normal] = n / np.linalg.norm(n, axis=-1)[..., None]
        return F
