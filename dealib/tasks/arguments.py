"""Arguments that tasks share: cases, quantities and options that exclude each other."""

from __future__ import annotations

from pathlib import Path

from dealib.config.case import Case, load
from dealib.errors import ConfigError, by_caller
from dealib.units import sensible

Given = Case | str | Path
CASES = Path("runs/studies/cases")  # default folder of solved cases


def silent(line: str) -> None:
    """Discard a line of progress."""


def as_case(case: Given) -> Case:
    """The case itself, or the case of a config file."""
    return case if isinstance(case, Case) else load(case)


def value(argument: str, given: str | float, dimension: str) -> float:
    """Convert a quantity to the internal unit.

    Args:
        argument: Name of the argument, for messages.
        given: A text with a unit, or a number in the internal unit.
        dimension: Key of `dealib.units.DIMENSIONS`.

    Raises:
        ConfigError: If it is not a quantity of that dimension.
    """
    if isinstance(given, (int, float)):
        return float(given)
    try:
        return sensible(given, dimension)
    except ValueError as error:
        option = "--" + argument.replace("_", "-")
        raise ConfigError(f"{by_caller(option, argument)}: {error}") from None


def exclude(overwrite: bool, resume: bool) -> None:
    """Raise `ConfigError` if `overwrite` and `resume` are both given."""
    if overwrite and resume:
        both = by_caller("--overwrite and --resume", "overwrite and resume")
        raise ConfigError(f"{both} exclude each other")
