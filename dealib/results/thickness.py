"""Averages over the thickness of a film: its points in columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dealib.results import local
from dealib.results.elements import Array, face


@dataclass(frozen=True)
class Columns:
    """Points of film cells, in columns through the thickness.

    Attributes:
        edges: Radii that bound the columns, (columns + 1,), mm.
        column: Column of each point, (cells, points).
        area: Meridian area of each point in the mesh, (cells, points), mm^2.
    """

    edges: Array
    column: npt.NDArray[np.int64]
    area: Array

    @classmethod
    def of(cls, edges: Array, corners: Array, position: Array) -> Columns:
        """Sort points into columns.

        Args:
            edges: Radii that bound the columns (see `edges`), ascending.
            corners: Corners of the cells (cells, corners, 2).
            position: The points (cells, points, 2).
        """
        x, y = corners[..., 0], corners[..., 1]
        area = np.abs((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)) / 2
        return cls(
            edges,
            _column(edges, position),
            np.broadcast_to(area[:, None] / position.shape[1], position.shape[:2]),
        )

    @property
    def radii(self) -> Array:
        """Middle of each column, (columns,), mm."""
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2)

    def average(
        self, values: Array, k: local.Kinematics, total: Callable[[Array], Array] = np.asarray
    ) -> Array:
        """Averages over the deformed thickness.

        Args:
            values: Values at the points, (cells, points, components).
            k: Deformation.
            total: Adds up what each rank has.

        Returns:
            Shape (columns, components).
        """
        weights = self.area * k.J / k.F[..., 2, 2]
        parts = [weights, *np.moveaxis(values * weights[..., None], -1, 0)]
        count, column = len(self.radii), self.column.ravel()
        mine = np.stack([np.bincount(column, p.ravel(), minlength=count) for p in parts])
        sums = total(mine.astype(float))  # without points they are integers
        return np.asarray((sums[1:] / sums[0]).T)


def edges(corners: Array, position: Array) -> Array:
    """Radii of the film's columns: of the corners on its upper face, ascending, mm.

    A column in which no point lies (of free triangles) goes to its neighbour.

    Args:
        corners: Corners of all film cells, (cells, corners, 2).
        position: Their points, (cells, points, 2).
    """
    upper = face(corners, 1)
    found = np.unique([corners[upper][:, 0], np.roll(corners, -1, axis=1)[upper][:, 0]])
    found = found[np.diff(found, prepend=-1.0) > 1e-9 * found[-1]]
    used = np.unique(_column(found, position))
    return np.append(found[[0, *used[1:]]], found[-1])


def _column(edges: Array, position: Array) -> npt.NDArray[np.int64]:
    return np.clip(np.searchsorted(edges, position[..., 0]) - 1, 0, len(edges) - 2)
