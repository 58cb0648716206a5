"""Messages from pydantic's errors: what is wrong, where, and what was expected."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from dealib.config.source import Source
from dealib.errors import ConfigError, Place, ValueAt, by_caller, did_you_mean
from dealib.reading import shown
from dealib.units import parse

Model = TypeVar("Model", bound=BaseModel)

_EXPECTED = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "string": "text",
    "tuple": "a list",
    "list": "a list",
    "dict": "a mapping of keys",
    "model": "a mapping of keys",
}
_LIMITS = {
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "multiple_of": "must be a multiple of {multiple_of:g}",
    "finite_number": "must be finite",
}


def validate(model: type[Model], source: Source) -> Model:
    """Validate a parsed file against a model.

    Args:
        model: The schema.
        source: The file and its overrides.

    Raises:
        ConfigError: With one message for each mistake and its place in the file.
    """
    tree = plain(source.tree)
    _refuse_other_kinds(model.__name__, tree, source.path)
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        found: dict[str, None] = {}
        errors = error.errors()
        misspelt = [item for item in errors if item["type"] == "extra_forbidden"]
        for item in errors:
            if item["type"] == "too_short" and any(_within(i["loc"], item["loc"]) for i in errors):
                continue  # only because its wrong items were left out
            if item["type"] == "missing" and any(_meant(m, item["loc"], model) for m in misspelt):
                continue  # the key is given under a misspelt name
            where = in_file(item, tree)
            if item["type"] in _WRONG_TYPES and any(_other(i, item, where, tree) for i in errors):
                continue  # another alternative of the union fits better, with a mistake inside
            at: Literal["key", "value"] = "key" if item["type"] == "extra_forbidden" else "value"
            said = problem({**item, "input": _given(tree, where, item)}, model)
            if item["type"] == "extra_forbidden" and _POISSON.fullmatch(str(where[-1])):
                said = _by_moduli(_given(tree, where[:-1], {}), str(where[-1]))
            found[source.message(where, said, at)] = None
        raise ConfigError("\n".join(found)) from None


# schema -> name of the kind of file, keys that only this kind has, command that reads it
_KINDS = {
    "Config": ("config", {"geometry", "materials", "mesh", "physics", "solver"}, "run"),
    "Study": ("study", {"title", "vary", "quantities", "panels", "windows"}, "study"),
    "Fit": ("fit", {"parameters", "data", "method"}, "calibrate"),
    "Design": ("design", {"variables", "quantities", "maximise", "minimise"}, "optimise"),
    "Benchmark": ("benchmark", {"device", "checks", "curves", "obtained"}, "validate"),
}

_IN_PYTHON = {"run": "simulate", "study": "run_study"}  # other functions are named as the command


def _refuse_other_kinds(wanted: str, tree: Mapping[str, Any], path: Path) -> None:
    """Raise `ConfigError` with one message if a file is of another kind."""
    counts = {name: len(own & tree.keys()) for name, (_, own, _) in _KINDS.items()}
    found = max(counts, key=counts.__getitem__)
    if wanted in counts and counts[found] > counts[wanted]:
        given, _, command = _KINDS[found]
        takes = by_caller(
            f"'dealib {command} {path}'", f"dealib.{_IN_PYTHON.get(command, command)}"
        )
        raise ConfigError(f"{path}: a {given}, not a {_KINDS[wanted][0]}; {takes} takes it")


_WRONG_TYPES = ("tuple_type", "dict_type", "string_type")


def _other(item: Mapping[str, Any], refused: Mapping[str, Any], where: Place, tree: Any) -> bool:
    """Whether an error comes from an alternative of a union that accepts the value's type.

    Args:
        item: The error.
        refused: An error of the value's type.
        where: Place of `refused` in the file.
        tree: The file.
    """
    within = in_file(item, tree)
    matches = item["type"] not in _WRONG_TYPES and item is not refused
    return matches and within[: len(where)] == where


def _within(loc: Place, other: Place) -> bool:
    return len(loc) > len(other) and loc[: len(other)] == other


def _given(tree: Any, where: Place, item: Mapping[str, Any]) -> Any:
    """The value in the file, which pydantic may have seen only after a conversion."""
    try:
        for part in where:
            tree = tree[part]
    except (KeyError, IndexError, TypeError):
        return item.get("input")
    return tree


def plain(node: Any) -> Any:
    """A ruamel tree as plain dicts and lists."""
    if isinstance(node, Mapping):
        return {str(k): plain(v) for k, v in node.items()}
    return [plain(v) for v in node] if isinstance(node, list) else node


def problem(item: Mapping[str, Any], model: type[BaseModel] | None = None) -> str:
    """The message for one of pydantic's errors.

    Args:
        item: Details of the error.
        model: The schema, for the keys and descriptions that it has at this place.
    """
    kind, given, ctx = item["type"], item.get("input"), item.get("ctx", {})
    if kind == "extra_forbidden":
        return f"unknown key{_hint(item, model)}"
    if kind == "missing" and isinstance(item["loc"][-1], int):
        return "too few items"
    if kind == "missing":
        return f"this key is missing{_meaning(model, item['loc'])}"
    if kind == "union_tag_not_found":
        tag = ctx["discriminator"].strip("'")
        fields = [m.model_fields[tag] for m in _models_at(model, item["loc"])]
        known = list(dict.fromkeys(str(a) for f in fields for a in get_args(f.annotation)))
        return f"the key {tag!r} is missing; one of {', '.join(known)}"
    if kind == "union_tag_invalid":
        tag, known = ctx["discriminator"].strip("'"), _words(ctx["expected_tags"])
        return f"unknown {tag} {ctx['tag']!r}{did_you_mean(ctx['tag'], known)}"
    if kind == "literal_error":
        return f"{_shown(given)} is not allowed{did_you_mean(given, _words(ctx['expected']))}"
    if kind == "value_error":
        return str(ctx["error"])
    if kind in _LIMITS:
        return f"{_LIMITS[kind].format(**ctx)}, not {_shown(given)}"
    if kind in ("too_short", "too_long"):
        return _length(ctx)
    if kind == "string_too_short":
        return "must not be empty"
    if kind == "string_pattern_mismatch":
        return f"{_shown(given)} is not a name; use a letter, then letters, digits, '_' and '-'"
    expected = _EXPECTED.get(kind.split("_")[0], "another kind of value")
    hint = ""
    if expected == "text" and isinstance(given, (int, float)):
        hint = f"; put it in quotes: '{given}'"
    return f"expected {expected}, not {_shown(given)}{hint}"


def _length(ctx: Mapping[str, Any]) -> str:
    """The message for a list with too few or too many items."""
    least, most, given = ctx.get("min_length"), ctx.get("max_length"), ctx["actual_length"]
    if not given:
        return "must not be empty"
    wanted = f"at least {least}" if most is None else f"at most {most}"
    return f"expected {wanted} items, not {given}"


def _hint(item: Mapping[str, Any], model: type[BaseModel] | None) -> str:
    """A hint at the key that an unknown one may stand for."""
    known = [n for m in _models_at(model, item["loc"][:-1]) for n in m.model_fields]
    return did_you_mean(str(item["loc"][-1]), list(dict.fromkeys(known)))


_POISSON = re.compile(r"nu|poissons?(_?ratio)?", re.IGNORECASE)


def _by_moduli(material: Any, key: str) -> str:
    """The message for a Poisson's ratio nu: give two moduli instead of E and nu."""
    said = "unknown key; give shear_modulus = E / (2 (1 + nu)), bulk_modulus = E / (3 (1 - 2 nu))"
    try:
        nu, E = float(material[key]), parse(material["youngs_modulus"], "stress")
    except (KeyError, TypeError, ValueError):
        return f"{said}; youngs_modulus alone means nu = 0.49"
    if not 0 <= nu < 0.5:
        return f"{said}; nu must be below 0.5, for incompressible rubber such as 0.499"
    return f"{said}, here {E / (2 + 2 * nu):.4g} MPa and {E / (3 - 6 * nu):.4g} MPa"


