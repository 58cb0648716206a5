"""Adaptive increments: halved and repeated on failure, grown again; corners are never skipped."""

from __future__ import annotations

import logging
import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from dealib.config.schema import Solver
from dealib.errors import NotConverged
from dealib.fem.newton import Newton, Singular
from dealib.program.predictor import Predictor

log = logging.getLogger(__name__)

_SAFETY = 0.9  # increment over the one that would just meet the tolerance
_AHEAD = 1e-5  # increment for the rates of inputs over the last one
_SMALLEST = 1e-9  # smallest increment over the first target


class Clock(Protocol):
    """A part of the state that is integrated in time."""

    def error(self) -> float:
        """Relative error of the last increment, of second order in it (collective)."""


class Watch(Protocol):
    """What refuses converged states."""

    def keep(self) -> None:
        """Take the present state as the last one (collective)."""

    def check(self) -> None:
        """Raise `NotConverged` if the state just found is to be refused (collective)."""


class _TooCoarse(NotConverged):
    """An increment whose time integration is not accurate enough.

    Attributes:
        factor: Factor by which to shorten it, besides halving.
    """

    def __init__(self, share: float) -> None:
        super().__init__(share)
        self.factor = min(1.0, max(0.2, 2 * _SAFETY / math.sqrt(share)))

    def __str__(self) -> str:
        return f"error of the time integration {self.args[0]:.3g} times its tolerance"


@dataclass
class StageClock:
    """Time and increment in a stage.

    Attributes:
        now: Time of the last converged state.
        size: Increment to try next, if no target is nearer.
    """

    now: float = 0.0
    size: float = math.inf


class Increments:
    """Drives Newton through one stage.

    Attributes:
        newton: The solver; its `system.q` is the state.
        settings: Targets and limits.
        predictor: Initial guesses for Newton's method; it is shared by all stages.
        clock: Time and increment in the stage; kept up to date.
        clocks: The parts of the state that are integrated in time.
        watch: Refuses converged states; None: all are accepted.
    """

    def __init__(
        self,
        newton: Newton,
        settings: Solver,
        predictor: Predictor,
        clock: StageClock | None = None,
        clocks: Sequence[Clock] = (),
        watch: Watch | None = None,
    ) -> None:
        self.newton, self.settings, self.predictor = newton, settings, predictor
        self.clock = StageClock() if clock is None else clock
        self.clocks, self.watch = clocks, watch

    def run(
        self,
        targets: list[float],
        corners: set[float],
        apply: Callable[[float], tuple[Any, ...]],
        explain: Callable[[float], str],
        judge: Callable[[float, float], tuple[bool, float]] = lambda at, step: (True, math.inf),
        skip: bool = False,
    ) -> Iterator[float]:
        """Solve up to each target in turn.

        Args:
            targets: Times at which a state is wanted, ascending, starting after 0.
            corners: Those at which an input changes direction: no extrapolation across them.
            apply: Sets the inputs of a time and names them, for the predictor's memory.
            explain: Message for a failure on the way to a time.
            judge: Whether to keep the state at a time, reached by a step; and the largest step
                to try next.
            skip: Whether a step may pass targets, up to the next corner.

        Yields:
            The time of each converged state: all targets that are not passed, and more where
            increments were cut.

        Raises:
            NotConverged: When an increment has been halved too often; the state is the last
                converged one.
        """
        q, clock = self.newton.system.q, self.clock
        smallest = 0.5**self.settings.max_cuts * targets[0]
        if clock.now == 0:
            self.predictor.start(apply(0.0))
        if self.watch is not None:
            self.watch.keep()
        kept = q.copy()
        while clock.now < targets[-1]:
            target = self._target(targets, corners, skip)
            left = target - clock.now
            step = left if clock.size > 0.75 * left else clock.size
            then = target if step == left else clock.now + step
            inputs = apply(then)
            try:
                self._solve(kept, then, inputs)
                if self.watch is not None:
                    self.watch.check()
                allowed = self._allowed(step)
            except Singular as error:
                raise NotConverged(f"{explain(then)} ({error})") from None
            except NotConverged as error:
                kept.copy(q)
                apply(clock.now)
                clock.size = step / 2
                if isinstance(error, _TooCoarse):
                    clock.size *= error.factor
                    smallest = min(smallest, 0.5**self.settings.max_cuts * clock.size)
                if clock.size < smallest or clock.size < _SMALLEST * targets[0]:
                    raise NotConverged(f"{explain(then)} ({error})") from None
                log.info("increment to %.6g cut to %.3g: %s", then, clock.size, str(error))
                continue
            keep, next_ = judge(then, step)
            if not keep:
                kept.copy(q)
                apply(clock.now)
                clock.size = next_
                continue
            if self.watch is not None:
                self.watch.keep()
            ends = then in corners or then == targets[-1]
            rate = None if ends else self._rate(apply, then, step)
            self.predictor.add(then, inputs, q, rate)
            kept, clock.now = q.copy(), then
            if self.newton.iterations <= self.settings.target_iterations:
                clock.size = 2 * step if step < left else max(clock.size, 2 * step)
            clock.size = min(clock.size, allowed, next_)
            log.debug("converged at %.6g of the stage, next %.3g", then, clock.size)
            if then in corners:
                self.predictor.corner()
            yield then

    def _target(self, targets: list[float], corners: set[float], skip: bool) -> float:
        """The next target, or the last one that a step may reach, up to a corner."""
        k = bisect_right(targets, self.clock.now)
        reach = (self.clock.now + self.clock.size) * (1 + 1e-9) if skip else -math.inf
        while k + 1 < len(targets) and targets[k] not in corners and targets[k + 1] <= reach:
            k += 1
        return targets[k]

    def _rate(self, apply: Callable[[float], tuple[Any, ...]], at: float, step: float) -> Any:
        """Rate of the state just found in the stage's time, by its tangent; None if unknown.

        There is none where states depend on the length of a step, as in time integration.
        """
        if self.clocks or not self.newton.iterations or not self.predictor.highest:
            return None
        apply(at + _AHEAD * step)
        rate = self.newton.answer()
        apply(at)
        if rate is not None:
            rate.scale(1 / (_AHEAD * step))
        return rate

    def _allowed(self, step: float) -> float:
        """The largest next increment for the tolerance of time integration.

        Raises:
            _TooCoarse: If this one was too large.
        """
        tolerance = self.settings.time_tolerance
        if not self.clocks or tolerance == 0:
            return math.inf
        share = max(clock.error() for clock in self.clocks) / tolerance
        if share > 1:
            raise _TooCoarse(share)
        return _SAFETY * step / math.sqrt(max(share, 1e-12))

    def _solve(self, kept: Any, then: float, inputs: tuple[Any, ...]) -> None:
        """Solve from a prediction; without one, or if that fails, from the last state."""
        q = self.newton.system.q
        guess = self.predictor.predict(then, inputs)
        if guess is not None:
            guess.copy(q)
            try:
                self.newton.solve(self.predictor.known)
                return
            except Singular:
                raise
            except NotConverged as error:
                log.debug("from the last state instead of the predicted one: %s", str(error))
                kept.copy(q)
        self.newton.solve()
