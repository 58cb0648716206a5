"""Signals that ask a run to stop or to report; every rank obeys them after the same step."""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType
from typing import Any

from mpi4py import MPI

from dealib.errors import Interrupted

_STOP = (signal.SIGINT, signal.SIGTERM)


class Signals:
    """A context in which signals wait for the end of the current step.

    SIGINT and SIGTERM then stop the run; a second one stops the process at once. SIGUSR1 asks for a
    report. Before `defer` is called there is no step to finish, and the run stops at once.

    Args:
        comm: MPI communicator.
    """

    def __init__(self, comm: Any) -> None:
        self._comm = comm
        self._stop = self._report = 0
        self._deferred = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Signals:
        if threading.current_thread() is threading.main_thread():
            handlers = dict.fromkeys(_STOP, self._on_stop) | {signal.SIGUSR1: self._on_report}
            self._before = {n: signal.signal(n, handler) for n, handler in handlers.items()}
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def defer(self) -> None:
        """From now on, finish the current step first."""
        self._deferred = True

    def obey(self) -> bool:
        """Stop if a signal asks for it; call it after each step (collective).

        Returns:
            Whether SIGUSR1 asks for a report.

        Raises:
            Interrupted: On every rank, after SIGINT or SIGTERM on any of them.
        """
        stop = self._comm.allreduce(self._stop, op=MPI.MAX)
        wanted = self._comm.allreduce(self._report, op=MPI.MAX)
        self._report = 0
        if stop:
            raise _interrupted(stop, everywhere=True)
        return bool(wanted)

    def _on_stop(self, number: int, frame: FrameType | None) -> None:
        if not self._deferred:
            raise _interrupted(number, everywhere=False)
        self._stop = number
        for again in _STOP:
            signal.signal(again, signal.SIG_DFL)
        if self._comm.rank == 0:  # a handler may interrupt a print, which is not reentrant
            os.write(2, b"\ndealib: finishing the step; once more to stop at once\n")

    def _on_report(self, number: int, frame: FrameType | None) -> None:
        self._report = 1


def _interrupted(number: int, everywhere: bool) -> Interrupted:
    return Interrupted(f"stopped by {signal.Signals(number).name}", number, everywhere)
