"""The load program as a generator of converged states."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dealib.config.case import Case
from dealib.config.follow import PARTNER
from dealib.config.program import Stage
from dealib.errors import ConfigError
from dealib.fem.layout import Layout
from dealib.fem.newton import Newton
from dealib.fem.problem import build_problem
from dealib.fem.system import Timings
from dealib.fem.viscous import Viscosity
from dealib.program import stages
from dealib.program.bias import second_film
from dealib.program.increments import Place
from dealib.program.inputs import mount_drives, terminal_drives
from dealib.program.predictor import Predictor
from dealib.program.progress import Progress
from dealib.program.states import Book, State
from dealib.program.turns import alone
from dealib.results.checkpoint import Checkpoint

__all__ = ["Simulation", "State"]


class Simulation:
    """Iterates over the converged states of a case; threads take turns.

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

    @alone()
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
        self.timings["mesh"] += time.perf_counter() - start
        self.viscosity = Viscosity(self.problem, self.layout) if self.problem.branches else None
        follows = [stage.follow for stage in case.config.program if stage.follow is not None]
        crossed = any(PARTNER[vary] != along for vary, along in (f.pair for f in follows))
        self.newton = Newton(self.problem, self.timings, symmetric=not crossed)
        self.steps_planned = _steps_planned(case.config.program)
        self.progress = Progress()
        self.predictor = Predictor(
            case.config.solver.predictor_order, retrace=self.viscosity is None
        )
        self.book = Book(case.config, self.problem.device, self.layout)
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
        states = self._states()
        while (state := _next(states)) is not None:
            yield state

    def _states(self) -> Iterator[State]:
        first, *others = self._stages
        if self.progress.step < 0:
            yield from stages.prestrain(self, first)
        for index, stage in enumerate(others, start=1):
            if self.progress.ended:
                return
            if index > self.progress.stage:
                self._begin(index, stage)
            if index == self.progress.stage and not self.progress.over:
                yield from (
                    stages.ramp(self, stage)
                    if stage.follow is None
                    else (stages.follow(self, stage))
                )

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
        try:
            self.progress = Progress.of(saved.values["progress"])
        except Exception as error:  # of a file whose content can be anything
            raise ConfigError(
                f"damaged checkpoint ({error!r}); start anew with --overwrite"
            ) from None
        self.problem.set_prestretch(1.0)
        known = []
        for k in range(comm.bcast(len(saved.states), root=0)):
            self.layout.scatter(None if mesh is None else saved.states[k])
            system.map.restrict(w, system.q)
            known.append(system.q.copy())
        if self.viscosity is not None and self.progress.row is not None:
            dissipated = self.progress.row["dissipated_energy_mJ"]
            self.viscosity.restore(saved.internal, dissipated)
        # states before row 0 are not saved: they lie on the way to the pre-stretch
        self.predictor.restore(saved.values["predictor"], known)

    def plain(self) -> dict[str, Any]:
        """What a checkpoint holds besides the states."""
        return {"progress": self.progress.plain(), "predictor": self.predictor.plain()}

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
            start = p.row["voltage_kV"], p.row["charge_uC"]
            p.drives["terminal"] = terminal_drives(stage.terminal, *start, p.drives["terminal"])
        p.stage, p.stage_start, p.place, p.branch = index, p.time, Place(), None
        p.over = False


@alone()
def _next(states: Iterator[State]) -> State | None:
    return next(states, None)


def _steps_planned(program: tuple[Stage, ...]) -> int:
    """Number of rows after row 0 if no increment is cut (corners off the grid may add some)."""
    return sum(s.steps * s.cycles for s in program if s.stage != "prestrain")
