"""Lagrange cells in numpy: shape functions in VTK's node order, on squares and triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def inverse(A: Array) -> Array:
    """Inverses of many small matrices, shape (..., 2, 2) or (..., 3, 3), by cofactors.

    LAPACK, called once a matrix, takes ten times as long.
    """
    if A.shape[-1] == 2:
        a, b, c, d = A[..., 0, 0], A[..., 0, 1], A[..., 1, 0], A[..., 1, 1]
        cofactors = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], -2)
        return np.asarray(cofactors / (a * d - b * c)[..., None, None])
    x, y, z = A[..., 0], A[..., 1], A[..., 2]  # columns
    rows = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], -2)
    return np.asarray(rows / np.einsum("...i,...i", rows[..., 0, :], x)[..., None, None])


@dataclass(frozen=True)
class Cell:
    """A reference cell.

    Attributes:
        name: 'quadrilateral' (0..1 squared) or 'triangle'.
        order: 1 or 2.
    """

    name: str
    order: int

    @property
    def corners(self) -> int:
        """Number of corners; they come first in the node order."""
        return 4 if self.name == "quadrilateral" else 3

    @cached_property
    def nodes(self) -> Array:
        """Reference coordinates of the nodes, shape (nodes, 2), in VTK's order."""
        corner = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        if self.name == "triangle":
            corner = np.array([[0.0, 0], [1, 0], [0, 1]])
        if self.order == 1:
            return corner
        middles = (corner + np.roll(corner, -1, axis=0)) / 2
        centre = corner.mean(axis=0, keepdims=True)
        return np.vstack([corner, middles, *([centre] if self.corners == 4 else [])])

    @cached_property
    def gauss(self) -> Array:
        """The points at which derivatives are best: 2 x 2 Gauss, or 3 mid-points of medians."""
        if self.corners == 3:
            return np.array([[1, 1], [4, 1], [1, 4]]) / 6
        g = (1 + np.array([-1, 1]) / np.sqrt(3)) / 2
        return np.array([[x, y] for x in g for y in g])

    @cached_property
    def from_gauss(self) -> Array:
        """Extrapolates values at the Gauss points to the nodes, (nodes, points)."""
        terms = [(0, 0), (1, 0), (0, 1), *([(1, 1)] if self.corners == 4 else [])]

        def powers(at: Array) -> Array:
            return np.stack([at[:, 0] ** a * at[:, 1] ** b for a, b in terms], axis=1)

        return np.asarray(powers(self.nodes) @ np.linalg.inv(powers(self.gauss)))

    @property
    def vtk_type(self) -> int:
        """VTK's cell type."""
        return {(4, 1): 9, (4, 2): 28, (3, 1): 5, (3, 2): 22}[self.corners, self.order]

    @property
    def xdmf_type(self) -> str:
        """XDMF's topology type."""
        name = "Quadrilateral" if self.corners == 4 else "Triangle"
        return name if self.order == 1 else f"{name}_{9 if self.corners == 4 else 6}"

    def shape(self, points: Array) -> tuple[Array, Array]:
        """Shape functions (points, nodes) and their gradients (points, nodes, 2)."""
        x, y = points.T
        powers = self._powers
        values = np.stack([x**a * y**b for a, b in powers], axis=1)
        d_x = np.stack([a * x ** max(a - 1, 0) * y**b for a, b in powers], axis=1)
        d_y = np.stack([b * x**a * y ** max(b - 1, 0) for a, b in powers], axis=1)
        return values @ self._coefficients, np.stack(
            [d_x @ self._coefficients, d_y @ self._coefficients], axis=2
        )

    @property
    def _powers(self) -> list[tuple[int, int]]:
        n = range(self.order + 1)
        return [(a, b) for a in n for b in n if self.corners == 4 or a + b <= self.order]

    @cached_property
    def _coefficients(self) -> Array:
        x, y = self.nodes.T
        return np.linalg.inv(np.stack([x**a * y**b for a, b in self._powers], axis=1))


@cache
def _linear(name: str) -> Cell:
    """Cell of a mesh with straight edges; its coefficients are computed once."""
    return Cell(name, 1)


def gradients(cell: Cell, corners: Array, points: Array) -> tuple[Array, Array]:
    """Gradients of the shape functions in a mesh with straight edges.

    Args:
        cell: Reference cell.
        corners: Corner coordinates, shape (cells, corners, 2).
        points: Reference points, shape (points, 2).

    Returns:
        Positions (cells, points, 2) and gradients (cells, points, nodes, 2).
    """
    linear = _linear(cell.name)
    N, dN = linear.shape(points)
    position = N @ corners
    jacobian = np.swapaxes(corners, 1, 2)[:, None] @ dN  # dX_i / dx_j
    _, reference = cell.shape(points)
    return position, reference @ inverse(jacobian)


def face(corners: Array, side: int) -> npt.NDArray[np.bool_]:
    """Which sides of cells are on the upper face of the body that they make up, or on its lower.

    Args:
        corners: Of all cells of the body, (cells, corners, 2).
        side: 1 for the upper face, -1 for the lower one.

    Returns:
        For the sides from each corner to the next, (cells, corners).
    """
    ends = np.roll(corners, -1, axis=1)
    middle, along = (corners + ends) / 2, ends - corners
    out = middle - corners.mean(axis=1, keepdims=True)
    turn = np.sign(out[..., 1] * along[..., 0] - out[..., 0] * along[..., 1])
    _, index, cells = np.unique(
        middle.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
    )
    free = (cells[index.ravel()] == 1).reshape(turn.shape)  # of one cell only
    return np.asarray(free & (side * turn * along[..., 0] > np.abs(along[..., 1])))
