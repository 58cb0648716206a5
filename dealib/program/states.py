"""The present state as a row of the history: measured, judged, accepted."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from dealib.config.program import Stage
from dealib.config.stop import StopWhen
from dealib.fem.film import FilmPoints
from dealib.fem.measures import film_stretches, measure
from dealib.fem.snapshot import Snapshot
from dealib.program.bias import ReachWatch
from dealib.program.margins import keep
from dealib.program.stability import StabilityWatch
from dealib.program.work import Work

if TYPE_CHECKING:
    from dealib.program.simulation import Simulation

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class State:
    """One converged state.

    Attributes:
        row: The history's row.
        end_of_stage: Whether it ends a stage.
        simulation: Where it came from; holds the fields until the next state is asked for.
    """

    row: dict[str, Any]
    end_of_stage: bool
    simulation: Simulation

    def nodal(self) -> Any:
        """Nodal values of the whole mesh on rank 0 (see `Layout`), None elsewhere (collective)."""
        return self.simulation.layout.gather()

    def internal(self) -> Any:
        """Internal state of Maxwell branches, likewise (see `Viscosity.gather`); None without."""
        viscosity = self.simulation.viscosity
        return None if viscosity is None else viscosity.gather()


class _Measured(NamedTuple):
    """A state before it is accepted."""

    row: dict[str, Any]
    snapshot: Snapshot
    work: Work


class Book:
    """Takes the states of a simulation down, one after the other."""

    def __init__(self, simulation: Simulation) -> None:
        self._of = simulation
        config = simulation.case.config
        self._film = FilmPoints.of(config, simulation.problem.device, simulation.layout)
        self._watch = StabilityWatch(config.materials.film)
        self._reach = ReachWatch()

    def met(self, stage: Stage, at: float) -> StopWhen | None:
        """The condition that the present state would meet, if there is one."""
        return self._met(stage, self._measure(stage, at, {}).row)

    def accept(self, stage: Stage, at: float, last: bool, more: dict[str, Any]) -> State:
        """Take the present state as the next one.

        Args:
            stage: Its stage.
            at: Clock time, s.
            last: Whether it ends the stage.
            more: Further columns.
        """
        p = self._of.progress
        row, snapshot, p.work = self._measure(stage, at, more)
        met = self._met(stage, row)
        p.step, p.time, p.row = p.step + 1, at, row
        keep(p.worst, snapshot.peaks, row)
        self._watch.see(row, lambda: film_stretches(snapshot))
        self._reach.see(row, self._of.newton.system.ports["mount"])
        if met is not None:
            p.over, ends = True, "run" if met in self._of.case.config.stop_when else "stage"
            found = {key: row[key] for key in ("step", "time_s", "stage")}
            p.stops.append({**found, "when": met.when, "ends": ends})
            log.info("%s ends the %s at step %d", met.when, ends, row["step"])
        return State(row, last or met is not None, self._of)

    def _measure(self, stage: Stage, at: float, more: dict[str, Any]) -> _Measured:
        p = self._of.progress
        row: dict[str, Any] = {"step": p.step + 1, "time_s": at, "stage": stage.stage}
        snapshot = Snapshot(self._of.newton, self._film, self._of.viscosity)
        work = replace(p.work)
        row |= measure(snapshot)
        row |= work.add(p.row, row)
        return _Measured(row | more, snapshot, work)

    def _met(self, stage: Stage, row: dict[str, Any]) -> StopWhen | None:
        conditions = (*self._of.case.config.stop_when, *stage.stop_when)
        return next((c for c in conditions if c.met(row)), None)
