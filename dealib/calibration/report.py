"""The results of a fit as text, CSV, Markdown, HTML and pictures."""

from __future__ import annotations

import base64
import csv
import html
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.calibration.reach import LEAST, inside, mirrored
from dealib.calibration.task import FitResult
from dealib.data.names import split_unit
from dealib.files import write_text

if TYPE_CHECKING:
    import pandas

Table = tuple[Sequence[str], list[Sequence[str]]]
PICTURE = "curves.png"
_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;"
    "color:#222;background:#fff}table{border-collapse:collapse;margin:1rem 0}"
    "th,td{padding:.25rem .9rem;text-align:left;border-bottom:1px solid #ddd}.bad{color:#b00}"
    "table{display:block;overflow-x:auto}img{max-width:100%}@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}"
    "td,th{border-color:#444}img{background:#fff}.bad{color:#f66}}"
)


@dataclass(frozen=True, repr=False)
class Fitted:
    """A fit and its report.

    Attributes:
        name: Name of the fit.
        description: Description in one line.
        found: Result of the search.
        before: Combinations of parameters that the data hardly determine at the start, in words.
        notes: Further notes for the reader.
        tables: Further tables by heading.
        files: Texts of further files by name.
        draw: Draws the curves into a file.
        material: Entry for a library, of a coupon fit.
        directory: Directory of the report, once it is written.
    """

    name: str
    description: str
    found: FitResult
    before: list[str]
    notes: list[str]
    tables: dict[str, Table]
    files: dict[str, str]
    draw: Callable[[Path], None]
    material: dict[str, Any] | None = None
    directory: Path | None = None

    def __repr__(self) -> str:
        return f"<Fitted {self.name}: {headline(self)}>"

    @property
    def failures(self) -> list[str]:
        """Why the fit is no success; empty if it is one."""
        return failures(self.found)

    @property
    def table(self) -> pandas.DataFrame:
        """The parameters with their values, errors, intervals and units."""
        import pandas as pd

        columns = ("value", "error", "low", "high", "unit")
        rows = {e.key: [getattr(e, n) for n in columns] for e in self.found.estimates}
        return pd.DataFrame.from_dict(rows, orient="index", columns=list(columns))


def write_report(fitted: Fitted, directory: Path) -> None:
    """Write all files of a fit into its directory."""
    fitted.draw(directory / PICTURE)
    _write_csv(directory / "parameters.csv", parameters(fitted.found, exact=True))
    _write_csv(directory / "correlation.csv", correlation(fitted.found))
    for k, c in enumerate(c for found in fitted.found.comparisons for c in found):
        columns = (c.x_name, f"measured_{c.y_name}", f"computed_{c.y_name}")
        numbers = zip(c.x, c.measured, c.computed, strict=True)
        rows: list[Sequence[str]] = [[repr(float(v)) for v in row] for row in numbers]
        _write_csv(directory / f"curve_{k}.csv", (columns, rows))
    for name, text in fitted.files.items():
        write_text(directory / name, text)
    write_text(directory / "report.txt", as_text(fitted) + "\n")
    write_text(directory / "report.md", _markdown(fitted))
    write_text(directory / "report.html", _html(fitted, directory / PICTURE))


def headline(fitted: Fitted) -> str:
    """Whether the fit succeeded, or why not."""
    failed = failures(fitted.found)
    return "NO SUCCESS: " + " ".join(failed) if failed else "the fit succeeded"


def failures(found: FitResult) -> list[str]:
    """Why a fit is no success; empty if it is one."""
    said = []
    if not found.converged:
        said.append(f"The search did not come to its end: {found.message}")
    if bound := [e.key for e in found.estimates if e.bound]:
        said.append(f"At its bound (widen it, or take the parameter out): {', '.join(bound)}.")
    if open_ := [e.key for e in found.estimates if e.open and not e.bound]:
        said.append(f"Not determined by these data: {', '.join(open_)}.")
    for series, comparisons in zip(found.task.series, found.comparisons, strict=True):
        for c in comparisons:
            what = f"{series.title}, {c.y_name}"
            if c.r2 < 0 and c.rmse > 2 * series.sigma[c.y_name]:
                sign = ", and the sign looks mirrored" if mirrored(c) else ""
                said.append(f"{what}: R2 is {c.r2:.3g}, worse than a constant{sign}.")
            if inside(c) < LEAST:
                said.append(f"{what}: only {int((~c.beyond).sum())} points lie inside the run.")
    return said


def parameters(found: FitResult, exact: bool = False) -> Table:
    """Best values with their intervals."""
    level = f"{found.task.confidence:.0%}"
    head = ("parameter", "value", "standard error", f"{level} low", f"{level} high", "unit")

    def number(value: float) -> str:
        return repr(value) if exact else f"{value:.6g}"

    return head, [
        (e.key, number(e.value), number(e.error), number(e.low), number(e.high), e.unit)
        for e in found.estimates
    ]


