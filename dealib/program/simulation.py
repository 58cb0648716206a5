"""The load program as a generator of converged states."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dealib.config.case import Case
from dealib.config.schema import Stage
from dealib.fem.layout import Layout
from dealib.fem.measures import film_stretches, measure
from dealib.fem.newton import Newton
from dealib.fem.problem import build_problem
from dealib.fem.system import Timings
from dealib.program.increments import Increments
from dealib.program.inputs import REST, milestones, mount_drive, terminal_drive
from dealib.program.predictor import Predictor
from dealib.program.stability import StabilityWatch
from dealib.program.work import Work


@dataclass(frozen=True)
class State:
    """One converged state.

    Attributes:
        row: The history's row.
        end_of_stage: Whether it ends a stage.
        warnings: What the user should know from this state on; each is given once a simulation.
        simulation: Where it came from; holds the fields until the next state is asked for.
    """

    row: dict[str, Any]
    end_of_stage: bool
    simulation: Simulation
    warnings: tuple[str, ...] = ()

    def nodal(self) -> Any:
        """Nodal (u_R, u_Z, phi) of the whole mesh on rank 0, None elsewhere (collective)."""
        return self.simulation.layout.gather()


class Simulation:
    """Iterates over the converged states of a case.

    Args:
        case: A loaded case.
        comm: MPI communicator.
        mesh_file: Where to write the mesh in Gmsh's format, if anywhere.

    Raises:
        NotConverged: While iterating, when a step fails at the smallest increment.
    """

    def __init__(
        self, case: Case, comm: MPI.Comm = MPI.COMM_WORLD, mesh_file: Path | None = None
    ) -> None:
        self.case, self.comm = case, comm
        self.timings = Timings()
        start = time.perf_counter()
        self.problem = build_problem(case.config, comm, mesh_file)
        self.layout = Layout.of(self.problem.device, self.problem.spaces)
        self.timings["mesh"] += time.perf_counter() - start
        self.newton = Newton(self.problem, self.timings)
        self.steps_planned = _steps_planned(case.config.program)
        self._drives = dict(REST)
        self._work = Work()
        self._predictor = Predictor(case.config.solver.predictor_order)
        self._watch = StabilityWatch(case.config.materials.film)
        self._step, self._time = 0, 0.0

    @property
    def unknowns(self) -> int:
        """Number of unknowns that are solved for."""
        return int(self.newton.system.q.size)

    def __iter__(self) -> Iterator[State]:
        """Run the program."""
        program = self.case.config.program
        first = program[0]
        if first.stage == "prestrain":
            yield self._prestrain(first)
            program = program[1:]
        else:
            yield self._prestrain(Stage(stage="prestrain", duration="1 s"))
        for stage in program:
            yield from self._run(stage)

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
        return self._state(stage.stage, 0.0, last=True)

    def _run(self, stage: Stage) -> Iterator[State]:
        row = self._row
        if stage.mount is not None:
            self._drives["mount"] = mount_drive(stage.mount, row["displacement_mm"], row["force_N"])
        if stage.terminal is not None:
            self._drives["terminal"] = terminal_drive(
                stage.terminal, row["voltage_kV"], row["charge_uC"]
            )
        drives = dict(self._drives)
        targets, corners = milestones(stage, list(drives.values()))
        start = self._time

        def apply(at: float) -> tuple[Any, ...]:
            for port, drive in drives.items():
                self.newton.system.ports[port] = drive.law(at)
            return tuple(x for d in drives.values() for x in (d.label, d.at(at)))

        increments = Increments(self.newton, self.case.config.solver, self._predictor)
        for at in increments.run(targets, corners, apply, lambda at: self._failure(stage, at)):
            self._step += 1
            self._time = start + at * stage.duration
            yield self._state(stage.stage, self._time, last=at == targets[-1])
        self._drives = {port: drive.held() for port, drive in drives.items()}

    def _state(self, stage: str, at: float, last: bool) -> State:
        row: dict[str, Any] = {"step": self._step, "time_s": at, "stage": stage}
        row |= measure(self.newton, self.layout)
        row |= self._work.add(row)
        self._row = row
        warnings = self._watch.see(row, lambda: film_stretches(self.newton, self.layout))
        return State(row, last, self, warnings)

    def _failure(self, stage: Stage, at: float) -> str:
        """Where the program stopped and what to try."""
        reached = self._time if stage.stage != "prestrain" else 0.0
        inputs = ", ".join(f"{d.label} = {d.at(at):.6g} {d.unit}" for d in self._drives.values())
        hint = "give the stage more steps"
        voltage = any(
            d.kind == "value" and d.label == "terminal.voltage" and d.at(at) != 0
            for d in self._drives.values()
        )
        if stage.stage == "prestrain":
            return f"stage 'prestrain' stopped at {at:.4g} of the pre-stretch; {hint}"
        if voltage:
            hint += "; if this is pull-in, prescribe the charge or the displacement instead"
        return (
            f"stage {stage.stage!r} stopped after t = {reached:.6g} s, on the way to {inputs}; "
            f"everything up to there is kept. Try: {hint}"
        )


def _steps_planned(program: tuple[Stage, ...]) -> int:
    """Number of rows after row 0 if no increment is cut (corners off the grid may add some)."""
    return sum(s.steps * s.cycles for s in program if s.stage != "prestrain")
