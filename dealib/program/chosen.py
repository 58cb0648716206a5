"""Stages with `steps: auto`: which states are solved, and the rows between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from dealib.arrays import Array
from dealib.config.program import Stage
from dealib.config.stop import StopWhen
from dealib.program.engine import Engine
from dealib.program.history import COUNTS, History, PendingRow, State, numbers
from dealib.program.knots import InterpolatedRows, share


def to_halve(met: Sequence[StopWhen], step: float, stage: Stage) -> bool:
    """Whether a step on which conditions are met is halved, to come closer to them."""
    halvings = [condition.bisect for condition in met]
    return bool(halvings) and step > 0.5 ** max(halvings) / stage.count * (1 + 1e-9)


class Chosen:
    """Solves the rows of a stage that its curves need, and interpolates the others.

    Args:
        of: The engine, at the beginning of the stage or where the stage goes on.
        history: Takes the rows down.
        stage: The stage.
        rows: Times at which a row is wanted, in cycles.
        corners: Those at which an input changes direction.
        more: Further columns of the present state.
    """

    def __init__(
        self,
        of: Engine,
        history: History,
        stage: Stage,
        rows: Sequence[float],
        corners: set[float],
        more: Callable[[], dict[str, Any]],
    ) -> None:
        self._of, self._history, self._stage, self._more = of, history, stage, more
        self._rows, self._corners, self._least = rows, corners, 1 / stage.count
        self._next: list[PendingRow] = []  # interpolated rows, and the state after them
        p = of.progress
        if p.clock.now == 0:
            p.knots.start()
            p.clock.size = self._least

    def judge(self, at: float, step: float) -> tuple[bool, float]:
        """Whether the present state may follow the last one; and the next step (collective).

        Args:
            at: Its time, in cycles.
            step: Since the last state.
        """
        of, p = self._of, self._of.progress
        draft = self._history.draft(self._clock(at), self._more())
        times = [x for x in self._rows if p.clock.now < x < at]
        fit = p.knots.fit(at, numbers(draft), times, self._inputs, ~self._history.extremes)
        fit = of.comm.bcast(fit, root=0)  # what follows is collective
        if times or fit.reach() >= 2 * self._least:  # else the next row is solved anyway
            fit = of.comm.bcast(self._with_extremes(fit, draft), root=0)
        turns = (p.row or {}).get("unstable_modes") != self._unstable(draft)
        # before a corner, the next row may be nearer than the distance of the rows
        least = min([self._least, *(x - p.clock.now for x in times[:1])])
        if times and (fit.share > 1 or turns):
            return False, max(least, min(step / 2, fit.reach(again=True)))
        self._next = [*self._interpolated(times, fit, draft), draft]
        met = self._history.met_by(self._stage, self._next)
        if to_halve(met, step, self._stage):
            return False, max(least, step / 2) if times else step / 2
        return True, self._least if at in self._corners else max(self._least, fit.reach())

    def accept(self, at: float, last: bool) -> list[State]:
        """The rows up to the state that was judged.

        Args:
            at: Its time, in cycles.
            last: Whether it ends the stage.
        """
        *between, draft = self._next
        states = self._history.accept(self._stage, draft, last, between)
        if at in self._corners:
            self._of.progress.knots.start(at)
        return states

    def _clock(self, at: float) -> float:
        return self._of.progress.stage_start + at * self._stage.duration

    def _inputs(self, at: float) -> list[float]:
        return [drive.at(at) for drive in self._of.drives]

    @staticmethod
    def _unstable(draft: PendingRow) -> Any:
        return (draft.values | draft.more).get("unstable_modes")

    def _with_extremes(self, fit: InterpolatedRows, draft: PendingRow) -> InterpolatedRows:
        """The same, judged by extremes over the device too (collective)."""
        extreme = self._history.extremes
        if not extreme.any():
            return fit
        guess, _ = self._history.measure_extremes(self._state(fit.ahead, []))
        values = numbers(draft)[extreme]
        return replace(fit, share=max(fit.share, share(guess, values, fit.allowed[extreme])))

    def _interpolated(
        self, times: Sequence[float], fit: InterpolatedRows, after: PendingRow
    ) -> Iterator[PendingRow]:
        """Rows before a state: sums over the device are interpolated, extremes are taken of states.

        An extreme moves from place to place, so that its curve has kinks, which states have not.
        """
        q = self._of.newton.system.q
        for at, row, weights in zip(times, fit.rows, fit.inside, strict=True):
            values, peaks = self._history.measure_extremes(self._state(weights, [q]))
            row[self._history.extremes] = values
            given = iter(row.tolist())
            named = {k: 0 if k in COUNTS else next(given) for k in after.values}
            named |= {k: v for k, v in after.values.items() if k == "unstable_modes"}
            ports = {name: (next(given), next(given)) for name in after.ports}
            yield PendingRow(self._clock(at), named, ports, after.more | {"solved": 0}, peaks)

    def _state(self, weights: Array, last: list[Any]) -> Any:
        """A sum of the last known states, and of this one."""
        known = self._of.predictor.path
        states = [k.q for k in known[len(known) + len(last) - len(weights) :]] + last
        found = states[0].duplicate()
        found.set(0.0)
        found.maxpy(weights.tolist(), states)
        return found
