"""A writer in a separate process: the solver continues while results are written.

Records are sent through a socket, in order. The process receives them at once, so that the run
goes on, and answers each one when it is on the disk. Few or little may be unanswered (`_AHEAD`,
`_BYTES`). If the run is killed, the process writes the records that it has received and ends. It
shares the lock of the run directory, so that no other run uses the directory before.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from dealib.errors import PlatformError
from dealib.results.lock import Lock

if TYPE_CHECKING:
    from dealib.results.writer import Record, WriterSetup

_AHEAD = 4  # messages that may be unanswered in any case,
_BYTES = 8_000_000  # and more as long as they are no larger together
_CODE = "import sys; sys.path[:] = {path!r}; from dealib.results.beside import main; main({file})"


class Beside:
    """The run's end of the socket (see `Writer`).

    It imports little, so that the process can start early: it is ready when the first state is.
    """

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        self._link = Connection(os.dup(self._socket.fileno()))
        with theirs:
            code = _CODE.format(path=sys.path, file=theirs.fileno())
            self._process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,  # the terminal's Ctrl-C is the run's alone
            )
        self._due: deque[int] = deque()  # sizes of the messages whose answers are still to come

    @staticmethod
    def useful() -> bool:
        """Whether there is a processor for it, and no mpirun that has others to feed."""
        launched = any(f"{name}_SIZE" in os.environ for name in ("OMPI_COMM_WORLD", "PMI"))
        return len(os.sched_getaffinity(0)) > 1 and not launched

    def __enter__(self) -> Beside:
        return self

    def __exit__(self, *error: object) -> None:
        self._link.close()
        self._socket.close()  # which ends the process
        self._process.wait()

    def open(self, opening: WriterSetup, lock: Lock) -> Beside:
        """Open the files of a run, and share the run directory's lock."""
        with suppress(OSError):  # it has left; the next message tells why
            socket.send_fds(self._socket, [b"-"], lock.descriptors)
        self._send(opening)
        return self

    def add(self, record: Record) -> None:
        """See `Writer`."""
        self._send(record)

    def wait(self) -> None:
        """See `Writer`."""
        while self._due:
            self._answer()

    def close(self) -> float:
        """See `Writer`."""
        self._send(None)
        while True:
            found = self._answer()
            if isinstance(found, float):
                return found

    def _send(self, message: WriterSetup | Record | None) -> None:
        content = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
        while self._full(len(content)) or self._link.poll():
            self._answer()
        try:
            self._link.send_bytes(content)
        except OSError:  # it has left; its last answer says why
            while True:
                self._answer()
        self._due.append(len(content))

    def _full(self, size: int) -> bool:
        """Whether too much is unanswered for a message of a size."""
        return len(self._due) >= _AHEAD and sum(self._due) + size > _BYTES

    def _answer(self) -> Any:
        """The next answer.

        Raises:
            PlatformError: What the writer met.
        """
        try:
            found = self._link.recv()
        except (EOFError, OSError):
            raise PlatformError("the process that writes results died; is memory short?") from None
        if isinstance(found, PlatformError):
            raise found
        self._due.popleft()
        return found


def main(file: int) -> None:
    """Write what comes until there is no more: the process.

    Args:
        file: Descriptor of the socket.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
        signal.signal(number, signal.SIG_IGN)  # they are for the run, whose end is its end
    from dealib.results.writer import StepWriter

    socket.recv_fds(socket.socket(fileno=os.dup(file)), 1, 1)  # held until this process ends
    sys.setswitchinterval(2e-4)  # the run waits while a record is received, and not for a writer
    link, writer, received = Connection(file), None, SimpleQueue[Any]()
    threading.Thread(target=_receive, args=(link, received), daemon=True).start()
    try:
        while (content := received.get()) is not None:
            message, answer = pickle.loads(content), None
            if writer is None:
                writer = StepWriter(message)
            elif message is None:
                answer = writer.close()
            else:
                writer.add(message)
            _tell(link, answer)
            if answer is not None:
                os._exit(0)  # all is written: the run need not wait for the interpreter's end
    except PlatformError as error:
        _tell(link, error)
    except BaseException as error:
        told = f"writing results failed ({type(error).__name__}: {error})"
        _tell(link, PlatformError(told))


def _receive(link: Connection, into: SimpleQueue[Any]) -> None:
    """Receive messages while others are written; None at the end."""
    with suppress(EOFError, OSError):  # the run has ended, or was killed in a message
        while True:
            into.put(link.recv_bytes())
    into.put(None)


def _tell(link: Connection, answer: float | PlatformError | None) -> None:
    with suppress(OSError):  # the run may be gone; what it gave is written nevertheless
        link.send(answer)
