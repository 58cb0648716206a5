"""The load program as a generator of converged states."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dealib.config.bias import Sampled, SecondFilm
from dealib.config.case import Case
from dealib.config.program import Stage
from dealib.fem.newton import Newton
from dealib.fem.reuse import Reuse
from dealib.program.bias import second_film
from dealib.program.engine import Engine
from dealib.program.history import History, State
from dealib.program.increments import StageClock
from dealib.program.inputs import drives
from dealib.program.progress import ProgramState
from dealib.program.stages import follow, prestrain, ramp
from dealib.program.turns import alone
from dealib.results.checkpoint import Checkpoint

__all__ = ["Simulation", "State"]


class Simulation:
    """Iterates over the converged states of a case; threads take turns.

    Attributes:
        engine: The discrete device, its solver and its progress.

    Args:
        case: A loaded case.
        comm: MPI communicator.
        mesh_file: Where to write the mesh in Gmsh's format, if anywhere.
        resume: Checkpoint from which to continue, on any number of ranks.
        newton: A solver shared with another simulation; this one then advances by `beside` only.
        only: Columns of the history to measure; default all.
        reuse: Provides the solver. If it is that of an earlier simulation, that one must not be
            used any more.

    Raises:
        ConfigError: If the checkpoint belongs to another mesh.
        NotConverged: While iterating, when a step fails at the smallest increment.
    """

    @alone()
    def __init__(
        self,
        case: Case,
        comm: MPI.Comm = MPI.COMM_WORLD,
        mesh_file: Path | None = None,
        resume: Checkpoint | None = None,
        newton: Newton | None = None,
        only: Collection[str] | None = None,
        reuse: Reuse | None = None,
    ) -> None:
        self.case, self.comm = case, comm
        with case.blamed():
            if reuse is not None:
                newton = reuse.newton(case.config, comm, mesh_file)
            self.engine = Engine(case.config, comm, mesh_file, newton)
            self._history = History(self.engine, only)
        self._stages = case.config.program
        if self._stages[0].stage != "prestrain":
            self._stages = (Stage(stage="prestrain", duration="1 s"), *self._stages)
        if resume is not None:
            self.engine.restore(resume)
        self._check_held()

    def __repr__(self) -> str:
        steps = f"step {self.progress.step} of {self.steps_planned}"
        return f"<Simulation {self.case.config.name}: {self.unknowns} unknowns, {steps}>"

    @property
    def progress(self) -> ProgramState:
        """How far the program has come."""
        return self.engine.progress

    @property
    def unknowns(self) -> int:
        """Number of unknowns that are solved for."""
        return int(self.engine.newton.system.q.size)

    @property
    def steps_planned(self) -> int:
        """Number of rows after row 0 if no increment is cut; corners between steps may add some."""
        program = self.case.config.program
        return sum(s.count * s.cycles for s in program if s.stage != "prestrain")

    def __iter__(self) -> Iterator[State]:
        """Run the program, or what is left of it."""
        states = self._states()
        while (state := _next(states)) is not None:
            yield state

    def _states(self) -> Iterator[State]:
        first, *others = self._stages
        engine, history = self.engine, self._history
        if self.progress.step < 0:
            yield from prestrain(engine, history, first)
        for index, stage in enumerate(others, start=1):
            if self.progress.ended:
                return
            if index > self.progress.stage:
                self._begin(index, stage)
            if index == self.progress.stage and not self.progress.over:
                run = ramp if stage.follow is None else follow
                yield from run(engine, history, stage)

    def beside(self, other: ProgramState, q: Any) -> State:
        """Find the state by one Newton step from that of a nearly equal simulation (collective).

        Args:
            other: Progress of that simulation, which has the same solver.
            q: Its state, at which the solver has been linearised.
        """
        engine, p, at = self.engine, self.progress, other.clock.now
        if other.stage > p.stage:
            self._begin(other.stage, self._stages[other.stage])
        stage, clocks = self._stages[p.stage], engine.clocks
        if other.stage == 0:
            engine.apply(0.0)
            engine.problem.set_prestretch(1.0)
            engine.newton.step_from(q)
            if engine.viscosity is not None:
                engine.viscosity.rest()
            return self._state(stage, 0.0, last=True)
        engine.begin((at - p.clock.now) * stage.duration)
        engine.apply(at)
        engine.newton.step_from(q)
        p.clock.now = at
        for clock in clocks:
            clock.commit()
        return self._state(stage, p.stage_start + at * stage.duration, last=False)

    def _state(self, stage: Stage, at: float, last: bool) -> State:
        (state,) = self._history.accept(stage, self._history.draft(at, {}), last)
        return state

    def _begin(self, index: int, stage: Stage) -> None:
        """Enter a stage: the ports keep their last values unless it drives them."""
        p, device = self.progress, self.case.config.device
        p.drives = {k: tuple(d.held(p.clock.now) for d in found) for k, found in p.drives.items()}
        for name, given in stage.driven(device).items():
            before = p.drives[name]
            p.drives[name] = drives(
                device.by_name[name], given, *p.ports[name], before, self.sample, stage
            )
        p.stage, p.stage_start, p.clock, p.branch = index, p.time, StageClock(), None
        p.over = False
        self.engine.enter(stage.dynamic)
        self._check_held()

    def _check_held(self) -> None:
        if self.engine.newton.system.inertia is not None:
            return
        with self.case.blamed():
            self.engine.check_held(0.0)

    def sample(self, film: SecondFilm) -> Sampled:
        """Compute the force curve of a second film by a simulation of its own."""
        return second_film(self.case.config, film, lambda case: Simulation(case, self.comm))


@alone()
def _next(states: Iterator[State]) -> State | None:
    return next(states, None)
