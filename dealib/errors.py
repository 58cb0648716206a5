"""Errors that a user can meet, each with its exit code."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

FAULT = 70  # exit code of what nobody foresaw: EX_SOFTWARE of sysexits.h


_callers = ["Python"]  # who called dealib, the last one counts


@contextmanager
def on_command_line() -> Iterator[None]:
    """Speak to somebody at the command line while the context lasts, else to a program."""
    _callers.append("command line")
    try:
        yield
    finally:
        _callers.pop()


def by_caller(command_line: str, python: str) -> str:
    """Words for whoever called: with options of the command line, or with arguments of Python."""
    return python if _callers[-1] == "Python" else command_line


def in_the_way(path: Path) -> str:
    """What to say of a file or directory of results that is there already."""
    ways = by_caller("choose another --out, or --overwrite it", "choose another, or overwrite=True")
    return f"{path} exists; {ways}"


def anew() -> str:
    """How to replace what cannot be gone on with."""
    return "start anew with " + by_caller("--overwrite", "overwrite=True")


def first_line(error: BaseException) -> str:
    """What an error says first, or its kind if it says nothing."""
    return next(iter(str(error).splitlines()), type(error).__name__)


class DealibError(Exception):
    """Base of all errors that dealib explains to its user.

    Attributes:
        exit_code: Of the command line.
        everywhere: Whether every rank of a parallel run raises it; if not, the others must be
            stopped.
    """

    exit_code = FAULT
    everywhere = True


class ConfigError(DealibError):
    """Something in the config, on the command line or in an input file is wrong."""

    exit_code = 2


class ValueAt(ValueError):
    """A check of a whole section that failed because of one of its keys.

    Args:
        where: Path of the most telling key, from the section.
        message: What is wrong.
    """

    def __init__(self, where: tuple[str | int, ...], message: str) -> None:
        super().__init__(where, message)  # all of them: pickle makes the error anew from these
        self.where = where

    def __str__(self) -> str:
        return str(self.args[1])


class NotConverged(DealibError):
    """A step did not converge even at the smallest increment; what converged is kept."""

    exit_code = 3


class PlatformError(DealibError):
    """The machine lacks something that dealib needs."""

    exit_code = 4
    everywhere = False


class Interrupted(KeyboardInterrupt):
    """A signal asked to stop; what is finished is kept.

    It is no `DealibError`, nor any other `Exception`: a loop that goes on past cases that fail is
    to end when its user says so.

    Args:
        message: What was kept and how to go on.
        signal: Number of the signal; the exit code is 128 + signal.
        everywhere: Whether every rank raises it.
    """

    def __init__(self, message: str, signal: int, everywhere: bool = False) -> None:
        super().__init__(message, signal, everywhere)
        self.signal, self.everywhere = signal, everywhere

    @property
    def exit_code(self) -> int:
        """As shells give it."""
        return 128 + self.signal

    def __str__(self) -> str:
        return str(self.args[0])


def did_you_mean(word: object, known: Sequence[str] | Mapping[str, Any]) -> str:
    """A hint at the nearest known word, or at all of them."""
    near = difflib.get_close_matches(str(word), list(known), n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(known)}" if known else ""
