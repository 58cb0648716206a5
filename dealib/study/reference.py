"""The reference page of studies, made from their schema and the tables of functions."""

from __future__ import annotations

from collections.abc import Iterator

from dealib.config.reference import json_schema, kind, meaning, sections
from dealib.observe.quantities import QUANTITIES
from dealib.study.expressions import COMMON, KINDS, OF_A_CASE, OF_ALL_CASES
from dealib.study.schema import MaterialTest, Study

_HEAD = """\
# All keys of a study

Made by `dealib schema --of study --reference` from the schema and the functions that
`dealib study` uses. The keys of the config that is varied are in [configs](../REFERENCE.md)."""

_EXPRESSIONS = """
## Expressions

They contain numbers, names, `+ - * / **` (exponents up to 64), brackets and functions; texts are in
double quotes. An infinite or undefined value is an error; only `at` may have no value.

- Over one case, in `quantities` and in `x` and `y` of panels of kind `curves`: names are columns
  of history.csv, or `stretch`, `strain`, `stress_MPa` of a `material_test`.
- Over all cases, in `windows`, in panels of kind `points` and in the braces of `comparison`: names
  are those of `quantities`, each an array with a value for each case that `where` selects.

| function | gives | over one case | over all cases |
|---|---|---|---|"""


def reference() -> str:
    """The page of all keys, functions and columns, in Markdown."""
    lines = [_HEAD, *sections(Study), *_material_test(), _EXPRESSIONS, *_functions(), *_columns()]
    return "\n".join(lines) + "\n"


def _material_test() -> Iterator[str]:
    schema = json_schema(MaterialTest)
    yield from ("", "## `material_test`", "", schema["description"], "")
    yield from ("| key | meaning | value | default |", "|---|---|---|---|")
    for key, value in schema["properties"].items():
        default = f"`{value['default']}`" if "default" in value else "*needed*"
        yield f"| `{key}` | {meaning(value)} | {kind(value)} | {default} |".replace("  ", " ")


def _functions() -> Iterator[str]:
    for name, (_, gives) in COMMON.items():
        yield f"| `{name}(values)` | {gives} | x | x |"
    for name, known in {**OF_A_CASE, **OF_ALL_CASES}.items():
        one, every = ("x" if name in scope else "" for scope in (OF_A_CASE, OF_ALL_CASES))
        call = f"{name}({', '.join(known.arguments)})"
        yield f"| `{call}` | {known.meaning} | {one} | {every} |".replace("  ", " ")
    yield from ("", "| argument | what |", "|---|---|")
    yield from (f"| `{name}` | {what} |" for name, what in KINDS.items())


def _columns() -> Iterator[str]:
    yield from ("", "## Columns of history.csv", "")
    yield "Not every run has all of them. If a device has several ports of a kind, each has its own"
    yield "column with its name at the end, such as `voltage_kV.left`; a capacitance has the names"
    yield "of a pair, `capacitance_pF.left.right`. Probes add further columns."
    yield from ("", "| column | what | unit | needs |", "|---|---|---|---|")
    for q in QUANTITIES:
        of = f", of each {q.kind.name}" if q.kind is not None else ""
        yield f"| `{q.name}` | {q.label}{of} | {q.unit} | {q.needs.text} |".replace("  ", " ")
