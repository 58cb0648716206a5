"""Conditions that end a stage or a run: a column of the history against a value with its unit."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field, field_validator

from dealib.config.columns import COLUMNS
from dealib.config.section import Section
from dealib.errors import ValueAt, did_you_mean
from dealib.materials.laws import LAWS
from dealib.materials.response import softens
from dealib.units import factor, split

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_CONDITION = re.compile(r"\s*(\w+)\s*(<=|>=|<|>)\s*(\S.*?)\s*")


class StopWhen(Section):
    """A condition; the first state that meets it is the last one of the stage, or of the run."""

    when: str = Field(description="such as `field_max_MV_per_m > 80 MV/m`: a column of history.csv")
    bisect: int = Field(
        0, ge=0, le=40, description="halvings of the step on which it is met, to come closer"
    )

    @field_validator("when")
    @classmethod
    def _readable(cls, text: str) -> str:
        _read(text)
        return text

    @cached_property
    def _parts(self) -> tuple[str, str, float]:
        return _read(self.when)

    @property
    def column(self) -> str:
        """The column that is watched."""
        return self._parts[0]

    def met(self, row: Mapping[str, Any]) -> bool:
        """Whether a row of the history meets it; never if the row lacks the column."""
        column, sign, limit = self._parts
        return column in row and _COMPARE[sign](float(row[column]), limit)


def _read(text: str) -> tuple[str, str, float]:
    """Column, sign and limit in the column's unit.

    Raises:
        ValueError: If the text is no condition.
    """
    found = _CONDITION.fullmatch(text)
    if found is None:
        raise ValueError(
            f"{text!r} is no condition; expected a column of history.csv, one of "
            f"{', '.join(_COMPARE)} and a value, such as 'field_max_MV_per_m > 80 MV/m'"
        )
    column, sign, value = found.groups()
    if column not in COLUMNS:
        raise ValueError(f"unknown column {column!r}{did_you_mean(column, COLUMNS)}")
    wanted = COLUMNS[column]
    number, unit = split(value)
    if wanted and not unit:
        raise ValueError(f"{value!r} has no unit; {column} is in {wanted}")
    if unit and not wanted:
        raise ValueError(f"{column} is a plain number, {value!r} has a unit")
    return column, sign, number * (factor(unit, wanted) if wanted else 1.0)


def _mapping(value: object) -> object:
    return {"when": value} if isinstance(value, str) else value


Condition: TypeAlias = Annotated[
    StopWhen, BeforeValidator(_mapping, json_schema_input_type=StopWhen | str)
]


# --- which columns a run has ---------------------------------------------------------------------

_Need: TypeAlias = tuple[str, Callable[[Any], bool]]  # what a config must have, and whether it does

_STRENGTH: _Need = ("limits.breakdown_strength", lambda c: c.limits.breakdown is not None)
_STRETCH: _Need = ("limits.stretch_max", lambda c: c.limits.stretch_max is not None)
_SOFTENING: _Need = (
    "a film that can lose its stiffness, such as mooney_rivlin with c01 below 0",
    lambda c: softens(c.materials.film),
)
_LOCKING: _Need = (
    f"a film whose law locks: {' or '.join(n for n, law in LAWS.items() if law.locks)}",
    lambda c: c.materials.film.locks,
)
_DIFFERENTIAL: _Need = ("sensing.differential: true", lambda c: c.sensing.differential)
_RESISTANCE: _Need = (
    "sensing.sheet_resistance",
    lambda c: c.sensing.sheet_resistance is not None,
)
_BRANCHES: _Need = (
    "Maxwell branches, such as materials.film.branches",
    lambda c: any(law.branches for law in c.solids.values()),
)
_FOLLOW: _Need = ("a stage with follow", lambda c: any(s.follow is not None for s in c.program))

_NEEDS = {
    "breakdown_use": _STRENGTH,
    "stretch_use": _STRETCH,
    "stability_use": _SOFTENING,
    "locking_use": _LOCKING,
    "differential_capacitance_pF": _DIFFERENTIAL,
    "blocked_capacitance_pF": _DIFFERENTIAL,
    "mount_stiffness_N_per_mm": _DIFFERENTIAL,
    "electrode_resistance_kohm": _RESISTANCE,
    "rc_time_us": _RESISTANCE,
    "dissipated_energy_mJ": _BRANCHES,
    "dissipated_power_mW": _BRANCHES,
    "unstable_modes": _FOLLOW,
    "limit_point": _FOLLOW,
    "bifurcation": _FOLLOW,
}


def check_conditions(config: Any) -> None:
    """Raise `ValueAt` if a condition watches a column that this run cannot have."""
    parts: list[tuple[tuple[str | int, ...], Any]] = [((), config)]
    parts += [(("program", i), stage) for i, stage in enumerate(config.program)]
    for where, part in parts:
        for k, condition in enumerate(part.stop_when):
            need, has = _NEEDS.get(condition.column, ("", lambda c: True))
            if not has(config):
                raise ValueAt((*where, "stop_when", k), f"{condition.column} needs {need}")
