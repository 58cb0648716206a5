"""Lagrange cells in numpy: shape functions and Gauss points, with nodes in VTK's order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from math import factorial
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array, Ints
from dealib.device.kinematics import by_component

# reference corners and edges in VTK's order
_CORNERS: dict[str, list[tuple[float, ...]]] = {
    "interval": [(0,), (1,)],
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "quadrilateral": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))],
}
_EDGES: dict[str, list[tuple[int, int]]] = {
    "interval": [(0, 1)],
    "triangle": [(0, 1), (1, 2), (2, 0)],
    "quadrilateral": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetrahedron": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "hexahedron": [
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ],
}
# middles of faces and of the cell, of tensor-product cells of second order
_MIDDLES: dict[str, list[tuple[float, ...]]] = {
    "quadrilateral": [(0.5, 0.5)],
    "hexahedron": [
        *((0, 0.5, 0.5), (1, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 1, 0.5), (0.5, 0.5, 0), (0.5, 0.5, 1)),
        (0.5, 0.5, 0.5),
    ],
}
_VTK = {
    "interval": (3, 21),
    "triangle": (5, 22),
    "quadrilateral": (9, 28),
    "tetrahedron": (10, 24),
    "hexahedron": (12, 29),
}
_XDMF = {
    "interval": ("Polyline", "Edge_3"),
    "triangle": ("Triangle", "Triangle_6"),
    "quadrilateral": ("Quadrilateral", "Quadrilateral_9"),
    "tetrahedron": ("Tetrahedron", "Tetrahedron_10"),
    "hexahedron": ("Hexahedron", "Hexahedron_27"),
}
SIMPLICES = ("triangle", "tetrahedron")


def inverse(A: Array) -> Array:
    """Inverses of many small matrices, shape (..., n, n) with n up to 3, by cofactors.

    LAPACK, called once a matrix, takes thirty times as long.
    """
    return inverted(A)[0]


def inverted(A: Array) -> tuple[Array, Array]:
    """The same, and the determinants."""
    if A.shape[-1] == 1:
        return np.asarray(1 / A), A[..., 0, 0]
    if A.shape[-1] == 2:
        a, b, c, d = A[..., 0, 0], A[..., 0, 1], A[..., 1, 0], A[..., 1, 1]
        cofactors = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], -2)
        size = np.asarray(a * d - b * c)
        return np.asarray(cofactors / size[..., None, None]), size
    of = np.ascontiguousarray(np.moveaxis(A, (-2, -1), (0, 1)))  # each component by itself
    next_ = of[_CYCLE][:, _CYCLE]
    cofactors = next_[1:4, 1:4] * next_[2:, 2:] - next_[1:4, 2:] * next_[2:, 1:4]
    size = np.einsum("j...,j...", of[0], cofactors[0])
    return by_component(np.swapaxes(cofactors / size, 0, 1)), size


_CYCLE = [0, 1, 2, 0, 1]


def metric(F: Array) -> Array:
    """F^T F of many small matrices, shape (..., n, n); `matmul` takes four times as long."""
    of = np.ascontiguousarray(np.moveaxis(F, (-2, -1), (0, 1)))
    return by_component(np.einsum("ki...,kj...->ij...", of, of))


def cross(u: Array, v: Array) -> Array:
    """Vector products, shape (..., 3)."""
    found = np.empty(u.shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., i] = u[..., j] * v[..., k] - u[..., k] * v[..., j]
    return found


def dot(u: Array, v: Array) -> Array:
    """Scalar products, shape (...)."""
    return np.asarray(np.einsum("...i,...i", u, v))


def determinant(A: Array) -> Array:
    """Determinants of many small matrices, shape (..., n, n) with n up to 3."""
    if A.shape[-1] == 1:
        return np.asarray(A[..., 0, 0])
    if A.shape[-1] == 2:
        return np.asarray(A[..., 0, 0] * A[..., 1, 1] - A[..., 0, 1] * A[..., 1, 0])
    a, b, c = (A[..., 0, k] for k in range(3))
    first = A[..., 1, 1] * A[..., 2, 2] - A[..., 1, 2] * A[..., 2, 1]
    second = A[..., 1, 2] * A[..., 2, 0] - A[..., 1, 0] * A[..., 2, 2]
    third = A[..., 1, 0] * A[..., 2, 1] - A[..., 1, 1] * A[..., 2, 0]
    return np.asarray(a * first + b * second + c * third)


@dataclass(frozen=True)
class Cell:
    """A reference cell.

    Attributes:
        name: 'interval', 'triangle', 'quadrilateral', 'tetrahedron' or 'hexahedron'.
        order: 1 or 2.
    """

    name: str
    order: int

    @property
    def dim(self) -> int:
        """Topological dimension."""
        return len(_CORNERS[self.name][0])

    @property
    def size(self) -> float:
        """Volume of the reference cell."""
        return 1 / factorial(self.dim) if self.name in SIMPLICES else 1.0

    @property
    def corners(self) -> int:
        """Number of corners; they come first in the node order."""
        return len(_CORNERS[self.name])

    @cached_property
    def nodes(self) -> Array:
        """Reference coordinates of the nodes, shape (nodes, dim), in VTK's order."""
        corner = np.array(_CORNERS[self.name], dtype=float)
        if self.order == 1:
            return corner
        edges = [(corner[a] + corner[b]) / 2 for a, b in _EDGES[self.name]]
        return np.array([*corner, *edges, *_MIDDLES.get(self.name, [])])

    @cached_property
    def gauss(self) -> Array:
        """Points where derivatives are best: two Gauss points a direction, or a simplex's."""
        if self.name == "triangle":
            return np.array([[1, 1], [4, 1], [1, 4]]) / 6
        if self.name == "tetrahedron":
            a, b = (5 - np.sqrt(5)) / 20, (5 + 3 * np.sqrt(5)) / 20
            return np.full((4, 3), a) + (b - a) * np.eye(4)[:, 1:]
        g = (1 + np.array([-1, 1]) / np.sqrt(3)) / 2
        return np.array(list(product(g, repeat=self.dim)))

    @property
    def gauss_weight(self) -> float:
        """Share of the reference cell's size at each of them."""
        size = {"triangle": 1 / 2, "tetrahedron": 1 / 6}.get(self.name, 1.0)
        return size / len(self.gauss)

    @cached_property
    def from_gauss(self) -> Array:
        """Extrapolates values at the Gauss points to the nodes, (nodes, points)."""
        terms = [t for t in product((0, 1), repeat=self.dim)]
        if self.name in SIMPLICES:
            terms = [t for t in terms if sum(t) <= 1]

        def powers(at: Array) -> Array:
            return np.stack([np.prod(at**t, axis=1) for t in np.array(terms)], axis=1)

        return np.asarray(powers(self.nodes) @ np.linalg.inv(powers(self.gauss)))

    @property
    def vtk_type(self) -> int:
        """VTK's cell type."""
        return _VTK[self.name][self.order - 1]

    @property
    def xdmf_type(self) -> str:
        """XDMF's topology type."""
        return _XDMF[self.name][self.order - 1]

    @cached_property
    def basix_order(self) -> Ints:
        """For each node in VTK's order its number in Basix's."""
        points = _element(self.name, self.order).points
        return np.array([int(np.abs(points - node).sum(axis=1).argmin()) for node in self.nodes])

    def shape(self, points: Array) -> tuple[Array, Array]:
        """Shape functions (points, nodes) and their gradients (points, nodes, dim)."""
        table = _element(self.name, self.order).tabulate(1, np.ascontiguousarray(points))[..., 0]
        table = table[..., self.basix_order]
        return table[0], np.moveaxis(table[1:], 0, -1)


