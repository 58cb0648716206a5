"""Initial guesses for Newton's method: extrapolations of the path, or states met before."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

_MOST, _LEAST = 64, 8  # states that are remembered for the way back
_ROOM = 256e6  # bytes for remembered states; the least number may exceed it
_CUBIC = 3  # order of the polynomial through two states and their rates
_SMOOTH = 0.5  # largest error of a prediction over the step, on a smooth path
_ODD = ("terminal", "terminals")  # first words of inputs that change sign with all voltages


@dataclass
class PathState:
    """A converged state on the path.

    Attributes:
        at: Time in the stage.
        inputs: The inputs that led to it.
        q: The reduced unknowns.
        smooth: Whether the path came here without a jump, that is close to the prediction.
        rate: Derivative of q by the stage's time; None if not known.
        exact: Whether q is what was accepted, and not what a checkpoint could keep of it.
    """

    at: float
    inputs: tuple[Any, ...]
    q: Any
    smooth: bool = False
    rate: Any = None
    exact: bool = True


def remembered(unknowns: int) -> int:
    """Number of states that are remembered, here and in a checkpoint, for a number of unknowns."""
    return int(min(_MOST, max(_LEAST, _ROOM // (8 * unknowns))))


@dataclass
class Predictor:
    """Extrapolates a smooth path, and remembers it for the way back.

    Between two corners of the input, Hermite's polynomial through the last states and their known
    rates is extrapolated. Its order is the one that would have predicted the last state best, or a
    higher one if that was the highest possible. Where the inputs turn, states with the same inputs
    are looked up: an elastic body that goes back along a smooth path returns through the same
    states. Its energy is even in the field, so that beyond 0 V it goes back through their images
    with all voltages reversed. Newton's method checks each guess, so that a guess can save
    iterations but not change a result. A path is not retraced across a jump (snap-through).

    Attributes:
        highest: Highest order of the polynomial; 0 always starts from the last state.
        retrace: Whether states depend on inputs alone, so that a way back leads through known ones.
        memory: How many states are remembered (see `remembered`).
        signs: Vector of what q is multiplied by where all voltages are reversed; None if unknown.
        path: Known states, oldest first.
        segment: Number of known states from the last corner on.
        back: Index in `path` of the state that the way back reached; None if not on a way back.
    """

    highest: int = 7
    retrace: bool = True
    memory: int = _MOST
    signs: Any = None
    path: list[PathState] = field(default_factory=list)
    segment: int = 0
    back: int | None = None
    _image: bool = False
    _returned: bool = False
    _order: int = 1

    def add(self, at: float, inputs: tuple[Any, ...], q: Any, rate: Any = None) -> None:
        """Remember a converged state, and its rate if that is known."""
        known = PathState(at, inputs, q.copy(), rate=rate)
        if self._returned:  # as smooth as on the way there
            known.smooth = self.path[(self.back or 0) + 1].smooth
        else:
            good = self._judge(at, q)
            known.smooth = bool(good)
            if self.segment == 2 and max(good, default=0) > (self.path[-1].rate is not None):
                self.path[-1].smooth = True  # the polynomial goes through the corner as well
        self._returned = False
        self.path.append(known)
        self.segment += 1
        for older in self.path[: -(self.highest + 1) // 2]:
            older.rate = None  # no polynomial needs it
        if len(self.path) > self.memory:
            self.path.pop(0)
            self.back = None if self.back is None else self.back - 1

    def start(self, inputs: tuple[Any, ...]) -> None:
        """Begin a stage, whose time is 0 at the last state, and its inputs are now called so."""
        self.corner()
        if self.path:
            self.path[-1].at, self.path[-1].inputs = 0.0, inputs

    def corner(self) -> None:
        """The input changes direction at the last state."""
        self.segment, self._order = min(1, len(self.path)), 1
        self.back = None
        for known in self.path:
            known.rate = None

    @property
    def rates(self) -> list[Any]:
        """The known rates, oldest first."""
        return [known.rate for known in self.path if known.rate is not None]

    @property
    def known(self) -> bool:
        """Whether the last guess is a state that was accepted with the same inputs."""
        return self._returned and self.path[self.back or 0].exact

    def predict(self, at: float, inputs: tuple[Any, ...]) -> Any:
        """A guess of the state at a time; None if there is none better than the last state."""
        self._returned = False
        if self.highest == 0 or not self.path:
            return None
        return self._recall(inputs) or self._extrapolate(at, self._order)

    def plain(self) -> dict[str, Any]:
        """Everything except states and rates, as plain values."""
        known = [[k.at, list(k.inputs), k.smooth] for k in self.path]
        rest = {"segment": self.segment, "back": self.back, "order": self._order}
        rest["image"] = self._image
        rated = [i for i, k in enumerate(self.path, -len(self.path)) if k.rate is not None]
        return {"known": known, "rated": rated, **rest}

    def restore(
        self,
        plain: dict[str, Any],
        states: Sequence[Any],
        rates: Sequence[Any] = (),
        exact: bool = True,
    ) -> None:
        """Inverse of `plain`, with the last states as far as they were kept, and their rates.

        Args:
            plain: The plain values.
            states: The states, oldest first.
            rates: Their rates, as far as they are known.
            exact: Whether the states are what was accepted.
        """
        lost = len(plain["known"]) - len(states)
        self.path = [
            PathState(at, tuple(inputs), q, smooth, exact=exact)
            for (at, inputs, smooth), q in zip(plain["known"][lost:], states, strict=True)
        ]
        self.segment, self._order = min(plain["segment"], len(states)), plain["order"]
        for index, rate in zip(plain["rated"], rates, strict=True):
            self.path[index].rate = rate
        back = plain["back"]
        self.back = None if back is None or back < lost else back - lost
        self._image = plain.get("image", False)

    def _recall(self, inputs: tuple[Any, ...]) -> Any:
        """The state with the same inputs on the way there, if the path leads back to it."""
        if not self.retrace:
            return None
        for back, image in self._ways():
            wanted = _reversed(inputs) if image else inputs
            smooth = back >= 1 and self.path[back].smooth
            if smooth and _equal(self.path[back - 1].inputs, wanted):
                self.back, self._image, self._returned = back - 1, image, True
                q = self.path[self.back].q
                if image:
                    q = q.copy()
                    q.pointwiseMult(q, self.signs)
                return q
        self.back = None
        return None

    def _ways(self) -> Iterator[tuple[int, bool]]:
        """Ways back: the state that each has reached, and whether it leads through images.

        They are the one on which the path is, one that turns at the last state, and one that goes
        through it at 0 V.
        """
        if self.back is not None:
            yield self.back, self._image
        last = len(self.path) - 1
        yield last, False
        if self.signs is not None:
            inputs = self.path[last].inputs
            if _equal(inputs, _reversed(inputs)):
                yield last, True

    def _judge(self, at: float, q: Any) -> list[int]:
        """Choose the order that would have predicted a state best; returns those that were good."""
        if not self.path:
            return []
        errors = [_distance(self.path[-1].q, q)]
        for order in range(1, self._possible + 1):
            guess = self._extrapolate(at, order)
            errors.append(_distance(guess, q) if guess is not None else math.inf)
        best = errors.index(min(errors))
        self._order = max(best + 1, _CUBIC) if best == len(errors) - 1 else best
        return [k for k, e in enumerate(errors) if k and e <= _SMOOTH * errors[0]]

    @property
    def _possible(self) -> int:
        """Highest order of a polynomial through states and rates since the corner."""
        known = self._since
        return min(self.highest, len(known) + sum(k.rate is not None for k in known) - 1)

    @property
    def _since(self) -> list[PathState]:
        """The last states that a polynomial may need, back to the corner at most."""
        return self.path[-min(self.segment, self.highest + 1) :]

    def _extrapolate(self, at: float, order: int) -> Any:
        """Hermite's polynomial through the last states, and their rates where they are known."""
        order = min(order, self._possible)
        if order < 1:
            return None
        known = self._since
        now = known[-1].at
        if len(known) > 1 and at - now > (2 + 1e-9) * (now - known[-2].at):
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


def _reversed(inputs: tuple[Any, ...]) -> tuple[Any, ...]:
    """The inputs, labels and values in turn, with all voltages and charges reversed."""
    found: list[Any] = []
    for label, value in zip(inputs[::2], inputs[1::2], strict=True):
        found += [label, -value if label.split(".")[0] in _ODD else value]
    return tuple(found)


def _equal(a: tuple[Any, ...], b: tuple[Any, ...]) -> bool:
    """Whether inputs are the same, but for the rounding of a wave that passes zero."""
    return len(a) == len(b) and all(
        x == y or (isinstance(x, float) and math.isclose(x, y, rel_tol=1e-12, abs_tol=1e-14))
        for x, y in zip(a, b, strict=True)
    )
