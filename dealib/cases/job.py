"""The job of a worker: one case is solved into its run directory; errors become results."""

from __future__ import annotations

import functools
import os
import shutil
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dealib.config.band import Band
from dealib.errors import FAULT, DealibError
from dealib.files import guarded

if TYPE_CHECKING:
    from dealib.config.case import Case

Report = Callable[[int, int], None]  # step, steps planned
Work = Callable[["Job", Report | None], None]
Spectrum = tuple[Band, str | None]  # its band and the stage at whose end; None: the last one


@dataclass(frozen=True)
class Job:
    """A case to solve.

    Attributes:
        label: Name in messages.
        key: Key of its physics.
        base: The file of the config.
        overrides: 'key=value' changes of it.
        folder: Folder of the cache.
        spectrum: Spectrum that is computed too.
        watch: Makes a further observer of the run, from its directory.
        work: Function that replaces the run; it takes the job and the report, and is defined in a
            module, so that it can be pickled.
    """

    label: str
    key: str
    base: Path
    overrides: tuple[str, ...]
    folder: Path
    spectrum: Spectrum | None = None
    watch: Callable[[Path], Any] | None = None
    work: Work | None = None

    @property
    def directory(self) -> Path:
        """Run directory."""
        return self.folder / self.key

    @property
    def log(self) -> Path:
        """File of all that the job prints."""
        return self.folder / f"{self.key}.log"


@dataclass(frozen=True)
class Ended:
    """How a job ended.

    Attributes:
        job: The job.
        status: 'done', 'not converged', 'failed' or 'crashed'.
        error: What went wrong; empty if nothing did.
        seconds: Wall time, s.
        exit_code: Exit code that the command line would have given.
    """

    job: Job
    status: str
    error: str = ""
    seconds: float = 0.0
    exit_code: int = 0


def run(job: Job, report: Report | None = None) -> Ended:
    """Solve a case; errors become results, and only interrupts are raised.

    Args:
        job: The case.
        report: Called with the step and the number of planned steps.
    """
    begin = time.perf_counter()
    status, error, code = "done", "", 0
    try:
        with _printed_to(job.log):
            (job.work or _run)(job, report)
    except DealibError as problem:
        code, error = problem.exit_code, str(problem)
        status = "not converged" if code == 3 else "failed"
    except Exception as problem:
        status, code = "failed", FAULT
        error = f"{type(problem).__name__}: {problem} (a fault of dealib itself; see {job.log})"
    return Ended(job, status, error, time.perf_counter() - begin, code)


def _run(job: Job, report: Report | None) -> None:
    from dealib.config import load

    solve(load(job.base, job.overrides), job, report)


def solve(case: Case, job: Job, report: Report | None, **options: Any) -> None:
    """Solve a case into the run directory of its job, in this process alone.

    Args:
        case: The case.
        job: The job.
        report: Called with the step and the number of planned steps.
        options: Further arguments of `simulate`.
    """
    from mpi4py import MPI

    from dealib.program import simulate
    from dealib.results.info import INFO

    if not (job.directory / INFO).is_file():  # incomplete; `simulate` would not overwrite it
        shutil.rmtree(job.directory, ignore_errors=True)
    observers: list[Any] = [] if report is None else [_Reporter(report)]
    if job.watch is not None:
        observers.append(job.watch(job.directory))
    done: Any = {"overwrite": True, "resumable": False, "observers": observers, **options}
    done |= {"comm": MPI.COMM_SELF, "reuse": reuse()}
    if job.spectrum is None:
        simulate(case, job.directory, **done)
        return
    from dealib.program.response import solve_spectrum

    solve_spectrum(case, job.directory, *job.spectrum, **done)


@functools.cache
def reuse() -> Any:
    """The solver of this process, which its cases share where their equations allow it."""
    from dealib.fem.reuse import Reuse  # imports dolfinx

    return Reuse()


class _Reporter:
    """An observer that reports the steps of a run."""

    def __init__(self, report: Report) -> None:
        self._report, self._total = report, 0

    def start(self, simulation: Any) -> None:
        """See `Observer`."""
        self._total = simulation.steps_planned

    def see(self, state: Any) -> None:
        """See `Observer`."""
        self._report(state.row["step"], self._total)

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""


@contextmanager
def _printed_to(path: Path) -> Iterator[None]:
    """Redirect all output of the process and its libraries to a file while the context lasts."""
    with guarded(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w", encoding="utf-8")
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    with file:
        try:
            for descriptor in (1, 2):
                os.dup2(file.fileno(), descriptor)
            yield
        except DealibError:
            raise
        except Exception:
            traceback.print_exc()
            raise
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for descriptor, old in zip((1, 2), kept, strict=True):
                os.dup2(old, descriptor)
                os.close(old)
            if path.stat().st_size == 0:
                path.unlink()
