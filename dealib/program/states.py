"""The present state as a row of the history: measured, judged, accepted."""

from __future__ import annotations

import logging
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from dealib.config.program import Stage
from dealib.config.schema import Config
from dealib.config.stop import StopWhen
from dealib.fem.device import Device
from dealib.fem.film import FilmPoints
from dealib.fem.layout import Layout
from dealib.fem.measures import film_stretches, measure
from dealib.fem.snapshot import Snapshot
from dealib.program.bias import ReachWatch
from dealib.program.margins import keep
from dealib.program.stability import StabilityWatch
from dealib.program.turns import alone
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

    @alone()
    def nodal(self) -> Any:
        """Nodal values of the whole mesh on rank 0 (see `Layout`), None elsewhere (collective)."""
        return self.simulation.layout.gather()

    @alone()
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
    """Takes the states of a simulation down, one after the other.

    It is given the simulation each time: kept here, the two would keep each other and their mesh
    until Python's collector comes, and MPI's communicators are few.

    Args:
        config: The config.
        device: The mesh.
        layout: Its layout.
    """

    def __init__(self, config: Config, device: Device, layout: Layout) -> None:
        self._film = FilmPoints.of(config, device, layout)
        self._watch = StabilityWatch(config.materials.film)
        self._reach = ReachWatch()

    def met(self, of: Simulation, stage: Stage, at: float) -> list[StopWhen]:
        """The conditions that the present state would meet (collective)."""
        with nullcontext() if of.viscosity is None else of.viscosity.tentative():
            return _met(of, stage, self._measure(of, stage, at, {}).row)

    def accept(
        self, of: Simulation, stage: Stage, at: float, last: bool, more: dict[str, Any]
    ) -> State:
        """Take the present state as the next one.

        Args:
            of: The simulation.
            stage: Its stage.
            at: Clock time, s.
            last: Whether it ends the stage.
            more: Further columns.
        """
        p = of.progress
        row, snapshot, p.work = self._measure(of, stage, at, more)
        met = _met(of, stage, row)
        p.step, p.time, p.row = p.step + 1, at, row
        keep(p.worst, snapshot.peaks, row)
        self._watch.see(row, lambda: film_stretches(snapshot))
        self._reach.see(row, of.newton.system.ports["mount"])
        if met:
            p.over, ends = True, "run" if met[0] in of.case.config.stop_when else "stage"
            found = {key: row[key] for key in ("step", "time_s", "stage")}
            p.stops.append({**found, "when": met[0].when, "ends": ends})
            log.info("%s ends the %s at step %d", met[0].when, ends, row["step"])
        return State(row, last or bool(met), of)

    def _measure(self, of: Simulation, stage: Stage, at: float, more: dict[str, Any]) -> _Measured:
        p = of.progress
        row: dict[str, Any] = {"step": p.step + 1, "time_s": at, "stage": stage.stage}
        snapshot = Snapshot(of.newton, self._film, of.viscosity)
        work = replace(p.work)
        row |= measure(snapshot)
        row |= work.add(p.row, row)
        return _Measured(row | more, snapshot, work)


def _met(of: Simulation, stage: Stage, row: dict[str, Any]) -> list[StopWhen]:
    """The conditions that a row meets, those of the run first."""
    return [c for c in (*of.case.config.stop_when, *stage.stop_when) if c.met(row)]
