"""Conditions that end a stage or a run: they compare a column of the history with a value."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field, field_validator

from dealib.errors import Place, ValueAt, did_you_mean
from dealib.observe.columns import columns
from dealib.section import Section
from dealib.units import factor, split

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_CONDITION = re.compile(r"\s*([\w.]+)\s*(<=|>=|<|>)\s*(\S.*?)\s*")


class StopWhen(Section):
    """A condition; the first state that meets it is the last one of the stage or run."""

    when: str = Field(
        description="a column of history.csv and a value, such as `field_max_MV_per_m > 80 MV/m`"
    )
    bisect: int = Field(
        0,
        ge=0,
        le=40,
        description="number of times that the step at which the condition is met is halved, to "
        "end closer to the value",
    )

    @field_validator("when")
    @classmethod
    def _readable(cls, text: str) -> str:
        _read(text)
        return text

    @cached_property
    def _parts(self) -> tuple[str, str, float, str]:
        return _read(self.when)

    @property
    def column(self) -> str:
        """The column of the history."""
        return self._parts[0]

    def met(self, row: Mapping[str, Any], unit: str) -> bool:
        """Whether a row of the history meets the condition; a row without the column does not.

        Args:
            row: The row.
            unit: Unit of the column.
        """
        column, sign, limit, given = self._parts
        scale = factor(given, unit) if unit else 1.0
        return column in row and _COMPARE[sign](float(row[column]), limit * scale)

    def check(self, unit: str) -> None:
        """Raise `ValueError` if the limit is not of its column's dimension.

        Args:
            unit: Unit of the column.
        """
        column, _, value, given = self._parts
        if unit and not given:
            raise ValueError(f"'{value:g}' has no unit; {column} is in {unit}")
        if given and not unit:
            raise ValueError(f"{column} is a plain number, '{value:g} {given}' has a unit")
        if unit:
            factor(given, unit)


def _read(text: str) -> tuple[str, str, float, str]:
    """Column, comparison, limit and unit of the limit.

    Raises:
        ValueError: If the text is not a condition.
    """
    found = _CONDITION.fullmatch(text)
    if found is None:
        raise ValueError(
            f"{text!r} is not a condition; expected a column of history.csv, one of "
            f"{', '.join(_COMPARE)} and a value, such as 'field_max_MV_per_m > 80 MV/m'"
        )
    column, sign, value = found.groups()
    return column, sign, *split(value)


def _mapping(value: object) -> object:
    return {"when": value} if isinstance(value, str) else value


Condition: TypeAlias = Annotated[
    StopWhen, BeforeValidator(_mapping, json_schema_input_type=StopWhen | str)
]


def check_conditions(config: Any) -> None:
    """Raise `ValueAt` if a condition names a column that this run does not have."""
    known = columns(config)
    parts: list[tuple[Place, Any]] = [((), config)]
    parts += [(("program", i), stage) for i, stage in enumerate(config.program)]
    for where, part in parts:
        for k, condition in enumerate(part.stop_when):
            at, name = (*where, "stop_when", k), condition.column
            if name not in known:
                raise ValueAt(at, f"unknown column {name!r}{did_you_mean(name, known)}")
            try:
                condition.check(known[name].unit)
            except ValueError as error:
                raise ValueAt(at, str(error)) from None
            needs = known[name].quantity.needs
            if not needs.has(config):
                raise ValueAt(at, f"{name} needs {needs.text}")
