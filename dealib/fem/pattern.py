"""Reduced matrices with only those entries that can differ from zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx.fem import petsc as fem_petsc

from dealib.fem import compat
from dealib.fem.constraints import ConstraintMap
from dealib.fem.problem import Problem

_CHUNK = 10_000  # nodes whose neighbours are counted at a time


def add_form(problem: Problem, form: str, matrix: Any) -> None:
    """Add a bilinear form to a reduced matrix, which is left to be assembled.

    Args:
        problem: The problem, at its state.
        form: Name of the form.
        matrix: The matrix.
    """
    map_ = problem.constraints
    matrix.setLGMap(map_.lgmap(map_.physical), map_.lgmap(map_.columns))
    fem_petsc.assemble_matrix(matrix, problem.form(form))


def create_matrix(problem: Problem, assemble: Callable[[Any], None]) -> Any:
    """An empty reduced matrix whose pattern comes from a generic state (collective).

    In a generic state no entry vanishes by chance. Later assemblies skip exact zeros, which may lie
    outside the pattern.

    Args:
        problem: The problem; its state is restored.
        assemble: Adds the tangent at the problem's state to a matrix.
    """
    map_, w = problem.constraints, problem.spaces.w
    saved = w.x.array.copy()
    index_map = problem.spaces.W.dofmap.index_map
    local = np.concatenate([np.arange(*index_map.local_range), index_map.ghosts])
    size = 1e-9 * problem.domain.sizes.thickness
    w.x.array[:] = size * (1 + np.sin(1e3 * local))
    given = {port: problem.value(port) for port in problem.values}
    problem.set_values(dict.fromkeys(given, size))
    problem.settle()
    loose = PETSc.Mat().createAIJ(((map_.owned, None), (map_.owned, None)), comm=map_.comm)
    loose.setPreallocationNNZ(_row_bounds(problem, map_))
    loose.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    loose.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
    ports = [*map_.ports.values()] if map_.comm.rank == 0 else []
    loose.setValues(ports, ports, np.ones((len(ports),) * 2), addv=PETSc.InsertMode.ADD_VALUES)
    assemble(loose)
    loose.assemble()
    matrix = loose.duplicate(copy=False)
    matrix.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
    matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    w.x.array[:] = saved
    problem.set_values(given)
    problem.settle()
    return matrix


def _row_bounds(problem: Problem, map_: ConstraintMap) -> tuple[Any, Any]:
    """Bounds of a row's entries, in this rank's columns and in others; rows of ports may be full.

    A row that exceeds its bound makes PETSc copy the whole matrix again and again.
    """
    owned, ports, total = map_.owned, len(map_.ports), map_.comm.allreduce(map_.owned)
    here = np.full(owned, 16, dtype=np.int32)
    if problem.domain.dim == 2:
        here[:] = 96 if problem.spaces.order == 2 else 48
    elif problem.domain.dim == 3:
        counted = _neighbours(problem)[map_.free]
        here[: len(counted)] = counted
    here += ports
    elsewhere = here.copy()
    if map_.comm.rank == 0:
        here[owned - ports :] = owned
        elsewhere[owned - ports :] = total - owned
    return np.minimum(here, owned), np.minimum(elsewhere, total - owned)


def _neighbours(problem: Problem) -> Any:
    """Number of degrees of freedom that share a cell with each local one."""
    from scipy.sparse import csr_matrix

    W, dim = problem.spaces.W, problem.kinematics.dim
    every = compat.cell_dofs(W)
    parts = [compat.cell_dofs(W.sub(0).sub(k)) for k in range(dim)]
    parts += [compat.cell_dofs(W.sub(1))] if not problem.kinematics.sheet else []
    first, cells = parts[0], np.arange(len(every)).repeat(parts[0].shape[1])
    nodes, index = np.unique(first, return_inverse=True)
    ones = np.ones(index.size, dtype=np.int8)
    shared = csr_matrix((ones, (index.ravel(), cells)), (len(nodes), len(every)))
    counts = np.empty(len(nodes), dtype=np.int32)
    for k in range(0, len(nodes), _CHUNK):
        counts[k : k + _CHUNK] = np.diff((shared[k : k + _CHUNK] @ shared.T).indptr)
    mine = np.diff(shared.indptr)  # cells, each with its own pressures
    pressures = every.shape[1] - sum(part.shape[1] for part in parts)
    bound = counts * len(parts) + mine * pressures
    found = np.full(int(every.max()) + 1, every.shape[1], dtype=np.int32)
    for part in parts:
        found[part.ravel()] = bound[index.ravel()]
    return found
