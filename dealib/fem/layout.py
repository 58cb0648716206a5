"""Between the distributed state and plain arrays in an order that no partition changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.fem import compat
from dealib.fem.domain import Domain, Spaces
from dealib.results.elements import Cell
from dealib.results.mesh import ResultMesh

Floats = npt.NDArray[np.float64]


@dataclass
class Layout:
    """Nodal values by cell on this rank, and the whole mesh on rank 0.

    The columns of nodal values are u by axis, mm, phi, kV, and p, MPa, in the mixed form.

    Attributes:
        cell: Reference cell.
        nodes: Coordinates of the local cells' nodes (cells, nodes, axes), mm.
        mesh: The whole mesh, nodes split between regions; None except on rank 0.
    """

    cell: Cell
    nodes: Floats
    mesh: ResultMesh | None
    _spaces: Spaces
    _comm: Any
    _dofs: tuple[Any, ...]
    _owned: int
    _order: Any
    _original: Any
    _pressure: tuple[Any, Any] | None  # its dofs by cell, and its basis at the cell's nodes

    @classmethod
    def of(cls, domain: Domain, spaces: Spaces) -> Layout:
        """Gather the mesh of a device (collective)."""
        mesh, W, comm = domain.mesh, spaces.W, domain.mesh.comm
        name, axes = compat.cell_name(mesh), domain.device.kinematics.dim
        cell = Cell(name, spaces.order)
        spaces_of = (*(W.sub(0).sub(k) for k in range(axes)), W.sub(1))
        dofs = tuple(compat.cell_dofs(V)[:, cell.basix_order] for V in spaces_of)
        pressure = None
        if spaces.pressure_element is not None:
            basis = compat.tabulate(spaces.pressure_element, cell.nodes)
            pressure = (compat.cell_dofs(W.sub(2)), basis)
        geometry = compat.cell_nodes(mesh)
        shape = Cell(name, compat.geometry_order(mesh))
        at = mesh.geometry.x[geometry[:, shape.basix_order]][..., :axes]
        nodes = np.asarray(shape.shape(cell.nodes)[0] @ at)
        owned = compat.local_cells(mesh)
        original = compat.original_cells(mesh)[:owned]
        index_map = W.dofmap.index_map
        numbers = index_map.local_to_global(dofs[-1][:owned].ravel().astype(np.int32))
        parts = comm.gather(
            (
                original,
                np.asarray(numbers).reshape(owned, -1),
                nodes[:owned],
                domain.region_of_cell[:owned],
            ),
            root=0,
        )
        order, whole = None, None
        if comm.rank == 0:
            cells, global_nodes, x, region = (
                np.concatenate([p[k] for p in parts]) for k in range(4)
            )
            order = np.argsort(cells)
            names = tuple(r.name for r in domain.device.regions)
            whole = ResultMesh.number(cell, global_nodes[order], x[order], region[order], names)
        return cls(cell, nodes, whole, spaces, comm, dofs, owned, order, original, pressure)

    @property
    def displacements(self) -> tuple[Any, ...]:
        """Degrees of freedom of the displacement along each axis, (cells, nodes) each."""
        return self._dofs[:-1]

    def local(self) -> Floats:
        """Nodal values of the local cells, ghosts included: (cells, nodes, columns)."""
        w = self._spaces.w.x.array
        columns = [w[d] for d in self._dofs]
        if self._pressure is not None:
            dofs, basis = self._pressure
            columns.append(w[dofs] @ basis.T)
        return np.stack(columns, axis=-1)

    def add_normals(self, normals: Floats) -> None:
        """Take directions across films up into the whole mesh (collective)."""
        found = self.gather_cells(normals)
        if self.mesh is not None:
            self.mesh = replace(self.mesh, normals=found)

    def gather(self) -> Floats | None:
        """Nodal values of the whole mesh, (nodes, columns), on rank 0.

        The pressure, which jumps between cells, is averaged at the nodes of each region.
        """
        by_cell = self.gather_cells(self.local())
        if by_cell is None or self.mesh is None:
            return None
        nodal = self.mesh.to_nodes(by_cell)
        if self._pressure is not None:
            every = np.arange(len(self.mesh.cells))  # nodes are split where regions meet
            self.mesh.average({"p": by_cell[..., -1]}, every, {"p": nodal[:, -1]})
        return nodal

    def gather_cells(self, values: Floats) -> Floats | None:
        """Values of the local cells, (cells, ...), for the whole mesh on rank 0."""
        parts = self._comm.gather(values[: self._owned], root=0)
        return None if parts is None else np.concatenate(parts)[self._order]

    def scatter(self, values: Floats | None) -> None:
        """Set the state from nodal values of the whole mesh on rank 0 (inverse of `gather`).

        The pressure is fitted to its averages in each cell: a start for Newton, who makes it exact.
        """
        by_cell = None
        if self.mesh is not None and values is not None:
            by_cell = values[self.mesh.cells]
        by_cell = self._comm.bcast(by_cell, root=0)
        w = self._spaces.w
        for k, dofs in enumerate(self._dofs):
            w.x.array[dofs[: self._owned]] = by_cell[self._original][..., k]
        if self._pressure is not None:
            dofs, basis = self._pressure
            fitted = by_cell[self._original][..., -1] @ np.linalg.pinv(basis).T
            w.x.array[dofs[: self._owned]] = fitted
        w.x.scatter_forward()
