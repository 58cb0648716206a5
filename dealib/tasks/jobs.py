"""Progress of cases that are solved: bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from dealib.cases.job import Ended, Job
from dealib.cases.workers import Watcher


def watcher(workers: int, total: int) -> Watcher:
    """An observer of cases.

    Args:
        workers: Number of processes; 0: ranks of MPI.
        total: Number of cases.
    """
    console = Console()
    if console.is_terminal and workers:
        return _Bars(console, workers, total)
    return _Lines(total)


def _words(ended: Ended) -> str:
    error = f": {ended.error}" if ended.error else ""
    return f"{ended.job.label}: {ended.status} in {ended.seconds:.1f} s{error}"


class _Lines(Watcher):
    """Prints a line for each case that ends."""

    def __init__(self, total: int) -> None:
        self._total, self._ended = total, 0

    def end(self, worker: int, ended: Ended) -> None:
        """See `Watcher`."""
        self._ended += 1
        of = f"/{self._total}" if self._total else ""
        print(f"{self._ended}{of}  {_words(ended)}", flush=True)


class _Bars(Watcher):
    """Shows a bar for each worker, and one for all cases."""

    def __init__(self, console: Console, workers: int, total: int) -> None:
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
        )
        self._workers = [self._bars.add_task(f"worker {i + 1}", total=1) for i in range(workers)]
        self._all = self._bars.add_task("all cases", total=total)

    def __enter__(self) -> Watcher:
        self._bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bars.stop()

    def begin(self, worker: int, job: Job) -> None:
        """See `Watcher`."""
        self._bars.reset(self._workers[worker], description=job.label, total=1)

    def step(self, worker: int, job: Job, step: int, total: int) -> None:
        """See `Watcher`."""
        self._bars.update(self._workers[worker], completed=step, total=max(step, total))

    def end(self, worker: int, ended: Ended) -> None:
        """See `Watcher`."""
        self._bars.advance(self._all)
        self._bars.reset(self._workers[worker], description=f"worker {worker + 1}", total=1)
        if ended.status != "done":
            self._bars.console.print(_words(ended), highlight=False, markup=False)
