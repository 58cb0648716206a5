"""A user's own library of materials: a YAML file in the format of the published one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import Field, RootModel, TypeAdapter, ValidationError, field_validator

from dealib.config.materials import Material
from dealib.config.messages import in_file, problem, validate
from dealib.config.schema import Config, Name
from dealib.config.source import Source
from dealib.config.text import dump, load
from dealib.errors import ValueAt, did_you_mean
from dealib.materials.laws import LAWS
from dealib.materials.published import OWN, PublishedMaterial
from dealib.section import Section

_LAW = TypeAdapter[Any](Material)


class Own(Section):
    """One material of a library."""

    description: str = Field("", description="what it is")
    source: str = Field("", description="where its values are from")
    values: dict[str, Any] = Field(description="keys of a film's material, its law among them")

    @field_validator("values")
    @classmethod
    def _lawful(cls, values: dict[str, Any]) -> dict[str, Any]:
        if values.get("law") not in LAWS:
            raise ValueAt(("law",), f"expected a law{did_you_mean(values.get('law'), LAWS)}")
        try:
            _LAW.validate_python(values)
        except ValidationError as error:
            item = error.errors()[0]
            raise ValueAt(in_file(item, values), problem(item)) from None
        return values


class _Library(RootModel[dict[Name, Own]]):
    """Materials by name."""


def read_library(path: Path) -> dict[str, PublishedMaterial]:
    """The materials of a file, by name.

    Raises:
        ConfigError: If the file is not a valid library; with the place of each mistake.
    """
    found = validate(_Library, Source(path)).root
    return {
        name: PublishedMaterial(own.description, own.source, own.values)
        for name, own in found.items()
    }


@contextmanager
def known(path: Path | None) -> Iterator[None]:
    """Make the materials of a library file available while the context lasts; None: no file."""
    token = OWN.set({} if path is None else read_library(path))
    try:
        yield
    finally:
        OWN.reset(token)


def of_config(source: Source) -> Path | None:
    """The library file that a config names; None if it names none.

    Raises:
        ConfigError: If there is no such file.
    """
    name = source.tree.get("library")
    if not isinstance(name, str):  # missing, or a wrong type that validation reports later
        return None
    return source.file(("library",), name)


def without_library(config: Config) -> Config:
    """A copy of a validated config that no longer refers to its library file."""
    materials = {n: m.model_copy(update={"library": None}) for n, m in config.materials.items()}
    return config.model_copy(update={"library": None, "materials": materials})


def add(path: Path, name: str, entry: Mapping[str, Any]) -> str:
    """The text of a library file to which a material is added.

    Args:
        path: The file; it need not exist, and it is not written.
        name: Name of the material; an entry of that name is replaced.
        entry: Description, source and values of the material.
    """
    tree = load(path.read_text(encoding="utf-8"), "rt") if path.is_file() else None
    tree = {} if tree is None else tree
    tree[name] = dict(entry)
    return dump(tree)
