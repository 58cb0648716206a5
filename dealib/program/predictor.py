"""Where Newton starts: along the path so far, or where the path has been before."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

_MOST, _LEAST = 64, 8  # states that are remembered for the way back
_ROOM = 256e6  # bytes that more than the fewest of them may take
_CUBIC = 3  # order through two states and their rates
_SMOOTH = 0.5  # largest error of a prediction, in steps, on a smooth path


@dataclass
class Known:
    """A converged state on the path.

    Attributes:
        at: Time in the stage.
        inputs: The inputs that led to it.
        q: The reduced unknowns.
        smooth: Whether the path came here without a jump: it was where prediction put it.
        rate: How q goes on from it in the stage's time; None if that is not known.
    """

    at: float
    inputs: tuple[Any, ...]
    q: Any
    smooth: bool = False
    rate: Any = None


def remembered(unknowns: int) -> int:
    """How many states of so many unknowns are remembered, here and in a checkpoint."""
    return int(min(_MOST, max(_LEAST, _ROOM // (8 * unknowns))))


@dataclass
class Predictor:
    """Extrapolates a smooth path, and remembers it for the way back.

    Between two corners of the input the last states, and their rates where they are known, are
    extrapolated by Hermite's polynomial. Its order is the one that would have predicted the last
    state best, or one more if that was the highest there was. After a corner, inputs that were met
    just before it are looked up: an elastic body that runs back along a smooth path returns to the
    states it came through. Newton checks each guess, so memory can save iterations but cannot
    change a result; a path that jumped (snap-through) is not retraced across its jump.

    Attributes:
        highest: Highest order of the polynomial; 0 always starts from the last state.
        retrace: Whether the body is elastic, so that a way back can lead through known states.
        memory: How many states are remembered (see `remembered`).
        path: Known states, oldest first.
        segment: Number of them since the last corner, which is the first of these.
        back: Index in `path` of the state that the way back reached; None if not on a way back.
    """

    highest: int = 7
    retrace: bool = True
    memory: int = _MOST
    path: list[Known] = field(default_factory=list)
    segment: int = 0
    back: int | None = None
    _returned: bool = False
    _order: int = 1

    def add(self, at: float, inputs: tuple[Any, ...], q: Any, rate: Any = None) -> None:
        """Remember a converged state, and its rate if that is known."""
        known = Known(at, inputs, q.copy(), rate=rate)
        if self._returned:  # the way back is as smooth as the way there
            known.smooth = self.path[(self.back or 0) + 1].smooth
        else:
            known.smooth = self._judge(at, q)
        self._returned = False
        self.path.append(known)
        self.segment += 1
        for older in self.path[: -(self.highest + 1) // 2]:
            older.rate = None  # no polynomial needs it
        if len(self.path) > self.memory:
            self.path.pop(0)
            self.back = None if self.back is None else self.back - 1

    def start(self) -> None:
        """A new stage: its clock starts at the last state, if there is one."""
        self.corner()
        if self.path:
            self.path[-1].at = 0.0

    def corner(self) -> None:
        """The input changes direction at the last state."""
        self.segment, self._order = min(1, len(self.path)), 1
        self.back = len(self.path) - 1 if self.path else None
        for known in self.path:
            known.rate = None

    @property
    def rates(self) -> list[Any]:
        """The rates that are known."""
        return [known.rate for known in self.path if known.rate is not None]

    def predict(self, at: float, inputs: tuple[Any, ...]) -> Any:
        """A guess of the state at a time, or None if the last state is as good."""
        self._returned = False
        if self.highest == 0 or not self.path:
            return None
        return self._recall(inputs) or self._extrapolate(at, self._order)

    def plain(self) -> dict[str, Any]:
        """All but the states, as plain values."""
        known = [[k.at, list(k.inputs), k.smooth] for k in self.path]
        rest = {"segment": self.segment, "back": self.back, "order": self._order}
        rated = [i for i, k in enumerate(self.path, -len(self.path)) if k.rate is not None]
        return {"known": known, "rated": rated, **rest}

    def restore(
        self, plain: dict[str, Any], states: Sequence[Any], rates: Sequence[Any] = ()
    ) -> None:
        """Inverse of `plain`, with the last states (those that were kept) and their rates."""
        lost = len(plain["known"]) - len(states)
        self.path = [
            Known(at, tuple(inputs), q, smooth)
            for (at, inputs, smooth), q in zip(plain["known"][lost:], states, strict=True)
        ]
        self.segment, self._order = min(plain["segment"], len(states)), plain["order"]
        for index, rate in zip(plain["rated"], rates, strict=True):
            self.path[index].rate = rate
        back = plain["back"]
        self.back = None if back is None or back < lost else back - lost

    def _recall(self, inputs: tuple[Any, ...]) -> Any:
        """The state met on the way there, if the path back leads to it."""
        if not self.retrace or self.back is None or self.back < 1:
            return None
        if not self.path[self.back].smooth or not _equal(self.path[self.back - 1].inputs, inputs):
            self.back = None
            return None
        self.back -= 1
        self._returned = True
        return self.path[self.back].q

    def _judge(self, at: float, q: Any) -> bool:
        """Choose the order that would have predicted a state best; whether it did so well."""
        if not self.path:
            return False
        errors = [_distance(self.path[-1].q, q)]
        for order in range(1, self._possible + 1):
            guess = self._extrapolate(at, order)
            errors.append(_distance(guess, q) if guess is not None else math.inf)
        best = errors.index(min(errors))
        self._order = max(best + 1, _CUBIC) if best == len(errors) - 1 else best
        return best > 0 and errors[best] <= _SMOOTH * errors[0]

    @property
    def _possible(self) -> int:
        """Order of the polynomial through all states and rates since the corner, at most."""
        known = self._since
        return min(self.highest, len(known) + sum(k.rate is not None for k in known) - 1)

    @property
    def _since(self) -> list[Known]:
        """The last states, back to the corner at most."""
        return self.path[-min(self.segment, self.highest + 1) :]

    def _extrapolate(self, at: float, order: int) -> Any:
        """Hermite's polynomial through the last states, and their rates where they are known."""
        order = min(order, self._possible)
        if order < 1:
            return None
        known = self._since
        now = known[-1].at
        if len(known) > 1 and at - now > 2 * (now - known[-2].at):
            return None
        rows, data, powers = [], [], np.arange(order + 1)
        for k in reversed(known):
            s = (k.at - now) / (at - now)
            rows.append(s**powers)
            data.append(k.q)
            if k.rate is not None:
                rows.append(powers * s ** np.maximum(powers - 1, 0) / (at - now))
                data.append(k.rate)
        count = order + 1  # equations for the weights: exact for each power
        weights = np.linalg.solve(np.array(rows[:count]).T, np.ones(count))
        guess = data[0].duplicate()
        guess.set(0.0)
        guess.maxpy(weights, data[:count])
        return guess


def _distance(a: Any, b: Any) -> float:
    difference = a.copy()
    difference.axpy(-1.0, b)
    return float(difference.norm())


def _equal(a: tuple[Any, ...], b: tuple[Any, ...]) -> bool:
    return len(a) == len(b) and all(
        x == y or (isinstance(x, float) and math.isclose(x, y, rel_tol=1e-12, abs_tol=1e-15))
        for x, y in zip(a, b, strict=True)
    )
