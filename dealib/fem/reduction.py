"""Solutions of a family of symmetric systems from a few of them, to a tolerance that is checked.

(sum f_k P_k) X = F with real symmetric P_k and complex factors f_k: between solved members, X is
sought in the span of their real and imaginary parts (Galerkin). The member with the largest
residual is solved next, until what was expected of it is true, twice in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Factors = dict[str, complex]
_TOLERANCE = 1e-9  # of what is looked at, of its own size
_NONE = 1e-15  # of the largest of them: it counts as zero
_LOOKED_AT = 8  # members whose residual is found anew before the next one is solved
_ENOUGH = 2  # members in turn that are what was expected
_SAME = 1e-13  # of a vector's size: what is left of it lies in the span


class Reduction:
    """Solutions of members of the family, one after the other (collective).

    Args:
        parts: P_k by name.
        right: F.
        solve: Real and imaginary part of the solution of a member.
        look: What of X must be right, the same on every rank.
    """

    def __init__(
        self,
        parts: dict[str, Any],
        right: Any,
        solve: Callable[[Factors], tuple[Any, Any]],
        look: Callable[[Complex], Complex],
    ) -> None:
        self._span, self._solve, self._look = _Span(parts, right), solve, look
        self._learnt = False

    def at(self, family: Sequence[Factors]) -> list[Complex]:
        """Coordinates of X of some members, in an order in which it changes smoothly."""
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
        """The member with the largest residual, of those that had the largest ones before."""
        found = sorted(missed, key=lambda k: -missed[k])[:_LOOKED_AT]
        missed |= {k: self._missed(family[k]) for k in found}
        return max(missed, key=lambda k: missed[k])

    def whole(self, coordinates: Complex) -> Complex:
        """This rank's rows of X."""
        return self._span.whole(coordinates)

    def size(self, coordinates: Complex, part: str) -> float:
        """The root of X.P_k X, of a matrix that is not negative."""
        return self._span.size(coordinates, part)


class _Span:
    """The span of vectors, and the system in it."""

    def __init__(self, parts: dict[str, Any], right: Any) -> None:
        self._parts, self._comm = parts, right.comm.tompi4py()
        self._right, self._vector, self._out = right, right.duplicate(), right.duplicate()
        size = len(right.array_r)
        self._V = np.empty((size, 0))
        self._PV = {name: np.empty((size, 0)) for name in parts}
        self._VPV = {name: np.empty((0, 0)) for name in parts}
        self._diagonal = {name: part.getDiagonal().array_r.copy() for name, part in parts.items()}

    def add(self, vector: Array) -> None:
        """Widen it by a vector, if that does not lie in it."""
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
        """Of a vector that lies in it."""
        return np.asarray(self._sum(self._V.T @ x))

    def whole(self, y: Complex) -> Complex:
        """The vector of some coordinates, of which it may have got more since."""
        return np.asarray(self._V[:, : len(y)] @ y)

    def size(self, y: Complex, part: str) -> float:
        """The root of x.P_k x."""
        inner = self._VPV[part][: len(y), : len(y)]
        return float(np.sqrt(max(float(np.vdot(y, inner @ y).real), 0.0)))

    def solution(self, factors: Factors) -> Complex:
        """Coordinates of the member's solution in it."""
        inner = sum(f * self._VPV[name] for name, f in self._used(factors))
        return np.asarray(np.linalg.solve(inner, self.coordinates(self._right.array_r)))

    def residual(self, factors: Factors, y: Complex) -> float:
        """How far a solution in it misses the equations, each over its own size."""
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
