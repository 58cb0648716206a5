"""The results of a fit as text, CSV, Markdown, HTML and pictures."""

from __future__ import annotations

import base64
import csv
import html
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dealib.calibration.fit import Fitted
from dealib.config import resolved
from dealib.data.names import split_unit
from dealib.files import write_text

Table = tuple[Sequence[str], list[Sequence[str]]]
_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;"
    "color:#222;background:#fff}table{border-collapse:collapse;margin:1rem 0}"
    "th,td{padding:.25rem .9rem;text-align:left;border-bottom:1px solid #ddd}"
    "table{display:block;overflow-x:auto}img{max-width:100%}@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}"
    "td,th{border-color:#444}img{background:#fff}}"
)


def write_report(fitted: Fitted, directory: Path) -> None:
    """Write all files of a fit into its directory."""
    from dealib.plots.compare import draw_comparison

    fit = fitted.plan.fit
    pairs = [(i, c) for i, found in enumerate(fitted.comparisons) for c in found]
    titles = [fit.data[i].file for i, _ in pairs]
    draw_comparison([c for _, c in pairs], directory / "curves.png", titles=titles)
    _write_csv(directory / "parameters.csv", parameters(fitted, exact=True))
    _write_csv(directory / "correlation.csv", correlation(fitted))
    for k, (_, c) in enumerate(pairs):
        columns = (c.x_name, f"measured_{c.y_name}", f"computed_{c.y_name}")
        numbers = zip(c.x, c.measured, c.computed, strict=True)
        rows: list[Sequence[str]] = [[repr(float(v)) for v in row] for row in numbers]
        _write_csv(directory / f"curve_{k}.csv", (columns, rows))
    best = {e.key: e.value for e in fitted.estimates}
    write_text(directory / "best.yaml", resolved(fitted.plan.case(0, best).config))
    write_text(directory / "report.txt", as_text(fitted) + "\n")
    write_text(directory / "report.md", _markdown(fitted))
    write_text(directory / "report.html", _html(fitted, directory / "curves.png"))


def parameters(fitted: Fitted, exact: bool = False) -> Table:
    """Best values with their intervals."""
    level = f"{fitted.plan.fit.method.confidence:.0%}"
    head = ("parameter", "value", "standard error", f"{level} low", f"{level} high", "unit")

    def number(value: float) -> str:
        return repr(value) if exact else f"{value:.6g}"

    return head, [
        (e.key, number(e.value), number(e.error), number(e.low), number(e.high), e.unit)
        for e in fitted.estimates
    ]


def correlation(fitted: Fitted) -> Table:
    """Correlation of the parameters."""
    keys = [e.key for e in fitted.estimates]
    last = [key.rpartition(".")[2] for key in keys]
    heads = last if len(set(last)) == len(last) else keys  # whole keys make a wide table
    rows: list[Sequence[str]] = [
        (key, *(f"{value:.4f}" for value in row))
        for key, row in zip(keys, fitted.correlation, strict=True)
    ]
    return ("", *heads), rows


def quality(fitted: Fitted) -> Table:
    """RMSE and R2 of each curve."""
    rows: list[Sequence[str]] = []
    for data, found in zip(fitted.plan.fit.data, fitted.comparisons, strict=False):
        for c in found:
            rmse = f"{c.rmse:.5g} {split_unit(c.y_name)[1]}".strip()
            rows.append((data.file, c.y_name, str(len(c.x)), rmse, f"{c.r2:.6f}"))
    return ("data", "curve", "points", "RMSE", "R2"), rows


def remarks(fitted: Fitted) -> list[str]:
    """What a reader must know about the numbers."""
    found = [
        f"{fitted.points} data points, {fitted.evaluations} evaluations, {fitted.solved} cases "
        f"solved; reduced chi-square {fitted.reduced_chi2:.4g}.",
        f"The search ended so: {fitted.message}",
    ]
    for e in fitted.estimates:
        low, high = fitted.plan.fit.parameters[e.key].range
        margin = 1e-3 * (high - low)
        if e.value - low < margin or high - e.value < margin:
            found.append(f"{e.key} is at its bound: widen it, or take the parameter out.")
        elif not np.isfinite(e.error):
            found.append(f"{e.key} is not determined by these data.")
    for data, comparisons in zip(fitted.plan.fit.data, fitted.comparisons, strict=False):
        for c in comparisons:
            if c.beyond.any():
                found.append(
                    f"{data.file}, {c.y_name}: the run does not reach {int(c.beyond.sum())} of "
                    f"{len(c.x)} points; its curve was continued straight."
                )
    strong = np.abs(fitted.correlation - np.eye(len(fitted.estimates))) > 0.95
    for i, j in np.argwhere(np.triu(strong)):
        a, b = fitted.estimates[i].key, fitted.estimates[j].key
        found.append(f"{a} and {b} are strongly correlated: these data hardly tell them apart.")
    return found


def as_text(fitted: Fitted) -> str:
    """The report for a terminal."""
    blocks = [fitted.plan.fit.name, _columns(parameters(fitted))]
    if len(fitted.estimates) > 1:
        blocks.append("correlation\n" + _columns(correlation(fitted)))
    blocks += [_columns(quality(fitted)), "\n".join(remarks(fitted))]
    return "\n\n".join(blocks)


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

    fit = fitted.plan.fit
    blocks = [f"# Fit {fit.name}", fit.description, "## Parameters", table(parameters(fitted))]
    blocks += ["## Correlation", table(correlation(fitted)), "## Curves", table(quality(fitted))]
    blocks += ["![measured and computed curves](curves.png)"]
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

    fit = fitted.plan.fit
    image = base64.b64encode(picture.read_bytes()).decode()
    notes = "".join(f"<li>{html.escape(r)}</li>" for r in remarks(fitted))
    title = html.escape(f"Fit {fit.name}")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{title}</h1><p>{html.escape(fit.description)}</p>"
        f"<h2>Parameters</h2>{table(parameters(fitted))}"
        f"<h2>Correlation</h2>{table(correlation(fitted))}"
        f"<h2>Curves</h2>{table(quality(fitted))}"
        f'<img alt="measured and computed curves" src="data:image/png;base64,{image}">'
        f"<ul>{notes}</ul></body></html>\n"
    )


def _write_csv(path: Path, table: Table) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((table[0], *table[1]))
    write_text(path, text.getvalue())
