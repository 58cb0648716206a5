"""Messages about tasks that take longer than two seconds."""

from __future__ import annotations

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

NOTE = 25  # log level of messages that are always shown but are no warnings
_MOMENT = 2.0  # s
_spent: dict[str, float] = defaultdict(float)


@contextmanager
def patience(what: str) -> Iterator[None]:
    """Tell the user about a task once it has taken two seconds, repeated calls added up.

    Args:
        what: The task, such as 'compiling forms'; it is reported once.
    """
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
