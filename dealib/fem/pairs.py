"""Complex symmetric systems, solved in real numbers.

(A + iB) X = F with real symmetric A and B and a real right-hand side is

    [[A, -B], [-B, -A]] (Re X, Im X) = (Re F, -Im F),

which is symmetric. Real and imaginary part of each unknown stand side by side.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.fem.linear import set_options

_PREFIX = "dealib_response_"
_OPTIONS: dict[str, Any] = {
    "mat_mumps_icntl_7": 5,  # METIS
    "mat_mumps_icntl_14": 60,  # room for pivoting, per cent
}


class Pairs:
    """Solves systems whose matrix is a sum of real matrices with complex factors.

    Args:
        parts: The real symmetric matrices by name. Rows of prescribed unknowns are those of the
            identity in one of them, and zero in the others.
    """

    def __init__(self, parts: dict[str, Any]) -> None:
        first = next(iter(parts.values()))
        self._comm, start_end = first.comm, first.getOwnershipRange()
        self._start, size = start_end[0], first.getSize()[0]
        rows = start_end[1] - start_end[0]
        keys = {}
        for name, part in parts.items():
            indptr, columns, values = part.getValuesCSR()
            row = np.repeat(np.arange(rows, dtype=np.int64), np.diff(indptr))
            keys[name] = (row * size + columns, values)
        diagonal = np.arange(rows, dtype=np.int64) * size + self._start + np.arange(rows)
        union = np.unique(np.concatenate([diagonal, *(key for key, _ in keys.values())]))
        self._values = {}
        for name, (key, values) in keys.items():
            self._values[name] = np.zeros(len(union))
            self._values[name][np.searchsorted(union, key)] = values
        row, columns = union // size, union % size
        counts = np.bincount(row, minlength=rows)
        self._indptr = np.concatenate([[0], np.cumsum(np.repeat(2 * counts, 2))]).astype(np.int32)
        # row i becomes 2i: A, -B, A, -B, ..., and 2i + 1: -B, -A, ...
        place = np.arange(len(union)) - (np.cumsum(counts) - counts)[row]
        upper = 4 * (np.cumsum(counts) - counts)[row] + 2 * place
        self._upper, self._lower = upper, upper + 2 * counts[row]
        indices = np.empty(4 * len(union), dtype=np.int32)
        for at in (self._upper, self._lower):
            indices[at], indices[at + 1] = 2 * columns, 2 * columns + 1
        self._data = np.zeros(4 * len(union))
        self._matrix = PETSc.Mat().createAIJ(
            ((2 * rows, 2 * size), (2 * rows, 2 * size)),
            csr=(self._indptr, indices, self._data),
            comm=self._comm,
        )
        self._indices, self._solver = indices, PETSc.KSP().create(self._comm)
        set_options(_PREFIX, _OPTIONS)
        self._solver.setOptionsPrefix(_PREFIX)
        self._solver.setType("preonly")
        self._solver.getPC().setType("cholesky")
        self._solver.getPC().setFactorSolverType("mumps")
        self._solver.setFromOptions()

    def solve(self, factors: dict[str, complex], right: Any) -> tuple[Any, Any]:
        """Real and imaginary part of the solution for a real right-hand side (collective).

        Args:
            factors: Factor of each matrix.
            right: The right-hand side.
        """
        data, up, low = self._data, self._upper, self._lower
        A = sum(complex(factors[name]).real * values for name, values in self._values.items())
        B = sum(complex(factors[name]).imag * values for name, values in self._values.items())
        data[up], data[up + 1], data[low], data[low + 1] = A, -B, -B, -A
        self._matrix.setValuesCSR(self._indptr, self._indices, data)
        self._matrix.assemble()
        self._solver.setOperators(self._matrix)
        x, f = self._matrix.createVecs()
        f.array[0::2] = right.array_r
        self._solver.solve(f, x)
        parts = right.duplicate(), right.duplicate()
        for part, k in zip(parts, (0, 1), strict=True):
            part.array[:] = x.array_r[k::2]
        return parts