def _meant(item: Mapping[str, Any], loc: Place, model: type[BaseModel]) -> bool:
    """Whether an unknown key is a missing one of the same section, misspelt."""
    same = item["loc"][:-1] == loc[:-1]
    return same and _hint(item, model) == f"; did you mean {loc[-1]!r}?"


def _shown(given: Any) -> str:
    """A value for use in a sentence."""
    if given is None:
        return "nothing"
    if isinstance(given, bool):
        return str(given).lower()
    if isinstance(given, (str, int, float)):
        return shown(repr(given))
    if isinstance(given, (dict, list)):
        return "a mapping" if isinstance(given, dict) else "a list"
    return f"a {type(given).__name__}"


def _words(listing: str) -> list[str]:
    """The words of a list of pydantic such as "'a', 'b' or 'c'"."""
    return [
        w.strip(" '") for w in listing.replace("' or '", "', '").replace(" or ", ",").split(",")
    ]


def in_file(item: Mapping[str, Any], tree: Any) -> Place:
    """Path in the file: pydantic's location without tags of unions and indices of lone values."""
    where: list[int | str] = []
    node, loc, kind = tree, item["loc"], item["type"]
    for depth, part in enumerate(loc):
        last = depth == len(loc) - 1
        if isinstance(node, Mapping):
            inside = part in node
        else:
            inside = isinstance(node, list) and isinstance(part, int) and part < len(node)
        if inside:
            where.append(part)
            node = node[part]
        elif last and kind == "missing" and isinstance(part, str):
            where.append(part)
    if kind == "union_tag_invalid":
        where.append(item["ctx"]["discriminator"].strip("'"))
    if kind == "value_error" and isinstance(item["ctx"]["error"], ValueAt):
        where.extend(item["ctx"]["error"].where)
    return tuple(where)


def _models_at(model: type[BaseModel] | None, loc: Iterable[int | str]) -> list[type[BaseModel]]:
    """The models that the schema allows at a location."""
    kinds = [] if model is None else [model]
    for part in loc:
        fields = [m.model_fields[part] for m in kinds if part in m.model_fields]
        fields = fields or [m.model_fields["root"] for m in kinds if "root" in m.model_fields]
        if fields:
            kinds = [m for f in fields for m in _models_in(f.annotation)]
        elif isinstance(part, str):  # the tag of a union, or a key that the user chose
            kinds = [m for m in kinds if part in _literals(m)] or kinds
    return kinds


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for arg in get_args(annotation) for m in _models_in(arg)]


def _literals(model: type[BaseModel]) -> set[str]:
    """All values of a model's literals."""
    found = [get_args(f.annotation) for f in model.model_fields.values()]
    return {a for args in found for a in args if isinstance(a, str)}


def _meaning(model: type[BaseModel] | None, loc: Place) -> str:
    """Description and example of a missing key."""
    fields = [m.model_fields.get(str(loc[-1])) for m in _models_at(model, loc[:-1])]
    for field in filter(None, fields):
        means, example = field.description or "", _example(field)
        such_as = f"such as '{example}'" if example else ""
        text = "; ".join(t for t in (means, such_as) if t)
        return f": {text}" if text else ""
    return ""


def _example(field: FieldInfo) -> str:
    """An example of a quantity with its unit; empty for other kinds of values."""
    for note in field.metadata:
        schema = getattr(note, "json_schema", None)
        if isinstance(schema, dict) and schema.get("examples"):
            return str(schema["examples"][0])
    return ""
