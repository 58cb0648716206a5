"""One run: a simulation, its observers, its directory and its status."""

from __future__ import annotations

import logging
import os
import platform
import shlex
import sys
import time
from collections.abc import Callable, Collection, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

from mpi4py import MPI

from dealib.config.case import Case, load
from dealib.config.doubts import warn
from dealib.errors import Interrupted, NotConverged, PlatformError, by_caller
from dealib.fem.reuse import Reuse
from dealib.log import to_file
from dealib.program.directory import finished, prepare
from dealib.program.margins import table
from dealib.program.recorder import Recorder
from dealib.program.signals import Signals
from dealib.program.simulation import Simulation, State
from dealib.program.turns import alone
from dealib.results import store
from dealib.results.beside import Beside
from dealib.results.critical import lost_at
from dealib.results.reader import Run
from dealib.results.summary import SYMBOLS
from dealib.results.writer import StepWriter
from dealib.units import counted
from dealib.versions import git_hash, versions

log = logging.getLogger(__name__)


class Observer(Protocol):
    """Sees every converged state, on every rank."""

    def start(self, simulation: Simulation) -> None:
        """Called once before the first state."""

    def see(self, state: State) -> None:
        """Called at each converged state."""

    def stop(self, error: BaseException | None) -> None:
        """Called at the end, with the error that ended the run, if any."""


class Log:
    """Writes each step to the log."""

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""
        mesh = simulation.engine.layout.mesh
        cells = 0 if mesh is None else len(mesh.cells)
        log.info(
            "%d cells, %d unknowns, %d ranks", cells, simulation.unknowns, simulation.comm.size
        )
        log.info("linear solver: %s", simulation.engine.newton.linear_solver)
        warn(simulation.case.config)
        row = simulation.progress.row
        self._rows = [] if row is None else [row]
        if simulation.progress.step >= 0:
            log.info("resumed after step %d", simulation.progress.step)

    def see(self, state: State) -> None:
        """See `Observer`."""
        log.info(line(state.row))
        for kind in ("limit_point", "bifurcation"):
            if state.row.get(kind):
                log.info("step %d is a %s", state.row["step"], kind.replace("_", " "))
        if state.lost:
            at = lost_at([*self._rows[-2:], state.row])
            log.warning(
                "%s loses its stability at %s, before step %d (%s), which has %s; the softest "
                "modes are fields of that step (%s)",
                "another mode" if self._rows and self._rows[-1]["unstable_modes"] else "the device",
                *(ports_told(at, ".5g"), state.row["step"], state.row["stage"]),
                counted(state.row["unstable_modes"], "unstable mode"),
                by_caller("dealib plot --field mode", "dealib.plot(run, field='mode')"),
            )
        self._rows = [*self._rows[-1:], state.row]

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        log.info("done" if error is None else f"stopped: {error}")


def line(row: dict[str, Any]) -> str:
    """One step in one line: its ports and the iterations."""
    return (
        f"step {row['step']:4d}  t {row['time_s']:9.4g} s  {row['stage']:<12.12s}"
        f"  {ports_told(row, 'z9.5f')}  {row['newton_iterations']:2d} it"
    )


def ports_told(
    row: dict[str, Any], form: str, symbols: Collection[str] = tuple(SYMBOLS.values())
) -> str:
    """Variables of the ports: 'u  -3.00000 mm  F  -0.81331 N  V(drive)   2.50000 kV'.

    Args:
        row: Of the history.
        form: Format of the numbers.
        symbols: Symbols of the variables to show.
    """
    found = []
    for column, value in row.items():
        stem, _, port = column.partition(".")
        if stem in SYMBOLS and SYMBOLS[stem] in symbols:
            at = f"({port})" if port else ""
            found.append(f"{SYMBOLS[stem]}{at} {value:{form}} {stem.partition('_')[2]}")
    return "  ".join(found)


