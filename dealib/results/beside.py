"""A writer in a separate process: the solver continues while results are written.

Records are sent through a socket, in order. The process answers each one once it is on the disk,
and at most `_AHEAD` records may be unanswered. The files are consistent at every moment, as without
the process. If the run is killed, the process writes the records that it has received and ends. It
shares the lock of the run directory, so that no other run uses the directory before.
"""

from __future__ import annotations

import os
import pickle
import select
import socket
import subprocess
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from dealib.errors import PlatformError
from dealib.results.lock import Lock

if TYPE_CHECKING:
    from dealib.results.writer import Opening, Record

_AHEAD = 4  # records that may be unanswered
_CODE = "import sys; sys.path[:] = {path!r}; from dealib.results.scribe import main; main({file})"


class Beside:
    """The run's end of the socket (see `Writer`).

    It imports little, so that the process can start early: it is ready when the first state is.
    """

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        with theirs:
            code = _CODE.format(path=sys.path, file=theirs.fileno())
            self._process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,  # the terminal's Ctrl-C is the run's alone
            )
        self._stream = self._socket.makefile("rwb")
        self._due = 0  # answers that are still to come

    @staticmethod
    def useful() -> bool:
        """Whether a processor is free for it: there are several, and no mpirun uses them."""
        launched = any(f"{name}_SIZE" in os.environ for name in ("OMPI_COMM_WORLD", "PMI"))
        return len(os.sched_getaffinity(0)) > 1 and not launched

    def __enter__(self) -> Beside:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):
            self._stream.close()
        self._socket.close()  # which ends the process
        self._process.wait()

    def open(self, opening: Opening, lock: Lock) -> Beside:
        """Open the files of a run, and share the run directory's lock."""
        try:
            socket.send_fds(self._socket, [b"-"], lock.descriptors)
        except OSError:
            self._answer()
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
        self._send("close")
        found = None
        while self._due:
            found = self._answer()
        assert isinstance(found, float)
        return found

    def _send(self, message: Any) -> None:
        while self._due > _AHEAD or select.select([self._socket], [], [], 0)[0]:
            self._answer()
        try:
            pickle.dump(message, self._stream, pickle.HIGHEST_PROTOCOL)
            self._stream.flush()
        except OSError:  # the process has ended; its last answer says why
            while True:
                self._answer()
        self._due += 1

    def _answer(self) -> Any:
        """The next answer.

        Raises:
            PlatformError: If the process failed or died.
        """
        try:
            found = pickle.load(self._stream)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise PlatformError(
                "the process that writes results died; the machine may be out of memory"
            ) from None
        if isinstance(found, PlatformError):
            raise found
        self._due -= 1
        return found
