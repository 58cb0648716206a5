"""Multigrid for thick solids: displacement, potential, and the mixed form's pressure by blocks."""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.arrays import Indices
from dealib.device.records import MOUNT, TERMINAL
from dealib.fem import compat
from dealib.fem.problem import Problem
from dealib.fem.system import System

EVENT = PETSc.Log.Event("dealib multigrid")
_PREFIX = "dealib_multigrid_"
_BODY: dict[str, Any] = {
    "pc_type": "hypre",
    "pc_hypre_boomeramg_strong_threshold": 0.5,  # for solids
}
_FIELD: dict[str, Any] = {"pc_type": "hypre"}


class Multigrid:
    """Preconditioner of PETSc's type `python`: a sweep of Gauss-Seidel over the blocks.

    The first two are one V-cycle of BoomerAMG each. In the displacement's block every node has all
    components, so that the block size tells multigrid the component of an unknown; fixed components
    are identity rows. A mount is a node too, of which one component moves. The potential's block is
    negative definite and is taken with the opposite sign; terminals without a given voltage belong
    to it. Other ports must be prescribed; their rows are identities already. In the mixed form the
    pressure comes last (see `_Pressure`).

    It holds no reference to the system, since PETSc would keep that alive.

    Args:
        system: The system, of a solid in three dimensions.
    """

    def __init__(self, system: System) -> None:
        self._matrix: Any = None
        self._rest: Any = None
        rows, problem = system.map, system.problem
        kinds = {port.name: port.kind for port in problem.device.ports}
        first = rows.owned - len(rows.ports) if rows.comm.rank == 0 else rows.owned
        ports: dict[Any, list[int]] = {MOUNT: [], TERMINAL: []}
        for k, name in enumerate(rows.ports if rows.comm.rank == 0 else ()):
            if kinds[name] in ports:
                ports[kinds[name]].append(first + k)
        moving, dim = np.flatnonzero(rows.field == 0), problem.kinematics.dim
        node, component = np.divmod(_components(problem)[rows.free[moving]], dim)
        nodes, node = np.unique(node, return_inverse=True)
        axes = [problem.kinematics.axes.index(p.along) for p in problem.device.of(MOUNT)]
        mounts = np.asarray(ports[MOUNT], dtype=np.int64)
        last = dim * (len(nodes) + np.arange(len(mounts))) + np.array(axes, int)[: len(mounts)]
        self._body = _Block(
            rows,
            np.concatenate([moving, mounts]),
            np.concatenate([dim * node + component, last]),
            dim * (len(nodes) + len(mounts)),
            *(dim, 1.0, _PREFIX + "body_", _BODY),
        )
        field = np.concatenate([np.flatnonzero(rows.field == 1), ports[TERMINAL]]).astype(np.int64)
        every = np.arange(len(field))
        self._field = _Block(rows, field, every, len(field), *(1, -1.0, _PREFIX + "field_", _FIELD))
        # the order of a sweep
        self._sweep: list[_Block | _Pressure] = [self._body, self._field]
        if problem.spaces.pressure_element is not None:
            self._sweep.append(_Pressure(problem))

    def setUp(self, pc: Any) -> None:
        """Extract the blocks from the tangent and set multigrid up (called by PETSc)."""
        with EVENT:
            self._set_up(pc)

    def destroy(self, pc: Any = None) -> None:
        """Destroy its PETSc objects (called by PETSc, and before they are created anew).

        Objects that were only dropped would enter PETSc's garbage while it is being collected.
        """
        for old in (self._rest, self._matrix):
            if old is not None:
                old.destroy()
        for block in self._sweep:
            block.destroy()

    def _set_up(self, pc: Any) -> None:
        from scipy.sparse import csr_matrix

        self.destroy()
        self._matrix = pc.getOperators()[1]
        self._rest = self._matrix.createVecLeft()
        indptr, indices, values = self._matrix.getValuesCSR()
        whole = csr_matrix((values, indices, indptr), (len(indptr) - 1, self._matrix.size[1]))
        for block in self._sweep:
            block.extract(whole)
        del indptr, indices, values, whole  # multigrid needs the memory
        for block in self._sweep:
            block.set_up()

    def apply(self, pc: Any, given: Any, found: Any) -> None:
        """Solve for each block with the residual of the blocks before; PETSc calls it."""
        with EVENT:
            given.copy(found)
            for block in self._sweep:
                found.array[block.rows] = 0.0
            self._sweep[0].add(given, found)
            for block in self._sweep[1:]:
                self._matrix.mult(found, self._rest)
                self._rest.aypx(-1.0, given)
                block.add(self._rest, found)


def _components(problem: Problem) -> Indices:
    """Node of each local displacement, times the number of components, plus its component."""
    W, dim = problem.spaces.W, problem.kinematics.dim
    parts = [compat.cell_dofs(W.sub(0).sub(k)) for k in range(dim)]
    found = np.full(int(compat.cell_dofs(W).max()) + 1, -1, dtype=np.int32)
    for k, part in enumerate(parts):
        found[part] = dim * parts[0] + k
    return found


