"""One run: a simulation, its observers, its directory and its status."""

from __future__ import annotations

import logging
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np

from dealib.config.case import Case, resolved
from dealib.errors import Interrupted, NotConverged, PlatformError
from dealib.fem import compat
from dealib.program.directory import identity, prepare
from dealib.program.log import to_file
from dealib.program.margins import table
from dealib.program.predictor import MEMORY
from dealib.program.signals import Signals
from dealib.program.simulation import Simulation, State
from dealib.results import paraview, store
from dealib.results.checkpoint import CheckpointFolder
from dealib.results.fields import Fields
from dealib.results.reader import Run

log = logging.getLogger(__name__)


class Observer(Protocol):
    """Sees every converged state, on every rank."""

    def start(self, simulation: Simulation) -> None:
        """Called once before the first state."""

    def see(self, state: State) -> None:
        """Called at each converged state."""

    def stop(self, error: BaseException | None) -> None:
        """Called at the end, with what ended it if not the program's end."""


class Recorder:
    """Writes history, states and fields into the run directory (files on rank 0)."""

    def __init__(self, directory: Path, case: Case) -> None:
        self.directory, self.case = directory, case
        self.wanted = case.config.output.fields
        self._history: store.HistoryFile | None = None
        self._states: store.StateFile | None = None
        self._fields: store.FieldFile | None = None
        self._checkpoint = CheckpointFolder(directory)

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        self._timings = simulation.timings
        mesh, done = simulation.layout.mesh, simulation.progress.step
        if mesh is None:
            return
        self._mesh = mesh.fingerprint
        self._history = store.HistoryFile(self.directory, done)
        texts = {"config": self.case.text, "config_resolved": resolved(self.case.config)}
        texts |= {f"versions/{k}": v for k, v in versions().items()}
        self._states = store.StateFile(self.directory, mesh, texts, done)
        if self.wanted != "none":
            self._fields = store.FieldFile(self.directory, mesh, done)
            self._derive = Fields(self.case.config, mesh)
            paraview.write(self.directory, mesh)

    def see(self, state: State) -> None:
        """See `Observer`. The checkpoint comes last: what it knows of is all there."""
        begin = time.perf_counter()
        stored = self.wanted == "every" or (self.wanted == "stage" and state.end_of_stage)
        nodal, internal = state.nodal(), state.internal()
        if self._history is not None and self._states is not None:
            viscosity = state.simulation.viscosity
            at_gauss = None if viscosity is None else viscosity.at_gauss(internal)
            if self._fields is not None and stored:
                found = self._derive(nodal, at_gauss)
                self._fields.add(state.row["step"], state.row["time_s"], found)
            self._history.add(state.row)
            self._states.add(state.row, nodal if stored else None, at_gauss)
            with self._timings("checkpoint"):
                values = state.simulation.plain()
                self._checkpoint.write(values, self._mesh, nodal, MEMORY, internal)
        self._timings["output"] += time.perf_counter() - begin

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        if self._states is not None and not isinstance(error, PlatformError):
            self._states.close()


class Log:
    """Writes each step to the log."""

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        cells = 0 if simulation.layout.mesh is None else len(simulation.layout.mesh.cells)
        log.info(
            "%d cells, %d unknowns, %d ranks", cells, simulation.unknowns, simulation.comm.size
        )
        if simulation.progress.step >= 0:
            log.info("resumed after step %d", simulation.progress.step)

    def see(self, state: State) -> None:
        """See `Observer`."""
        log.info(line(state.row))
        for kind in ("limit_point", "bifurcation"):
            if state.row.get(kind):
                log.info("step %d is a %s", state.row["step"], kind.replace("_", " "))

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        log.info("done" if error is None else f"stopped: {error}")


def line(row: dict[str, Any]) -> str:
    """One step in one line."""
    return (
        f"step {row['step']:4d}  t {row['time_s']:9.4g} s  {row['stage']:<12.12s}"
        f"  u {row['displacement_mm']:9.5f} mm  F {row['force_N']:9.5f} N"
        f"  V {row['voltage_kV']:7.4f} kV  C {row['capacitance_pF']:8.3f} pF"
        f"  {row['newton_iterations']:2d} it"
    )


