"""Say what is going on when it takes longer than a moment."""

from __future__ import annotations

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

NOTE = 25  # level of what a user is told without asking, though it is no warning
_MOMENT = 2.0  # s
_spent: dict[str, float] = defaultdict(float)


@contextmanager
def patience(what: str) -> Iterator[None]:
    """Tell what is being done if it takes more than two seconds, all its times together; once."""
    note = threading.Timer(max(_MOMENT - _spent[what], 0.0), _say, [what])
    note.daemon = True
    begin = time.perf_counter()
    if _spent[what] <= _MOMENT:
        note.start()
    try:
        yield
    finally:
        note.cancel()
        _spent[what] += time.perf_counter() - begin


def _say(what: str) -> None:
    logging.getLogger("dealib").log(NOTE, "%s ...", what)
