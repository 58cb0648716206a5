"""Prepares a run directory: a new one, a replaced one, or one whose run is resumed."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dealib.config.case import Case
from dealib.config.schema import Config
from dealib.device import gmsh_model
from dealib.errors import ConfigError, DealibError, PlatformError, anew, by_caller
from dealib.files import TEMPORARY, write_text
from dealib.log import LOGGER
from dealib.results import store
from dealib.results.checkpoint import FOLDER, VALUES, Checkpoint, CheckpointFolder, history_sum
from dealib.results.history import HISTORY
from dealib.results.info import INFO
from dealib.results.lock import Lock
from dealib.results.reader import Run
from dealib.section import leaves

# keys that may change when a run is resumed, since no equation depends on them (a mesh file is
# compared by its mesh, not by its path)
_FREE = ("name", "description", "output.", "solver.", "mesh.file", "tables.")
# what runs, pictures and reports leave in their directory
_OURS = (
    *("run.json", "run.log", "config.yaml", "config.resolved.yaml", "mesh.msh", "history.csv"),
    *("results.h5", "states", "fields.xdmf", "fields", "checkpoint", "view_in_paraview.py"),
    *("modes.csv", "modes.xdmf", "frequencies.csv", "response.csv", "circuit.csv"),
    *("plots", "report.html", f"*{TEMPORARY}", f"*{TEMPORARY}.*"),
)
_PATIENCE = 20.0  # s, for the writer of a run that was just killed; it needs less


def prepare(
    path: Path,
    case: Case,
    info: dict[str, Any],
    overwrite: bool,
    resume: bool,
    comm: MPI.Comm,
    offer_resume: bool = True,
) -> tuple[Checkpoint | None, Lock]:
    """Make the run directory, or prepare an existing one to be resumed (collective).

    Args:
        path: The run directory.
        case: The case to run.
        info: First content of `run.json`; what earlier sessions left there is added to it.
        overwrite: Replace an existing run.
        resume: Continue an existing run.
        comm: MPI communicator.
        offer_resume: Whether the caller could continue a run that is in the way.

    Returns:
        The checkpoint from which to continue, its arrays on rank 0, or None to start at the
        beginning; and the directory's lock (on rank 0), to be held during the run.

    Raises:
        DealibError: On every rank, whatever went wrong on rank 0.
    """
    error: DealibError | None = None
    saved: Checkpoint | None = None
    lock = Lock()
    if comm.rank == 0:
        try:
            if case.config.mesh.file is not None:  # before anything is overwritten
                gmsh_model.check(case.config)
            if resume:
                lock = _held(path)
                saved = _take_up(path, case, info)
            else:
                lock = _make(path, overwrite, offer_resume)
            store.write_info(path, info)
            write_text(path / "config.yaml", case.text)
            write_text(path / "config.resolved.yaml", case.resolved)
        except DealibError as caught:
            error = caught
    error = comm.bcast(error, root=0)
    if error is not None:
        with lock:
            raise error
    plain = None if saved is None else (saved.values, saved.mesh)
    plain = comm.bcast(plain, root=0)
    if saved is None and plain is not None:
        saved = Checkpoint(*plain)
    return saved, lock


def finished(path: Path, case: Case, comm: MPI.Comm) -> bool:
    """Whether a run is done, so that there is nothing to resume (collective).

    Raises:
        ConfigError: On every rank, if it is another config's.
    """
    found: bool | ConfigError = False
    if comm.rank == 0:
        try:
            found = (path / INFO).is_file() and Run(path).status == "done"
            if found:
                _refuse_changes(path, case)
                LOGGER.warning("%s: this run is finished; it is left as it is", path)
        except ConfigError as error:
            found = error
    found = comm.bcast(found, root=0)
    if isinstance(found, ConfigError):
        raise found
    return found


def _make(path: Path, overwrite: bool, offer_resume: bool = False) -> Lock:
    """Make a directory for a new run; files in it that are not dealib's are kept."""
    if _used(path):
        if not overwrite:
            ways = by_caller(
                "choose another --out, or --overwrite it",
                "choose another directory, or overwrite=True",
            )
            if offer_resume:
                ways = by_caller(
                    "choose another --out, --overwrite it, or --resume it",
                    "choose another directory, overwrite=True, or resume=True",
                )
                ways += " if it is an unfinished run"
            raise ConfigError(f"{path} exists and is not empty; {ways}")
        if not (path / INFO).is_file():
            raise ConfigError(f"{path} is no run directory of dealib; it is not overwritten")
    try:
        path.mkdir(parents=True, exist_ok=True)
        lock = Lock(path, 0 if _status(path) == "running" else _PATIENCE)
        for name in _OURS:
            for found in path.glob(name):
                shutil.rmtree(found) if found.is_dir() else found.unlink()
    except OSError as error:
        raise PlatformError(f"cannot make {path}: {error.strerror}") from None
    if not os.access(path, os.W_OK):
        raise PlatformError(f"cannot write into {path}: permission denied")
    return lock


