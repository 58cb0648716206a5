"""Lowest eigenvalues of a state's tangent, and their shapes: the softest modes, and vibrations.

The eigenvalue problem is K u = x M u, with K the second derivative of the potential, and M either

- the matrix of u.u averaged over the mounted volume of all materials: x, in N/mm, is twice the
  energy of a mode of 1 mm root mean square, and is negative for an unstable mode;
- or the mass, in t: x, in 1/s^2, is the square of an angular frequency, or minus the square of a
  growth rate.

M is zero for the potential, the pressure and the ports without displacements; these are eliminated
through the saddle-point form of the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.fem import petsc as fem_petsc

from dealib.fem.linear import Factor
from dealib.fem.system import System

Array = npt.NDArray[np.float64]
_BELOW, _WIDER = 2.0, 4.0  # first shift over the nearest eigenvalue, and its growth factor
_TOLERANCE = 1e-10  # relative, of 1 / (x - shift)
_ALIKE = 0.5  # least (u.M v)^2 of two modes that count as the same


@dataclass(frozen=True)
class Eigenmodes:
    """The lowest modes of a state.

    Attributes:
        unstable: Number of unstable modes, that is of independent motions that lower the potential.
        values: x of each mode, ascending.
        shapes: Reduced vectors u with u.M u = 1, the same on every rank: (modes, unknowns).
        momenta: M u, likewise.
    """

    unstable: int
    values: Array
    shapes: Array
    momenta: Array

    def first(self, count: int) -> Eigenmodes:
        """The first modes, as many as asked for."""
        parts = {name: getattr(self, name)[:count] for name in ("values", "shapes", "momenta")}
        return replace(self, **parts)

    def again(self, other: Eigenmodes) -> Eigenmodes:
        """These modes in another state: its modes with the most similar shapes.

        Where there is no similar one, the value is NaN and the shape remains.
        """
        from scipy.optimize import linear_sum_assignment

        like = (self.momenta @ other.shapes.T) ** 2
        rows, columns = linear_sum_assignment(-like)
        same = like[rows, columns] > _ALIKE
        mine, found = rows[same], columns[same]
        values = np.full_like(self.values, np.nan)
        shapes, momenta = self.shapes.copy(), self.momenta.copy()
        values[mine], shapes[mine] = other.values[found], other.shapes[found]
        momenta[mine] = other.momenta[found]
        return Eigenmodes(other.unstable, values, shapes, momenta)


def lowest(tangent: Any, mass: Any, concave: int, count: int) -> Eigenmodes:
    """The lowest modes of a tangent (collective).

    ARPACK finds the eigenvalues nearest to a shift, which must lie below the lowest one. If there
    are unstable modes, the number of negative pivots tells whether it does.

    Args:
        tangent: K of the reduced unknowns, symmetric (see `fixed_tangent`).
        mass: M.
        concave: Number of unknowns in which the potential is concave (see `Newton.concave`).
        count: Number of modes.
    """
    factor, shift = Factor(tangent), 0.0
    unstable, neutral = factor.inertia[0] - concave, factor.inertia[1]
    if unstable or neutral:
        (nearest,), *_ = _nearest(factor, mass, shift, 1, "LM")
        shift = -_BELOW * abs(nearest)
        while (factor := Factor(tangent - shift * mass)).inertia[0] > concave:
            shift *= _WIDER
    return Eigenmodes(unstable, *_nearest(factor, mass, shift, count, "LA"))


def _nearest(
    factor: Factor, mass: Any, shift: float, count: int, which: str
) -> tuple[Array, Array, Array]:
    """Eigenvalues nearest to a shift, their vectors u in rows, and M u, the same on every rank.

    ARPACK runs on every rank with whole vectors; products and solutions are distributed.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    comm, (start, end) = mass.comm.tompi4py(), mass.getOwnershipRange()
    size = mass.getSize()[0]
    x, y = mass.createVecs()

    def apply(act: Any, whole: Array) -> Array:
        x.array[:] = np.ravel(whole)[start:end]
        act(x, y)
        return np.concatenate(comm.allgather(y.array_r.copy()))

    operators = [
        LinearOperator((size, size), matvec=lambda v, act=act: apply(act, v), dtype=np.float64)
        for act in (mass.mult, factor.solve)
    ]
    first = np.random.default_rng(1).standard_normal(size)
    values, vectors = eigsh(
        operators[0], min(count, size - 1), operators[0], shift, which, first,
        tol=_TOLERANCE, OPinv=operators[1],
    )  # fmt: skip
    order = np.argsort(values)
    shapes = vectors[:, order].T
    return values[order], shapes, np.array([apply(mass.mult, shape) for shape in shapes])


def averaged(system: System) -> Any:
    """M of u.u averaged over the mounted volume (collective); zero rows for prescribed ports."""
    problem, map_ = system.problem, system.map
    matrix = system.matrix.duplicate(copy=False)
    matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    matrix.setLGMap(map_.lgmap(map_.physical), map_.lgmap(map_.columns))
    fem_petsc.assemble_matrix(matrix, problem.form("product"))
    matrix.assemble()
    matrix.scale(1 / problem.integrate("mounted"))
    fixed = [map_.ports[n] for n, law in system.ports.items() if law.fixed]
    matrix.zeroRowsColumns(fixed if map_.comm.rank == 0 else [], 0.0)
    return matrix
