"""The schema as JSON schema for editors, and as a reference page in Markdown."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from typing import Any

from pydantic import BaseModel

from dealib.config.schema import Config
from dealib.materials.published import library
from dealib.units import DIMENSIONS

Node = dict[str, Any]
SCHEMA_FILE = "dealib.schema.json"
MODELINE = f"# yaml-language-server: $schema={SCHEMA_FILE}"


def json_schema(model: type[BaseModel] = Config) -> Node:
    """JSON schema of a file; quantities carry their dimension and an example."""
    schema = model.model_json_schema()
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
    return dict(_tidy(schema))


def json_text(model: type[BaseModel] = Config) -> str:
    """The JSON schema as a file's text."""
    return json.dumps(json_schema(model), indent=2) + "\n"


def _tidy(node: Any) -> Any:
    """Remove titles and nulls from a JSON schema; add units to descriptions and defaults."""
    if isinstance(node, list):
        return [_tidy(n) for n in node]
    if not isinstance(node, dict):
        return node
    node = {k: _tidy(v) for k, v in node.items() if not (k == "title" and isinstance(v, str))}
    if "properties" in node:
        order = sorted(node["properties"], key=lambda name: name != "law")  # `law` comes first
        node["properties"] = {name: node["properties"][name] for name in order}
        return node | {"title": node.get("description", "").split(":")[0].rstrip(".")}
    if "discriminator" not in node and not any("required" in c for c in node.get("oneOf", [])):
        node["anyOf"] = [*node.get("anyOf", []), *node.pop("oneOf", [])]
    choices = [c for c in node.pop("anyOf", []) if c.get("type") != "null"]
    if len(choices) == 1:
        node = choices[0] | node
    elif choices:
        node["anyOf"] = choices
    if isinstance(node.get("default", ""), (dict, type(None))):
        del node["default"]
    if dimension := _dimension(node):
        unit, example = DIMENSIONS[dimension]
        kind = f"{dimension}, such as '{example}'"
        means = node.get("description", "")
        node["description"] = f"{means} ({kind})" if means and kind not in means else means or kind
        if "default" in node:
            node["default"] = f"{node['default']:g} {unit}"
    return node


def _dimension(node: Node) -> str:
    """Dimension of a quantity or of a polyline of quantities; empty for anything else."""
    for choice in [node, *node.get("anyOf", [])]:
        if "dimension" in choice:
            return str(choice["dimension"])
    return ""


def meaning(node: Node) -> str:
    """Description of a key, without the dimension that `_tidy` adds."""
    return str(node.get("description", "")).split(f" ({_dimension(node) or '?'}, such as ")[0]


def properties(node: Node, defs: Node) -> Node:
    """Keys of a section of the schema."""
    return dict(resolve(node, defs).get("properties", {}))


def resolve(node: Node, defs: Node) -> Node:
    """The definition that a node refers to."""
    return dict(defs[node["$ref"].rsplit("/", 1)[1]]) if "$ref" in node else node


def variants(node: Node, defs: Node) -> dict[str, Node]:
    """Definitions of a discriminated union, by tag."""
    mapping = node.get("discriminator", {}).get("mapping", {})
    return {tag: resolve({"$ref": ref}, defs) for tag, ref in mapping.items()}


def kind(node: Node) -> str:
    """The type of a key's value in words."""
    if dimension := _dimension(node):
        return f"{dimension}, or list" if "anyOf" in node else dimension
    if "anyOf" in node:
        return ", or ".join(kind(c) for c in node["anyOf"])
    if "enum" in node or "const" in node:
        return ", ".join(f"`{v}`" for v in node.get("enum", [node.get("const")]))
    if node.get("type") == "array":
        items = node.get("prefixItems")
        return f"list of {len(items)}" if items else "list"
    if node.get("type") == "object" and "properties" not in node:
        return "mapping"
    names = {"integer": "whole number", "number": "number", "string": "text", "boolean": "switch"}
    limits = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = [f"{sign} {node[key]:g}" for key, sign in limits.items() if key in node]
    return " ".join([names.get(node.get("type", ""), "section"), ", ".join(bounds)]).strip()


def reference() -> str:
    """The reference page of all keys of a config, in Markdown."""
    head = [
        "# All keys of a config",
        "",
        "Made by `dealib schema --reference` from the schema that `dealib check` applies. Values",
        "with a dimension are written with a unit; any unit of that dimension is accepted.",
        "",
        "| dimension | example |",
        "|---|---|",
        *(f"| {name} | `{example}` |" for name, (_, example) in DIMENSIONS.items()),
    ]
    return "\n".join([*head, *sections(Config), *_library()]) + "\n"


