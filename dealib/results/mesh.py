"""The mesh of the results: plain arrays, nodes split where regions meet."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints
from dealib.results.elements import Cell


@dataclass(frozen=True)
class ResultMesh:
    """A mesh whose regions share no nodes, so that nodal averages stay within a region.

    Attributes:
        cell: Reference cell.
        points: Node coordinates (nodes, axes), mm.
        cells: Nodes of each cell, VTK's order.
        region: Region id of each cell.
        names: Region names by id.
        normals: Normals of the films at the cells' Gauss points, (cells, points, 3), where these
            are no layers of a laminate; else None.
    """

    cell: Cell
    points: Array
    cells: Ints
    region: Ints
    names: tuple[str, ...]
    normals: Array | None = None

    @classmethod
    def number(
        cls,
        cell: Cell,
        shared: Any,
        nodes: Array,
        region: Any,
        names: tuple[str, ...],
        split: Any = None,
    ) -> ResultMesh:
        """Number the nodes by first appearance, separately in each region.

        Args:
            cell: Reference cell.
            shared: Numbers of each cell's nodes, equal where cells share a node, (cells, nodes).
            nodes: Coordinates of each cell's nodes, (cells, nodes, axes), mm.
            region: Region id of each cell, (cells,).
            names: Region names by id.
            split: Number of the group of each cell, (cells,): only cells of one group share nodes;
                by default the region ids.
        """
        split = region if split is None else split
        key = shared * (int(split.max()) + 1) + split[:, None]
        _, first, inverse = np.unique(key.ravel(), return_index=True, return_inverse=True)
        rank = np.empty(len(first), dtype=np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        cells = rank[inverse].reshape(key.shape)
        points = np.empty((len(first), nodes.shape[-1]))
        points[cells] = nodes
        return cls(cell, points, cells, np.asarray(region, dtype=np.int64), names)

    @property
    def fingerprint(self) -> str:
        """Equal for equal meshes, on any number of ranks."""
        digest = hashlib.sha256()
        for array in (self.points.round(9) + 0.0, self.cells, self.region):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @property
    def nodes(self) -> Array:
        """Coordinates of each cell's nodes, (cells, nodes, axes)."""
        return np.asarray(self.points[self.cells])

    @property
    def corners(self) -> Array:
        """Corner coordinates of each cell, (cells, corners, axes)."""
        return np.asarray(self.points[self.cells[:, : self.cell.corners]])

    def in_region(self, *names: str) -> Ints:
        """Indices of the cells of regions, sorted."""
        ids = [self.names.index(name) for name in names]
        return np.flatnonzero(np.isin(self.region, ids))

    def average(self, by_cell: dict[str, Array], cells: Ints, out: dict[str, Array]) -> None:
        """Average values at the nodes of some cells into arrays of nodal values.

        Args:
            by_cell: Values by name, (cells, nodes of a cell, ...).
            cells: Indices of the cells, which make up whole regions.
            out: Nodal values by name, (nodes, ...), which are overwritten.
        """
        Average(self, [cells]).into(out, [by_cell])


class Average:
    """Averages values of cells at their nodes, with weights that are computed once.

    Args:
        mesh: The mesh.
        blocks: Indices of the cells, in blocks that together make up whole regions.
    """

    def __init__(self, mesh: ResultMesh, blocks: Sequence[Ints]) -> None:
        from scipy.sparse import csr_matrix

        count = np.zeros(len(mesh.points))
        self._totals = []  # nodes of each block, and the sums of its values there
        for cells in blocks:
            nodes, place = np.unique(mesh.cells[cells].ravel(), return_inverse=True)
            shape = len(nodes), len(place)
            total = csr_matrix((np.ones(len(place)), (place, np.arange(len(place)))), shape)
            count[nodes] += np.bincount(place, minlength=len(nodes))
            self._totals.append((nodes, total))
        self._used = np.flatnonzero(count)
        self._count = count[self._used, None]

    def into(self, out: dict[str, Array], blocks: Iterable[dict[str, Array]]) -> None:
        """Average values by name, (cells, nodes of a cell, ...), into nodal ones, (nodes, ...)."""
        flat: dict[str, Array] = {}  # the same, a row for each node
        for (nodes, total), by_cell in zip(self._totals, blocks, strict=True):
            for name, values in by_cell.items():
                if name not in flat:
                    flat[name] = out[name].reshape(len(out[name]), -1)
                    flat[name][self._used] = 0.0
                flat[name][nodes] += total @ values.reshape(total.shape[1], -1)
        for sums in flat.values():
            sums[self._used] /= self._count
