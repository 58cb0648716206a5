"""From a YAML file to a validated case, with messages that say what, where and what to do."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from ruamel.yaml import YAML

from dealib.config.schema import Config
from dealib.config.source import Source, did_you_mean
from dealib.errors import ConfigError
from dealib.materials.laws import LAWS


@dataclass(frozen=True)
class Case:
    """A validated config and the text it came from.

    Attributes:
        config: The validated config.
        text: The file as given.
        path: The file.
        overrides: The `key=value` assignments applied on top.
    """

    config: Config
    text: str
    path: Path
    overrides: tuple[str, ...] = ()


def load(path: str | Path, set: Mapping[str, Any] | Iterable[str] | None = None) -> Case:
    """Read and validate a config.

    Args:
        path: The YAML file.
        set: Overrides, as a mapping of dotted keys or as 'key=value' texts.

    Raises:
        ConfigError: With one message a mistake, each with its place in the file.
    """
    source = Source(Path(path))
    pairs = [f"{k}={v}" for k, v in set.items()] if isinstance(set, Mapping) else list(set or ())
    for assignment in pairs:
        source.override(assignment)
    try:
        config = Config.model_validate(_plain(source.tree))
    except ValidationError as error:
        raise ConfigError("\n".join(_messages(error, source))) from None
    if config.mesh.file is not None:
        mesh = source.path.parent / config.mesh.file
        found = mesh if mesh.exists() else Path(config.mesh.file)
        if not found.exists():
            problem = f"there is no file {config.mesh.file!r} (looked in . and {mesh.parent})"
            raise ConfigError(source.message(("mesh", "file"), problem))
        config = config.model_copy(
            update={"mesh": config.mesh.model_copy(update={"file": str(found)})}
        )
    return Case(config, source.text, source.path, tuple(pairs))


def resolved(config: Config) -> str:
    """The config with all defaults, as YAML that reads back as the same config."""
    out = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(_listed(config.model_dump(exclude_none=True)), out)
    return out.getvalue()


def _plain(node: Any) -> Any:
    """Plain dicts and lists of a ruamel tree."""
    if isinstance(node, Mapping):
        return {str(k): _plain(v) for k, v in node.items()}
    if isinstance(node, list):
        return [_plain(v) for v in node]
    return node


def _listed(node: Any) -> Any:
    """Tuples as lists, which YAML can say; single values of a polyline stay lists."""
    if isinstance(node, dict):
        return {k: _listed(v) for k, v in node.items()}
    return [_listed(v) for v in node] if isinstance(node, (list, tuple)) else node


def _messages(error: ValidationError, source: Source) -> list[str]:
    found: dict[str, None] = {}
    for item in error.errors():
        where = _in_file(item["loc"], source.tree)
        found[source.message(where, _problem(item, where))] = None
    return list(found)


def _in_file(loc: tuple[int | str, ...], tree: Any) -> tuple[int | str, ...]:
    """Pydantic's location without what it adds for unions (the tag) and one-value polylines."""
    where: list[int | str] = []
    node = tree
    for depth, part in enumerate(loc):
        inside = isinstance(node, (Mapping, list))
        if not inside or (part in LAWS and isinstance(node, Mapping) and part not in node):
            continue
        where.append(part)
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            where.extend(p for p in loc[depth + 1 :] if p not in LAWS)
            break
    return tuple(where)


def _problem(item: Any, where: tuple[int | str, ...]) -> str:
    kind, given = item["type"], item.get("input")
    if kind == "extra_forbidden":
        return f"unknown key{did_you_mean(where[-1], _keys_at(item['loc'][:-1]))}"
    if kind == "missing":
        return "this key is missing"
    if kind == "union_tag_not_found":
        return f"the key 'law' is missing; known laws: {', '.join(LAWS)}"
    if kind == "union_tag_invalid":
        tag = item["ctx"]["tag"]
        return f"unknown law {tag!r}{did_you_mean(tag, LAWS)}"
    if kind == "literal_error":
        known = [k.strip(" '") for k in item["ctx"]["expected"].replace(" or ", ",").split(",")]
        return f"{given!r} is not allowed{did_you_mean(given, known)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return "expected a mapping of keys"
    if kind == "value_error":
        return str(item["ctx"]["error"])
    if kind == "multiple_of":
        return f"expected a multiple of {item['ctx']['multiple_of']}, not {given!r}"
    message = item["msg"][0].lower() + item["msg"][1:]
    return f"{message}, not {given!r}" if isinstance(given, (str, int, float)) else message


def _keys_at(loc: tuple[int | str, ...]) -> list[str]:
    """The keys that the schema knows at a location."""
    kinds: list[Any] = [Config]
    for part in loc:
        following: list[Any] = []
        for model in kinds:
            if isinstance(part, int) or part in LAWS:
                following.append(model)
                continue
            field = getattr(model, "model_fields", {}).get(part)
            if field is not None:
                following.extend(_models_in(field.annotation))
        if part in LAWS:
            following = [m for m in following if m.__name__.startswith(LAWS[str(part)].__name__)]
        kinds = following
    return [name for model in kinds for name in model.model_fields]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for arg in get_args(annotation) for m in _models_in(arg)]


def json_schema() -> dict[str, Any]:
    """JSON schema of the config, for editors."""
    return TypeAdapter(Config).json_schema(by_alias=True)
