"""Reading of a study: its cases, each with a validated config and the key of its results."""

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
from dealib.errors import ConfigError, Place
from dealib.patience import patience
from dealib.reading import read_bytes
from dealib.study import scope
from dealib.study.schema import MaterialTest, Study, Where

_CASES = 10_000  # largest number of cases of a study; reading a hundred takes some seconds


@dataclass(frozen=True)
class Planned:
    """One case of a study.

    Attributes:
        label: Unique within the study.
        axes: Label of each axis of `vary`.
        work: The config, or the material test.
        base: The file of the base config.
        overrides: 'key=value' changes of it.
        key: Key of all that its results depend on; empty for a material test.
        solve: Function that solves it; None: it is run.
        table: File in its run directory that expressions read; empty: the history.
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
class StudyPlan:
    """A study and its cases.

    Attributes:
        study: The content of the file.
        path: The file.
        cases: The cases.
        source: The file with the positions of its keys.
    """

    study: Study
    path: Path
    cases: tuple[Planned, ...]
    source: Source

    def chosen(self, where: Where) -> list[Planned]:
        """The selected cases."""
        return [case for case in self.cases if selected(case, where)]

    def fault(self, where: Place, problem: str) -> ConfigError:
        """An error that points at a place of the study's file."""
        return ConfigError(self.source.message(where, problem))


def selected(case: Planned, where: Where) -> bool:
    """Whether a case has the labels of a selection."""
    return all(
        case.axes[axis] in ((labels,) if isinstance(labels, str) else labels)
        for axis, labels in where.items()
    )


def read(path: Path) -> StudyPlan:
    """Read a study and validate all its cases.

    Raises:
        ConfigError: With one message for each mistake and its place in a file.
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
    plan = StudyPlan(study, path, tuple(cases), source)
    scope.check(plan)
    return plan


def find(path: Path) -> list[Path]:
    """Find studies.

    Args:
        path: The file of a study, or a folder; other YAML files in a folder are left out.

    Raises:
        ConfigError: If a folder holds no study.
    """
    if not path.is_dir():
        return [path]
    found = sorted(p for p in path.glob("*.yaml") if _is_study(p))
    if not found:
        raise ConfigError(f"{path}: the folder has no study (a *.yaml file with a title)")
    return found


def _is_study(path: Path) -> bool:
    """Whether a file has a key that configs, fits and designs do not have."""
    own = set(Study.model_fields) - set(Config.model_fields) - {"base", "set", "quantities"}
    try:
        text = read_bytes(path, "study", 1_000_000).decode(errors="replace")
    except ConfigError:
        return True  # reading it reports the error
    return not own.isdisjoint(re.findall(r"^(\w+):", text, re.M))


def _grid(study: Study) -> Iterator[tuple[dict[str, str], dict[str, Any]]]:
    """Labels and changes of all combinations of the axes."""
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
    """Insert the labels of a case in a template such as '{law}, {modulus}'."""
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
