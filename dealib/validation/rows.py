"""Computed quantities of benchmarks beside their references, one row per quantity."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dealib.cases.cache import DONE
from dealib.errors import ConfigError, did_you_mean
from dealib.reading import read_text
from dealib.study.evaluate import Results
from dealib.validation.definition import Definition, allowed

_LARGEST = 10_000_000  # bytes of a file of results
WITHIN, OUTSIDE, SKIPPED, LACKING = "within", "outside", "skipped", "no value"
Key = tuple[str, str]  # benchmark and quantity


@dataclass(frozen=True)
class Row:
    """A quantity of a benchmark.

    Attributes:
        benchmark: Name of the benchmark.
        kind: 'analytical', 'code' or 'measured'.
        quantity: Name of the quantity.
        unit: Unit of the numbers.
        value: Computed value; NaN if there is none.
        reference: Reference value.
        allowed: Largest difference that the tolerance allows.
        tolerance: The tolerance as given, such as '1 %'.
        verdict: 'within', 'outside', 'skipped' or 'no value'.
        note: Why there is no value, or where the tolerance comes from.
    """

    benchmark: str
    kind: str
    quantity: str
    unit: str
    value: float
    reference: float
    allowed: float
    tolerance: str
    verdict: str
    note: str = ""

    @property
    def key(self) -> Key:
        """Benchmark and quantity."""
        return self.benchmark, self.quantity

    @property
    def difference(self) -> float:
        """Value minus reference."""
        return self.value - self.reference

    @property
    def told(self) -> str:
        """The difference as text, in percent if the tolerance is relative."""
        if math.isnan(self.value):
            return ""
        if self.tolerance.endswith("%"):
            return f"{100 * self.difference / abs(self.reference):+.2g} %"
        return f"{self.difference:+.2g}"

    def judged(self, value: float) -> Row:
        """This row with another value and its verdict."""
        near = abs(value - self.reference) <= self.allowed * (1 + 1e-9)
        return replace(self, value=value, verdict=WITHIN if near else OUTSIDE)

    def record(self) -> dict[str, Any]:
        """The row as written to tables."""
        return {**asdict(self), "difference": self.difference}


def rows(definition: Definition, results: Results | None) -> list[Row]:
    """The rows of a benchmark.

    Args:
        definition: The benchmark.
        results: Results of its cases; None if they are not solved.
    """
    failed = [s for s in results.statuses if s.status != DONE] if results else []
    note = "; ".join(f"case {s.case.label!r}: {s.status}" for s in failed)
    there = results if not failed else None
    given = definition.benchmark
    values = [math.nan] * len(given.checks)
    if there is not None:
        values = [v.smallest for v in there.windows[: len(values)]]
    found = []
    for check, number, value in zip(given.checks, given.numbers(), values, strict=True):
        off, told = allowed(check.tolerance.given, number), _told(*check.tolerance.given)
        numbers = (value, number, off, told, LACKING, note or check.because)
        found.append(Row(given.name, given.kind, check.name, check.unit, *numbers))
    for k, curve in enumerate(given.curves):
        if curve.rms is None:
            continue
        name = f"{curve.name}, rms of the differences"
        value = math.nan if there is None else _rms(definition, there, k)
        numbers = (value, 0.0, curve.rms, f"{curve.rms:g}", LACKING, note or curve.because)
        row = Row(given.name, given.kind, name, curve.unit, *numbers)
        if definition.lacks(k):
            lacking = f"{curve.reference.file} is not at hand"
            row = replace(row, verdict=SKIPPED, note=lacking)
        found.append(row)
    return [row if math.isnan(row.value) else row.judged(row.value) for row in found]


def _told(kind: str, size: float) -> str:
    return f"{100 * size:g} %" if kind == "relative" else f"{size:g}"


def _rms(definition: Definition, results: Results, index: int) -> float:
    """Root mean square of the differences of a curve from its reference, within its range."""
    curves = results.curves(index)
    references = definition.study.panels[index].references  # type: ignore[union-attr]
    if not references or not curves:
        return math.nan
    x, y = np.array(references[0].x), np.array(references[0].y)
    order = np.argsort(curves[0].x, kind="stable")
    there, values = curves[0].x[order], curves[0].y[order]
    inside = (x >= there[0]) & (x <= there[-1])
    if inside.mean() < 0.9:
        problem = (
            f"the curve reaches from {there[0]:.4g} to {there[-1]:.4g}, which holds only "
            f"{inside.sum()} of {len(x)} points of the reference"
        )
        raise definition.fault(("curves", index, "x"), problem)
    return float(np.sqrt(np.mean((np.interp(x, there, values) - y)[inside] ** 2)))


# --- numbers of another code ---------------------------------------------------------------------

COLUMNS = ("benchmark", "quantity", "value")


def others(path: Path) -> dict[Key, float]:
    """Read the numbers of another code: a CSV with the columns of `COLUMNS`.

    Raises:
        ConfigError: If it is none.
    """
    lines = read_text(path, "results", _LARGEST).splitlines()
    table = csv.DictReader(lines)
    head = [name.strip() for name in table.fieldnames or ()]
    table.fieldnames = head
    for column in COLUMNS:
        if column not in head:
            wanted = ",".join(COLUMNS)
            raise ConfigError(f"{path}:1: the column {column!r} is missing; expected {wanted}")
    found: dict[Key, float] = {}
    for number, row in enumerate(table, start=2):
        name, quantity, text = ((row[c] or "").strip() for c in COLUMNS)
        if (name, quantity) in found:
            raise ConfigError(f"{path}:{number}: {name}, {quantity!r} is given twice")
        try:
            found[name, quantity] = float(text) if text else math.nan
        except ValueError:
            raise ConfigError(f"{path}:{number}: {text!r} is no number") from None
    if not found:
        raise ConfigError(f"{path}: no results below the head")
    return found


def against(known: Sequence[Row], given: Mapping[Key, float], path: Path) -> list[Row]:
    """The rows for which another code gives values, with these values.

    Args:
        known: Rows of all benchmarks.
        given: Numbers of the other code (see `others`).
        path: File of these numbers, for messages.

    Raises:
        ConfigError: If it names an unknown benchmark or quantity.
    """
    there = {row.key: row for row in known}
    names = {row.benchmark for row in known}
    for name, quantity in given:
        if name not in names:
            raise ConfigError(
                f"{path}: there is no benchmark {name!r}{did_you_mean(name, sorted(names))}"
            )
        if (name, quantity) not in there:
            own = [q for b, q in there if b == name]
            problem = f"{path}: {name} has no quantity {quantity!r}"
            raise ConfigError(f"{problem}{did_you_mean(quantity, own)}")
    found = []
    for key, value in given.items():
        row = replace(there[key], note="")
        found.append(
            replace(row, value=value, verdict=LACKING) if math.isnan(value) else row.judged(value)
        )
    return found
