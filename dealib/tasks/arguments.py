"""What functions of tasks are given: cases, quantities, and what excludes each other."""

from __future__ import annotations

from pathlib import Path

from dealib.config.case import Case, load
from dealib.errors import ConfigError, by_caller
from dealib.units import sensible

Given = Case | str | Path


def silent(line: str) -> None:
    """Tell nobody."""


def as_case(case: Given) -> Case:
    """A case, or that of a config's path."""
    return case if isinstance(case, Case) else load(case)


def value(argument: str, given: str | float, dimension: str) -> float:
    """A quantity in the internal unit, of a text with its unit or a number in that unit.

    Args:
        argument: Its name; on the command line it is an option.
        given: The quantity.
        dimension: Key of `dealib.units.DIMENSIONS`.

    Raises:
        ConfigError: If it is none.
    """
    if isinstance(given, (int, float)):
        return float(given)
    try:
        return sensible(given, dimension)
    except ValueError as error:
        option = "--" + argument.replace("_", "-")
        raise ConfigError(f"{by_caller(option, argument)}: {error}") from None


def exclude(overwrite: bool, resume: bool) -> None:
    """Refuse both at once.

    Raises:
        ConfigError: If both are given.
    """
    if overwrite and resume:
        both = by_caller("--overwrite and --resume", "overwrite and resume")
        raise ConfigError(f"{both} exclude each other")
