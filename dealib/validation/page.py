"""The page of a suite of benchmarks: self-contained HTML, with curves where there are any."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from dealib.report import rendered
from dealib.validation.rows import OUTSIDE, SKIPPED, WITHIN, Row
from dealib.validation.suite import BenchmarkResult

KINDS = {
    "analytical": "closed forms and differential equations",
    "code": "other codes",
    "measured": "measurements",
}


def number(value: float) -> str:
    """A number of a table."""
    return "" if math.isnan(value) else f"{value:.6g}"


def tally(rows: Sequence[Row]) -> str:
    """How many quantities are within their tolerance, in words."""
    count = Counter(row.verdict for row in rows)
    judged = len(rows) - count[SKIPPED]
    skipped = f"; {count[SKIPPED]} skipped" if count[SKIPPED] else ""
    return f"{count[WITHIN]} of {judged} quantities within their tolerance{skipped}"


def good(rows: Sequence[Row]) -> bool:
    """Whether all that was compared is within its tolerance."""
    return all(row.verdict in (WITHIN, SKIPPED) for row in rows)


def page(
    found: Sequence[BenchmarkResult],
    shown: Sequence[Row],
    pictures: Mapping[str, str],
    versions: str,
    code: str = "dealib",
) -> str:
    """The page as HTML.

    Args:
        found: The benchmarks.
        shown: The rows that are judged.
        pictures: SVG of curves, by the name of the benchmark.
        versions: Versions of the software that computed the numbers.
        code: Name of the code whose numbers are judged.
    """
    own = {row.key: row.value for one in found for row in one.rows}
    entries: list[dict[str, Any]] = []
    for one in found:
        given = one.definition.benchmark
        rows = [row for row in shown if row.benchmark == given.name]
        if rows:
            picture = Markup(pictures.get(given.name, ""))
            entries.append({"given": given, "rows": rows, "picture": picture, "good": good(rows)})
    return rendered(
        Path(__file__).parent,
        entries=entries,
        kinds=[k for k in KINDS if any(e["given"].kind == k for e in entries)],
        words=KINDS,
        tally=tally(shown),
        good=good(shown),
        outside=OUTSIDE,
        number=number,
        versions=versions,
        code=code,
        own=own,
    )
