"""Averages over the thickness of a layer, whose points are sorted into columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.results import stress
from dealib.results.elements import Cell, face


@dataclass(frozen=True)
class Columns:
    """Points of a layer's cells, in columns through the thickness.

    Attributes:
        edges: Coordinates along the layer that bound the columns, (columns + 1,), mm.
        column: Column of each point, (cells, points).
        volume: Volume of each point in the mesh per length out of the plane, (cells, points).
    """

    edges: Array
    column: npt.NDArray[np.int64]
    volume: Array

    @classmethod
    def of(cls, edges: Array, along: Array, nodes: Array, corners: int) -> Columns:
        """Sort points into columns.

        Args:
            edges: Coordinates that bound the columns (see `edges`), ascending, mm.
            along: Coordinates of the points along the layer, (cells, points), mm.
            nodes: Coordinates of the cells' nodes, (cells, nodes, axes), mm.
            corners: Number of corners of a cell.
        """
        x, y = nodes[:, :corners, 0], nodes[:, :corners, 1]
        area = np.abs((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)) / 2
        share = np.broadcast_to(area[:, None] / along.shape[1], along.shape)
        return cls(edges, _column(edges, along), share)

    @property
    def middles(self) -> Array:
        """Middle of each column, (columns,), mm."""
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2)

    def average(
        self, values: Array, k: stress.Deformation, total: Callable[[Array], Array] = np.asarray
    ) -> Array:
        """Averages over the deformed thickness.

        Args:
            values: Values at the points, (cells, points, components).
            k: Deformation.
            total: Adds up the arrays of all ranks.

        Returns:
            Shape (columns, components).
        """
        weights = self.volume * k.J / k.F[..., 2, 2]
        parts = [weights, *np.moveaxis(values * weights[..., None], -1, 0)]
        count, column = len(self.middles), self.column.ravel()
        mine = np.stack([np.bincount(column, p.ravel(), minlength=count) for p in parts])
        sums = total(mine.astype(float))  # without points they are integers
        return np.asarray((sums[1:] / sums[0]).T)


def edges(cell: Cell, nodes: Array, along: Array, normal: int) -> Array:
    """Coordinates that bound the columns of a layer, ascending, mm.

    They are the corners on its upper face. A column without points, which unstructured triangles
    may leave, is joined to its neighbour.

    Args:
        cell: Reference cell.
        nodes: Coordinates of the nodes of all cells of the layer, (cells, nodes, axes), mm.
        along: Coordinates of their points along the layer, (cells, points), mm.
        normal: Number of the axis across the layer.
    """
    upper = face(nodes, cell.corners, 1, normal)
    corner = nodes[:, : cell.corners, 1 - normal]
    found = np.unique([corner[upper], np.roll(corner, -1, axis=1)[upper]])
    size = np.abs(found).max()
    found = found[np.diff(found, prepend=-np.inf) > 1e-9 * size]
    used = np.unique(_column(found, along))
    return np.append(found[[0, *used[1:]]], found[-1])


def _column(edges: Array, along: Array) -> npt.NDArray[np.int64]:
    return np.clip(np.searchsorted(edges, along) - 1, 0, len(edges) - 2)
