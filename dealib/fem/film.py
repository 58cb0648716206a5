"""The film at its Gauss points: what does not change is found once, the rest at each state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dealib.config.schema import Config
from dealib.fem.device import Device
from dealib.geometry import names
from dealib.results import local
from dealib.results.elements import Array
from dealib.results.margins import Film

if TYPE_CHECKING:
    from dealib.fem.layout import Layout

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class FilmPoints:
    """The Gauss points of this rank's film cells, in columns through the thickness.

    Attributes:
        film: Material and reference values.
        layout: Where nodal values come from.
        cells: The cells.
        points: Their Gauss points.
        column: Column of each point, (cells, points).
        area: Meridian area of each point in the mesh, (cells, points), mm^2.
        radii: Middle of each column of the whole film, (columns,), mm.
    """

    film: Film
    layout: Layout
    cells: npt.NDArray[np.int32]
    points: local.Points
    column: Ints
    area: Array
    radii: Array

    @classmethod
    def of(cls, config: Config, device: Device, layout: Layout) -> FilmPoints:
        """Those of a device (collective)."""
        cells = device.owned(device.cells(names.FILM))
        corners = layout.corners[cells]
        points = local.Points.of(layout.cell, corners, layout.cell.gauss)
        edges = _face(corners, device.mesh.comm)
        column = np.searchsorted(edges, points.position[..., 0]) - 1
        x, y = corners[..., 0], corners[..., 1]
        nx, ny = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
        area = np.abs((x * ny - nx * y).sum(axis=1)) / 2
        shape = points.position.shape[:2]
        return cls(
            Film.of(config),
            layout,
            cells,
            points,
            np.clip(column, 0, len(edges) - 2),
            np.broadcast_to(area[:, None] / shape[1], shape),
            (edges[1:] + edges[:-1]) / 2,
        )

    def nodal(self) -> Array:
        """Nodal values of the cells in the present state, (cells, nodes, columns)."""
        return self.layout.local()[self.cells]

    def average(self, values: Array, weights: Array, comm: Any) -> Array:
        """Averages through the thickness (collective).

        Args:
            values: Values at the points, (cells, points, components).
            weights: Weights of the points, (cells, points).
            comm: MPI communicator.

        Returns:
            Shape (columns, components).
        """
        count, column = len(self.radii), self.column.ravel()
        parts = [weights, *np.moveaxis(values * weights[..., None], -1, 0)]
        mine = np.stack([np.bincount(column, p.ravel(), minlength=count) for p in parts])
        total = np.empty_like(mine)
        comm.Allreduce(mine, total, op=MPI.SUM)
        return np.asarray((total[1:] / np.where(total[0] > 0, total[0], np.nan)).T)


def _face(corners: Array, comm: Any) -> Array:
    """Radii of the corners on the film's top face, which bound its columns (collective)."""
    heights = comm.allgather(corners[..., 1].max() if corners.size else -np.inf)
    top = corners[corners[..., 1] > max(heights) - 1e-6 * abs(max(heights))][:, 0]
    found = np.sort(np.concatenate(comm.allgather(top)))
    return np.asarray(found[np.diff(found, prepend=-1.0) > 1e-9 * found[-1]])
