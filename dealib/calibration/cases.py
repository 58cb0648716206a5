"""Solved cases: in parallel processes, kept on disk by the hash of their config."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np

from dealib.config import Case, load, resolved
from dealib.errors import NotConverged, PlatformError

History = dict[str, np.ndarray]


class Cases:
    """Solves cases in processes of its own; what is solved once is read from then on.

    Args:
        folder: Where the histories are kept.
        jobs: Number of processes.
    """

    def __init__(self, folder: Path, jobs: int) -> None:
        self.folder, self.solved, self.found = folder, 0, 0
        self._pool = ProcessPoolExecutor(
            jobs, multiprocessing.get_context("spawn"), initializer=_ignore_interrupt
        )

    def __enter__(self) -> Cases:
        return self

    def __exit__(self, *error: object) -> None:
        # cases under way are finished and kept
        self._pool.shutdown(cancel_futures=True)

    def histories(self, cases: Sequence[Case]) -> list[History | NotConverged]:
        """Histories of cases, or why there is none.

        Raises:
            PlatformError: If a process died.
        """
        jobs: dict[str, Future[None]] = {}
        files = [self.folder / f"{_key(case)}.json" for case in cases]
        for case, file in zip(cases, files, strict=True):
            if file.is_file():
                self.found += 1
            elif file.name not in jobs:
                self.solved += 1
                jobs[file.name] = self._pool.submit(_solve, case.path, case.overrides, file)
        try:
            for job in jobs.values():
                job.result()
        except BrokenProcessPool:
            raise PlatformError("a process that solves a case died; is memory short?") from None
        return [_read(file) for file in files]


def _ignore_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides


def _key(case: Case) -> str:
    """Hash of what decides on a case's history."""
    from dealib.results.store import HISTORY

    config = case.config.model_dump(mode="json", exclude={"name", "description", "output"})
    text = HISTORY + json.dumps(config, sort_keys=True)
    if case.config.mesh.file is not None:
        text += Path(case.config.mesh.file).read_text(encoding="utf-8", errors="replace")
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _solve(path: Path, overrides: tuple[str, ...], file: Path) -> None:
    """Solve a case in a worker and write its history, or why it failed."""
    from dealib.program import Simulation
    from dealib.results.store import write_text

    case = load(path, overrides)
    rows: list[dict[str, Any]] = []
    error = ""
    try:
        rows.extend(state.row for state in Simulation(case))
    except NotConverged as failure:
        error = str(failure)
    columns = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
    content = {"error": error, "config": resolved(case.config), "history": columns}
    write_text(file, json.dumps(content))


def _read(file: Path) -> History | NotConverged:
    content = json.loads(file.read_text(encoding="utf-8"))
    if content["error"]:
        return NotConverged(content["error"])
    return {name: np.asarray(values) for name, values in content["history"].items()}
