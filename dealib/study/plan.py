"""From a study's file to its cases, each with a validated config and a key of its physics."""

from __future__ import annotations

import copy
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dealib.cases.cache import key
from dealib.cases.job import Work
from dealib.config import load
from dealib.config.messages import problem, validate
from dealib.config.names import fault
from dealib.config.schema import Config
from dealib.config.source import Source
from dealib.errors import ConfigError
from dealib.patience import patience
from dealib.reading import read_bytes
from dealib.study import scope
from dealib.study.schema import MaterialTest, Study, Where

_CASES = 10_000  # most of a study, of which a hundred are read in some seconds


@dataclass(frozen=True)
class Planned:
    """One case of a study.

    Attributes:
        label: Unique within the study.
        axes: Label of each axis of `vary`.
        work: What is computed: a config, or a test of a material.
        base: The config's file.
        overrides: 'key=value' changes of it.
        key: Of all that its results depend on; none for a test of a material.
        solve: What solves it; none: it is run.
        table: File of its run directory that expressions read; none: the history.
    """

    label: str
    axes: Mapping[str, str]
    work: Config | MaterialTest
    base: Path
    overrides: tuple[str, ...] = ()
    key: str = ""
    solve: Work | None = None
    table: str = ""


@dataclass(frozen=True)
class Plan:
    """A study and its cases."""

    study: Study
    path: Path
    cases: tuple[Planned, ...]
    source: Source

    def chosen(self, where: Where) -> list[Planned]:
        """The cases that a selection means."""
        return [case for case in self.cases if selected(case, where)]

    def fault(self, where: tuple[str | int, ...], problem: str) -> ConfigError:
        """An error that points at a place of the study's file."""
        return ConfigError(self.source.message(where, problem))


def selected(case: Planned, where: Where) -> bool:
    """Whether a case has the labels of a selection."""
    return all(
        case.axes[axis] in ((labels,) if isinstance(labels, str) else labels)
        for axis, labels in where.items()
    )


def read(path: Path) -> Plan:
    """Read a study and validate all its cases.

    Raises:
        ConfigError: With one message a mistake, each with its place in a file.
    """
    source = Source(path)
    study = validate(Study, source)
    count = math.prod(len(_points(axis)) for axis in study.vary.values())
    if count > _CASES:
        problem = f"{count:.6g} cases; a study has at most {_CASES:,}"
        raise ConfigError(source.message(("vary",), problem, "key"))
    cases: list[Planned] = []
    with patience(f"reading {count} cases of {path}"):
        for axes, changes in _grid(study):
            label = _label(study, axes)
            for text in (label, *axes.values()):
                if wrong := fault(text):
                    raise ConfigError(source.message(("vary",), f"label {text!r}: {wrong}", "key"))
            try:
                cases.append(_case(study, path, label, axes, changes))
            except ConfigError as error:
                raise ConfigError(f"{path}: case {label!r}: {error}") from None
    twice = [label for label, n in Counter(c.label for c in cases).items() if n > 1]
    if twice:
        raise ConfigError(
            source.message(("label",), f"several cases are named {sorted(twice)[0]!r}")
        )
    plan = Plan(study, path, tuple(cases), source)
    scope.check(plan)
    return plan


def find(path: Path) -> list[Path]:
    """The study files that a path means: itself, or all in a folder; configs there are left out.

    Raises:
        ConfigError: If there are none.
    """
    if not path.is_dir():
        return [path]
    found = sorted(p for p in path.glob("*.yaml") if _is_study(p))
    if not found:
        raise ConfigError(f"{path}: no study here (a study is a *.yaml file with a title)")
    return found


def _is_study(path: Path) -> bool:
    """Whether a file has a key that neither configs have nor fits and designs."""
    own = set(Study.model_fields) - set(Config.model_fields) - {"base", "set", "quantities"}
    try:
        text = read_bytes(path, "study", 1_000_000).decode(errors="replace")
    except ConfigError:
        return True  # to read it tells what is wrong
    return not own.isdisjoint(re.findall(r"^(\w+):", text, re.M))


# --- variations ----------------------------------------------------------------------------------


def _grid(study: Study) -> Iterator[tuple[dict[str, str], dict[str, Any]]]:
    """All combinations of the axes: their labels, and the changes they make."""
    axes = [[(name, *point) for point in _points(axis)] for name, axis in study.vary.items()]
    for combination in itertools.product(*axes):
        changes: dict[str, Any] = {}
        for _, _, change in combination:
            changes |= change
        yield {name: label for name, label, _ in combination}, changes


def _points(axis: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    if all(isinstance(v, dict) for v in axis.values()):
        return list(axis.items())
    rows = [dict(zip(axis, row, strict=True)) for row in zip(*axis.values(), strict=True)]
    first = next(iter(axis))
    return [(str(row[first]), row) for row in rows]


def _label(study: Study, axes: Mapping[str, str]) -> str:
    return fill(study.label or ", ".join(f"{{{name}}}" for name in axes) or study.name, axes)


def fill(template: str, axes: Mapping[str, str]) -> str:
    """A template such as '{law}, {modulus}' with the labels of a case."""
    return re.sub(r"\{(\w+)\}", lambda m: axes.get(m[1], m[0]), template)


def _case(
    study: Study, path: Path, label: str, axes: dict[str, str], changes: dict[str, Any]
) -> Planned:
    changes = {**study.set, **changes}
    if study.material_test is not None:
        return _material_test(study.material_test, path, label, axes, changes)
    base = path.parent / str(changes.pop("base", study.base))
    if study.program is not None:
        changes = {"program": study.program, **changes}
    case = load(base, {"output.fields": "stage", **changes})
    known = key(case.config, case.config.output.fields)
    return Planned(label, axes, case.config, base, case.overrides, known)


def _material_test(
    given: dict[str, Any], path: Path, label: str, axes: dict[str, str], changes: dict[str, Any]
) -> Planned:
    tree = copy.deepcopy(given)
    for dotted, value in changes.items():
        _into(tree, dotted.split("."), value, dotted)
    try:
        work = MaterialTest.model_validate(tree)
    except ValidationError as error:
        said = [f"{'.'.join(map(str, i['loc']))}: {problem(i)}" for i in error.errors()]
        raise ConfigError("\n".join(f"material_test.{s}" for s in said)) from None
    return Planned(label, axes, work, path)


def _into(node: Any, parts: list[str], value: Any, dotted: str) -> None:
    """Set a value deep in a tree of mappings and lists."""
    *parents, last = (int(p) if p.isdigit() else p for p in parts)
    try:
        for part in parents:
            node = node.setdefault(part, {}) if isinstance(node, dict) else node[part]
        node[last] = value
    except (KeyError, IndexError, TypeError, AttributeError):
        raise ConfigError(f"{dotted}: there is no such place") from None