def versions() -> dict[str, str]:
    """Versions of everything that results depend on."""
    from importlib.metadata import version

    from petsc4py import PETSc

    import gmsh

    return {
        "dealib": version("dealib"),
        "dolfinx": compat.VERSION,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "gmsh": gmsh.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def simulate(
    case: Case,
    directory: str | Path | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    observers: Sequence[Observer] = (),
    comm: MPI.Comm = MPI.COMM_WORLD,
    argv: Sequence[str] | None = None,
    started: float | None = None,
) -> Run:
    """Run a case into its directory.

    Args:
        case: A loaded case.
        directory: Run directory; default the config's.
        overwrite: Replace an existing run.
        resume: Go on with an unfinished run; a finished one is left as it is.
        observers: What else sees each state.
        comm: MPI communicator.
        argv: Command line to record.
        started: `time.perf_counter()` at which the process began, for the timings.

    Returns:
        The run, to read.

    Raises:
        ConfigError: If the directory exists, or cannot be resumed.
        NotConverged: If a step failed; what converged is in the directory.
        Interrupted: After SIGINT or SIGTERM; what converged is in the directory.
        PlatformError: If the disk refuses.
    """
    begin = time.perf_counter() if started is None else started
    path = Path(directory or case.config.directory)
    info: dict[str, Any] = {
        "name": case.config.name,
        "status": "running",
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "argv": list(argv if argv is not None else sys.argv),
        "config": str(case.path),
        "set": list(case.overrides),
        "ranks": comm.size,
        **identity(),
        "git": _git_hash(),
        "versions": versions(),
    }
    if resume and _is_done(path, comm):
        return Run(path)
    with Signals(comm) as signals, to_file(path, comm.rank == 0) as info["warnings"]:
        saved = prepare(path, case, info, overwrite, resume, comm)
        with _Session(path, info, begin, comm) as session:
            log.info("%s", shlex.join(info["argv"]))
            log.info("%s", ", ".join(f"{k} {v}" for k, v in info["versions"].items()))
            mesh_file = path / "mesh.msh" if saved is None else None
            simulation = Simulation(case, comm, mesh_file, saved)
            session.run(simulation, [Recorder(path, case), Log(), *observers], signals)
    return Run(path)


class _Session:
    """Runs a simulation and keeps `run.json` true, whatever ends it."""

    def __init__(self, path: Path, info: dict[str, Any], begin: float, comm: MPI.Comm) -> None:
        self.path, self.info, self.begin, self.comm = path, info, begin, comm
        self.timings: dict[str, float] = {}
        self.imported = time.perf_counter() - begin

    def __enter__(self) -> _Session:
        return self

    def run(self, simulation: Simulation, observers: Sequence[Observer], signals: Signals) -> None:
        """Show every state to every observer."""
        self.timings = simulation.timings
        self.timings["import"] += self.imported
        self.info["unknowns"] = simulation.unknowns
        failure: BaseException | None = None
        try:
            for observer in observers:
                observer.start(simulation)
            loop = time.perf_counter()
            signals.defer()
            try:
                for state in simulation:
                    for observer in observers:
                        observer.see(state)
                    if signals.obey():
                        log.info("SIGUSR1: the checkpoint is at step %d", state.row["step"])
            finally:
                self.timings["solve"] += time.perf_counter() - loop  # the whole step loop
                self.timings["factorisation"] += simulation.newton.factorisation_seconds
                self.info["steps"] = max(simulation.progress.step, 0)
                self.info["newton_iterations"] = simulation.newton.total
                self.info["margins"] = table(simulation.progress.worst)
                self.info["stops"] = simulation.progress.stops
        except BaseException as error:
            failure = error
            raise
        finally:
            for observer in reversed(observers):
                observer.stop(failure)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.info["status"] = _status(error)
        if error is not None:
            self.info["error"] = str(error)
        self.timings["total"] = time.perf_counter() - self.begin
        self.info["timings"] = {k: round(v, 4) for k, v in self.timings.items()}
        self.info["ended"] = datetime.now(UTC).isoformat(timespec="seconds")
        if self.comm.rank == 0:
            try:
                store.write_info(self.path, self.info)
            except PlatformError:
                if error is None:
                    raise  # else the first refusal is the one to report


def _status(failure: BaseException | None) -> str:
    if failure is None:
        return "done"
    if isinstance(failure, NotConverged):
        return "not converged"
    return "interrupted" if isinstance(failure, (Interrupted, KeyboardInterrupt)) else "failed"


def _is_done(path: Path, comm: MPI.Comm) -> bool:
    done = (path / store.INFO).is_file() and Run(path).status == "done"
    return bool(comm.bcast(done, root=0))


def _git_hash() -> str | None:
    """Commit of the checkout that dealib runs from, if it is one."""
    try:
        found = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() if found.returncode == 0 else None
