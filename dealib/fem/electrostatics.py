"""The electric field with the body fixed: the matrix of the potential, and capacitances."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx.fem import petsc as fem_petsc

from dealib.arrays import Array
from dealib.device.records import TERMINAL
from dealib.errors import NotConverged
from dealib.fem.constraints import FIELDS, owners_decide
from dealib.fem.linear import set_options
from dealib.fem.system import System

_SMALL: dict[str, Any] = {  # less than half of what MUMPS takes, which begins slowly
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_ordering_type": "qmd",
}
_LARGE: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_7": 5,
    "mat_mumps_icntl_8": 0,  # it is definite: neither scaling
    "mat_mumps_cntl_1": 0.0,  # nor pivoting
}
_ITERATIVE: dict[str, Any] = {"ksp_type": "cg", "ksp_rtol": 1e-8, "pc_type": "hypre"}
_FEW = 10_000  # unknowns


class Electrostatics:
    """Solves for the potential at unit voltages; the pattern and its order are found once.

    The electric energy is quadratic in the potential. Its matrix has the free potentials and the
    terminals; it is assembled at the problem's state.

    Args:
        system: The system, whose pattern it takes.
        iterative: Whether to solve by iterations.
    """

    def __init__(self, system: System, iterative: bool = False) -> None:
        self._system, map_ = system, system.map
        self._names = [port.name for port in system.problem.device.of(TERMINAL)]
        ports = [map_.ports[name] for name in self._names] if map_.comm.rank == 0 else []
        chosen = np.array([*map_.numbers("potential"), *ports], dtype=np.int32)
        self._chosen = PETSc.IS().createGeneral(chosen, comm=map_.comm)
        self._matrix = system.matrix.createSubMatrix(self._chosen, self._chosen)
        self._matrix.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        self._fixed = self._matrix.copy()
        self._fixed.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self._solver = PETSc.KSP().create(map_.comm)
        kind, options = "large", _LARGE
        if iterative:
            kind, options = "iterative", _ITERATIVE
        elif map_.comm.size == 1 and len(chosen) <= _FEW:
            kind, options = "small", _SMALL
        set_options(f"dealib_field_{kind}_", options)
        self._solver.setOptionsPrefix(f"dealib_field_{kind}_")
        self._solver.setFromOptions()
        self._solver.setOperators(self._fixed)
        self._first, self._count = self._matrix.getOwnershipRange()[0], len(chosen) - len(ports)
        self._ports = np.arange(self._count, len(chosen), dtype=np.int32)  # on rank 0 alone

    @cached_property
    def _rows(self) -> Any:
        """Rows of the matrix of the local degrees of freedom of the potential, ghosts included."""
        map_, spaces = self._system.map, self._system.problem.spaces
        numbers = np.full(len(map_.columns), -1, dtype=np.int64)
        free = map_.free[map_.field == FIELDS.index("potential")]
        numbers[free] = self._first + np.arange(len(free))
        numbers = owners_decide(spaces.W, numbers)
        ports = map_.comm.bcast(self._ports, root=0)
        for name, row in zip(self._names, ports, strict=True):
            numbers[map_.columns == map_.ports[name]] = row
        return map_.lgmap(numbers[spaces.potential[1]].astype(np.int32))

    def capacitances(self) -> Array:
        """Charges on the terminals at unit voltage of each, nF (collective).

        They are energies of two potentials, which are stationary in both: errors enter squared.
        Of electrodes that charge in time, they are as if these had charged for long.

        Returns:
            Shape (terminals, terminals), symmetric.

        Raises:
            NotConverged: If an iterative solver does not come so far.
        """
        matrix, fixed, count = self._matrix, self._fixed, len(self._names)
        matrix.zeroEntries()
        matrix.setLGMap(self._rows, self._rows)
        fem_petsc.assemble_matrix(matrix, self._system.problem.form("field"))
        matrix.assemble()
        matrix.copy(fixed, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        if self._system.charging is not None:
            self._system.charging.add_long(fixed, self._chosen)
        states = [self._with_port(matrix.createVecRight(), k, 1.0) for k in range(count)]
        columns = [fixed * state for state in states]
        fixed.zeroRowsColumns(self._ports, -1.0)
        inner = matrix.createVecRight()
        for state, column in zip(states, columns, strict=True):
            for k in range(count):
                self._with_port(column, k, 0.0)
            self._solver.solve(column, inner)
            if self._solver.getConvergedReason() < 0:
                raise NotConverged("the potential at a test voltage was not found")
            state.axpy(-1.0, inner)
        charges = [matrix * state for state in states]
        return -np.array([[state.dot(charge) for charge in charges] for state in states])

    def _with_port(self, vector: Any, k: int, value: float) -> Any:
        """A vector with another entry of a terminal."""
        if len(self._ports):  # on rank 0
            vector.array[self._count + k] = value
        return vector
