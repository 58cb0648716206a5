"""The film at its Gauss points: what does not change is found once, the rest at each state."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dealib.config.schema import Config
from dealib.fem.device import Device
from dealib.fem.layout import Layout
from dealib.geometry import names
from dealib.results import local
from dealib.results.electrodes import Rings
from dealib.results.elements import Array
from dealib.results.margins import Film
from dealib.results.thickness import Columns, edges


@dataclass(frozen=True)
class FilmPoints:
    """The Gauss points of this rank's film cells.

    Attributes:
        film: Material and reference values.
        layout: Where nodal values come from.
        cells: The cells.
        points: Their Gauss points.
        columns: The same, sorted into columns of the whole film.
        comm: MPI communicator.
    """

    film: Film
    layout: Layout
    cells: npt.NDArray[np.int32]
    points: local.Points
    columns: Columns
    comm: MPI.Comm

    @classmethod
    def of(cls, config: Config, device: Device, layout: Layout) -> FilmPoints:
        """Those of a device (collective)."""
        comm = device.mesh.comm
        cells = device.owned(device.cells(names.FILM))
        corners = layout.corners[cells]
        points = local.Points.of(layout.cell, corners, layout.cell.gauss)
        position = points.position
        every = (np.concatenate(comm.allgather(part)) for part in (corners, position))
        columns = Columns.of(edges(*every), corners, position)
        return cls(Film.of(config), layout, cells, points, columns, comm)

    def nodal(self) -> Array:
        """Nodal values of the cells in the present state, (cells, nodes, columns)."""
        return self.layout.local()[self.cells]

    def tensions(
        self, k: local.Kinematics, pressure: Array | None, internal: Array | None
    ) -> Array:
        """In-plane true stresses, averaged through the thickness (collective).

        Args:
            k: Deformation and field.
            pressure: The mixed form's p, (cells, points).
            internal: C_i of Maxwell branches, (cells, points, branches, 4).

        Returns:
            Shape (columns, 2).
        """
        return self.columns.average(self.film.tensions(k, pressure, internal), k, self._total)

    def rings(self, k: local.Kinematics, capacitance: float) -> Rings:
        """The film in rings (collective).

        Args:
            k: Deformation.
            capacitance: Of the whole, nF.
        """
        along, around = np.hypot(k.F[..., 0, 0], k.F[..., 1, 0]), k.F[..., 2, 2]
        values = np.stack([along, around, (along * around) ** 2 / k.J], axis=-1)
        found = self.columns.average(values, k, self._total)
        edges = self.columns.edges
        share = found[:, 2] * np.diff(edges**2)
        return Rings(edges, found[:, 0], found[:, 1], capacitance * share / share.sum())

    def _total(self, mine: Array) -> Array:
        total = np.empty_like(mine)
        self.comm.Allreduce(mine, total, op=MPI.SUM)
        return total
