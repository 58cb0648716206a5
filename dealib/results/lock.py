"""The lock of a run directory: one run at a time writes into it."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import suppress
from pathlib import Path

from dealib.errors import ConfigError


class Lock:
    """A held lock; it lasts until every process that shares it has closed it.

    Args:
        path: The directory; None on ranks that write nothing.
        patience: How long to wait for another run to leave it, s.

    Raises:
        ConfigError: If another run holds it.
    """

    def __init__(self, path: Path | None = None, patience: float = 0.0) -> None:
        self.descriptors: tuple[int, ...] = ()
        if path is None:
            return
        deadline = time.monotonic() + patience
        with suppress(PermissionError):
            self.descriptors = (os.open(path, os.O_RDONLY),)
        for descriptor in self.descriptors:
            while not _taken(descriptor):
                if time.monotonic() > deadline:
                    os.close(descriptor)
                    raise ConfigError(f"{path}: another run is writing there")
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
    except OSError:  # a file system without locks
        return True
    return True
