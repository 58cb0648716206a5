"""`dealib compare`: a run against measured curves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer

from dealib.data.compare import Comparison, compare
from dealib.data.measured import read, split_unit
from dealib.results.reader import Run


def compare_run(run: Run, data: Path, stage: str | None, out: Path | None, overwrite: bool) -> None:
    """Print RMSE and R2 of each measured curve, and draw it if wanted.

    Raises:
        ConfigError: If data and run do not fit, or the picture is in the way.
    """
    if out is not None:
        from dealib.plots.style import FORMATS, check_target

        check_target(out, FORMATS, overwrite)
    history = {str(name): run.history[name].to_numpy() for name in run.history}
    numeric = [name for name, values in history.items() if values.dtype.kind in "fi"]
    found = compare(history, read(data, numeric), stage)
    typer.echo("\n".join(table(found)))
    if out is not None:
        from dealib.plots.compare import draw_comparison

        draw_comparison(found, out, history, [f"{run.info['name']}, {data.name}"] * len(found))
        typer.echo(str(out))


def table(comparisons: list[Comparison]) -> list[str]:
    """A line a curve, and a line a branch where there are several."""
    rows = [("curve", "points", "RMSE", "R2")]
    for c in comparisons:
        numbers = np.unique(c.branch)
        rows.append(_row(c.y_name, c))
        if len(numbers) > 1:
            for k in numbers:
                part = c.of_branch(int(k))
                if part.inside.any():
                    rows.append(_row(f"  branch {int(k) + 1}", part, split_unit(c.y_name)[1]))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    return [
        "  ".join(f"{cell:<{w}}" for cell, w in zip(r, widths, strict=True)).rstrip() for r in rows
    ]


def _row(name: str, c: Comparison, unit: str | None = None) -> tuple[str, str, str, str]:
    inside, total = int(c.inside.sum()), len(c.x)
    points = str(total) if inside == total else f"{inside} of {total}"
    unit = split_unit(c.y_name)[1] if unit is None else unit
    return name, points, f"{c.rmse:.5g} {unit}".rstrip(), f"{c.r2:.6f}"
