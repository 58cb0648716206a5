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
_ENOUGH = 2  # members in turn that are what was expected
_SAME = 1e-13  # of a vector's size: what is left of it lies in the span


def solve_all(
    parts: dict[str, Any],
    right: Any,
    family: Sequence[Factors],
    solve: Callable[[Factors], tuple[Any, Any]],
    look: Callable[[Complex], Complex],
) -> list[Complex]:
    """X of each member, this rank's rows (collective).

    Args:
        parts: P_k by name.
        right: F.
        family: Factors of each member, in an order in which X changes smoothly.
        solve: Real and imaginary part of the solution of a member.
        look: What of X must be right, the same on every rank.
    """
    span = _Span(parts, right)
    exact: dict[int, Complex] = {}

    def learn(k: int) -> Complex:
        one, other = (part.array_r.copy() for part in solve(family[k]))
        exact[k] = one + 1j * other
        span.add(one)
        span.add(other)
        return exact[k]

    for k in sorted({0, len(family) // 2, len(family) - 1}):
        learn(k)
    right_so_far = 0
    while True:
        found = {k: span.solution(f) for k, f in enumerate(family) if k not in exact}
        if found:
            worst = max(found, key=lambda k: span.residual(family[k], found[k]))
            expected, true = look(found[worst]), look(learn(worst))
            size = np.abs(true)
            hit = (np.abs(expected - true) <= _TOLERANCE * size + _NONE * size.max()).all()
            right_so_far = right_so_far + 1 if hit else 0
        if not found or right_so_far == _ENOUGH:
            return [(found | exact)[k] for k in range(len(family))]


class _Span:
    """The span of vectors, and the system in it."""

    def __init__(self, parts: dict[str, Any], right: Any) -> None:
        self._parts, self._comm = parts, right.comm.tompi4py()
        self._right, self._vector, self._out = right, right.duplicate(), right.duplicate()
        size = len(right.array_r)
        self._V = np.empty((size, 0))
        self._PV = {name: np.empty((size, 0)) for name in parts}
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

    def solution(self, factors: Factors) -> Complex:
        """The member's solution in it."""
        inner = sum(f * self._inner(name) for name, f in self._used(factors))
        y = np.linalg.solve(inner, self._sum(self._V.T @ self._right.array_r))
        return np.asarray(self._V @ y)

    def residual(self, factors: Factors, x: Complex) -> float:
        """How far a solution in it misses the equations, each over its own size."""
        y = self._sum(self._V.T @ x)
        miss = sum(f * (self._PV[name] @ y) for name, f in self._used(factors))
        miss = miss - self._right.array_r
        own = np.abs(sum(f * self._diagonal[name] for name, f in self._used(factors)))
        own = np.sqrt(np.maximum(own, 1e-300))
        return self._norm(miss / own) / self._norm(x * own)

    def _inner(self, name: str) -> Array:
        return self._sum(self._V.T @ self._PV[name])

    def _used(self, factors: Factors) -> list[tuple[str, complex]]:
        return [(name, factors[name]) for name in self._parts]

    def _sum(self, mine: Any) -> Any:
        return self._comm.allreduce(mine)

    def _norm(self, x: Any) -> float:
        return float(np.sqrt(self._comm.allreduce(float(np.vdot(x, x).real))))
