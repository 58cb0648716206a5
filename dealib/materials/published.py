"""Materials by name: published ones, each with its source, and those of a user."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ruamel.yaml import YAML

from dealib.materials.laws import LAWS, Law


@dataclass(frozen=True)
class PublishedMaterial:
    """One material.

    Attributes:
        description: What it is.
        source: Where its values are from.
        values: Keys of a film's material in a config, its `law` among them.
    """

    description: str
    source: str
    values: Mapping[str, Any]

    @property
    def law(self) -> type[Law]:
        """Its law."""
        return LAWS[self.values["law"]]

    @property
    def parameters(self) -> dict[str, Any]:
        """The law's parameters alone."""
        return {n: self.values[n] for n in self.law.names() if n in self.values}

    @property
    def words(self) -> str:
        """The values in words, such as 'yeoh: c10 0.2 MPa, c20 -10 kPa'."""
        rest = ", ".join(f"{k} {_text(v)}" for k, v in self.values.items() if k != "law")
        return f"{self.values['law']}: {rest}"

    def with_changes(self, given: Mapping[str, Any], only: tuple[str, ...]) -> dict[str, Any]:
        """The values, some replaced by those of a config.

        Args:
            given: Keys of a config; youngs_modulus replaces all parameters that it sets.
            only: Keys of the material to keep besides those of its law.
        """
        kept = {"law": self.values["law"]} | self.parameters
        kept |= {k: v for k, v in self.values.items() if k in only}
        if given.get("youngs_modulus") is not None:
            kept = {k: v for k, v in kept.items() if k not in self.law.ruled()}
        return kept | dict(given)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return " ".join(f"{k} {v}" for k, v in value.items())
    return "[" + ", ".join(map(_text, value)) + "]" if isinstance(value, list) else str(value)


OWN: ContextVar[Mapping[str, PublishedMaterial]] = ContextVar("OWN", default=MappingProxyType({}))


@functools.cache
def _published() -> dict[str, PublishedMaterial]:
    path = Path(__file__).with_name("published.yaml")
    found = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    return {name: PublishedMaterial(**entry) for name, entry in found.items()}


def library() -> dict[str, PublishedMaterial]:
    """All materials by name; those in `OWN` before published ones of the same name."""
    return {**_published(), **OWN.get()}
