"""Workers: processes of this machine, or ranks of mpirun, that solve jobs and survive failures."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from dealib.study.job import Job, Outcome, run


class Watcher(Protocol):
    """Sees how the jobs go on."""

    def begin(self, worker: int, job: Job) -> None:
        """A worker has taken a job."""

    def step(self, worker: int, job: Job, step: int, total: int) -> None:
        """A worker has solved a step."""

    def end(self, worker: int, outcome: Outcome) -> None:
        """A worker has ended a job."""


class _Queue:
    """Jobs in order, such that two that compile the same forms never start together."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.pending = list(jobs)
        self._ready: set[str] = set()
        self._compiling: str | None = None

    def take(self) -> Job | None:
        """The next job that may start now."""
        for job in self.pending:
            known = job.kind in self._ready
            if known or self._compiling is None:
                if not known:
                    self._compiling = job.kind
                self.pending.remove(job)
                return job
        return None

    def compiled(self, job: Job) -> None:
        """The forms of a job's kind exist (or will not)."""
        self._ready.add(job.kind)
        if self._compiling == job.kind:
            self._compiling = None


def in_processes(jobs: Sequence[Job], count: int, watcher: Watcher) -> Iterator[Outcome]:
    """Solve jobs in processes; one that dies is reported, and replaced.

    The first job of each kind compiles the forms; the others of its kind wait for its first step,
    so that nothing is compiled twice.

    Yields:
        Outcomes as they come.
    """
    context = multiprocessing.get_context("spawn")  # dolfinx and MPI do not survive a fork
    queue = _Queue(jobs)
    workers = [_Worker(context, i) for i in range(min(count, len(jobs)))]
    try:
        while queue.pending or any(w.job for w in workers):
            for worker in workers:
                if worker.job is None and (job := queue.take()) is not None:
                    worker.give(job)
                    watcher.begin(worker.number, job)
            busy: dict[Any, _Worker] = {w.pipe: w for w in workers if w.job is not None}
            for pipe in wait(list(busy)):
                worker = busy[pipe]
                job = worker.job
                assert job is not None
                message = worker.receive()
                if isinstance(message, tuple):
                    watcher.step(worker.number, job, *message)
                queue.compiled(job)
                if isinstance(message, Outcome):
                    watcher.end(worker.number, message)
                    yield message
    finally:
        for worker in workers:
            worker.stop()


class _Worker:
    """A process that solves one job at a time."""

    def __init__(self, context: Any, number: int) -> None:
        self._context, self.number = context, number
        self.job: Job | None = None
        self._start()

    def _start(self) -> None:
        self.pipe: Connection
        self.pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def give(self, job: Job) -> None:
        """Start a job."""
        if not self._process.is_alive():
            self._start()
        self.job = job
        self.pipe.send(job)

    def receive(self) -> tuple[int, int] | Outcome:
        """What the process says next; an outcome too when it has died."""
        assert self.job is not None
        try:
            message = self.pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            message = Outcome(self.job, "crashed", _death(self._process.exitcode))
        if isinstance(message, Outcome):
            self.job = None
        return message

    def stop(self) -> None:
        """End the process."""
        with suppress(OSError):
            self.pipe.close()
        if self.job is not None:
            self._process.terminate()
        self._process.join(timeout=10)
        if self._process.is_alive():
            self._process.kill()


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        return f"the process was ended by {signal.Signals(-code).name}"
    return f"the process ended with exit code {code}"


def _serve(pipe: Connection) -> None:
    """Life of a worker process: until its pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all: the parent decides
    with suppress(EOFError, OSError):
        while True:
            job = pipe.recv()
            pipe.send(run(job, lambda step, total: pipe.send((step, total))))


def in_ranks(jobs: Sequence[Job], watcher: Watcher, executor: Any) -> Iterator[Outcome]:
    """Solve jobs in the ranks of an executor of mpi4py.futures.

    The first job of each kind goes alone, so that its forms are compiled once where ranks share a
    home directory.

    Yields:
        Outcomes as they come.
    """
    from concurrent.futures import as_completed

    first = list({job.kind: job for job in reversed(jobs)}.values())
    batches = [[job] for job in first] + [[job for job in jobs if job not in first]]
    for batch in batches:
        futures = [executor.submit(run, job) for job in batch]
        for future in as_completed(futures):
            outcome = future.result()
            watcher.end(0, outcome)
            yield outcome
