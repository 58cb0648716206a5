"""The bases of config sections, and the values in dumped ones."""

from __future__ import annotations

from collections.abc import Iterator
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


def leaves(node: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of a dumped section."""
    if not isinstance(node, (dict, list, tuple)):
        yield path, node
        return
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        yield from leaves(value, f"{path}.{key}".lstrip("."))
