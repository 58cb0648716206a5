"""Workers that solve jobs: processes of this machine, or ranks of mpirun."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from dealib.cases.job import Ended, Job, run
from dealib.errors import Interrupted


class Watcher:
    """Base of observers of jobs; its methods do nothing."""

    def __enter__(self) -> Watcher:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def begin(self, worker: int, job: Job) -> None:
        """Called when a worker begins a job."""

    def step(self, worker: int, job: Job, step: int, total: int) -> None:
        """Called when a worker has solved a step."""

    def end(self, worker: int, ended: Ended) -> None:
        """Called when a worker has ended a job."""


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0))


class Pool:
    """Processes that solve jobs; one that dies is reported and replaced.

    They end with the context; busy ones are terminated.

    Args:
        count: Largest number of processes; they are started when they are needed.
        watcher: Observer of the jobs.
    """

    def __init__(self, count: int, watcher: Watcher | None = None) -> None:
        self._count, self._watcher = count, watcher or Watcher()
        self._context = multiprocessing.get_context("spawn")  # MPI does not survive a fork
        self._workers: list[_Worker] = []

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *error: object) -> None:
        for worker in self._workers:
            worker.dismiss()
        for worker in self._workers:
            worker.wait()

    def solve(self, jobs: Sequence[Job]) -> Iterator[Ended]:
        """Solve jobs in their order.

        Yields:
            The result of each job when it ends.
        """
        pending, watcher = list(reversed(jobs)), self._watcher
        while len(self._workers) < min(self._count, len(jobs)):
            self._workers.append(_Worker(self._context, len(self._workers)))
        while True:
            for worker in self._workers:
                if worker.job is None and pending:
                    watcher.begin(worker.number, worker.give(pending.pop()))
            busy: dict[Any, _Worker] = {w.pipe: w for w in self._workers if w.job is not None}
            if not busy:
                return
            for pipe in wait(list(busy)):
                worker = busy[pipe]
                job, message = worker.job, worker.receive()
                assert job is not None
                if isinstance(message, Ended):
                    watcher.end(worker.number, message)
                    yield message
                else:
                    watcher.step(worker.number, job, *message)


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

    def give(self, job: Job) -> Job:
        """Start a job."""
        if not self._process.is_alive():
            self._start()
        self.job = job
        self.pipe.send(job)
        return job

    def receive(self) -> tuple[int, int] | Ended:
        """Next message of the process: steps, or the end of its job, also if it has died."""
        assert self.job is not None
        message: tuple[int, int] | Ended
        try:
            message = self.pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            message = Ended(self.job, "crashed", _death(self._process.exitcode), exit_code=4)
        if isinstance(message, Ended):
            self.job = None
        return message

    def dismiss(self) -> None:
        """Make the process end; a busy one is terminated."""
        with suppress(OSError):
            self.pipe.close()
        if self.job is not None:
            self._process.terminate()

    def wait(self) -> None:
        """Wait up to 10 s for the end of the process, then kill it."""
        self._process.join(timeout=10)
        if self._process.is_alive():
            self._process.kill()


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        return f"the process was ended by {signal.Signals(-code).name}"
    return f"the process ended with exit code {code}"


def _serve(pipe: Connection) -> None:
    """Main loop of a worker process; it ends when the pipe is closed or a signal comes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent acts
    gc.set_threshold(20_000)  # imported modules stay, and a case makes hardly any garbage
    try:
        while True:
            pipe.send(run(pipe.recv(), lambda step, total: pipe.send((step, total))))
    except (EOFError, OSError, Interrupted):
        sys.stdout.flush()
        os._exit(0)  # at once: Python 3.12 complains of a message that was cut off


def in_ranks(jobs: Sequence[Job], watcher: Watcher, executor: Any) -> Iterator[Ended]:
    """Solve jobs in the ranks of an executor of mpi4py.futures.

    Yields:
        The result of each job when it ends.
    """
    from concurrent.futures import as_completed

    futures = [executor.submit(run, job) for job in jobs]
    try:
        for future in as_completed(futures):
            ended = future.result()
            watcher.end(0, ended)
            yield ended
    finally:
        for future in futures:
            future.cancel()
