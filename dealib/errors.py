"""Errors that a user can meet, each with its exit code."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

Place: TypeAlias = tuple[str | int, ...]  # of a key: names, and positions in lists

FAULT = 70  # exit code of an unexpected error: EX_SOFTWARE of sysexits.h

_callers = ["Python"]  # stack of callers; messages are worded for the last one


@contextmanager
def on_command_line() -> Iterator[None]:
    """Word messages for the command line while the context lasts, otherwise for Python."""
    _callers.append("command line")
    try:
        yield
    finally:
        _callers.pop()


def by_caller(command_line: str, python: str) -> str:
    """Choose the wording for the caller: options of the command line, or arguments of Python."""
    return python if _callers[-1] == "Python" else command_line


def in_the_way(path: Path) -> str:
    """The message for a file or directory of results that exists already."""
    ways = by_caller("choose another --out, or --overwrite it", "choose another, or overwrite=True")
    return f"{path} exists; {ways}"


def anew() -> str:
    """Advice for results that cannot be continued: start again and replace them."""
    return "start anew with " + by_caller("--overwrite", "overwrite=True")


def first_line(error: BaseException) -> str:
    """First line of an error's text, or the name of its class if it has none."""
    return next(iter(str(error).splitlines()), type(error).__name__)


class DealibError(Exception):
    """Base of all errors that dealib explains to its user.

    Attributes:
        exit_code: Exit code of the command line.
        everywhere: Whether every rank of a parallel run raises it; if not, the other ranks have
            to be stopped.
    """

    exit_code = FAULT
    everywhere = True


class ConfigError(DealibError):
    """The config, the command line or an input file is wrong."""

    exit_code = 2


class ValueAt(ValueError):
    """A check of a section failed because of one of its keys.

    Args:
        where: Path of that key, relative to the section.
        message: What is wrong.
    """

    def __init__(self, where: Place, message: str) -> None:
        super().__init__(where, message)  # all arguments, from which pickle restores the error
        self.where = where

    def __str__(self) -> str:
        return str(self.args[1])


class NotConverged(DealibError):
    """A step did not converge even at the smallest increment; earlier states are kept."""

    exit_code = 3


class PlatformError(DealibError):
    """The machine lacks something that dealib needs."""

    exit_code = 4
    everywhere = False


class Interrupted(KeyboardInterrupt):
    """A signal asked to stop; finished results are kept.

    It is not a subclass of `Exception`, so that a loop that continues after failed cases still
    ends when its user interrupts it.

    Args:
        message: What was kept and how to continue.
        signal: Number of the signal; the exit code is 128 + signal.
        everywhere: Whether every rank raises it.
    """

    def __init__(self, message: str, signal: int, everywhere: bool = False) -> None:
        super().__init__(message, signal, everywhere)
        self.signal, self.everywhere = signal, everywhere

    @property
    def exit_code(self) -> int:
        """128 + signal, the convention of shells."""
        return 128 + self.signal

    def __str__(self) -> str:
        return str(self.args[0])


def did_you_mean(word: object, known: Sequence[str] | Mapping[str, Any]) -> str:
    """A hint at the nearest known word; if none is near, the list of all of them."""
    near = difflib.get_close_matches(str(word), list(known), n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(known)}" if known else ""