def sections(model: type[BaseModel]) -> Iterator[str]:
    """The lines of a reference page: all sections of a file, each with a table of its keys."""
    schema = json_schema(model)
    yield from _Page(schema.get("$defs", {})).section(schema, "")


def _library() -> Iterator[str]:
    yield from ("", "## Published materials", "")
    yield from ("For `library` of a film or an electrode; every value can be overridden.", "")
    yield from ("| name | what | values | source |", "|---|---|---|---|")
    for name, entry in library().items():
        yield f"| `{name}` | {entry.description} | {entry.words} | {entry.source} |"


def _sections(node: Node) -> list[Node]:
    """The sections among the alternatives of a key's value."""
    return [n for n in (node, *node.get("anyOf", ())) if "$ref" in n or "discriminator" in n]


def inner(value: Node) -> tuple[Node, str]:
    """The value of a key, or of its items, and what they add to its path: '[]', '.KEY' or ''."""
    for key, on in (("items", "[]"), ("additionalProperties", ".KEY")):
        held = value.get(key)
        if isinstance(held, dict) and _sections(held):
            return held, on
    return value, ""


class _Page:
    """The sections of a reference page; each definition is shown once.

    Args:
        defs: Definitions of the schema.
    """

    def __init__(self, defs: Node) -> None:
        self._defs, self._seen = defs, set[str]()
        alike: dict[str, list[str]] = {}
        for name, node in defs.items():
            alike.setdefault(node.get("description", name), []).append(name)
        # reference -> common heading of sections that differ in their dimension only
        self._general = {
            f"#/$defs/{name}": str(defs[name]["title"]).partition(" ")[2]
            for names in alike.values()
            if len(names) > 1
            for name in names
        }

    def section(
        self, node: Node, path: str, tag: str = "", without: Collection[str] = ()
    ) -> Iterator[str]:
        """The lines of a section and of the sections in it.

        Args:
            node: Its definition.
            path: Its path in the file.
            tag: The value that chooses it among alternatives, such as 'law `gent`'.
            without: Keys that are described elsewhere.
        """
        heading = f"## `{path}`" if path else "## Top level"
        yield from ("", f"{heading} with {tag}" if tag else heading, "")
        yield from (node.get("description", ""), "")
        keys = {key: value for key, value in node["properties"].items() if key not in without}
        yield from self._table(node, keys)
        for key, value in keys.items():
            held, on = inner(value)
            for one in _sections(held):
                yield from self._below(one, f"{path}.{key}".lstrip(".") + on)

    def _table(self, node: Node, keys: Node, own: str = "") -> Iterator[str]:
        yield from ("| key | meaning | value | default |", "|---|---|---|---|")
        for key, value in keys.items():
            required = "*needed*" if key in node.get("required", ()) else ""
            default = f"`{value['default']}`" if value.get("default", "") != "" else required
            held, on = inner(value)
            means = meaning(value) or resolve(held, self._defs).get("description", "")
            what = {"[]": "list of sections", ".KEY": "sections by key"}.get(on) or kind(value)
            for general in {self._general.get(n.get("$ref", "")) for n in _sections(held)} - {None}:
                what = what.replace("section", f"[{general}](#{general})")
            what = "as its key" if own and what == own else what
            yield f"| `{key}` | {means} | {what} | {default} |".replace("  ", " ")

    def _below(self, held: Node, path: str) -> Iterator[str]:
        tagged = variants(held, self._defs)
        if tagged:
            yield from self._variants(tagged, path, held["discriminator"]["propertyName"])
        elif (general := self._general.get(held["$ref"])) is not None:
            if general not in self._seen:
                self._seen.add(general)
                node = resolve(held, self._defs)
                own = next((d for d in map(_dimension, node["properties"].values()) if d), "")
                yield from ("", f"## {general.capitalize()}", "", node["description"], "")
                yield from self._table(node, node["properties"], own)
        elif held["$ref"] not in self._seen:
            self._seen.add(held["$ref"])
            yield from self.section(resolve(held, self._defs), path)

    def _variants(self, tagged: dict[str, Node], path: str, by: str) -> Iterator[str]:
        if self._seen.issuperset(tagged):
            keys = "`, `".join(tagged)
            yield from ("", f"## `{path}`", "", f"Laws and their parameters as above: `{keys}`.")
            return
        first, *others = (variant["properties"] for variant in tagged.values())
        common = {k: v for k, v in first.items() if others and all(o.get(k) == v for o in others)}
        for tag, variant in tagged.items():
            if tag not in self._seen:
                yield from self.section(variant, path, f"{by} `{tag}`", common)
        if common:
            node = {"properties": common, "description": f"Keys that go with each {by}."}
            yield from self.section(node, path, f"any {by}")
        self._seen.update(tagged)