def _used(path: Path) -> bool:
    """Whether a path holds anything but unfinished files of a killed run."""
    if not path.is_dir():
        return path.exists()
    return any(TEMPORARY not in f.suffixes for f in path.iterdir())


def _held(path: Path) -> Lock:
    """The lock of a run that may be resumed."""
    there = any((path / name).exists() for name in (INFO, FOLDER))
    if not path.is_dir() or (not there and _used(path)):
        raise ConfigError(
            f"{path}: nothing to resume, there is no run here; "
            + by_caller(
                "start it without --resume, or give the --out of the run that is meant",
                "start it without resume=True, or give the directory of the run that is meant",
            )
        )
    if not there:
        return _make(path, overwrite=False)  # killed before it began
    run = Run(path)
    running = run.status == "running"
    try:
        lock = Lock(path, 0 if running else _PATIENCE)
        if lock.sure or not running:  # the process may be another one by now
            return lock
        lock.__exit__()
    except ConfigError:
        if not running:
            raise
    raise ConfigError(
        f"{path}: this run is still going on (process {run.info['pid']} on {run.info['host']})"
    )


def _status(path: Path) -> str:
    """Status of the run in a directory; empty if there is none that can be read."""
    try:
        return Run(path).status
    except ConfigError:
        return ""


def _take_up(path: Path, case: Case, info: dict[str, Any]) -> Checkpoint | None:
    saved = CheckpointFolder(path).read()
    if saved is None:
        rows = 0
        with suppress(ConfigError):
            rows = len(Run(path).history)
        if rows > 1:
            raise _no_way(path, f"{path / FOLDER / VALUES}: missing")
        return None  # killed before its first checkpoint
    run = Run(path)
    old = run.info
    _refuse_changes(path, case)
    try:
        history = run.history
        run.check_states()
    except ConfigError as error:
        raise _no_way(path, str(error)) from None
    if len(history) <= saved.step:
        raise _no_way(path, f"{HISTORY} ends before the checkpoint (step {saved.step})")
    for name, found in ((HISTORY, history), (store.STATES, run.states_file.history)):
        known = [] if found is None else found[: saved.step + 1].to_dict("records")
        if history_sum({str(k): v for k, v in row.items()} for row in known) != saved.history:
            remove = "; it is restored if you remove it" if name == HISTORY else ""
            raise _no_way(path, f"{name} is not what the run has written{remove}")
    write_text(path / HISTORY, history.to_csv(index=False, na_rep="nan"))
    for name, version in info["versions"].items():
        before = old["versions"].get(name)
        if before != version:
            LOGGER.warning("resumed with %s %s, begun with %s", name, version, before)
    keys = ("started", "ended", "status", "steps", "argv", "ranks", "timings", "warnings")
    session = {k: old[k] for k in keys if k in old} | {"status": run.status}
    info["earlier_sessions"] = [*old.get("earlier_sessions", []), session]
    return saved


def _refuse_changes(path: Path, case: Case) -> None:
    """Raise `ConfigError` if the config differs from that of the run."""
    try:
        before = Run(path).config
    except ConfigError as error:
        raise _no_way(path, str(error)) from None
    changes = _changes(before, case.config)
    if changes:
        raise ConfigError(
            f"{path}: cannot resume, the config has changed since:\n  "
            + "\n  ".join(changes)
            + "\nOnly name, description, output, solver and mesh.file may change; "
            "undo the changes, or start anew with "
            + by_caller("--overwrite or another --out", "overwrite=True or another directory")
        )


def _no_way(path: Path, problem: str) -> ConfigError:
    return ConfigError(f"{path}: cannot resume, {problem}; {anew()}")


def _changes(before: Config, now: Config) -> list[str]:
    """Keys of the config that differ from what they were, with both values."""
    old, new = (dict(leaves(c.model_dump(exclude_none=True))) for c in (before, now))
    return [
        f"{key}: was {old.get(key, 'absent')}, is {new.get(key, 'absent')}"
        for key in dict.fromkeys([*old, *new])
        if old.get(key) != new.get(key) and not key.startswith(_FREE)
    ]
