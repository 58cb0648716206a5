"""Follows a branch of equilibria by pseudo-arc-length, past limit points and bifurcations.

The equation of the varied port is replaced by that of a plane across the branch, at a distance from
the last state (H. B. Keller, in: Applications of Bifurcation Theory, Academic Press, 1977, 359;
see `Pair.arc`). The branch's exact tangent takes one back-substitution. At a limit point the varied
variable's part of it changes sign; Brent's method finds it. Any other change of the number of
unstable modes is a bifurcation; bisection finds it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from dealib.config.schema import Solver
from dealib.errors import NotConverged
from dealib.fem.newton import Newton
from dealib.program.pair import Pair, Two
from dealib.program.predictor import Predictor
from dealib.program.progress import Position

log = logging.getLogger(__name__)

_ACCURACY = 1e-9  # of a limit point, in steps; the variable's error is of second order in it
_BISECTIONS = 8  # of the step in which a bifurcation lies
_TURN = math.cos(math.radians(50))  # largest turn of the direction in one step
_AT_REST = 1e-6  # part of the direction below which a variable does not move
LIMIT_POINT, BIFURCATION = "limit point", "bifurcation"


@dataclass(frozen=True)
class BranchState:
    """A state on the branch; the solver is at it.

    Attributes:
        step: Distance from the previous state, over the sizes.
        direction: Direction of the branch in both variables, over the sizes.
        rate: Direction of the branch in all unknowns.
        modes: Number of unstable modes under control of the varied variable; at a limit point the
            number before it.
        kind: `LIMIT_POINT`, `BIFURCATION` or empty.
    """

    step: float
    direction: Two
    rate: Any
    modes: int
    kind: str = ""


class BranchFollower:
    """Follows one branch.

    Attributes:
        position: Current position on the branch; kept up to date.

    Args:
        newton: The solver, at a state under the current control.
        settings: Iterations and cuts.
        predictor: Initial guesses for Newton's method.
        pair: The two variables.
        end: Value of the second variable at which to stop.
        steps: Number of steps that a straight branch would take.
        position: Position from which to continue; default the current state.
        goal: Value towards which the varied variable starts, if the second one is at rest.
    """

    def __init__(
        self,
        newton: Newton,
        settings: Solver,
        predictor: Predictor,
        pair: Pair,
        end: float,
        steps: int,
        position: Position | None = None,
        goal: float | None = None,
    ) -> None:
        self.newton, self.settings, self.predictor = newton, settings, predictor
        self.pair, self.end, self.goal = pair, end, goal
        self.position = Position(pair.sizes) if position is None else position
        self._largest = 1 / steps
        self._system = newton.system
        self._rate: Any = None  # of the last state

    def run(self) -> Iterator[BranchState]:
        """Yield the states one after another, until `position.done`.

        Raises:
            NotConverged: When a step has been halved too often; the solver is at the last state.
        """
        if self.position.step == 0:
            self._start()
        elif not self.position.done:
            self._go_on()
        while not self.position.done:
            found, iterations = self._advance(self._system.q.copy())
            self._accept(found)
            if iterations <= self.settings.target_iterations:
                self.position.step = min(2 * self.position.step, self._largest)
            yield found

    def _start(self) -> None:
        """Find the direction at the first state: towards the end, or the goal, or away from zero.

        The branch's tangent is found with a plane of an arbitrary direction, to which it is hardly
        ever parallel.
        """
        p, pair = self.position, self.pair
        self.predictor.start(("branch", p.length))
        self._system.residual(self._system.q, self._system.residual_vector)
        p.point, p.modes, p.step = pair.point(self._system), self._modes(), self._largest
        x, y = p.point
        direction, rate = pair.direction(self.newton, pair.arc(p.point, (0.6, 0.8), 0.0))
        towards = direction[1] * (self.end - y)
        if abs(direction[1]) < _AT_REST:
            towards = direction[0] * ((x or 1.0) if self.goal is None else self.goal - x)
        p.direction, self._rate = _oriented(direction, rate, towards)
        p.rising = math.copysign(1.0, p.direction[0])

    def _go_on(self) -> None:
        """Find the rate at the state of a resumed position."""
        p = self.position
        direction, rate = self.pair.direction(self.newton, self.pair.arc(p.point, p.direction, 0.0))
        _, self._rate = _oriented(direction, rate, _along(direction, p.direction))

    def _advance(self, kept: Any) -> tuple[BranchState, int]:
        """The next state, and its iterations; the step is halved where Newton's method fails."""
        p = self.position
        smallest = self._largest * 0.5**self.settings.max_cuts
        while True:
            try:
                return self._step(kept)
            except NotConverged as error:
                kept.copy(self._system.q)
                p.step /= 2
                if p.step < smallest:
                    self._system.ports[self.pair.port] = self.pair.control(p.point[0])
                    self._system.residual(self._system.q, self._system.residual_vector)
                    raise NotConverged(f"the branch ends, or turns too sharply ({error})") from None
                log.info("step along the branch cut to %.3g: %s", p.step, str(error))

    def _step(self, kept: Any) -> tuple[BranchState, int]:
        """The state after a step, or a special point or the end before it; and its iterations."""
        p = self.position
        at = p.length + p.step
        guess = self.predictor.predict(at, ("branch", at))
        if guess is None:
            guess = kept.copy()
            guess.axpy(p.step, self._rate)
        reached = self._solve(kept, p.step, guess)
        iterations = self.newton.iterations
        if _along(reached.direction, p.direction) < _TURN:
            raise NotConverged("the branch turns too sharply for this step")
        beyond = self._beyond()
        if beyond:
            reached = self._last(kept)
        found = self._limit_point(kept, reached) or self._bifurcation(kept, reached) or reached
        p.done = beyond and found.step == reached.step
        return found, iterations

    # --- states ----------------------------------------------------------------------------------

    def _solve(self, kept: Any, step: float, guess: Any) -> BranchState:
        """Find the state at a distance from the last one."""
        p = self.position
        self._system.ports[self.pair.port] = self.pair.arc(p.point, p.direction, step)
        guess.copy(self._system.q)
        self.newton.solve()
        return self._found(kept, step)

    def _last(self, kept: Any) -> BranchState:
        """Find the state at the end of the second variable, from one just beyond it."""
        p = self.position
        self._system.ports[self.pair.port] = self.pair.end(self.end)
        self.newton.solve()
        moved = zip(p.direction, self.pair.point(self._system), p.point, p.sizes, strict=True)
        return self._found(kept, sum(d * (b - a) / size for d, b, a, size in moved))

    def _found(self, kept: Any, step: float) -> BranchState:
        """The record of the solver's state, with its direction and its stability."""
        p, port = self.position, self.pair.port
        law, modes = self._system.ports[port], self._modes()
        arc = self.pair.arc(p.point, p.direction, step)
        direction, rate = self.pair.direction(self.newton, arc)
        self._system.ports[port] = law
        moved = self._system.q.copy()
        moved.axpy(-1.0, kept)
        return BranchState(step, *_oriented(direction, rate, moved.dot(rate)), modes)

    def _modes(self) -> int:
        """Unstable modes of the solver's state under control of the freed variable."""
        ports, port = self._system.ports, self.pair.port
        law = ports[port]
        ports[port] = self.pair.control(self.pair.point(self._system)[0])
        modes = self.newton.unstable_modes()
        ports[port] = law
        return modes

    def _beyond(self) -> bool:
        before, now = self.position.point[1], self.pair.point(self._system)[1]
        return (now - self.end) * (before - self.end) <= 0

    def _accept(self, found: BranchState) -> None:
        p = self.position
        p.length += found.step
        p.point, p.direction = self.pair.point(self._system), found.direction
        p.rising = -p.rising if found.kind == LIMIT_POINT else math.copysign(1.0, p.direction[0])
        p.modes = None if found.kind == LIMIT_POINT else found.modes
        p.count += 1
        self._rate = found.rate
        self.predictor.add(p.length, ("branch", p.length), self._system.q)

    # --- special points --------------------------------------------------------------------------

    def _limit_point(self, kept: Any, reached: BranchState) -> BranchState | None:
        """The limit point before a state, if there is one."""
        from scipy.optimize import brentq

        p = self.position
        if reached.direction[0] * p.rising >= 0:
            return None
        between, found = self._between(kept, reached), reached

        def turning(share: float) -> float:
            nonlocal found
            if share == 0:
                return p.rising * max(abs(p.direction[0]), _ACCURACY)
            found = self._solve(kept, share * reached.step, between(share))
            return found.direction[0]

        try:
            turning(brentq(turning, 0.0, 1.0, xtol=_ACCURACY))
        except ValueError:
            raise NotConverged("the step leads to another branch") from None
        modes = reached.modes if p.modes is None else p.modes
        return replace(found, modes=modes, kind=LIMIT_POINT)

    def _bifurcation(self, kept: Any, reached: BranchState) -> BranchState | None:
        """The first state with another number of unstable modes, if that changes in the step."""
        p = self.position
        if p.modes is None or reached.modes == p.modes:
            return None
        between, low, high = self._between(kept, reached), 0.0, 1.0
        for _ in range(_BISECTIONS):
            share = (low + high) / 2
            found = self._solve(kept, share * reached.step, between(share))
            low, high = (share, high) if found.modes == p.modes else (low, share)
        found = self._solve(kept, high * reached.step, between(high))
        return replace(found, kind=BIFURCATION)

    def _between(self, kept: Any, reached: BranchState) -> Callable[[float], Any]:
        """A function of a share of the step: Hermite's cubic through both ends and their rates."""
        q, before, step = self._system.q.copy(), self._rate, reached.step
        after = step / _along(reached.direction, self.position.direction)

        def at(share: float) -> Any:
            rest, guess = 1 - share, q.duplicate()
            guess.set(0.0)
            weights = [rest**2 * (1 + 2 * share), share**2 * (1 + 2 * rest)]
            slopes = [share * rest**2 * step, -rest * share**2 * after]
            guess.maxpy(weights + slopes, [kept, q, before, reached.rate])
            return guess

        return at


def _along(one: Two, other: Two) -> float:
    """Cosine of the angle between two directions."""
    return one[0] * other[0] + one[1] * other[1]


def _oriented(direction: Two, rate: Any, sense: float) -> tuple[Two, Any]:
    """A direction, or its opposite if `sense` is negative."""
    if sense >= 0:
        return direction, rate
    rate.scale(-1.0)
    return (-direction[0], -direction[1]), rate
