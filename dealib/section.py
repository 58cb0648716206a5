"""The base of all config sections."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator

from dealib.errors import ValueAt


class Section(BaseModel):
    """Base of all sections: unknown keys are errors, and values cannot be changed."""

    model_config = ConfigDict(defer_build=True, frozen=True, extra="forbid", allow_inf_nan=False)


class OneOf(Section):
    """A section in which exactly one key is given."""

    @model_validator(mode="after")
    def _one_of(self) -> OneOf:
        names = list(type(self).model_fields)
        given = [n for n in names if getattr(self, n) is not None]
        if len(given) > 1:
            raise ValueAt((given[1],), f"{' and '.join(given)} exclude each other; give one")
        if not given:
            raise ValueError(f"give one of {', '.join(names)}")
        return self

    @property
    def given(self) -> tuple[str, Any]:
        """Name and value of the key that is given."""
        return next((n, v) for n in type(self).model_fields if (v := getattr(self, n)) is not None)