@alone()
def simulate(
    case: Case | str | Path,
    directory: str | Path | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    observers: Sequence[Observer] = (),
    beside: Beside | None = None,
    look: Callable[[State], State] | None = None,
    resumable: bool = True,
    reuse: Reuse | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    argv: Sequence[str] | None = None,
    started: float | None = None,
) -> Run:
    """Run a case into its directory; threads take turns.

    Args:
        case: A loaded case, or a config's path.
        directory: Run directory; default the config's.
        overwrite: Replace an existing run.
        resume: Continue an unfinished run; a finished one is left as it is.
        observers: Further observers of each state.
        beside: Process that writes; default: this process writes each state before the next step.
        look: Called with each state first; the state that it returns is observed and written.
        resumable: Whether to write checkpoints; without them most is written at the end.
        reuse: Provides the solver, that of the previous case if it fits.
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
    if not isinstance(case, Case):
        case = load(case)
    path = Path(directory or case.config.directory).expanduser()
    info: dict[str, Any] = {
        "name": case.config.name,
        "status": "running",
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "argv": list(argv if argv is not None else sys.argv),
        "config": str(case.path),
        "set": list(case.overrides),
        "ranks": comm.size,
        "pid": os.getpid(),  # with the host it tells a killed run from one that is still running
        "host": platform.node(),
        "git": git_hash(),
        "versions": versions(),
    }
    if resume and finished(path, case, comm):
        return Run(path)
    with Signals(comm) as signals, to_file(path, comm.rank == 0) as info["warnings"]:
        saved, lock = prepare(path, case, info, overwrite, resume, comm, look is None)
        with lock, _Session(path, info, begin, comm) as session:
            log.info("%s", shlex.join(info["argv"]))
            log.info("%s", ", ".join(f"{k} {v}" for k, v in info["versions"].items()))
            mesh_file = path / "mesh.msh" if saved is None else None
            simulation = Simulation(case, comm, mesh_file, saved, reuse=reuse)
            # several ranks give what is large while it is written, which no other process can do
            several = comm.size > 1
            writer = StepWriter if beside is None or several else partial(beside.open, lock=lock)
            recorder = Recorder(path, case, writer, resumable)
            session.run(simulation, recorder, observers, signals, look)
    return Run(path)


class _Session:
    """Runs a simulation and brings `run.json` up to date, whatever ends it."""

    def __init__(self, path: Path, info: dict[str, Any], begin: float, comm: MPI.Comm) -> None:
        self.path, self.info, self.begin, self.comm = path, info, begin, comm
        self.timings: dict[str, float] = {}
        self.imported = time.perf_counter() - begin

    def __enter__(self) -> _Session:
        return self

    def run(
        self,
        simulation: Simulation,
        recorder: Recorder,
        others: Sequence[Observer],
        signals: Signals,
        look: Callable[[State], State] | None,
    ) -> None:
        """Show every state to every observer."""
        observers: list[Observer] = [recorder, Log(), *others]
        self.timings = simulation.engine.timings
        self.timings["import"] += self.imported
        self.info["unknowns"] = simulation.unknowns
        failure: BaseException | None = None
        try:
            for observer in observers:
                observer.start(simulation)
            loop = time.perf_counter()
            signals.defer()
            try:
                for found in simulation:
                    state = found if look is None else look(found)
                    for observer in observers:
                        observer.see(state)
                    if state.solved and signals.obey():
                        recorder.wait()
                        log.info("SIGUSR1: the checkpoint is at step %d", state.row["step"])
            finally:
                self.timings["solve"] += time.perf_counter() - loop  # the whole step loop
                self.timings["factorisation"] += simulation.engine.newton.factorisation_seconds
                self.info["steps"] = max(simulation.progress.step, 0)
                self.info["newton_iterations"] = simulation.engine.newton.total
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
                    raise  # otherwise the first error is the one to report


def _status(failure: BaseException | None) -> str:
    if failure is None:
        return "done"
    if isinstance(failure, NotConverged):
        return "not converged"
    return "interrupted" if isinstance(failure, (Interrupted, KeyboardInterrupt)) else "failed"
