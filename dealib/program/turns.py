"""Lets one thread solve at a time: PETSc, Gmsh and the compiler of forms are not thread-safe."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

_LOCK = threading.RLock()


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other thread solves; also a decorator, `@alone()`."""
    with _LOCK:
        yield