@cache
def _element(name: str, order: int) -> Any:
    """Basix's element; it imports nothing of dolfinx."""
    import basix

    family, kind = basix.ElementFamily.P, getattr(basix.CellType, name)
    return basix.create_element(family, kind, order, basix.LagrangeVariant.gll_warped)


def gradients(cell: Cell, nodes: Array, points: Array) -> tuple[Array, Array]:
    """Gradients of the shape functions in the mesh.

    Args:
        cell: Reference cell.
        nodes: Coordinates of the cells' nodes, shape (cells, nodes, dim).
        points: Reference points, shape (points, dim).

    Returns:
        Positions (cells, points, dim) and gradients (cells, points, nodes, dim).
    """
    N, dN = cell.shape(points)
    jacobian = np.swapaxes(nodes, 1, 2)[:, None] @ dN  # dX_i / dx_j
    return N @ nodes, dN @ inverse(jacobian)


def face(nodes: Array, corners: int, side: int, across: int = 1) -> npt.NDArray[np.bool_]:
    """Which sides of plane cells lie on the upper or the lower face of their body.

    Args:
        nodes: Coordinates of the nodes of all cells of the body, (cells, nodes, 2).
        corners: Number of corners of a cell.
        side: 1 for the upper face, -1 for the lower one.
        across: Number of the axis that points upwards.

    Returns:
        True or False for the side from each corner to the next, (cells, corners).
    """
    here = nodes[:, :corners] if across == 1 else nodes[:, :corners, ::-1]
    ends = np.roll(here, -1, axis=1)
    middle, along = (here + ends) / 2, ends - here
    out = middle - here.mean(axis=1, keepdims=True)
    turn = np.sign(out[..., 1] * along[..., 0] - out[..., 0] * along[..., 1])
    _, index, cells = np.unique(
        middle.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
    )
    free = (cells[index.ravel()] == 1).reshape(turn.shape)  # of one cell only
    return np.asarray(free & (side * turn * along[..., 0] > np.abs(along[..., 1])))
