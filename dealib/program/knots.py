"""Rows of the history between solved states: interpolated, and judged by the state that follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dealib.arrays import Array

TOLERANCE = 1e-5  # of the range of a column
_NOISE = 1e-9  # of the largest value of a column: what Newton's method leaves of a state
_TINY = 1e-15
_HIGHEST = 7  # order; the predictor remembers one state more at least
LEFT = 0.25  # of the error of a prediction, that is left in the rows when the state is known
_SAFETY, _STEPS = 0.5, np.geomspace(2.0, 0.05, 60)  # of an increment, to try next


@dataclass(frozen=True)
class InterpolatedRows:
    """Rows before a new state.

    Attributes:
        rows: The rows, (times, columns).
        share: The largest error, of what is allowed.
        allowed: Error of each column.
        ahead: Weights of the last states that predict the new one.
        inside: Weights of these and the new one that give the rows, (times, states).
        nodes: Times of these and the new one.
    """

    rows: Array
    share: float
    allowed: Array
    ahead: Array
    inside: Array
    nodes: Array

    def reach(self, again: bool = False) -> float:
        """The next increment whose error is allowed, from the new state or `again` from the last.

        The error of a prediction is a derivative, which hardly changes from one increment to the
        next, times the product of the distances from the states that it comes from.
        """
        old, new, at = self.nodes[:-1], self.nodes[1:], self.nodes[-1]
        steps = (at - old[-1]) * _STEPS
        begin, known = (old[-1], old) if again else (at, new)
        distances = begin + steps[:, None] - known
        error = self.share * np.prod(distances / (at - old), axis=1)
        return float(steps[int(np.argmax(error <= _SAFETY))] if error[-1] <= _SAFETY else steps[-1])


@dataclass
class Knots:
    """Solved states since the last corner of the inputs, and how far each column has ranged.

    The next state is predicted from them by a polynomial, of the order that does so best. With the
    state itself that polynomial gives the rows before it. If all turns sharply just after the last
    state, a quarter of the prediction's error is left in them at most; if all is smooth, far less.

    Attributes:
        at: Times in the stage, in cycles.
        values: A row each.
        low, high: Least and largest value of each column in the run.
    """

    at: list[float] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)

    def add(self, at: float, values: Array) -> None:
        """Take a state as solved."""
        self.at, self.values = [*self.at, at][-_HIGHEST - 1 :], [*self.values, values.tolist()]
        self.values = self.values[-_HIGHEST - 1 :]
        low, high = (np.array(x) if x else values for x in (self.low, self.high))
        self.low, self.high = np.fmin(low, values).tolist(), np.fmax(high, values).tolist()

    def start(self, at: float = 0.0) -> None:
        """At the last state, which is at this time, the inputs turn: those before do not count."""
        self.at, self.values = [at] * len(self.at[-1:]), self.values[-1:]

    def fit(
        self,
        at: float,
        values: Array,
        times: Sequence[float],
        inputs: Callable[[float], Sequence[float]],
        smooth: Array,
    ) -> InterpolatedRows:
        """How the rows before a new state follow from it and the known ones.

        Args:
            at: Its time.
            values: Of its columns.
            times: Of the rows, later than the last state.
            inputs: What drives the ports at a time: exact, and therefore a check.
            smooth: Which columns may be interpolated.
        """
        t, known = np.array(self.at), np.array(self.values)
        low, high = np.fmin(self.low, values), np.fmax(self.high, values)
        size = np.fmax(np.abs(low), np.abs(high))
        allowed = TOLERANCE * (high - low) + _NOISE * size + _TINY
        ahead = [_weights(t[-order - 1 :], [at])[0] for order in range(len(t))]
        guesses = [w @ known[-len(w) :] for w in ahead]
        shares = [share(guess[smooth], values[smooth], allowed[smooth]) for guess in guesses]
        order = int(np.argmin(shares))
        nodes = [*self.at[-order - 1 :], at]
        inside = _weights(np.array(nodes), times)
        rows = inside @ np.vstack([known[-order - 1 :], values])
        rows = np.where((known == values).all(axis=0), values, rows)
        worst = shares[order]
        if len(times):
            given, exact = (np.array([inputs(x) for x in of]) for of in (nodes, times))
            both = np.vstack([given, exact])
            allowed_ = TOLERANCE * np.ptp(both, axis=0) + _NOISE * np.abs(both).max(axis=0) + _TINY
            off = np.abs(inside @ given - exact) / allowed_
            worst = max(worst, float(off.max(initial=0.0)))
        return InterpolatedRows(rows, worst, allowed, ahead[order], inside, np.array(nodes))


def share(guess: Array, values: Array, allowed: Array) -> float:
    """Largest error that a prediction leaves in rows before it, of what is allowed."""
    with np.errstate(invalid="ignore"):
        off = np.where(guess == values, 0.0, LEFT * np.abs(guess - values) / allowed)
    return float(np.where(np.isnan(off), np.inf, off).max(initial=0.0))


def _weights(nodes: Array, times: Sequence[float]) -> Any:
    """Lagrange's polynomials through the nodes, (times, nodes)."""
    x = np.asarray(times, dtype=float)
    return np.array(
        [
            np.prod([(x - other) / (node - other) for other in nodes if other != node], axis=0)
            * np.ones_like(x)
            for node in nodes
        ]
    ).T
