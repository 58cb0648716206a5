"""The process that writes the results of a run (see `dealib.results.beside`)."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import socket
import threading
from contextlib import suppress
from typing import IO, Any

from dealib.errors import PlatformError
from dealib.results.writer import Record, StepWriter

_AHEAD = 2  # records that are read before they are written


def main(file: int) -> None:
    """Write the records that come through a socket until it is closed.

    Args:
        file: Descriptor of the socket.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
        signal.signal(number, signal.SIG_IGN)  # the run handles them, and this process ends with it
    with socket.socket(fileno=file) as link:
        lock = socket.recv_fds(link, 1, 1)[1]  # it is held until this process ends
        with link.makefile("rb") as inputs, link.makefile("wb") as answers:
            messages: queue.Queue[Any] = queue.Queue(_AHEAD)
            threading.Thread(target=_receive, args=(inputs, messages), daemon=True).start()
            try:
                _write(messages, answers)
            except BaseException as error:
                _answer(answers, _failure(error))
            for descriptor in lock:
                os.close(descriptor)
            os._exit(0)  # not waiting for the thread


def _receive(inputs: IO[bytes], messages: queue.Queue[Any]) -> None:
    try:
        while True:
            messages.put(pickle.load(inputs))
    except (EOFError, OSError):  # the run has ended
        messages.put(None)
    except Exception as error:  # the run was killed in the middle of a message
        messages.put(error)


def _write(messages: queue.Queue[Any], answers: IO[bytes]) -> None:
    if (opening := messages.get()) is None:
        return
    writer = StepWriter(opening)
    _answer(answers, None)
    while (message := messages.get()) is not None:
        if isinstance(message, Exception):
            raise message
        if isinstance(message, Record):
            writer.add(message)
            _answer(answers, None)
        else:
            _answer(answers, writer.close())


def _answer(answers: IO[bytes], value: Any) -> None:
    with suppress(OSError):  # the run may have ended; its records are written nevertheless
        pickle.dump(value, answers)
        answers.flush()


def _failure(error: BaseException) -> PlatformError:
    """The error that the run raises for a failure of the writer."""
    if isinstance(error, PlatformError):
        return error
    return PlatformError(f"writing results failed ({type(error).__name__}: {error})")
