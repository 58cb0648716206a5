"""`dealib validate`: solve benchmarks, compare them with their references, write table and page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dealib.cases.cache import Cache
from dealib.errors import ConfigError, DealibError, did_you_mean
from dealib.files import guarded, write_text
from dealib.tasks.jobs import watcher
from dealib.tasks.studies import draw_panels, solve
from dealib.validation import suite
from dealib.validation.definition import NoBenchmark
from dealib.validation.page import KINDS, good, number, page, tally
from dealib.validation.rows import LACKING, OUTSIDE, WITHIN, Row, against, others
from dealib.validation.suite import BenchmarkResult
from dealib.versions import version_line

_WIDTH = 150  # characters of the table's width if the output is not a terminal


class OutsideTolerance(DealibError):
    """A result is not within the tolerance of its reference."""

    exit_code = 1


def run_validation(
    names: Sequence[str],
    kind: str | None,
    out: Path,
    cache: Path,
    jobs: int | None,
    retry: bool,
    other: Path | None,
) -> None:
    """Solve and compare benchmarks, or compare the numbers of another code.

    Raises:
        OutsideTolerance: If a number is not within its tolerance.
        NotConverged: If a case has failed.
        ConfigError: If a file is wrong.
    """
    if kind not in (None, *KINDS):
        raise ConfigError(f"--kind {kind}: unknown{did_you_mean(kind, list(KINDS))}")
    theirs = {} if other is None else others(other)
    named = names or list(dict.fromkeys(name for name, _ in theirs))
    try:
        given, store = suite.definitions(named, kind), Cache(cache)
    except NoBenchmark as error:
        raise ConfigError(f"{other}: {error}" if other and not names else str(error)) from None
    with guarded(out):
        out.mkdir(parents=True, exist_ok=True)
    if other is None:
        failed = solve(
            suite.solvable(given), store, jobs, retry, typer.echo, watcher, of="benchmark"
        )
        found = suite.evaluated(given, store, failed)
        rows, code = [row for one in found for row in one.rows], "dealib"
    else:  # nothing is solved; dealib's numbers are shown where they are in the cache
        found = suite.evaluated(given, store, {}, whole=True)
        known = [row for one in found for row in one.rows]
        code = other.name if other.stem == "dealib" else other.stem
        rows = against(known, theirs, other)
    _write(found, rows, out, code)
    if other is None:
        suite.check(found)
    if not good(rows):
        wrong = [f"  {r.benchmark}: {r.quantity}: {r.told}" for r in rows if r.verdict == OUTSIDE]
        lacking = sum(r.verdict == LACKING for r in rows)
        head = f"{len(wrong)} of {len(rows)} quantities are outside their tolerance"
        head += f", and {lacking} without a value" if lacking else ""
        raise OutsideTolerance("\n".join([head, *wrong]))


def _write(found: Sequence[BenchmarkResult], rows: Sequence[Row], out: Path, code: str) -> None:
    """Print the table; write it as CSV, JSON and an HTML page, and print these files."""
    import pandas as pd

    _print(rows, code)
    typer.echo(tally(rows))
    records = [row.record() for row in rows]
    stem = "results" if code == "dealib" else f"against-{code}"
    write_text(out / f"{stem}.csv", pd.DataFrame(records).to_csv(index=False))
    for record in records:  # JSON has no NaN
        record |= {k: None for k, v in record.items() if v != v}
    text = json.dumps({"code": code, "versions": version_line(), "results": records}, indent=1)
    write_text(out / f"{stem}.json", text + "\n")
    versions = version_line() if code == "dealib" else ""
    write_text(out / f"{stem}.html", page(found, rows, _pictures(found), versions, code))
    for suffix in ("csv", "json", "html"):
        typer.echo(str(out / f"{stem}.{suffix}"))


def _pictures(found: Sequence[BenchmarkResult]) -> dict[str, str]:
    pictures = {}
    for one in found:
        if one.results is not None and (drawn := draw_panels(one.results)) is not None:
            pictures[one.definition.study.name] = drawn[0]
    return pictures


def _print(rows: Sequence[Row], code: str) -> None:
    table = Table(box=None, pad_edge=False)
    for name in ("benchmark", "quantity", "unit"):
        table.add_column(name, overflow="fold")
    for name in (code, "reference", "difference", "tolerance"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("")
    before = ""
    for row in rows:
        style = "" if row.verdict == WITHIN else "bold red" if row.verdict == OUTSIDE else "dim"
        name = "" if row.benchmark == before else row.benchmark
        before = row.benchmark
        numbers = (number(row.value), number(row.reference), row.told, row.tolerance)
        cells = (name, row.quantity, row.unit, *numbers, row.verdict)
        table.add_row(*(Text(cell) for cell in cells), style=style)
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDTH)
    console.print(table)
