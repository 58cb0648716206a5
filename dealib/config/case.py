"""From a YAML file to a validated case."""

from __future__ import annotations

import functools
import io
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from ruamel.yaml import YAML

from dealib.config.library import known, of_config, without_library
from dealib.config.linear import check_linear
from dealib.config.messages import validate
from dealib.config.schema import Config
from dealib.config.size import Size, refuse_too_large, size
from dealib.config.source import Source
from dealib.config.text import dump
from dealib.config.wave import Wave
from dealib.device.shapes import MeshShape
from dealib.errors import ConfigError, Place, ValueAt


@dataclass(frozen=True, repr=False)
class Case:
    """A validated config and the text it came from.

    Attributes:
        config: The validated config.
        text: The text of the file.
        path: The file.
        overrides: The `key=value` assignments applied to it.
        within: Key of the file that holds the config; empty: the whole file is the config.
    """

    config: Config
    text: str
    path: Path
    overrides: tuple[str, ...] = ()
    within: str = ""

    def __repr__(self) -> str:
        changes = "".join(f", {change}" for change in self.overrides)
        return f"<Case {self.config.name}: {self.path}{changes}>"

    @property
    def size(self) -> Size:
        """Estimate of a run's unknowns, steps, memory, time and disk space."""
        return size(self.config)

    @cached_property
    def resolved(self) -> str:
        """The config with all defaults, as YAML."""
        return resolved(self.config)

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Turn a `ValueAt` of a run into a message with the place in the file.

        Raises:
            ConfigError: Instead of `ValueAt`.
        """
        try:
            yield
        except ValueAt as error:
            try:
                source = Source(self.path, within=self.within)
                for assignment in self.overrides:
                    source.override(assignment)
                message = source.message(error.where, str(error))
            except ConfigError:  # the file no longer exists
                message = f"{'.'.join(map(str, error.where))}: {error}"
            raise ConfigError(message) from None


def load(
    path: str | Path,
    set: Mapping[str, Any] | Iterable[str] | None = None,
    *,
    within: str = "",
) -> Case:
    """Read and validate a config.

    Args:
        path: The YAML file.
        set: Overrides, as a mapping of dotted keys or as 'key=value' texts. A text is read as YAML;
            None is YAML's null, such as for no clamps or no limit.
        within: Key of the file that holds the config; empty: the whole file is the config.

    Raises:
        ConfigError: With one message for each mistake and its place in the file.
    """
    source = Source(Path(path), within=within)
    items = set.items() if isinstance(set, Mapping) else ()
    pairs = [f"{k}={_yaml(v)}" for k, v in items] or list(set or ())
    for assignment in pairs:
        source.override(assignment)
    with known(of_config(source)):
        config = validate(Config, source)
    if config.library is not None:  # the values of its materials are in the config now
        config = without_library(config)
    for where, file in _files(config):
        config = _put(config, where, str(source.file(where, file)))
    try:
        if isinstance(config.geometry, MeshShape):
            config.check_device()
        check_linear(config)
        refuse_too_large(config)
    except ValueAt as error:
        raise ConfigError(source.message(error.where, str(error), "key")) from None
    return Case(config, source.text, source.path, tuple(pairs), within)


def _files(config: Config) -> Iterator[tuple[Place, str]]:
    """The paths of the keys that name files, and these names."""
    if config.mesh.file is not None:
        yield ("mesh", "file"), config.mesh.file
    if isinstance(config.geometry, MeshShape):
        yield ("geometry", "file"), config.geometry.file
    for k, stage in enumerate(config.program):
        for path, _, _, given in stage.inputs:
            for name, course in given.courses:
                if isinstance(course, Wave) and course.file is not None:
                    yield ("program", k, *path, *name, "file"), course.file


def _put(node: Any, where: Place, value: Any) -> Any:
    """A copy of a section with another value at a path."""
    if not where:
        return value
    key, *rest = where
    if isinstance(node, BaseModel):
        name = str(key)
        return node.model_copy(update={name: _put(getattr(node, name), tuple(rest), value)})
    changed: Any = dict(node) if isinstance(node, dict) else list(node)
    changed[key] = _put(node[key], tuple(rest), value)
    return changed if isinstance(node, dict) else tuple(changed)


def _yaml(value: Any) -> str:
    """A value of Python or numpy as YAML; a text is taken as YAML."""
    if isinstance(value, str):
        return value
    return json.dumps(value, default=lambda x: getattr(x, "tolist", x.__str__)())


def read(path: Path) -> Config:
    """Read a resolved config, as run directories hold it.

    It may be larger than one written by hand, and the files that it names need not exist.

    Raises:
        ConfigError: If it is not valid.
    """
    return validate(Config, Source(path, most=20_000_000))


def resolved(config: Config) -> str:
    """The config with all defaults, as YAML that reads back as the same config."""
    sections = _listed(config.model_dump(exclude_none=True)).items()
    return "".join(_section(json.dumps({name: section})) for name, section in sections)


@functools.lru_cache(maxsize=64)
def _section(text: str) -> str:
    """A section in JSON as YAML; cached, since most sections of a sweep's cases are equal."""
    return yaml_text(json.loads(text))


def commented(path: Path, changes: Iterable[str]) -> str:
    """The text of a file with 'key=value' changes applied; its comments are kept."""
    source = Source(path)
    for assignment in changes:
        source.override(assignment)
    return dump(source.tree)


def yaml_text(tree: Any) -> str:
    """A tree as YAML; the order of its keys is kept."""
    out = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(tree, out)
    return out.getvalue()


def _listed(node: Any) -> Any:
    """A tree with lists instead of tuples, for which YAML has no plain form."""
    if isinstance(node, dict):
        return {k: _listed(v) for k, v in node.items()}
    return [_listed(v) for v in node] if isinstance(node, (list, tuple)) else node
