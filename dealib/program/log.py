"""What a run tells: the logger 'dealib', with `run.log` and the terminal as its listeners."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOGGER = logging.getLogger("dealib")
LOG = "run.log"
PASSING = {"passing": True}  # extra of a warning that is not kept: results tell more in the end


class _Terminal(logging.Handler):
    """Writes to whatever standard error is now (a progress bar replaces it)."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr, flush=True)


class _Kept(logging.Handler):
    """Keeps the texts of warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if not hasattr(record, "passing"):
            self.texts.append(record.getMessage())


class _File(logging.FileHandler):
    """The log never stops a run: results report a disk that refuses."""

    def handleError(self, record: logging.LogRecord) -> None:
        pass


def to_terminal(verbose: bool, here: bool = True) -> None:
    """Show warnings on standard error.

    Args:
        verbose: Also increments and Newton's residuals.
        here: Whether this rank shows anything.
    """
    LOGGER.propagate = False
    if not here:
        LOGGER.addHandler(logging.NullHandler())
        return
    terminal = _Terminal(logging.DEBUG if verbose else logging.WARNING)
    terminal.setFormatter(logging.Formatter("dealib: %(message)s"))
    LOGGER.addHandler(terminal)
    LOGGER.setLevel(logging.DEBUG if verbose else logging.INFO)


@contextmanager
def to_file(directory: Path, here: bool = True) -> Iterator[list[str]]:
    """Write dated lines to `run.log` while the context lasts.

    Args:
        directory: The run directory.
        here: Whether this rank writes.

    Yields:
        The warnings so far.
    """
    kept = _Kept()
    handlers: list[logging.Handler] = [kept]
    if here:
        file = _File(directory / LOG, encoding="utf-8", delay=True)
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
        handlers.append(file)
    level = LOGGER.level
    LOGGER.setLevel(min(level or logging.INFO, logging.INFO))
    for handler in handlers:
        LOGGER.addHandler(handler)
    try:
        yield kept.texts
    finally:
        for handler in handlers:
            LOGGER.removeHandler(handler)
            handler.close()
        LOGGER.setLevel(level)
