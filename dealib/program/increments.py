"""Adaptive increments: cut back and rolled back on failure, grown again, corners never skipped."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from dealib.config.schema import Solver
from dealib.errors import NotConverged
from dealib.fem.newton import Newton


class Increments:
    """Drives Newton through one stage.

    Attributes:
        newton: The solver; its `system.q` is the state.
        settings: Targets and limits.
    """

    def __init__(self, newton: Newton, settings: Solver) -> None:
        self.newton, self.settings = newton, settings

    def run(
        self,
        targets: list[float],
        corners: set[float],
        apply: Callable[[float], None],
        explain: Callable[[float], str],
    ) -> Iterator[float]:
        """Solve up to each target in turn.

        Args:
            targets: Times at which a state is wanted, ascending, starting after 0.
            corners: Those at which an input changes direction: no extrapolation across them.
            apply: Sets the inputs of a time.
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
        before: tuple[float, object] | None = None  # an earlier converged time and state
        kept = q.copy()
        for target in targets:
            while now < target:
                left = target - now
                step = left if size > 0.75 * left else size
                then = target if step == left else now + step
                apply(then)
                try:
                    self._solve(kept, before, now, then)
                except NotConverged as error:
                    kept.copy(q)
                    apply(now)
                    size = step / 2
                    if size < smallest:
                        raise NotConverged(f"{explain(then)} ({error})") from None
                    continue
                before = (now, kept)
                kept, now = q.copy(), then
                if self.newton.iterations <= self.settings.target_iterations:
                    size = 2 * step if step < left else max(size, 2 * step)
                yield now
                if now in corners:
                    before = None

    def _solve(
        self, kept: object, before: tuple[float, object] | None, now: float, then: float
    ) -> None:
        """From an extrapolation if there is one, else (or if that fails) from the last state."""
        q = self.newton.system.q
        if before is not None and self.settings.predictor == "secant":
            earlier, state = before
            ratio = (then - now) / (now - earlier)
            if ratio <= 2:
                q.axpby(-ratio, 1 + ratio, state)
                try:
                    self.newton.solve()
                    return
                except NotConverged:
                    kept.copy(q)  # type: ignore[attr-defined]
        self.newton.solve()
