"""Standard streams that are closed or full; commands finish their work all the same."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any


class _Patient:
    """A stream that discards its output after the first error of writing.

    Attributes:
        lost: That error; None: all was written.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.lost: OSError | None = None

    def write(self, text: str) -> int:
        """See `io.TextIOBase`."""
        return int(self._tried(self._stream.write, text) or 0)

    def flush(self) -> None:
        """See `io.TextIOBase`."""
        self._tried(self._stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _tried(self, method: Any, *arguments: Any) -> Any:
        try:
            return method(*arguments)
        except OSError as error:
            self.lost = error
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
            return None


def guard() -> None:
    """Protect the standard streams; call it before anything is opened or printed."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file would get its number, and what is printed
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))
        stream = getattr(sys, name)
        if number and (
            stream is getattr(sys, f"__{name}__") or getattr(sys, f"__{name}__") is None
        ):
            setattr(sys, name, _Patient(stream))


def flushed(code: int) -> int:
    """Flush standard output.

    Args:
        code: The exit code so far.

    Returns:
        The exit code; 4 instead of 0 if output was lost. A reader that closes the pipe early, such
        as `head`, is no error.
    """
    sys.stdout.flush()
    lost = getattr(sys.stdout, "lost", None)
    if lost is None or lost.errno == errno.EPIPE:
        return code
    print(f"dealib: cannot write to standard output: {lost.strerror}", file=sys.stderr)
    return code or 4
