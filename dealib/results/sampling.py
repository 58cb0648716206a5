"""Sampling of stored fields between the nodes, by the shape functions of the cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dealib.arrays import Array, Ints
from dealib.errors import did_you_mean
from dealib.results.elements import Cell, face
from dealib.results.mesh import ResultMesh
from dealib.results.quantities import NOISE

_AT_ONCE = 1_000_000  # pairs of points and cells


def reference_grid(cell: Cell, n: int) -> tuple[Array, Ints]:
    """Points (points, 2) and triangles (triangles, 3) of a reference cell with n parts per side."""
    j, i = np.divmod(np.arange((n + 1) ** 2), n + 1)
    a = np.array([k for k in range((n + 1) * n) if k % (n + 1) < n])
    b, c, d = a + 1, a + n + 2, a + n + 1  # the small squares' other corners
    triangles = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    points = np.stack([i, j], axis=1) / n
    if cell.corners == 3:  # keep what lies in the lower left half, cut along the other diagonal
        triangles = np.vstack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)])
        triangles = triangles[((i + j)[triangles] <= n).all(axis=1)]
        used = np.flatnonzero(i + j <= n)
        points, triangles = points[used], np.searchsorted(used, triangles)
    return points, triangles


def locate(mesh: ResultMesh, cells: Ints, points: Array) -> tuple[Ints, Array]:
    """Find the cells that contain points, or that are nearest to them.

    Args:
        mesh: The mesh.
        cells: Indices of the cells to search, of one region.
        points: Points of the undeformed mesh, (points, 2), mm.

    Returns:
        Cell of each point, (points,), and its reference coordinates, (points, 2).
    """
    parts = np.array_split(points, 1 + len(points) * len(cells) // _AT_ONCE)
    found = [_locate(mesh, cells, part) for part in parts]
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _locate(mesh: ResultMesh, cells: Ints, points: Array) -> tuple[Ints, Array]:
    corners = mesh.corners[cells]
    low, high = corners.min(axis=1), corners.max(axis=1)
    beside = np.maximum(low - points[:, None], points[:, None] - high).max(axis=2)
    near = np.maximum(beside.min(axis=1, keepdims=True), 0) + 1e-6 * (high - low).min()
    point, cell = np.nonzero(beside <= near)
    linear = Cell(mesh.cell.name, 1)
    at = np.full((len(point), 2), 1 / mesh.cell.corners**0.5)
    for _ in range(8):  # Newton on the (bi)linear map; exact at once for rectangles
        N, dN = linear.shape(at)
        reached = np.einsum("pn,pni->pi", N, corners[cell])
        slope = np.einsum("pnj,pni->pij", dN, corners[cell])
        at = at + np.linalg.solve(slope, (points[point] - reached)[..., None])[..., 0]
    outside = np.maximum(-at, at - 1).clip(min=0).sum(axis=1)
    if mesh.cell.corners == 3:
        outside = np.maximum(outside, at.sum(axis=1) - 1)
    order = np.lexsort((outside, point))
    first = order[np.unique(point[order], return_index=True)[1]]
    return cells[cell[first]], at[first]


@dataclass(frozen=True)
class Sampler:
    """Divides the cells of some regions into triangles.

    Attributes:
        mesh: The mesh of the results.
        cells: Indices of the sampled cells.
        n: Parts per side of a cell.
    """

    mesh: ResultMesh
    cells: Ints
    n: int = 4

    @classmethod
    def of(cls, mesh: ResultMesh, regions: tuple[str, ...], n: int = 4) -> Sampler:
        """A sampler of named regions; names that the mesh does not have are ignored."""
        found = [mesh.in_region(r) for r in regions if r in mesh.names]
        return cls(mesh, np.concatenate(found), n if mesh.cell.order == 2 else 1)

    @cached_property
    def _grid(self) -> tuple[Array, Ints]:
        return reference_grid(self.mesh.cell, self.n)

    @cached_property
    def triangles(self) -> Ints:
        """Indices of the triangles' corners among the sampled points, (triangles, 3)."""
        points, triangles = self._grid
        start = len(points) * np.arange(len(self.cells))[:, None, None]
        return np.asarray((start + triangles).reshape(-1, 3))

    @cached_property
    def outline(self) -> Ints:
        """Pairs of sampled points along the boundaries of the regions, (edges, 2)."""
        edges = self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        places = np.round(self.points / np.ptp(self.points, axis=0).min(), 9)
        _, place = np.unique(places, axis=0, return_inverse=True)
        ends = np.sort(place.ravel()[edges], axis=1)
        region = self.of_points(self.mesh.region[self.cells])[edges[:, 0]]
        keys = np.column_stack([ends, region])
        _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
        return np.asarray(edges[first[count == 1]])  # inner edges belong to two triangles

    def of_points(self, of_cells: Ints) -> Ints:
        """Values at the sampled points, from values that are constant in each sampled cell."""
        return np.repeat(of_cells, len(self._grid[0]))

    def __call__(self, nodal: Array) -> Array:
        """Nodal values at the sampled points."""
        N, _ = self.mesh.cell.shape(self._grid[0])
        found = np.einsum("pn,cn...->cp...", N, nodal[self.mesh.cells[self.cells]])
        return np.asarray(found.reshape(-1, *nodal.shape[1:]))

    @cached_property
    def points(self) -> Array:
        """Sampled points of the mesh, (points, axes), mm."""
        return self(self.mesh.points)


