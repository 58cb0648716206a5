"""The load program as a generator of converged states."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

from dealib.config.case import Case
from dealib.config.program import Stage
from dealib.config.stop import StopWhen
from dealib.errors import ConfigError
from dealib.fem.film import FilmPoints
from dealib.fem.layout import Layout
from dealib.fem.measures import Snapshot, film_stretches, measure
from dealib.fem.newton import Newton
from dealib.fem.problem import build_problem
from dealib.fem.system import Timings
from dealib.program.bias import ReachWatch, second_film
from dealib.program.increments import Increments, Place
from dealib.program.inputs import Drive, law, milestones, mount_drives, terminal_drives
from dealib.program.margins import keep
from dealib.program.predictor import Predictor
from dealib.program.progress import Progress
from dealib.program.stability import StabilityWatch
from dealib.program.work import Work
from dealib.results.checkpoint import Checkpoint

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


class _Measured(NamedTuple):
    """A state before it is accepted."""

    row: dict[str, Any]
    snapshot: Snapshot
    work: Work


class Simulation:
    """Iterates over the converged states of a case.

    Attributes:
        progress: How far the program has come.

    Args:
        case: A loaded case.
        comm: MPI communicator.
        mesh_file: Where to write the mesh in Gmsh's format, if anywhere.
        resume: Go on from there (on any number of ranks) instead of from the start.

    Raises:
        ConfigError: If the checkpoint belongs to another mesh.
        NotConverged: While iterating, when a step fails at the smallest increment.
    """

    def __init__(
        self,
        case: Case,
        comm: MPI.Comm = MPI.COMM_WORLD,
        mesh_file: Path | None = None,
        resume: Checkpoint | None = None,
    ) -> None:
        self.case, self.comm = case, comm
        self.timings = Timings()
        start = time.perf_counter()
        self.problem = build_problem(case.config, comm, mesh_file)
        self.layout = Layout.of(self.problem.device, self.problem.spaces)
        self._film = FilmPoints.of(case.config, self.problem.device, self.layout)
        self.timings["mesh"] += time.perf_counter() - start
        self.newton = Newton(self.problem, self.timings)
        self.steps_planned = _steps_planned(case.config.program)
        self.progress = Progress()
        self._measured: _Measured | None = None
        self._predictor = Predictor(case.config.solver.predictor_order)
        self._watch = StabilityWatch(case.config.materials.film)
        self._reach = ReachWatch()
        self._stages = case.config.program
        if self._stages[0].stage != "prestrain":
            self._stages = (Stage(stage="prestrain", duration="1 s"), *self._stages)
        if resume is not None:
            self._restore(resume)

    @property
    def unknowns(self) -> int:
        """Number of unknowns that are solved for."""
        return int(self.newton.system.q.size)

    def __iter__(self) -> Iterator[State]:
        """Run the program, or what is left of it."""
        first, *others = self._stages
        if self.progress.step < 0:
            yield self._prestrain(first)
        for index, stage in enumerate(others, start=1):
            if self.progress.ended:
                return
            if index > self.progress.stage:
                self._begin(index, stage)
            if index == self.progress.stage and not self.progress.over:
                yield from self._run(stage)

    def _restore(self, saved: Checkpoint) -> None:
        """Take up a saved state (collective)."""
        mesh, comm = self.layout.mesh, self.comm
        same = comm.bcast(None if mesh is None else mesh.fingerprint == saved.mesh, root=0)
        if not same:
            raise ConfigError(
                "the checkpoint belongs to another mesh (has mesh.file changed, or Gmsh?); "
                "start anew with --overwrite, or elsewhere with --out"
            )
        system, w = self.newton.system, self.problem.spaces.w
        self.progress = Progress.of(saved.values["progress"])
        self.problem.set_prestretch(1.0)
        known = []
        for k in range(comm.bcast(len(saved.states), root=0)):
            self.layout.scatter(None if mesh is None else saved.states[k])
            system.map.restrict(w, system.q)
            known.append(system.q.copy())
        # states before row 0 are not saved: they lie on the way to the pre-stretch
        self._predictor.restore(saved.values["predictor"], known)

    def plain(self) -> dict[str, Any]:
        """What a checkpoint holds besides the states."""
        return {"progress": self.progress.plain(), "predictor": self._predictor.plain()}

    # --- stages ----------------------------------------------------------------------------------

    def _prestrain(self, stage: Stage) -> State:
        """Ramp the pre-stretch with the ports at rest; the clock starts when it is reached."""

        def apply(fraction: float) -> tuple[Any, ...]:
            self.problem.set_prestretch(fraction)
            return ("prestretch", fraction)

        apply(0.0)
        increments = Increments(self.newton, self.case.config.solver, self._predictor)
        targets = [k / stage.steps for k in range(1, stage.steps + 1)]
        for _ in increments.run(targets, {1.0}, apply, lambda at: self._failure(stage, at)):
            pass
        return self._state(stage, 0.0, last=True)

    def _begin(self, index: int, stage: Stage) -> None:
        """Enter a stage: the ports keep their last values unless it drives them."""
        p = self.progress
        assert p.row is not None
        held = {k: tuple(d.held(p.place.now) for d in drives) for k, drives in p.drives.items()}
        p.drives = held
        if stage.mount is not None:
            start = p.row["displacement_mm"], p.row["force_N"]
            sample = partial(second_film, self.case.config, self.comm)
            p.drives["mount"] = mount_drives(stage.mount, *start, p.drives["mount"], sample)
        if stage.terminal is not None:
            p.drives["terminal"] = terminal_drives(
                stage.terminal, p.row["voltage_kV"], p.row["charge_uC"]
            )
        p.stage, p.stage_start, p.place = index, p.time, Place()
        p.over = False

    def _run(self, stage: Stage) -> Iterator[State]:
        """The rest of the stage that the progress is in."""
        p = self.progress
        targets, corners = milestones(stage, self._drives())

        def apply(at: float) -> tuple[Any, ...]:
            for port, drives in p.drives.items():
                self.newton.system.ports[port] = law(drives, at)
            return tuple(x for d in self._drives() for x in (d.label, d.at(at)))

        def time(at: float) -> float:
            return p.stage_start + at * stage.duration

        def too_far(at: float, step: float) -> bool:
            """Whether a condition is met on a step that can still be halved."""
            self._measured = self._measure(stage, time(at))
            met = self._met(stage, self._measured.row)
            halve = met is not None and step > 0.5**met.bisect / stage.steps * (1 + 1e-9)
            if halve:
                self._measured = None
            return halve

        apply(p.place.now)
        increments = Increments(self.newton, self.case.config.solver, self._predictor, p.place)
        explain = partial(self._failure, stage)
        for at in increments.run(targets, corners, apply, explain, too_far):
            yield self._state(stage, time(at), last=at == targets[-1])
            if p.over:
                return

    # --- states ----------------------------------------------------------------------------------

    def _measure(self, stage: Stage, at: float) -> _Measured:
        """The present state as the next row of the history."""
        p = self.progress
        row: dict[str, Any] = {"step": p.step + 1, "time_s": at, "stage": stage.stage}
        snapshot, work = Snapshot(self.newton, self._film), replace(p.work)
        row |= measure(snapshot)
        row |= work.add(p.row, row)
        return _Measured(row, snapshot, work)

    def _met(self, stage: Stage, row: dict[str, Any]) -> StopWhen | None:
        """The condition that a state meets, if there is one."""
        conditions = (*self.case.config.stop_when, *stage.stop_when)
        return next((c for c in conditions if c.met(row)), None)

    def _state(self, stage: Stage, at: float, last: bool) -> State:
        """Accept the present state."""
        p = self.progress
        row, snapshot, p.work = self._measured or self._measure(stage, at)
        met = self._met(stage, row)
        p.step, p.time, p.row, self._measured = p.step + 1, at, row, None
        keep(p.worst, snapshot.peaks, row)
        self._watch.see(row, lambda: film_stretches(snapshot))
        self._reach.see(row, self.newton.system.ports["mount"])
        if met is not None:
            p.over, ends = True, "run" if met in self.case.config.stop_when else "stage"
            found = {key: row[key] for key in ("step", "time_s", "stage")}
            p.stops.append({**found, "when": met.when, "ends": ends})
            log.info("%s ends the %s at step %d", met.when, ends, row["step"])
        return State(row, last or met is not None, self)

    def _drives(self) -> list[Drive]:
        return [drive for drives in self.progress.drives.values() for drive in drives]

    def _failure(self, stage: Stage, at: float) -> str:
        """Where the program stopped and what to try."""
        drives = self._drives()
        inputs = ", ".join(f"{d.label} = {d.at(at):.6g} {d.unit}" for d in drives)
        hint = "give the stage more steps"
        voltage = any(
            d.kind == "value" and d.label == "terminal.voltage" and d.at(at) != 0 for d in drives
        )
        self.newton.system.map.expand(self.newton.system.q, self.problem.spaces.w)
        if self.problem.locked(0.9):
            hint = "less load, for a law is stretched to over 90 % of its limit"
        if stage.stage == "prestrain":
            return f"stage 'prestrain' stopped at {at:.4g} of the pre-stretch; {hint}"
        if voltage:
            hint += "; if this is pull-in, prescribe the charge or the displacement instead"
        return (
            f"stage {stage.stage!r} stopped after t = {self.progress.time:.6g} s, "
            f"on the way to {inputs}; everything up to there is kept. Try: {hint}"
        )


def _steps_planned(program: tuple[Stage, ...]) -> int:
    """Number of rows after row 0 if no increment is cut (corners off the grid may add some)."""
    return sum(s.steps * s.cycles for s in program if s.stage != "prestrain")
