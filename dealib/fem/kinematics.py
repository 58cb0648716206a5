"""Axisymmetric kinematics: from two displacement components to 3 x 3 tensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl


@dataclass(frozen=True)
class Axisymmetric:
    """Components (R, Z, theta) of a body of revolution in its meridian plane.

    Attributes:
        mesh: Mesh with coordinates (R, Z).
    """

    mesh: Any

    @property
    def volume(self) -> Any:
        """DV per mesh area: 2 pi R."""
        return 2 * np.pi * ufl.SpatialCoordinate(self.mesh)[0]

    def deformation_gradient(self, u: Any) -> Any:
        """F of shape (3, 3) from u = (u_R, u_Z)."""
        assert u.ufl_shape == (2,), "the displacement has two components"
        H = ufl.grad(u)
        hoop = u[0] / ufl.SpatialCoordinate(self.mesh)[0]
        return ufl.as_matrix(
            [[1 + H[0, 0], H[0, 1], 0], [H[1, 0], 1 + H[1, 1], 0], [0, 0, 1 + hoop]]
        )

    def nominal_field(self, phi: Any) -> Any:
        """E = -Grad phi, shape (3,), per length of the mesh."""
        g = ufl.grad(phi)
        return ufl.as_vector([-g[0], -g[1], 0])


def inverse_transpose(F: Any) -> Any:
    """F^-T of the block form above (cheaper than a general inverse)."""
    d = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return ufl.as_matrix(
        [
            [F[1, 1] / d, -F[1, 0] / d, 0],
            [-F[0, 1] / d, F[0, 0] / d, 0],
            [0, 0, 1 / F[2, 2]],
        ]
    )


def area_stretch(F: Any, prestretch: Any) -> Any:
    """Square root of the growth in area of layers that were normal to Z, pre-stretch included.

    Args:
        F: Deformation gradient of the block form above.
        prestretch: Stretches (radial, thickness, hoop) before it.
    """
    radial = (F[0, 0] ** 2 + F[1, 0] ** 2) ** 0.5
    return (prestretch[0] * radial * prestretch[2] * F[2, 2]) ** 0.5


def jacobian(F: Any) -> Any:
    """J = det F of the block form above."""
    return (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]) * F[2, 2]
