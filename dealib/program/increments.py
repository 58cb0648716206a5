"""Adaptive increments: cut back and rolled back on failure, grown again, corners never skipped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from dealib.config.schema import Solver
from dealib.errors import NotConverged
from dealib.fem.newton import Newton
from dealib.program.predictor import Predictor


class Increments:
    """Drives Newton through one stage.

    Attributes:
        newton: The solver; its `system.q` is the state.
        settings: Targets and limits.
        predictor: Where Newton starts; it lasts over the stages.
    """

    def __init__(self, newton: Newton, settings: Solver, predictor: Predictor) -> None:
        self.newton, self.settings, self.predictor = newton, settings, predictor

    def run(
        self,
        targets: list[float],
        corners: set[float],
        apply: Callable[[float], tuple[Any, ...]],
        explain: Callable[[float], str],
    ) -> Iterator[float]:
        """Solve up to each target in turn.

        Args:
            targets: Times at which a state is wanted, ascending, starting after 0.
            corners: Those at which an input changes direction: no extrapolation across them.
            apply: Sets the inputs of a time and names them, for the predictor's memory.
            explain: Message for a failure on the way to a time.

        Yields:
            The time of each converged state: all targets, and more where increments were cut.

        Raises:
            NotConverged: When an increment has been halved too often; the state is the last
                converged one.
        """
        q = self.newton.system.q
        now, size = 0.0, float("inf")
        smallest = 0.5**self.settings.max_cuts * targets[0]
        self.predictor.start()
        kept = q.copy()
        for target in targets:
            while now < target:
                left = target - now
                step = left if size > 0.75 * left else size
                then = target if step == left else now + step
                inputs = apply(then)
                try:
                    self._solve(kept, then, inputs)
                except NotConverged as error:
                    kept.copy(q)
                    apply(now)
                    size = step / 2
                    if size < smallest:
                        raise NotConverged(f"{explain(then)} ({error})") from None
                    continue
                self.predictor.add(then, inputs, q)
                kept, now = q.copy(), then
                if self.newton.iterations <= self.settings.target_iterations:
                    size = 2 * step if step < left else max(size, 2 * step)
                yield now
                if now in corners:
                    self.predictor.corner()

    def _solve(self, kept: Any, then: float, inputs: tuple[Any, ...]) -> None:
        """From a prediction if there is one, else (or if that fails) from the last state."""
        q = self.newton.system.q
        guess = self.predictor.predict(then, inputs)
        if guess is not None:
            guess.copy(q)
            try:
                self.newton.solve()
                return
            except NotConverged:
                kept.copy(q)
        self.newton.solve()
