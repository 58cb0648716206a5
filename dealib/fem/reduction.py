"""Model reduction: solutions of a family of symmetric systems from a few of them.

The members are (sum f_k P_k) X = F with real symmetric P_k and complex factors f_k. A few are
solved; the others are sought in the span of the solutions' real and imaginary parts (Galerkin). The
member with the largest residual is solved next, until two members in turn agree with their
reduced solution to a tolerance.

A part with a large factor, such as conductance over a small frequency, rounds off what is added to
it in a row. Where such a part acts, a solution is therefore taken apart into a vector of its rows
and one of the others: without that, motions had errors of 5e-8, now they are below 1e-9.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dealib.arrays import Array, Complex

Factors = dict[str, complex]
_TOLERANCE = 1e-9  # relative error of the checked values
_NONE = 1e-15  # checked value over the largest one below which it counts as zero
_LOOKED_AT = 8  # members whose residual is updated before the next one is solved
_ENOUGH = 2  # members in turn that must agree
_SAME = 1e-13  # relative remainder of a vector that counts as lying in the span


class Reduction:
    """Solves members of the family (collective).

    Args:
        parts: P_k by name.
        right: F.
        solve: Gives real and imaginary part of the solution of a member.
        look: Gives the values of X that are checked, the same on every rank.
        apart: Names of P_k whose rows have vectors of their own.
    """

    def __init__(
        self,
        parts: dict[str, Any],
        right: Any,
        solve: Callable[[Factors], tuple[Any, Any]],
        look: Callable[[Complex], Complex],
        apart: Sequence[str] = (),
    ) -> None:
        self._span, self._solve, self._look = _Span(parts, right, apart), solve, look
        self._learnt = False

    def at(self, family: Sequence[Factors]) -> list[Complex]:
        """Coordinates of X in the span for members in an order in which X changes smoothly."""
        span, exact = self._span, {}

        def learn(k: int) -> Complex:
            one, other = (part.array_r.copy() for part in self._solve(family[k]))
            span.add(one)
            span.add(other)
            exact[k] = span.coordinates(one + 1j * other)
            return one + 1j * other

        if family and not self._learnt:
            for k in sorted({0, len(family) // 2, len(family) - 1}):
                learn(k)
            self._learnt = True
        missed = {k: self._missed(f) for k, f in enumerate(family) if k not in exact}
        right_so_far = 0
        while missed and right_so_far < _ENOUGH:
            worst = self._worst(missed, family)
            expected = self._look(self.whole(span.solution(family[worst])))
            true = self._look(learn(worst))
            del missed[worst]
            size = np.abs(true)
            hit = (np.abs(expected - true) <= _TOLERANCE * size + _NONE * size.max()).all()
            right_so_far = right_so_far + 1 if hit else 0
        found = exact | {k: span.solution(family[k]) for k in missed}
        return [found[k] for k in range(len(family))]

    def _missed(self, factors: Factors) -> float:
        return self._span.residual(factors, self._span.solution(factors))

    def _worst(self, missed: dict[int, float], family: Sequence[Factors]) -> int:
        """The member with the largest residual among those that had the largest ones before."""
        found = sorted(missed, key=lambda k: -missed[k])[:_LOOKED_AT]
        missed |= {k: self._missed(family[k]) for k in found}
        return max(missed, key=lambda k: missed[k])

    def whole(self, coordinates: Complex) -> Complex:
        """This rank's rows of X."""
        return self._span.whole(coordinates)

    def size(self, coordinates: Complex, part: str) -> float:
        """Square root of X.P_k X for a positive semidefinite P_k."""
        return self._span.size(coordinates, part)


class _Span:
    """An orthonormal basis of vectors, and the system's matrices in it."""

    def __init__(self, parts: dict[str, Any], right: Any, apart: Sequence[str]) -> None:
        self._parts, self._comm = parts, right.comm.tompi4py()
        self._right, self._vector, self._out = right, right.duplicate(), right.duplicate()
        size = len(right.array_r)
        self._V = np.empty((size, 0))
        self._PV = {name: np.empty((size, 0)) for name in parts}
        self._VPV = {name: np.empty((0, 0)) for name in parts}
        self._diagonal = {name: part.getDiagonal().array_r.copy() for name, part in parts.items()}
        self._apart = [self._diagonal[name] != 0 for name in apart if name in parts]

    def add(self, vector: Array) -> None:
        """Extend the basis by a vector, in parts if some of its rows are to be apart."""
        for rows in self._apart:
            self._extend(np.where(rows, vector, 0.0))
            vector = np.where(rows, 0.0, vector)
        self._extend(vector)

    def _extend(self, vector: Array) -> None:
        """Extend the basis by a vector, unless the vector lies in the span."""
        size = self._norm(vector)
        rest = vector.copy()
        for _ in range(2):
            rest -= self._V @ self._sum(self._V.T @ rest)
        left = self._norm(rest)
        if left <= _SAME * size:
            return
        rest /= left
        self._V = np.column_stack([self._V, rest])
        self._vector.array[:] = rest
        for name, part in self._parts.items():
            part.mult(self._vector, self._out)
            self._PV[name] = np.column_stack([self._PV[name], self._out.array_r])
            new = self._sum(self._V.T @ self._out.array_r)
            self._VPV[name] = np.block([[self._VPV[name], new[:-1, None]], [new]])

    def coordinates(self, x: Complex) -> Complex:
        """Coordinates of a vector that lies in the span."""
        return np.asarray(self._sum(self._V.T @ x))

    def whole(self, y: Complex) -> Complex:
        """The vector of some coordinates, found before the basis was extended further."""
        return np.asarray(self._V[:, : len(y)] @ y)

    def size(self, y: Complex, part: str) -> float:
        """Square root of x.P_k x."""
        inner = self._VPV[part][: len(y), : len(y)]
        return float(np.sqrt(max(float(np.vdot(y, inner @ y).real), 0.0)))

    def solution(self, factors: Factors) -> Complex:
        """Coordinates of the member's Galerkin solution."""
        inner = sum(f * self._VPV[name] for name, f in self._used(factors))
        return np.asarray(np.linalg.solve(inner, self.coordinates(self._right.array_r)))

    def residual(self, factors: Factors, y: Complex) -> float:
        """Relative residual of a solution, scaled by the diagonal of the system."""
        x = self.whole(y)
        miss = sum(f * (self._PV[name] @ y) for name, f in self._used(factors))
        miss = miss - self._right.array_r
        own = np.abs(sum(f * self._diagonal[name] for name, f in self._used(factors)))
        own = np.sqrt(np.maximum(own, 1e-300))
        return self._norm(miss / own) / self._norm(x * own)

    def _used(self, factors: Factors) -> list[tuple[str, complex]]:
        return [(name, factors[name]) for name in self._parts]

    def _sum(self, mine: Any) -> Any:
        return self._comm.allreduce(mine)

    def _norm(self, x: Any) -> float:
        return float(np.sqrt(self._comm.allreduce(float(np.vdot(x, x).real))))
