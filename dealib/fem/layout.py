"""Converts the distributed state to plain arrays, whose order no partition changes, and back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.fem import compat
from dealib.fem.domain import node_positions
from dealib.fem.exchange import Exchange
from dealib.fem.groups import Group
from dealib.fem.potential import Problem
from dealib.results.elements import Cell
from dealib.results.mesh import ResultMesh


@dataclass
class Layout:
    """Nodal values by cell on this rank, and the whole mesh on rank 0.

    The columns of nodal values are u by axis, mm, phi, kV, and in the mixed form p, MPa. In a sheet
    phi is the voltage across the layer; in tension fields the components of the excess metric
    follow (see `materials.wrinkling`).

    Attributes:
        cell: Reference cell.
        nodes: Coordinates of the nodes of each row, (rows, nodes, axes), mm. A row is a local
            cell; of a sheet, a layer on a local cell.
        mesh: The whole mesh, nodes split between regions; None except on rank 0.
        exchange: Moves values of rows between the ranks.
    """

    cell: Cell
    nodes: Array
    mesh: ResultMesh | None
    exchange: Exchange
    _problem: Problem
    _dofs: tuple[Any, ...]
    _cells: Any  # of each row
    _groups: Any  # the same, of a sheet
    _pressure: tuple[Any, Any] | None  # its dofs by cell, and its basis at the cell's nodes

    @classmethod
    def of(cls, problem: Problem) -> Layout:
        """Gather the mesh of a device (collective)."""
        domain, spaces, kinematics = problem.domain, problem.spaces, problem.kinematics
        mesh, W, comm = domain.mesh, spaces.W, domain.mesh.comm
        name, axes = compat.cell_name(mesh), kinematics.dim
        cell = Cell(name, spaces.order)
        spaces_of = [W.sub(0).sub(k) for k in range(axes)]
        if not kinematics.sheet:
            spaces_of.append(W.sub(1))
        dofs = tuple(compat.cell_dofs(V)[:, cell.basix_order] for V in spaces_of)
        pressure = None
        if spaces.pressure_element is not None:
            basis = compat.tabulate(spaces.pressure_element, cell.nodes)
            pressure = (compat.cell_dofs(W.sub(2)), basis)
        nodes = node_positions(domain, cell)
        rows, groups = _rows(problem)
        owned = rows < compat.local_cells(mesh)
        total = comm.allreduce(compat.local_cells(mesh), op=MPI.SUM)
        original = compat.original_cells(mesh)[rows] + groups * total
        index_map = W.dofmap.index_map
        numbers = index_map.local_to_global(dofs[0][rows].ravel().astype(np.int32))
        regions = {r.name: k for k, r in enumerate(domain.device.regions)}
        region = (
            domain.region_of_cell
            if not kinematics.sheet
            else np.array([regions[g.regions[0]] for g in problem.groups], dtype=np.int32)[groups]
        )
        parts = comm.gather(
            (
                original[owned],
                np.asarray(numbers).reshape(len(rows), -1)[owned],
                nodes[rows][owned],
                region[owned],
                groups[owned],
            ),
            root=0,
        )
        places: list[Any] = []
        whole = None
        if comm.rank == 0:
            cells, global_nodes, x, region, split = (
                np.concatenate([p[k] for p in parts]) for k in range(5)
            )
            order = np.argsort(cells)
            place = np.empty_like(order)
            place[order] = np.arange(len(order))
            places = np.split(place, np.cumsum([len(part[0]) for part in parts])[:-1])
            whole = ResultMesh.number(
                *(cell, global_nodes[order], x[order], region[order], tuple(regions)),
                split[order] if kinematics.sheet else region[order],
            )
        exchange = Exchange(comm, original, owned, places)
        return cls(cell, nodes[rows], whole, exchange, problem, dofs, rows, groups, pressure)

    def rows(self, group: Group) -> Any:
        """Rows of the nodal values of a group of regions, ghosts included."""
        if group.sheet is None:
            return self._problem.domain.cells(*group.regions)
        return np.flatnonzero(self._groups == self._problem.groups.index(group))

    def cells(self, rows: Any) -> Any:
        """Local cells of rows."""
        return self._cells[rows]

    def owned(self, rows: Any) -> Any:
        """The rows among the given ones that this rank owns."""
        return rows[self.exchange.owned[rows]]

    @property
    def columns(self) -> int:
        """Number of columns of nodal values."""
        return self.local().shape[-1]

    @property
    def displacements(self) -> tuple[Any, ...]:
        """Degrees of freedom of the displacement along each axis, (rows, nodes) each."""
        return tuple(dofs[self._cells] for dofs in self._dofs[: self._problem.kinematics.dim])

    def local(self, rows: Any = slice(None)) -> Array:
        """Nodal values of rows, ghosts included: (rows, nodes, columns); default of all."""
        w = self._problem.spaces.w.x.array
        if self.exact:
            return np.asarray(w[self._every_dof[rows]])
        columns = [w[d[self._cells]] for d in self._dofs]
        if self._problem.kinematics.sheet:
            columns.append(np.broadcast_to(self._voltages()[:, None], columns[0].shape))
            if sheet := self._wrinkled:
                excess = sheet.excess_of_cells(self._cells) @ np.linalg.pinv(self._at_quadrature).T
                columns += list(np.moveaxis(excess, 1, 0))
        if self._pressure is not None:
            dofs, basis = self._pressure
            columns.append(w[dofs] @ basis.T)
        return np.stack(columns, axis=-1)[rows]

    @cached_property
    def _every_dof(self) -> Any:
        """Degrees of freedom of the nodal values where each is one, (rows, nodes, columns)."""
        return np.stack([dofs[self._cells] for dofs in self._dofs], axis=-1)

    @property
    def exact(self) -> bool:
        """Whether `gather` keeps the whole state."""
        return self._pressure is None and not self._problem.kinematics.sheet

    @property
    def _wrinkled(self) -> Any:
        sheet = self._problem.sheet
        return sheet if sheet is not None and sheet.wrinkles else None

    @cached_property
    def _at_quadrature(self) -> Array:
        """Shape functions of the nodes at the quadrature points, (points, nodes)."""
        return self.cell.shape(self._wrinkled.reference)[0]

    def _voltages(self) -> Array:
        """Voltage across the layer of each row of a sheet, kV."""
        found = []
        for _, sheet in self._problem.sheets:
            low, high = (self._problem.value(p) if p else 0.0 for p in sheet.between)
            found.append(0.0 if None in sheet.between else low - high)
        return np.array(found)[self._groups]

    def add_normals(self, normals: Array) -> None:
        """Store directions across films, (rows, points, 3), with the whole mesh (collective)."""
        found = self.gather_cells(normals)
        if self.mesh is not None:
            self.mesh = replace(self.mesh, normals=found)

    def gather(self) -> Array | None:
        """Nodal values of the whole mesh, (nodes, columns), on rank 0.

        The pressure, which jumps between cells, is averaged at the nodes of each region.
        """
        local = self.local()
        nodal, pressure = np.empty((0, 0)), np.empty((0, 0))
        if self.mesh is not None:
            nodal = np.empty((len(self.mesh.points), local.shape[-1]))
            if self._pressure is not None:
                pressure = np.empty(self.mesh.cells.shape)
        for rows, piece in self.exchange.collect(local):
            assert self.mesh is not None
            nodal[self.mesh.cells[rows]] = piece
            if self._pressure is not None:
                pressure[rows] = piece[..., -1]
        if self.mesh is None:
            return None
        if self._pressure is not None:
            every = np.arange(len(self.mesh.cells))  # nodes are split where regions meet
            self.mesh.average({"p": pressure}, every, {"p": nodal[:, -1]})
        return nodal

    def gather_cells(self, values: Array) -> Array | None:
        """Values of the local rows, (rows, ...), for the whole mesh on rank 0."""
        whole = None if self.mesh is None else np.empty((len(self.mesh.cells), *values.shape[1:]))
        for rows, piece in self.exchange.collect(values):
            assert whole is not None
            whole[rows] = piece
        return whole

    def scatter(self, values: Array | None) -> None:
        """Set the state from nodal values of the whole mesh on rank 0 (inverse of `gather`).

        The pressure is fitted in each cell to its nodal averages, as a start for Newton's method.
        """
        comm = self._problem.domain.comm
        columns, give = comm.bcast(None if values is None else values.shape[1], root=0), None
        if values is not None and self.mesh is not None:
            nodes_of = self.mesh.cells
            give = lambda rows: np.asarray(values[nodes_of[rows]])  # noqa: E731
        mine = self.exchange.hand_out(give, (self.nodes.shape[1], columns))
        w, cells = self._problem.spaces.w, self._cells[self.exchange.owned]
        for k, dofs in enumerate(self._dofs):
            w.x.array[dofs[cells]] = mine[..., k]
        if self._pressure is not None:
            dofs, basis = self._pressure
            w.x.array[dofs[cells]] = mine[..., -1] @ np.linalg.pinv(basis).T
        if sheet := self._wrinkled:
            excess = mine[..., len(self._dofs) + 1 :]
            at = np.einsum("qn,cnk->cqk", self._at_quadrature, excess)
            sheet.set_excess(cells, at)
        w.x.scatter_forward()


def _rows(problem: Problem) -> tuple[Any, Any]:
    """Cell and group number of each row of nodal values; a sheet has a row for each layer."""
    if not problem.kinematics.sheet:
        cells = problem.domain.all_cells
        return cells, np.zeros(len(cells), dtype=np.int64)
    found = [problem.domain.cells(sheet.area) for _, sheet in problem.sheets]
    groups = [np.full(len(cells), k) for k, cells in enumerate(found)]
    return np.concatenate(found), np.concatenate(groups)
