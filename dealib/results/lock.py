"""The lock of a run directory: one run at a time writes into it."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

from dealib.errors import ConfigError


class Lock:
    """A held lock; it lasts until every process that shares it has closed it.

    Attributes:
        descriptors: File descriptors of the directory, to be shared with a child process.
        sure: Whether the file system supports locks.

    Args:
        path: The directory; None on ranks that write nothing.
        patience: How long to wait for another run to release the lock, s.

    Raises:
        ConfigError: If another run holds it.
    """

    def __init__(self, path: Path | None = None, patience: float = 0.0) -> None:
        self.descriptors: tuple[int, ...] = ()
        self.sure = False
        if path is None:
            return
        deadline = time.monotonic() + patience
        while True:
            try:
                descriptor = os.open(path, os.O_RDONLY)
            except OSError:  # not ours to read, or just replaced
                return
            try:
                taken, self.sure = _taken(descriptor), True
            except OSError:
                taken = True
            if taken and _same(descriptor, path):
                self.descriptors = (descriptor,)
                return
            os.close(descriptor)
            if not taken and time.monotonic() > deadline:
                raise ConfigError(
                    f"{path}: another run is writing there; wait until it ends, or name another "
                    "directory"
                )
            time.sleep(0.01)

    def __enter__(self) -> Lock:
        return self

    def __exit__(self, *error: object) -> None:
        for descriptor in self.descriptors:
            os.close(descriptor)
        self.descriptors = ()


def _taken(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _same(descriptor: int, path: Path) -> bool:
    """Whether a path still names the directory, which another run may have replaced meanwhile."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except OSError:
        return False
