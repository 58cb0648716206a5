"""What a user sees while cases are solved: a line a worker and a total, or plain lines."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from dealib.study.job import Job, Outcome
from dealib.study.workers import Watcher


def watcher(workers: int, total: int) -> Watcher:
    """Bars on a terminal, plain lines elsewhere."""
    console = Console()
    if console.is_terminal and workers:
        return _Bars(console, workers, total)
    return _Lines(console, total)


def _words(outcome: Outcome) -> str:
    error = f": {outcome.error}" if outcome.error else ""
    return f"{outcome.job.label}: {outcome.status} in {outcome.seconds:.1f} s{error}"


class _Lines:
    """One line a case that ends."""

    def __init__(self, console: Console, total: int) -> None:
        self._total, self._ended = total, 0

    def begin(self, worker: int, job: Job) -> None:
        """See `Watcher`."""

    def step(self, worker: int, job: Job, step: int, total: int) -> None:
        """See `Watcher`."""

    def end(self, worker: int, outcome: Outcome) -> None:
        """See `Watcher`."""
        self._ended += 1
        of = f"/{self._total}" if self._total else ""
        print(f"{self._ended}{of}  {_words(outcome)}", flush=True)


class _Bars:
    """One bar a worker, and one for all."""

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
        self._all, self._left = self._bars.add_task("all cases", total=total), total
        self._bars.start()

    def begin(self, worker: int, job: Job) -> None:
        """See `Watcher`."""
        self._bars.reset(self._workers[worker], description=job.label, total=1)

    def step(self, worker: int, job: Job, step: int, total: int) -> None:
        """See `Watcher`."""
        self._bars.update(self._workers[worker], completed=step, total=max(step, total))

    def end(self, worker: int, outcome: Outcome) -> None:
        """See `Watcher`."""
        self._left -= 1
        self._bars.advance(self._all)
        self._bars.reset(self._workers[worker], description=f"worker {worker + 1}", total=1)
        if outcome.status != "done":
            self._bars.console.print(_words(outcome), highlight=False, markup=False)
        if self._left == 0:
            self._bars.stop()
