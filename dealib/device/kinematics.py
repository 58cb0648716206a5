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


@dataclass(frozen=True)
class Kinematics:
    """One space.

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
    def revolved(self) -> bool:
        """Whether it is a body of revolution, whose first coordinate is the radius."""
        return self.space == "axisymmetric"

    def times(self, multiple: float) -> Kinematics:
        """The same space for a device of another multiple of the mesh."""
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

        assert u.ufl_shape == (self.dim,), "the displacement has a component an axis"
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
        n, F = self.dim, np.zeros((*position.shape[:2], 3, 3))
        F[..., :n, :n] = np.swapaxes(u, 1, 2)[:, None] @ dN
        F += np.eye(3)
        if self.revolved:
            F[..., 2, 2] += u[..., 0] @ N.T / position[..., 0]
        return F

    def field(self, phi: Array, dN: Array) -> Array:
        """E at points of cells, (cells, points, 3), from nodal potentials (cells, nodes)."""
        E = np.zeros((*dN.shape[:2], 3))
        E[..., : self.dim] = -(phi[:, None, None] @ dN)[..., 0, :]
        return E


AXISYMMETRIC = Kinematics("axisymmetric", ("R", "Z"), ("R", "Z", "theta"), 2 * np.pi)
PLANE_STRAIN = Kinematics("plane_strain", ("X", "Z"), ("X", "Z", "Y"))
SOLID = Kinematics("3d", ("X", "Y", "Z"), ("X", "Y", "Z"))
SPACES = {k.space: k for k in (AXISYMMETRIC, PLANE_STRAIN, SOLID)}
