"""Reading of benchmarks; their cases form a study, which is solved and drawn like any other."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dealib
from dealib.cases.cache import key
from dealib.config import load
from dealib.config.messages import validate
from dealib.config.source import Source
from dealib.errors import ConfigError, Place, did_you_mean
from dealib.reading import read_text
from dealib.results import spectra
from dealib.study import scope
from dealib.study.plan import Planned, StudyPlan
from dealib.study.schema import Curves, Reference, Study, Window
from dealib.validation.schema import Benchmark, CurveCheck, ReferenceCurve
from dealib.validation.solving import DEVICE, solve

_ROOT = Path(dealib.__file__).parents[1]
SUITE = _ROOT / "configs" / "validation"
_SUFFIX = ".yaml"
_LARGEST = 10_000_000  # bytes of a reference curve


class NoBenchmark(ConfigError):
    """There is no benchmark of a given name."""


@dataclass(frozen=True)
class Definition(StudyPlan):
    """A benchmark as a study of its cases.

    Attributes:
        benchmark: Content of the file.
    """

    benchmark: Benchmark = field(kw_only=True)

    def lacks(self, index: int) -> bool:
        """Whether the reference of a curve is in a file that is missing."""
        panel = self.study.panels[index]
        return isinstance(panel, Curves) and not panel.references

    @property
    def comparable(self) -> bool:
        """Whether there is at least one reference."""
        curves = enumerate(self.benchmark.curves)
        judged = any(c.rms is not None and not self.lacks(k) for k, c in curves)
        return bool(self.benchmark.checks) or judged

    def fault(self, where: Place, problem: str) -> ConfigError:
        """An error that points at a place of the benchmark's file."""
        head, *rest = where
        return super().fault((_IN_FILE.get(str(head), head), *rest), problem)


_IN_FILE = {"windows": "checks", "panels": "curves"}  # the study's name -> that of the benchmark


def find(names: Sequence[str | Path], suite: Path = SUITE) -> list[Path]:
    """The files of benchmarks, given by names, files or folders; by default the whole suite.

    Raises:
        ConfigError: If there is no such benchmark.
    """
    known = {path.stem: path for path in sorted(suite.glob(f"*{_SUFFIX}"))}
    if not names and not known:
        raise ConfigError(f"{suite}: no benchmarks here; name files or a folder")
    found: dict[Path, None] = {}
    for name in names or [suite]:
        path = Path(name)
        if str(name) in known:
            found[known[str(name)]] = None
        elif path.is_dir():
            files = sorted(path.glob(f"*{_SUFFIX}"))
            if not files:
                raise ConfigError(f"{path}: no benchmarks here (files *{_SUFFIX})")
            found |= dict.fromkeys(files)
        elif path.suffix == _SUFFIX or path.exists():
            found[path] = None
        else:
            raise NoBenchmark(f"there is no benchmark {name!r}{did_you_mean(name, known)}")
    return list(found)


def benchmark(path: Path) -> tuple[Benchmark, Source]:
    """Read the file of a benchmark.

    Raises:
        ConfigError: With one message a mistake, each with its place in the file.
    """
    source = Source(path)
    given = validate(Benchmark, source)
    if given.name != path.stem:
        problem = f"a benchmark is called as its file, here {path.stem!r}"
        raise ConfigError(source.message(("name",), problem))
    return given, source


def read(path: Path) -> Definition:
    """Read a benchmark and validate all its cases and expressions.

    Raises:
        ConfigError: With one message a mistake, each with its place in the file.
    """
    given, source = benchmark(path)
    references = [_points(curve, k, source) for k, curve in enumerate(given.curves)]
    study = _study(given, path, references)
    cases = tuple(_case(given, path, label) for label in given.labels)
    found = Definition(study, path, cases, source, benchmark=given)
    scope.check(found)
    return found


def _case(given: Benchmark, path: Path, label: str) -> Planned:
    changes = {"output.fields": "none", **given.cases.get(label, {})}
    try:
        case = load(path, changes, within=DEVICE)
    except ConfigError as error:
        raise ConfigError(f"{error}\n(case {label!r} of {path})") from None
    linear = given.modes or given.spectrum
    table = "" if linear is None else spectra.MODES if given.modes else spectra.RESPONSE
    also = "" if linear is None else linear.model_dump_json()
    known = key(case.config, case.config.output.fields, table + also)
    axes = {"case": label}
    return Planned(label, axes, case.config, path, case.overrides, known, solve, table)


def _study(given: Benchmark, path: Path, references: Sequence[Reference | None]) -> Study:
    panels = []
    for curve, reference in zip(given.curves, references, strict=True):
        panels.append(
            Curves(
                kind="curves",
                title=curve.name,
                where={"case": curve.case or given.labels[0]},
                x=curve.x,
                y=curve.y,
                label="dealib",
                references=() if reference is None else (reference,),
            )
        )
    windows = []
    for check, number in zip(given.checks, given.numbers(), strict=True):
        off = allowed(check.tolerance.given, number)
        windows.append(
            Window(name=check.name, value=check.value, low=number - off, high=number + off)
        )
    return Study(
        name=given.name,
        title=given.title,
        source=given.source,
        base=path.name,
        label="{case}",
        vary={"case": {label: {} for label in given.labels}},
        quantities=given.quantities,
        panels=tuple(panels),
        windows=tuple(windows),
    )


def allowed(tolerance: tuple[str, float], reference: float) -> float:
    """Largest difference from a reference that a tolerance allows, in the quantity's unit."""
    kind, size = tolerance
    return size * abs(reference) if kind == "relative" else size


# --- reference curves ----------------------------------------------------------------------------


def _points(curve: CurveCheck, index: int, source: Source) -> Reference | None:
    """The reference of a curve; None if its file is missing."""
    given = curve.reference
    x, y = given.x, given.y
    if given.file is not None:
        path = _data(given.file, source.path.parent)
        if path is None:
            return None
        x, y = _branch(given, *_columns(path))
        if not x:
            where = ("curves", index, "reference", "branch")
            raise ConfigError(source.message(where, f"{path} has no points on this branch"))
    return Reference(label=given.label, x=x, y=y, style=given.style)


def _data(name: str, beside: Path) -> Path | None:
    """A file of data beside the benchmark or in the folder of data; None if it is missing."""
    folder = Path(os.environ.get("DEALIB_DATA", _ROOT.parent / "shared" / "data"))
    return next((p for p in (beside / name, folder / name) if p.is_file()), None)


def _columns(path: Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The first two columns of a CSV; lines above the first numbers are skipped."""
    rows: list[tuple[float, float]] = []
    lines = read_text(path, "reference curve", _LARGEST).splitlines()
    for number, cells in enumerate(csv.reader(lines), start=1):
        if not cells:
            continue
        try:
            rows.append((float(cells[0]), float(cells[1])))
        except (ValueError, IndexError):
            if rows:
                raise ConfigError(f"{path}:{number}: expected two numbers") from None
    if not rows:
        raise ConfigError(f"{path}: no line with two numbers")
    x, y = zip(*rows, strict=True)
    return x, y


def _branch(given: ReferenceCurve, x: Any, y: Any) -> tuple[Any, Any]:
    top = x.index(max(x))
    part = {"all": slice(None), "loading": slice(top + 1), "unloading": slice(top, None)}
    return x[part[given.branch]], y[part[given.branch]]
