"""Adaptive increments: cut back and rolled back on failure, grown again, corners never skipped."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from dealib.config.schema import Solver
from dealib.errors import NotConverged
from dealib.fem.newton import Newton
from dealib.program.predictor import Predictor

log = logging.getLogger(__name__)


@dataclass
class Place:
    """Where the increments are in a stage.

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
        predictor: Where Newton starts; it lasts over the stages.
        place: Where the stage is; kept up to date.
    """

    def __init__(
        self, newton: Newton, settings: Solver, predictor: Predictor, place: Place | None = None
    ) -> None:
        self.newton, self.settings, self.predictor = newton, settings, predictor
        self.place = Place() if place is None else place

    def run(
        self,
        targets: list[float],
        corners: set[float],
        apply: Callable[[float], tuple[Any, ...]],
        explain: Callable[[float], str],
        too_far: Callable[[float, float], bool] = lambda at, step: False,
    ) -> Iterator[float]:
        """Solve up to each target in turn.

        Args:
            targets: Times at which a state is wanted, ascending, starting after 0.
            corners: Those at which an input changes direction: no extrapolation across them.
            apply: Sets the inputs of a time and names them, for the predictor's memory.
            explain: Message for a failure on the way to a time.
            too_far: Whether the state at a time, reached by a step, asks for a smaller step.

        Yields:
            The time of each converged state: all targets, and more where increments were cut.

        Raises:
            NotConverged: When an increment has been halved too often; the state is the last
                converged one.
        """
        q, place = self.newton.system.q, self.place
        smallest = 0.5**self.settings.max_cuts * targets[0]
        if place.now == 0:
            self.predictor.start()
        kept = q.copy()
        for target in targets:
            while place.now < target:
                left = target - place.now
                step = left if place.size > 0.75 * left else place.size
                then = target if step == left else place.now + step
                inputs = apply(then)
                try:
                    self._solve(kept, then, inputs)
                except NotConverged as error:
                    kept.copy(q)
                    apply(place.now)
                    place.size = step / 2
                    if place.size < smallest:
                        raise NotConverged(f"{explain(then)} ({error})") from None
                    log.info("increment to %.6g cut to %.3g: %s", then, place.size, error)
                    continue
                if too_far(then, step):
                    kept.copy(q)
                    apply(place.now)
                    place.size = step / 2
                    continue
                self.predictor.add(then, inputs, q)
                kept, place.now = q.copy(), then
                if self.newton.iterations <= self.settings.target_iterations:
                    place.size = 2 * step if step < left else max(place.size, 2 * step)
                log.debug("converged at %.6g of the stage, next %.3g", then, place.size)
                if then in corners:
                    self.predictor.corner()
                yield then

    def _solve(self, kept: Any, then: float, inputs: tuple[Any, ...]) -> None:
        """From a prediction if there is one, else (or if that fails) from the last state."""
        q = self.newton.system.q
        guess = self.predictor.predict(then, inputs)
        if guess is not None:
            guess.copy(q)
            try:
                self.newton.solve()
                return
            except NotConverged as error:
                log.debug("from the last state instead of the predicted one: %s", error)
                kept.copy(q)
        self.newton.solve()
