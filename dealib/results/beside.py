"""A writer in a process of its own: the solver goes on while results are written.

Records go through a pipe, in order, and what is written is whole at every moment, as it is without
it. The process leaves with its run: when that was killed, it writes what it was given and ends. It
shares the run directory's lock, so that nobody takes the directory up before.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import queue
import select
import subprocess
import sys
import threading
from contextlib import suppress
from types import TracebackType
from typing import IO, Any

from dealib.errors import PlatformError
from dealib.results.lock import Lock
from dealib.results.writer import Opening, Record, StepWriter, failure

_AHEAD = 4  # records that may wait
_PIPE = 1 << 20  # bytes that fit into the pipe, where the system allows it
_CODE = "import sys; sys.path[:] = {path!r}; from dealib.results.beside import main; main()"


class Beside:
    """The run's end of the pipe (see `Writer`).

    It is started early, and opened when the mesh is known.

    Args:
        lock: The run directory's.
    """

    def __init__(self, lock: Lock) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _CODE.format(path=sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=lock.descriptors,
            start_new_session=True,  # the terminal's Ctrl-C is the run's alone
        )
        with suppress(OSError):
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE)

    def __enter__(self) -> Beside:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with suppress(OSError):
            self._pipe.close()  # it ends when nothing more can come
        self._process.wait()

    def open(self, opening: Opening) -> Beside:
        """Begin."""
        self._send(opening)
        return self

    def add(self, record: Record) -> None:
        """See `Writer`."""
        self._send(record)

    def wait(self) -> None:
        """See `Writer`."""
        self._send("wait")
        self._answer()

    def close(self, gather: bool) -> float:
        """See `Writer`."""
        self._send("gather" if gather else "leave")
        return float(self._answer())

    @property
    def _pipe(self) -> IO[bytes]:
        assert self._process.stdin is not None
        return self._process.stdin

    def _send(self, message: Any) -> None:
        assert self._process.stdout is not None
        if select.select([self._process.stdout], [], [], 0)[0]:
            self._answer()  # unasked: it is a failure
        try:
            pickle.dump(message, self._pipe, pickle.HIGHEST_PROTOCOL)
            self._pipe.flush()
        except BrokenPipeError:
            self._answer()

    def _answer(self) -> Any:
        """The next answer.

        Raises:
            PlatformError: What the writer met.
        """
        assert self._process.stdout is not None
        try:
            found = pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError):
            raise PlatformError("the process that writes results died; is memory short?") from None
        if isinstance(found, PlatformError):
            raise found
        return found


def main() -> None:
    """The process: write what comes until there is no more."""
    inputs, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    messages: queue.Queue[Any] = queue.Queue(_AHEAD)
    threading.Thread(target=_receive, args=(inputs, messages), daemon=True).start()

    def answer(value: Any) -> None:
        pickle.dump(value, answers)
        answers.flush()

    try:
        _write(messages, answer)
    except BaseException as error:
        with suppress(BrokenPipeError):  # the run is gone
            answer(failure(error))
    os._exit(0)  # not waiting for the thread


def _receive(inputs: IO[bytes], messages: queue.Queue[Any]) -> None:
    while True:
        try:
            messages.put(pickle.load(inputs))
        except (EOFError, pickle.UnpicklingError):  # the latter: killed in the middle of a record
            messages.put(None)
            return


def _write(messages: queue.Queue[Any], answer: Any) -> None:
    if (opening := messages.get()) is None:
        return  # the run ended before it began
    writer = StepWriter(opening)
    while (message := messages.get()) is not None:
        if isinstance(message, Record):
            writer.add(message)
        elif message == "wait":
            answer(None)
        else:
            answer(writer.close(gather=message == "gather"))
