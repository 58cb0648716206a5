"""Records converged states as rows of the history."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from dealib.arrays import Array
from dealib.config.program import Stage
from dealib.config.stop import StopWhen
from dealib.errors import ConfigError
from dealib.fem.films import FilmPoints
from dealib.fem.probes import Probes
from dealib.fem.snapshot import Extremum, Snapshot
from dealib.observe.columns import columns, measured
from dealib.program.bias import ReachWatch
from dealib.program.engine import Engine
from dealib.program.margins import keep
from dealib.program.stability import StabilityWatch
from dealib.program.turns import alone
from dealib.program.work import LOST, STORED, Two, Work

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
        solved: Whether it was solved; else it is a row that is interpolated, without fields.
    """

    row: dict[str, Any]
    end_of_stage: bool
    engine: Engine
    lost: bool = False
    modes: Any = None
    solved: bool = True

    def __repr__(self) -> str:
        row = self.row
        return f"<State {row['step']}: {row['stage']}, t = {row['time_s']:g} s>"

    @alone()
    def nodal(self) -> Any:
        """Nodal values of the whole mesh on rank 0 (see `Layout`), None elsewhere (collective).

        Raises:
            ConfigError: Of an interpolated row, which has none.
        """
        if not self.solved:
            raise ConfigError(
                f"step {self.row['step']} is interpolated (steps: auto), so it has no fields; take "
                "those states whose `solved` is true, or give the stage a number of steps"
            )
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


class PendingRow(NamedTuple):
    """A row before it is accepted.

    Attributes:
        at: Clock time, s.
        values: What is measured of the state.
        ports: Value and dual of each port.
        more: Further columns.
        peaks: Where the margins are smallest.
        snapshot: The state; None where it is interpolated.
    """

    at: float
    values: dict[str, Any]
    ports: dict[str, Two]
    more: dict[str, Any]
    peaks: dict[str, Extremum]
    snapshot: Snapshot | None = None


COUNTS = ("newton_iterations", "unstable_modes")  # columns without values between two states


def numbers(draft: PendingRow) -> Array:
    """What can be interpolated of a row: its columns, then values and duals of the ports."""
    values = [v for k, v in draft.values.items() if k not in COUNTS]
    return np.array([*values, *(x for pair in draft.ports.values() for x in pair)], dtype=float)


class History:
    """Measures the states of an engine and accepts them, one after the other.

    Attributes:
        extremes: Which of `numbers` are extremes over the device.

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
        extreme = [c.quantity.extreme for c in self._measured if c.name not in COUNTS]
        ports = [False] * (2 * len(engine.problem.device.ports))
        self.extremes = np.array([*extreme, *ports])
        self._auto = any(stage.auto for stage in config.program)

    def met(self, stage: Stage, at: float) -> list[StopWhen]:
        """The conditions that the current state would meet if it were accepted (collective)."""
        with ExitStack() as tried:
            for clock in self._engine.clocks:
                tried.enter_context(clock.tentative())
            return self.met_by(stage, [self.draft(at, {})])

    def met_by(self, stage: Stage, drafts: Sequence[PendingRow]) -> list[StopWhen]:
        """The conditions that one of the next rows would meet."""
        rows, _ = self._rows(stage, drafts)
        return [condition for row in rows for condition in self._met(stage, row)]

    def accept(
        self,
        stage: Stage,
        draft: PendingRow,
        last: bool,
        between: Sequence[PendingRow] = (),
    ) -> list[State]:
        """Accept the current state as the next row.

        Args:
            stage: Its stage.
            draft: Its row.
            last: Whether it ends the stage.
            between: Interpolated rows that come before it.

        Returns:
            The interpolated rows, then the state.
        """
        of, p = self._engine, self._engine.progress
        (*others, row), p.work = self._rows(stage, [*between, draft])
        axes = of.problem.kinematics.axes
        snapshot, at = draft.snapshot, draft.at
        assert snapshot is not None
        met = self._met(stage, row)
        modes, before = None, (p.row or {}).get("unstable_modes", 0)
        lost = of.config.output.modes > 0 and row["unstable_modes"] > before
        if lost:
            modes, _ = of.mode_shapes(snapshot.modes)
        p.step, p.time, p.row, p.ports = row["step"], at, row, draft.ports
        for told, taken in zip([*others, row], [*between, draft], strict=True):
            keep(p.worst, taken.peaks, told, axes)
        self._stability.see(row, snapshot)
        self._reach.see(row, of)
        if met:
            p.over, ends = True, "run" if met[0] in of.config.stop_when else "stage"
            found = {key: row[key] for key in ("step", "time_s", "stage")}
            p.stops.append({**found, "when": met[0].when, "ends": ends})
            log.info("%s ends the %s at step %d", met[0].when, ends, row["step"])
        if self._auto:
            p.knots.add(p.clock.now, numbers(draft))
        return [
            *(State(other, False, of, solved=False) for other in others),
            State(row, last or bool(met), of, lost, modes),
        ]

    def draft(self, at: float, more: dict[str, Any]) -> PendingRow:
        """Measure the present state (collective).

        Args:
            at: Clock time, s.
            more: Further columns.
        """
        of, p = self._engine, self._engine.progress
        snapshot = Snapshot(
            of.newton, self._films, self._probes, of.viscosity, of.inertia, p.through
        )
        values: dict[str, Any] = {c.name: c.measure(snapshot) for c in self._measured}
        if of.config.output.modes:
            values["unstable_modes"] = snapshot.modes.unstable
        if self._auto:
            more = {**more, "solved": 1}
        return PendingRow(at, values, of.port_pairs(), more, snapshot.peaks, snapshot)

    def measure_extremes(self, q: Any) -> tuple[Array, dict[str, Extremum]]:
        """Those columns that are extremes, of a state that need not be in equilibrium (collective).

        Args:
            q: Its reduced unknowns.

        Returns:
            The values in the order of `numbers`, and where margins are smallest.
        """
        newton, system = self._engine.newton, self._engine.newton.system
        system.expand(q)
        snapshot = Snapshot(newton, self._films, self._probes)
        found = [c.measure(snapshot) for c in self._measured if c.quantity.extreme]
        system.expand(system.q)
        return np.array(found), snapshot.peaks

    def _rows(
        self, stage: Stage, drafts: Sequence[PendingRow]
    ) -> tuple[list[dict[str, Any]], Work]:
        """Rows of the history that would follow the last one, and the work after them."""
        device, p = self._engine.problem.device, self._engine.progress
        work, rows = replace(p.work, done=dict(p.work.done)), []
        before = p.ports if p.row is not None else None
        for step, (at, values, ports, more, *_) in enumerate(drafts, start=p.step + 1):
            row = {"step": step, "time_s": at, "stage": stage.stage, **values}
            stored, lost = (sum(row.get(name, 0.0) for name in names) for names in (STORED, LOST))
            rows.append(row | work.add(device, before, ports, stored, lost) | more)
            before = ports
        return rows, work

    def _met(self, stage: Stage, row: dict[str, Any]) -> list[StopWhen]:
        """The conditions that a row meets; those of the run come first."""
        every = (*self._engine.config.stop_when, *stage.stop_when)
        return [c for c in every if c.met(row, self._units[c.column])]
