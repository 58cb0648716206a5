"""Films at their Gauss points, for fields, stresses and limits in each state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.fem.differential import test_fields
from dealib.fem.groups import Group
from dealib.fem.layout import Layout
from dealib.fem.newton import Newton
from dealib.fem.potential import Problem
from dealib.results import local, stress
from dealib.results.electrodes import Rings
from dealib.results.elements import gradients
from dealib.results.margins import Film, layered, mounted_fresh
from dealib.results.thickness import Columns, edges

_FAINT = 1e-2  # field over the strongest one below which a point lies outside the electrodes


@dataclass(frozen=True)
class FilmPoints:
    """The Gauss points of this rank's cells of one dielectric material.

    Attributes:
        film: Material and reference values.
        group: The regions.
        layout: Layout of nodal values.
        cells: Rows of the cells in the layout.
        points: The Gauss points.
        columns: The points sorted into columns through the whole layer; None if it is not plane.
        comm: MPI communicator.
    """

    film: Film
    group: Group
    layout: Layout
    cells: npt.NDArray[np.int32]
    points: local.CellPoints
    columns: Columns | None
    comm: MPI.Comm

    @classmethod
    def all(
        cls, problem: Problem, layout: Layout, normals: Array | None = None
    ) -> tuple[FilmPoints, ...]:
        """The films of a device, one for each material and direction (collective).

        Args:
            problem: The problem.
            layout: Its layout.
            normals: Directions across the films at the Gauss points of the local cells; default
                those of the layers.
        """
        materials = local.region_materials(problem.config)
        found = ((group, materials[group.regions[0]]) for group in problem.groups)
        return tuple(
            cls._of(problem, layout, group, material, normals)
            for group, material in found
            if material.law is not None and material.permittivity
        )

    @classmethod
    def _of(
        cls,
        problem: Problem,
        layout: Layout,
        group: Group,
        material: stress.RegionMaterial,
        normals: Array | None,
    ) -> FilmPoints:
        config, comm = problem.config, problem.domain.comm
        cells = layout.owned(layout.rows(group))
        nodes = layout.nodes[cells]
        kinematics, cell = problem.kinematics, layout.cell
        points = local.CellPoints.of(kinematics, material, cell, nodes, cell.gauss)
        frame = None
        if normals is not None:
            frame = local.Frame.of_normals(normals[cells], problem.kinematics.dim == 2)
        film = Film.of(material, mounted_fresh(config, group.regions[0]), frame)
        columns = _columns(config, group, layout, nodes, points, comm)
        return cls(film, group, layout, cells, points, columns, comm)

    @cached_property
    def volumes(self) -> Array:
        """Mounted volume of the device at each point, (cells, points), mm^3."""
        k, cell, nodes = self.points.kinematics, self.layout.cell, self.layout.nodes[self.cells]
        size = local.volumes(k, cell, nodes, cell.gauss, cell.gauss_weight)
        return size * (self.film.material.thickness or 1.0)

    def nodal(self) -> Array:
        """Nodal values of the cells in the current state, (cells, nodes, columns)."""
        return self.layout.local(self.cells)

    def tensions(self, k: stress.Deformation, nodal: Array, internal: Array | None) -> Array:
        """In-plane true stresses (see `Film.tensions`), averaged through a layer's thickness.

        Args:
            k: Deformation and field.
            nodal: Nodal values of the cells.
            internal: C_i of Maxwell branches, (cells, points, branches, 4).

        Returns:
            Shape (columns, 3), or (cells, points, 3) where there are no columns (collective).
        """
        found = self.film.tensions(k, self.points.pressure(nodal), internal)
        return found if self.columns is None else self.columns.average(found, k, self._total)

    def rings(self, k: stress.Deformation, capacitance: float) -> Rings:
        """The film divided into rings between the columns' edges (collective).

        Args:
            k: Deformation.
            capacitance: Capacitance of the whole film, nF.
        """
        assert self.columns is not None
        a = k.F[..., self.film.material.plane[0]]
        along, around = np.linalg.norm(a, axis=-1), k.F[..., 2, 2]
        values = np.stack([along, around, (along * around) ** 2 / k.J], axis=-1)
        found = self.columns.average(values, k, self._total)
        edges = self.columns.edges
        revolved = self.points.kinematics.revolved and self.film.material.normal == 1
        share = found[:, 2] * np.diff(edges**2 if revolved else edges)
        return Rings(edges, found[:, 0], found[:, 1], capacitance * share / share.sum())

    def _total(self, mine: Array) -> Array:
        total = np.empty_like(mine)
        self.comm.Allreduce(mine, total, op=MPI.SUM)
        return total


def _columns(
    config: Config,
    group: Group,
    layout: Layout,
    nodes: Array,
    points: local.CellPoints,
    comm: MPI.Comm,
) -> Columns | None:
    """Columns of a plane layer, the same on all ranks; None if it is not plane."""
    if not layered(config, group.regions):
        return None
    along = points.position[..., 1 - group.normal]
    all_nodes, all_along = (np.concatenate(comm.allgather(part)) for part in (nodes, along))
    bounds = edges(layout.cell, all_nodes, all_along, group.normal)
    return Columns.of(bounds, along, nodes, layout.cell.corners)


def field_normals(newton: Newton, layout: Layout) -> Array:
    """Unit directions of the nominal field at test voltages, (cells, points, 3) (collective).

    At each Gauss point of the local cells it is the field of the terminal that is strongest there,
    and Z where there is no field.
    """
    problem, nodal = newton.system.problem, None
    k, cell = problem.kinematics, layout.cell
    position, dN = gradients(cell, layout.nodes, cell.gauss)
    across = np.eye(3)[k.components.index("Z")]
    best = np.tile(_FAINT * across, (*position.shape[:2], 1))
    saved = newton.system.q.copy()
    for trial in test_fields(newton):
        newton.system.expand(trial)
        nodal = layout.local()
        E = k.field(nodal[..., k.dim], dN)
        size = problem.domain.comm.allreduce(float(np.abs(E).max(initial=0.0)), op=MPI.MAX)
        stronger = np.linalg.norm(E / size, axis=-1) > np.linalg.norm(best, axis=-1)
        best = np.where(stronger[..., None], E / size, best)
    newton.system.expand(saved)
    return np.asarray(best / np.linalg.norm(best, axis=-1)[..., None])
