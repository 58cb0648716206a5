"""Minimisation of an objective within limits by sequential quadratic programming (SLSQP).

Variables are scaled from 0 to 1. Points without values get a bad value, from which the search
steps back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array
from dealib.design.goals import Aim, Limit
from dealib.design.schema import Search

Seen = Mapping[str, tuple[float, Array]]  # value and slopes of each quantity
Oracle = Callable[[Array], Seen | None]
_SAME = 1e-4  # distance from a point without values within which no other one is evaluated
_PATIENCE = 10  # points in a row without improvement that end a search, as at a kink
_FAR = 10.0  # by how much the scaled objective of a point without values is worse


@dataclass(frozen=True)
class Best:
    """The best point that a search has seen.

    Attributes:
        x: The point.
        beyond: Largest relative violation of a limit; 0 if there is none.
        objective: The objective to minimise.
    """

    x: Array
    beyond: float
    objective: float

    @property
    def rank(self) -> tuple[float, float]:
        """A point with a smaller rank is better."""
        return self.beyond, self.objective


class _Enough(Exception):
    """The search is over."""


@dataclass(frozen=True)
class _State:
    """Scaled objective `f` and slacks minus margin `g` of a point, with their slopes."""

    f: float
    df: Array
    g: Array
    dg: Array


class _Walk:
    """A search: the points that it has seen, and the best of them."""

    def __init__(self, see: Oracle, aim: Aim, limits: Sequence[Limit], search: Search) -> None:
        self._see, self._aim, self._limits, self.search = see, aim, limits, search
        self.best: Best | None = None
        self.hurry = False  # whether the search ends at the first point within all limits
        self._known: dict[bytes, _State] = {}
        self._holes: list[Array] = []
        self._last: _State | None = None
        self._scales: list[float] = []
        self._in_vain = 0

    def at(self, x: Array) -> _State:
        """State of a point; if it has no values, that of the last point with a bad objective."""
        x = np.clip(x, 0, 1)
        if (key := x.tobytes()) not in self._known:
            if len(self._known) >= self.search.evaluations or self._in_vain > _PATIENCE:
                raise _Enough
            hole = any(np.abs(x - other).max() < _SAME for other in self._holes)
            seen = None if hole else self._see(x)
            if seen is not None:
                self._last = self._known[key] = self._state(x, seen)
            elif (last := self._last) is None:
                raise _Enough
            else:
                self._holes.append(x)
                bad = last.f + _FAR * (1 + abs(last.f))
                self._known[key] = _State(bad, last.df, last.g - _FAR, last.dg)
            if self.hurry and self.best is not None and not self.best.beyond:
                raise _Enough
        return self._known[key]

    def _state(self, x: Array, seen: Seen) -> _State:
        if not self._scales:
            f = seen[self._aim.name][0]
            self._scales = [abs(f) or 1.0, *(scale(limit, seen) for limit in self._limits)]
        found = ranked(x, seen, self._aim, self._limits)
        gain = self.search.tolerance * self._scales[0], self.search.tolerance
        best, self._in_vain = self.best, self._in_vain + 1
        if (
            best is None
            or found.beyond < best.beyond - gain[1]
            or (found.beyond <= best.beyond and found.objective < best.objective - gain[0])
        ):
            self._in_vain = 0
        if self.best is None or found.rank < self.best.rank:
            self.best = found
        sign, n = self._aim.sign / self._scales[0], len(x)
        known = list(zip(self._limits, self._scales[1:], strict=True))
        values = {name: value for name, (value, _) in seen.items()}
        g = np.array([limit.slack(values) / s for limit, s in known]) - self.search.margin
        dg = np.array([-limit.sign * seen[limit.name][1] / s for limit, s in known])
        f, df = seen[self._aim.name]
        return _State(sign * f, sign * df, g, dg.reshape(len(known), n))


def scale(limit: Limit, seen: Seen) -> float:
    """Scale of a slack: the limit, or the value of the quantity if the limit is 0."""
    return abs(limit.bound) or abs(seen[limit.name][0]) or 1.0


def ranked(x: Array, seen: Seen, aim: Aim, limits: Sequence[Limit]) -> Best:
    """The objective and the largest violation of a limit at a point."""
    values = {name: value for name, (value, _) in seen.items()}
    beyond = [-limit.slack(values) / scale(limit, seen) for limit in limits]
    return Best(x, max(0.0, *beyond, 0.0), aim.sign * values[aim.name])


def descend(
    see: Oracle, aim: Aim, limits: Sequence[Limit], start: Array, search: Search
) -> Best | None:
    """Search from a start.

    Args:
        see: Values and slopes at a point; None if it has no values.
        aim: The objective.
        limits: The limits.
        start: The first point, from 0 to 1 in each variable.
        search: Settings of the search.

    Returns:
        The best point seen; None if the start has no values.
    """
    walk = _Walk(see, aim, limits, search)
    try:
        first = walk.at(start)
        if not len(start):
            return walk.best
        if (first.g < 0).any():
            walk.hurry = True
            _into_limits(walk, start)
        walk.hurry = False
        assert walk.best is not None
        end = _minimum(
            walk.best.x,
            lambda x: (walk.at(x).f, walk.at(x).df),
            lambda x: (walk.at(x).g, walk.at(x).dg),
            search,
        )
        for _ in range(3):  # the search may have ended slightly beyond a limit
            here = walk.at(end)
            if not (here.g < 0).any():
                break
            end = _nearest(here, np.clip(end, 0, 1), search)
    except _Enough:
        pass
    return walk.best


def _minimum(
    start: Array,
    objective: Callable[[Array], tuple[float, Array]],
    slacks: Callable[[Array], tuple[Array, Array]],
    search: Search,
    most: float = 1.0,
) -> Array:
    from scipy.optimize import minimize

    found = minimize(
        lambda x: objective(x)[0],
        start,
        jac=lambda x: objective(x)[1],
        method="SLSQP",
        bounds=[(0.0, 1.0)] * (len(start) - 1) + [(0.0, most)],
        constraints={"type": "ineq", "fun": lambda x: slacks(x)[0], "jac": lambda x: slacks(x)[1]},
        options={"ftol": search.tolerance, "maxiter": search.evaluations},
    )
    return np.asarray(found.x)


def _into_limits(walk: _Walk, start: Array) -> None:
    """Minimise the largest violation of limits until a point is within all of them."""
    excess = float(-walk.at(start).g.min()) + walk.search.margin
    down = np.eye(len(start) + 1)[-1]

    def slacks(z: Array) -> tuple[Array, Array]:
        here = walk.at(z[:-1])
        return here.g + z[-1], np.column_stack([here.dg, np.ones(len(here.g))])

    try:
        _minimum(np.append(start, excess), lambda z: (z[-1], down), slacks, walk.search, 2 * excess)
    except _Enough:
        if walk.best is None or walk.best.beyond:
            raise


def _nearest(here: _State, x: Array, search: Search) -> Array:
    """The nearest point within all limits, for slacks linearised at x."""
    return _minimum(
        x,
        lambda y: (float((y - x) @ (y - x)), 2 * (y - x)),
        lambda y: (here.g + here.dg @ (y - x) - search.margin, here.dg),
        search.model_copy(update={"tolerance": 1e-12, "evaluations": 50}),
    )
