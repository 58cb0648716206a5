"""Times of the phases of a run."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Timings(defaultdict[str, float]):
    """Seconds by phase."""

    def __init__(self) -> None:
        super().__init__(float)

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        """Add the time of a block to a phase."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self[phase] += time.perf_counter() - start
