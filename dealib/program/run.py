"""One run: a simulation, its observers, its directory and its status."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np

from dealib.config.case import Case, resolved
from dealib.errors import ConfigError, DealibError, PlatformError
from dealib.fem import compat
from dealib.geometry import model
from dealib.program.simulation import Simulation, State
from dealib.results import paraview, store
from dealib.results.fields import fields
from dealib.results.reader import Run


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

    def __init__(self, directory: Path, case: Case, timings: dict[str, float]) -> None:
        self.directory, self.case = directory, case
        self.wanted = case.config.output.fields
        self._history: store.HistoryFile | None = None
        self._states: store.StateFile | None = None
        self._fields: store.FieldFile | None = None
        self._timings = timings

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        self._timings = simulation.timings
        mesh = simulation.layout.mesh
        if mesh is None:
            return
        self._history = store.HistoryFile(self.directory)
        texts = {"config": self.case.text, "config_resolved": resolved(self.case.config)}
        texts |= {f"versions/{k}": v for k, v in versions().items()}
        self._states = store.StateFile(self.directory, mesh, texts)
        if self.wanted != "none":
            self._fields = store.FieldFile(self.directory, mesh)
            paraview.write(self.directory, mesh)

    def see(self, state: State) -> None:
        """See `Observer`."""
        begin = time.perf_counter()
        stored = self.wanted == "every" or (self.wanted == "stage" and state.end_of_stage)
        nodal = state.nodal() if stored else None
        if self._history is not None and self._states is not None:
            self._history.add(state.row)
            self._states.add(state.row, nodal)
            if self._fields is not None and nodal is not None:
                found = fields(self.case.config, self._fields.mesh, nodal)
                self._fields.add(state.row["step"], state.row["time_s"], found)
        self._timings["output"] += time.perf_counter() - begin

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        if self._states is not None and not isinstance(error, PlatformError):
            self._states.close()


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
        observers: What else sees each state.
        comm: MPI communicator.
        argv: Command line to record.
        started: `time.perf_counter()` at which the process began, for the timings.

    Returns:
        The run, to read.

    Raises:
        ConfigError: If the directory exists.
        NotConverged: If a step failed; what converged is in the directory.
    """
    begin = time.perf_counter() if started is None else started
    path = Path(directory or case.config.directory)
    _prepare(path, case, overwrite, comm)
    info: dict[str, Any] = {
        "name": case.config.name,
        "status": "running",
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "argv": list(argv if argv is not None else sys.argv),
        "set": list(case.overrides),
        "ranks": comm.size,
        "pid": os.getpid(),
        "host": platform.node(),
        "git": _git_hash(),
        "versions": versions(),
        "warnings": [],
    }
    _publish(path, info, comm)
    timings: dict[str, float] = {"import": time.perf_counter() - begin}
    everyone: list[Observer] = [Recorder(path, case, timings), *observers]
    failure: BaseException | None = None
    steps = 0
    try:
        simulation = Simulation(case, comm, mesh_file=path / "mesh.msh")
        simulation.timings["import"] += timings["import"]
        timings = simulation.timings
        info["unknowns"] = simulation.unknowns
        for observer in everyone:
            observer.start(simulation)
        loop = time.perf_counter()
        try:
            for state in simulation:
                steps = state.row["step"]
                info["warnings"] += state.warnings
                for observer in everyone:
                    observer.see(state)
        finally:
            timings["solve"] += time.perf_counter() - loop  # the whole step loop
            timings["factorisation"] += simulation.newton.factorisation_seconds
            info["steps"], info["newton_iterations"] = steps, simulation.newton.total
    except BaseException as error:
        failure = error
        raise
    finally:
        for observer in reversed(everyone):
            observer.stop(failure)
        info["status"] = _status(failure)
        if failure is not None:
            info["error"] = str(failure)
        timings["total"] = time.perf_counter() - begin
        info["timings"] = {k: round(v, 4) for k, v in timings.items()}
        info["ended"] = datetime.now(UTC).isoformat(timespec="seconds")
        _publish(path, info, comm)
    return Run(path)


def _status(failure: BaseException | None) -> str:
    if failure is None:
        return "done"
    if isinstance(failure, DealibError):
        return {3: "not converged"}.get(failure.exit_code, "failed")
    return "interrupted" if isinstance(failure, KeyboardInterrupt) else "failed"


def _prepare(path: Path, case: Case, overwrite: bool, comm: MPI.Comm) -> None:
    """Make the run directory on rank 0; every rank raises what went wrong there."""
    error: DealibError | None = None
    if comm.rank == 0:
        try:
            if case.config.mesh.file is not None:  # before anything is overwritten
                model.check(case.config)
            _make(path, overwrite)
            store.write_text(path / "config.yaml", case.text)
            store.write_text(path / "config.resolved.yaml", resolved(case.config))
        except DealibError as caught:
            error = caught
    error = comm.bcast(error, root=0)
    if error is not None:
        raise error


def _make(path: Path, overwrite: bool) -> None:
    if path.exists() and any(path.iterdir() if path.is_dir() else [path]):
        if not overwrite:
            raise ConfigError(
                f"{path} exists and is not empty; choose another --out, or --overwrite it"
            )
        if not (path / store.INFO).is_file():
            raise ConfigError(f"{path} is no run directory of dealib; it is not overwritten")
        shutil.rmtree(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlatformError(f"cannot make {path}: {error.strerror}") from None


def _publish(path: Path, info: dict[str, Any], comm: MPI.Comm) -> None:
    if comm.rank == 0:
        store.write_info(path, info)


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