def correlation(found: FitResult) -> Table:
    """Correlation of the parameters."""
    keys = [e.key for e in found.estimates]
    last = [key.rpartition(".")[2] for key in keys]
    heads = last if len(set(last)) == len(last) else keys  # whole keys make a wide table
    rows: list[Sequence[str]] = [
        (key, *(f"{value:.4f}" for value in row))
        for key, row in zip(keys, found.correlation, strict=True)
    ]
    return ("", *heads), rows


def quality(found: FitResult) -> Table:
    """RMSE and R2 of each curve, and its noise."""
    rows: list[Sequence[str]] = []
    for series, comparisons, noise in zip(
        found.task.series, found.comparisons, found.noise, strict=True
    ):
        for c, n in zip(comparisons, noise, strict=False):
            unit = split_unit(c.y_name)[1]
            rmse = f"{c.rmse:.5g} {unit}".strip()
            points = (str(len(c.x)), rmse, f"{c.r2:.6f}", f"{n.correlation:.2f}", f"{n.points:.0f}")
            rows.append((series.title, c.y_name, *points))
    worth = ("correlation of neighbours", "independent points")
    return ("data", "curve", "points", "RMSE", "R2", *worth), rows


def remarks(fitted: Fitted) -> list[str]:
    """Remarks on the quality of the fit, for the report."""
    found = fitted.found
    said = [
        f"{found.points} data points, {found.evaluations} evaluations; reduced chi-square "
        f"{found.reduced_chi2:.4g}.",
        *fitted.notes,
        f"The search ended so: {found.message}",
    ]
    for series, comparisons in zip(found.task.series, found.comparisons, strict=True):
        for c in comparisons:
            if c.beyond.any():
                said.append(
                    f"{series.title}, {c.y_name}: the run does not reach {int(c.beyond.sum())} of "
                    f"{len(c.x)} points; its curve was continued straight."
                )
    strong = np.abs(found.correlation - np.eye(len(found.estimates))) > 0.95
    for i, j in np.argwhere(np.triu(strong)):
        a, b = found.estimates[i].key, found.estimates[j].key
        said.append(f"{a} and {b} are strongly correlated: these data hardly tell them apart.")
    said += [f"At the start: {line}" for line in fitted.before]
    said += [f"At the best fit: {line}" for line in found.unseen]
    if bent := [e.key for e in found.estimates if e.bent]:
        said.append(
            f"The linear intervals of {', '.join(bent)} mislead; method.intervals: profile finds "
            "better ones."
        )
    return said


def _blocks(fitted: Fitted) -> dict[str, Table]:
    found = fitted.found
    blocks = {"Parameters": parameters(found)}
    if len(found.estimates) > 1:
        blocks["Correlation"] = correlation(found)
    return {**blocks, "Curves": quality(found), **fitted.tables}


def as_text(fitted: Fitted) -> str:
    """The report for a terminal."""
    blocks = [f"{fitted.name}: {headline(fitted)}"]
    blocks += [f"{name}\n{_columns(table)}" for name, table in _blocks(fitted).items()]
    return "\n\n".join([*blocks, "\n".join(remarks(fitted))])


def _columns(table: Table) -> str:
    head, rows = table
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = ["  ".join(f"{c:<{w}}" for c, w in zip(r, widths, strict=True)) for r in (head, *rows)]
    return "\n".join(line.rstrip() for line in lines)


def _markdown(fitted: Fitted) -> str:
    def table(found: Table) -> str:
        head, rows = found
        lines = ["| " + " | ".join(row) + " |" for row in (head, *rows)]
        return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])

    blocks = [f"# Fit {fitted.name}", fitted.description, f"**{headline(fitted)}**"]
    for name, found in _blocks(fitted).items():
        blocks += [f"## {name}", table(found)]
    blocks += [f"![measured and computed curves]({PICTURE})"]
    blocks += ["\n".join(f"- {r}" for r in remarks(fitted))]
    return "\n\n".join(filter(None, blocks)) + "\n"


def _html(fitted: Fitted, picture: Path) -> str:
    def table(found: Table) -> str:
        head, rows = found
        cells = [("th", head), *(("td", row) for row in rows)]
        lines = [
            "<tr>" + "".join(f"<{tag}>{html.escape(c)}</{tag}>" for c in row) + "</tr>"
            for tag, row in cells
        ]
        return "<table>" + "".join(lines) + "</table>"

    image = base64.b64encode(picture.read_bytes()).decode()
    notes = "".join(f"<li>{html.escape(r)}</li>" for r in remarks(fitted))
    title = html.escape(f"Fit {fitted.name}")
    tables = "".join(f"<h2>{name}</h2>{table(t)}" for name, t in _blocks(fitted).items())
    mark = ' class="bad"' if failures(fitted.found) else ""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{title}</h1>"
        f"<p>{html.escape(fitted.description)}</p>"
        f"<p{mark}><strong>{html.escape(headline(fitted))}</strong></p>{tables}"
        f'<img alt="measured and computed curves" src="data:image/png;base64,{image}">'
        f"<ul>{notes}</ul></body></html>\n"
    )


def _write_csv(path: Path, table: Table) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((table[0], *table[1]))
    write_text(path, text.getvalue())