class _Pressure:
    """The pressure of the mixed form, which jumps from cell to cell: the cells are solved exactly.

    The tangent's own block is -M / kappa, with the mass matrix M. What the displacement answers to
    a pressure adds nearly -M / (4 G / 3), as in an infinite body at rest (a plane wave feels
    2 G dev : dev as 4 G / 3). That is spectrally equivalent to the Schur complement where the pair
    of elements is stable (D. Silvester and A. Wathen, SIAM J. Numer. Anal. 31 (1994) 1352).

    Attributes:
        rows: Local numbers of the unknowns, cell by cell.

    Args:
        problem: In the mixed form.
    """

    def __init__(self, problem: Problem) -> None:
        numbering = problem.constraints
        dofs = compat.cell_dofs(problem.spaces.W.sub(2))[: compat.local_cells(problem.domain.mesh)]
        row = np.full(int(dofs.max(initial=0)) + 1, -1)
        free = numbering.free[numbering.free < len(row)]
        row[free] = np.arange(len(free))
        softer = np.ones(len(dofs))  # than the tangent's block
        for group in problem.groups:
            if group.material:
                material = problem.config.materials[group.material]
                cells = problem.domain.cells(*group.regions)
                ratio = material.parameters["bulk_modulus"] / material.shear_modulus_at_rest
                softer[cells[cells < len(dofs)]] = 1 + 3 / 4 * ratio
        used = row[dofs[:, 0]] >= 0
        self._cells, self._softer = row[dofs[used]], softer[used, None, None]
        self.rows = self._cells.ravel()
        self._first = numbering.comm.exscan(numbering.owned) or 0

    def extract(self, whole: Any) -> None:
        """Invert the blocks of the cells in a matrix (see `_Block.extract`)."""
        count, size = self._cells.shape
        place = np.full(whole.shape[0], -1)
        place[self.rows] = np.arange(len(self.rows))
        part = whole[self.rows].tocoo()
        column = part.col - self._first
        mine = (column >= 0) & (column < len(place))
        row, column, values = part.row[mine], place[column[mine]], part.data[mine]
        kept = column >= 0
        row, column, values = row[kept], column[kept], values[kept]
        blocks = np.zeros((count, size, size))
        blocks[row // size, row % size, column % size] = values
        self._inverse = np.linalg.inv(blocks * self._softer)

    def set_up(self) -> None:
        """See `_Block`."""

    def destroy(self) -> None:
        """See `_Block`."""

    def add(self, given: Any, found: Any) -> None:
        """Add the approximate pressure of a right-hand side."""
        answer = self._inverse @ given.array_r[self._cells][..., None]
        found.array[self.rows] += answer.ravel()


class _Block:
    """Some unknowns in another order, with multigrid for their block of a matrix.

    Attributes:
        rows: Local numbers of the unknowns.

    Args:
        numbering: The constraint map.
        rows: Local numbers of the unknowns.
        places: Local number of each unknown in the block.
        count: Rows of the block on this rank; those without an unknown are identity rows.
        size: Components of a node.
        sign: Factor of the block.
        prefix: Prefix of the options.
        options: PETSc's options.
    """

    def __init__(
        self,
        numbering: Any,
        rows: Any,
        places: Any,
        count: int,
        size: int,
        sign: float,
        prefix: str,
        options: dict[str, Any],
    ) -> None:
        self.rows, self._places, self._count = rows, places, count
        self._size, self._sign, self._prefix, comm = size, sign, prefix, numbering.comm
        known = PETSc.Options()
        for key, value in options.items():
            known[prefix + key] = value
        self._first = comm.exscan(count) or 0
        column = np.full(numbering.owned, -1, dtype=np.int32)
        column[rows] = self._first + places
        self._column = np.concatenate(comm.allgather(column))  # of each unknown, on any rank
        self._row = np.full(count, -1)
        self._row[places] = rows
        self._comm = comm
        self._pc: Any = None

    def extract(self, whole: Any) -> None:
        """Extract the block from a matrix.

        Args:
            whole: This rank's rows, columns numbered over all ranks.
        """
        from scipy.sparse import csr_matrix

        known = self._row >= 0
        part = whole[self._row[known]]
        columns = self._column[part.indices]
        kept = columns >= 0
        lengths = np.zeros(self._count, dtype=np.int64)
        lengths[known] = np.diff(np.concatenate([[0], np.cumsum(kept)])[part.indptr])
        indptr = np.concatenate([[0], np.cumsum(lengths)])
        shape = (self._count, int(self._comm.allreduce(self._count)))
        block = csr_matrix((self._sign * part.data[kept], columns[kept], indptr), shape)
        diagonal = block.diagonal(self._first)
        unit = float(np.abs(diagonal).mean()) if len(diagonal) else 1.0
        # rows without an unknown; and identity rows of prescribed ports, to which the sign applied
        turned = np.where((diagonal < 0) & (self._sign < 0), -2 * diagonal, 0.0)
        places = np.arange(self._count)
        more = (np.where(known, turned, unit), (places, self._first + places))
        block += csr_matrix(more, shape)
        sizes = ((self._count, None), (self._count, None))
        csr = (block.indptr.astype(np.int32), block.indices.astype(np.int32), block.data)
        self._matrix = PETSc.Mat().createAIJ(sizes, bsize=self._size, csr=csr, comm=self._comm)

    def set_up(self) -> None:
        """Set multigrid up."""
        self._pc = PETSc.PC().create(self._comm)
        self._pc.setOptionsPrefix(self._prefix)
        self._pc.setOperators(self._matrix)
        self._pc.setFromOptions()
        self._pc.setUp()
        self._given, self._found = self._matrix.createVecs()

    def destroy(self) -> None:
        """Destroy the PETSc objects of a tangent."""
        if self._pc is not None:
            for old in (self._pc, self._matrix, self._given, self._found):
                old.destroy()

    def add(self, given: Any, found: Any) -> None:
        """Add the block's approximate solution of a right-hand side."""
        self._given.set(0.0)
        self._given.array[self._places] = self._sign * given.array_r[self.rows]
        self._pc.apply(self._given, self._found)
        found.array[self.rows] += self._found.array_r[self._places]