class LayerStrip:
    """A layer between two faces, in which points are given by fractions along and across it.

    Args:
        mesh: The mesh.
        region: Name of the region.
        across: Number of the axis across it.

    Raises:
        ValueError: If there is no such region.
    """

    def __init__(self, mesh: ResultMesh, region: str, across: int = 1) -> None:
        known = [name for i, name in enumerate(mesh.names) if (mesh.region == i).any()]
        if region not in known:
            raise ValueError(f"there is no region {region!r} here{did_you_mean(region, known)}")
        self.mesh, self._across = mesh, across
        self._axes = [1 - across, across]
        self.cells: Ints = mesh.in_region(region)
        self.top = mesh.points[self.face(1)][:, self._axes]
        self.bottom = mesh.points[self.face(-1)][:, self._axes]
        self.start, self.length = float(self.top[0, 0]), float(np.ptp(self.top[:, 0]))

    def face(self, side: int) -> Ints:
        """The region's nodes on its upper (1) or lower (-1) face, in ascending order along it."""
        cell, own = self.mesh.cell, self.mesh.cells[self.cells]
        on, n = face(self.mesh.corners[self.cells], cell.corners, side, self._across), cell.corners
        found = [own[:, :n], np.roll(own[:, :n], -1, axis=1)]
        found += [own[:, n : 2 * n]] if cell.order == 2 else []
        nodes = np.unique(np.concatenate([part[on] for part in found]))
        along = np.round(self.mesh.points[nodes, 1 - self._across], 9)
        return np.asarray(nodes[np.unique(along, return_index=True)[1]])  # one of coincident ones

    @property
    def positions(self) -> Array:
        """Fractions of the length at which the upper face has nodes."""
        return np.asarray((self.top[:, 0] - self.start) / self.length)

    def at(self, values: Array, along: Array, across: Array | float) -> Array:
        """A nodal field at fractions of the length and of the thickness (0: bottom, 1: top).

        Args:
            values: Nodal values, (nodes, ...).
            along: Fractions of the length, (points,).
            across: Fractions of the thickness, (points,) or one.

        Returns:
            Shape (points, ...).
        """
        x = self.start + self.length * np.asarray(along, float)
        high, low = (np.interp(x, end[:, 0], end[:, 1]) for end in (self.top, self.bottom))
        points = np.column_stack([x, low + across * (high - low)])[:, self._axes]
        cells, reference = locate(self.mesh, self.cells, points)
        N, _ = self.mesh.cell.shape(reference)
        return np.asarray(np.einsum("pn,pn...->p...", N, values[self.mesh.cells[cells]]))

    def charge(self, arrays: dict[str, Array], side: int) -> tuple[Array, Array]:
        """Charge density on a conductor that touches a face: Gauss's law (thesis, Fig. 29).

        Args:
            arrays: All nodal fields of a state.
            side: 1 for the upper face, -1 for the lower one.

        Returns:
            Positions of the face's nodes along the mesh, mm, and D.n there, uC/mm^2 = C/m^2 of
            deformed area, n pointing out of the conductor into the strip.
        """
        nodes = self.face(side)
        X, u, D = (v[nodes][:, self._axes] for v in (self.mesh.points, arrays["u"], arrays["D"]))
        along = np.gradient(X + u, X[:, 0], axis=0, edge_order=2)
        up = np.stack([-along[:, 1], along[:, 0]], axis=1)
        D = np.where(np.abs(D) < NOISE, 0.0, D)
        return X[:, 0], -side * np.einsum("ni,ni->n", D, up) / np.linalg.norm(up, axis=1)
