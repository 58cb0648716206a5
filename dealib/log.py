"""The logger 'dealib', which writes to the terminal and to the log of a run."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dealib.errors import DealibError
from dealib.patience import NOTE

LOGGER = logging.getLogger("dealib")
LOG = "run.log"
logging.addLevelName(NOTE, "NOTE")
PASSING = {"passing": True}  # `extra` of a warning that is shown but not stored with results


class _Terminal(logging.Handler):
    """Looks up standard error at each message, since a progress bar replaces it."""

    def emit(self, record: logging.LogRecord) -> None:
        stream = sys.stdout if record.levelno == NOTE else sys.stderr
        print(f"dealib: {record.getMessage()}", file=stream, flush=True)


class _Kept(logging.Handler):
    """Keeps the texts of warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if not hasattr(record, "passing"):
            self.texts.append(record.getMessage())


class _File(logging.FileHandler):
    """A log that cannot be written does not stop a run; writing the results reports it."""

    def handleError(self, record: logging.LogRecord) -> None:
        pass

    def close(self) -> None:
        with suppress(OSError):  # of lines that could not be written
            super().close()


def to_terminal(verbose: bool, here: bool = True) -> None:
    """Show warnings on standard error.

    Args:
        verbose: Also show increments and the residuals of Newton's method.
        here: Whether this rank shows anything.
    """
    level = logging.DEBUG if verbose else NOTE
    LOGGER.handlers[:] = [_Terminal(level) if here else logging.NullHandler()]
    LOGGER.setLevel(logging.DEBUG if verbose else logging.INFO)


def verbose() -> bool:
    """Whether the terminal shows increments and residuals (`to_terminal`)."""
    return LOGGER.isEnabledFor(logging.DEBUG)


@contextmanager
def to_file(directory: Path, here: bool = True) -> Iterator[list[str]]:
    """Write dated lines to `run.log` while the context lasts.

    Args:
        directory: The run directory.
        here: Whether this rank writes.

    Yields:
        The warnings so far.
    """
    kept, path = _Kept(), directory / LOG
    handlers: list[logging.Handler] = [kept]
    if here:
        file = _File(path, encoding="utf-8", delay=True)
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
        handlers.append(file)
    level = LOGGER.level
    LOGGER.setLevel(min(level or logging.INFO, logging.INFO))
    for handler in handlers:
        LOGGER.addHandler(handler)
    try:
        yield kept.texts
    except DealibError:
        raise
    except Exception as error:
        LOGGER.info("stopped by an unexpected error", exc_info=True)
        error.add_note(f"the run's log is {path}")
        raise
    finally:
        for handler in handlers:
            LOGGER.removeHandler(handler)
            handler.close()
        LOGGER.setLevel(level)
