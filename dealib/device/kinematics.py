"""How displacements and potential on a mesh become 3 x 3 tensors, in UFL and in numpy.

Every space embeds the gradient of the displacement into a deformation gradient F of shape (3, 3)
and that of the potential into a nominal field E of shape (3,), so that all energies, margins and
fields are written once. UFL and numpy read the same description.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dealib.arrays import Array

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
        sheet: Whether the mesh is a middle surface.
    """

    space: str
    axes: tuple[str, ...]
    components: tuple[str, str, str]
    multiple: float = 1.0
    sheet: ClassVar[bool] = False

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
            F[..., 2, 2] = hoop(F, u, N, position)
        return F

    def field(self, phi: Array, dN: Array) -> Array:
        """E at points of cells, (cells, points, 3), from nodal potentials (cells, nodes)."""
        E = np.zeros((*dN.shape[:2], 3))
        E[..., : self.dim] = -at_points(phi[..., None], dN)[..., 0, :]
        return E


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


def hoop(F: Array, u: Array, N: Array, position: Array) -> Array:
    """Hoop stretch at points; on the axis itself it equals the radial stretch."""
    R = position[..., 0]
    on_axis = np.abs(R) < _ON_AXIS
    around = 1 + u[..., 0] @ N.T / np.where(on_axis, 1.0, R)
    return np.where(on_axis, F[..., 0, 0], around)


AXISYMMETRIC = Kinematics("axisymmetric", ("R", "Z"), ("R", "Z", "theta"), 2 * np.pi)
PLANE_STRAIN = Kinematics("plane_strain", ("X", "Z"), ("X", "Z", "Y"))
SOLID = Kinematics("3d", ("X", "Y", "Z"), ("X", "Y", "Z"))
SPACES = {k.space: k for k in (AXISYMMETRIC, PLANE_STRAIN, SOLID)}
