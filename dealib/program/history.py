"""Records converged states as rows of the history."""

from __future__ import annotations

import logging
from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from dealib.config.program import Stage
from dealib.config.stop import StopWhen
from dealib.fem.films import FilmPoints
from dealib.fem.probes import Probes
from dealib.fem.snapshot import Snapshot
from dealib.observe.quantities import columns, measured
from dealib.program.bias import ReachWatch
from dealib.program.engine import Engine
from dealib.program.margins import keep
from dealib.program.stability import StabilityWatch
from dealib.program.turns import alone
from dealib.program.work import LOST, STORED, Work

log = logging.getLogger(__name__)


@dataclass(frozen=True, repr=False)
class State:
    """One converged state.

    Attributes:
        row: The history's row.
        end_of_stage: Whether it ends a stage.
        engine: Its engine, which holds the fields until the next state is asked for.
        lost: Whether it has more unstable modes than the state before it.
        modes: If so, displacements of the softest modes on rank 0, (modes, nodes, axes).
    """

    row: dict[str, Any]
    end_of_stage: bool
    engine: Engine
    lost: bool = False
    modes: Any = None

    def __repr__(self) -> str:
        row = self.row
        return f"<State {row['step']}: {row['stage']}, t = {row['time_s']:g} s>"

    @alone()
    def nodal(self) -> Any:
        """Nodal values of the whole mesh on rank 0 (see `Layout`), None elsewhere (collective)."""
        return self.engine.layout.gather()

    @alone()
    def internal(self) -> Any:
        """Internal state of Maxwell branches, likewise (see `Viscosity.gather`); None without."""
        viscosity = self.engine.viscosity
        return None if viscosity is None else viscosity.gather()

    @alone()
    def in_time(self) -> dict[str, Any]:
        """Velocities and charges of electrodes, likewise (see `Engine.in_time`)."""
        return self.engine.in_time()


class _Measured(NamedTuple):
    """A state before it is accepted."""

    row: dict[str, Any]
    snapshot: Snapshot
    work: Work


class History:
    """Measures the states of an engine and accepts them, one after the other.

    Args:
        engine: The engine.
        only: Columns to measure; default all.
    """

    def __init__(self, engine: Engine, only: Collection[str] | None = None) -> None:
        self._engine, config = engine, engine.config
        self._films = FilmPoints.all(engine.problem, engine.layout, engine.normals)
        self._probes = Probes(engine.problem, engine.layout)
        self._measured = [c for c in measured(config) if only is None or c.name in only]
        self._units = {name: column.unit for name, column in columns(config).items()}
        self._stability = StabilityWatch([p.film.law for p in self._films])
        self._reach = ReachWatch()

    def met(self, stage: Stage, at: float) -> list[StopWhen]:
        """The conditions that the current state would meet if it were accepted (collective)."""
        with ExitStack() as tried:
            for clock in self._engine.clocks:
                tried.enter_context(clock.tentative())
            return self._met(stage, self._measure(stage, at, {}).row)

    def accept(self, stage: Stage, at: float, last: bool, more: dict[str, Any]) -> State:
        """Accept the current state as the next row.

        Args:
            stage: Its stage.
            at: Clock time, s.
            last: Whether it ends the stage.
            more: Further columns.
        """
        of, p = self._engine, self._engine.progress
        row, snapshot, p.work = self._measure(stage, at, more)
        met = self._met(stage, row)
        modes, before = None, (p.row or {}).get("unstable_modes", 0)
        lost = of.config.output.modes > 0 and row["unstable_modes"] > before
        if lost:
            modes, _ = of.mode_shapes(snapshot.modes)
        p.step, p.time, p.row, p.ports = p.step + 1, at, row, of.port_pairs()
        keep(p.worst, snapshot.peaks, row, of.problem.kinematics.axes)
        self._stability.see(row, snapshot)
        self._reach.see(row, of)
        if met:
            p.over, ends = True, "run" if met[0] in of.config.stop_when else "stage"
            found = {key: row[key] for key in ("step", "time_s", "stage")}
            p.stops.append({**found, "when": met[0].when, "ends": ends})
            log.info("%s ends the %s at step %d", met[0].when, ends, row["step"])
        return State(row, last or bool(met), of, lost, modes)

    def _measure(self, stage: Stage, at: float, more: dict[str, Any]) -> _Measured:
        of, p = self._engine, self._engine.progress
        row: dict[str, Any] = {"step": p.step + 1, "time_s": at, "stage": stage.stage}
        snapshot = Snapshot(
            of.newton, self._films, self._probes, of.viscosity, of.inertia, p.through
        )
        for column in self._measured:
            row[column.name] = column.measure(snapshot)
        if of.config.output.modes:
            row["unstable_modes"] = snapshot.modes.unstable
        work = replace(p.work, done=dict(p.work.done))
        stored, lost = (sum(row.get(name, 0.0) for name in names) for names in (STORED, LOST))
        before = p.ports if p.row is not None else None
        row |= work.add(of.problem.device, before, of.port_pairs(), stored, lost)
        return _Measured(row | more, snapshot, work)

    def _met(self, stage: Stage, row: dict[str, Any]) -> list[StopWhen]:
        """The conditions that a row meets; those of the run come first."""
        every = (*self._engine.config.stop_when, *stage.stop_when)
        return [c for c in every if c.met(row, self._units[c.column])]
