"""`dealib compare`: a run against measured curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from dealib.data.compare import Comparison, remedy
from dealib.data.names import split_unit
from dealib.data.schema import Selection
from dealib.errors import ConfigError
from dealib.results.reader import Run
from dealib.tasks.measuring import against, selection

_MOST_BRANCHES = 8  # lines of branches that are printed of a curve


def compare_run(
    run: Run,
    files: Sequence[Path],
    wanted: dict[str, Any],
    settings: Sequence[str],
    out: Path | None,
    overwrite: bool,
) -> None:
    """Print RMSE and R2 of each measured curve, and draw it if wanted.

    Args:
        run: The run.
        files: The data.
        wanted: Keys of a `Selection` but `file`, for all files.
        settings: More of them, as KEY=VALUE.
        out: Picture.
        overwrite: Whether it may be there.

    Raises:
        ConfigError: If data and run do not fit, or the picture is in the way.
    """
    if out is not None:
        from dealib.plots.style import FORMATS, check_target

        check_target(out, FORMATS, overwrite)
    found: list[Comparison] = []
    titles: list[str] = []
    for file in files:
        data, curves, history = against(run, file, chosen(file, wanted, settings))
        typer.echo("\n".join([data.account, *table(curves), *_outside(curves, history)]))
        found += curves
        titles += [f"{run.info['name']}, {file.name}"] * len(curves)
    if out is not None:
        from dealib.plots.compare import draw_comparison

        draw_comparison(found, out, history, titles)
        typer.echo(str(out))


def _outside(curves: list[Comparison], history: Mapping[str, Any]) -> list[str]:
    """A line a curve that lies mostly outside the run, with what may be the matter."""
    return [
        f"{c.y_name}: only {c.inside.mean():.0%} of the points lie inside the run's range of "
        f"{c.x_name}{remedy(c.x_name, c.x, history[c.x_name])}"
        for c in curves
        if c.inside.mean() < 0.5
    ]


def chosen(file: Path, wanted: dict[str, Any], settings: Sequence[str]) -> Selection:
    """What is taken from a file, by the options of the command line.

    Raises:
        ConfigError: If an option is wrong.
    """
    keys = dict(wanted)
    for setting in settings:
        key, sign, text = setting.partition("=")
        if not sign or "" in key.strip().split("."):
            raise ConfigError(f"--set {setting}: expected KEY=VALUE, such as prepare.force.sign=-1")
        try:
            keys[key.strip()] = YAML(typ="safe", pure=True).load(text)
        except (YAMLError, ValueError):
            keys[key.strip()] = text
    return selection(file, keys)


def table(comparisons: list[Comparison]) -> list[str]:
    """A line a curve, and a line a branch where there are several."""
    rows = [("curve", "points", "RMSE", "R2")]
    for c in comparisons:
        numbers = np.unique(c.branch)
        rows.append(_row(c.y_name, c))
        if len(numbers) > 1:
            parts = [(int(k) + 1, c.of_branch(int(k))) for k in numbers[:_MOST_BRANCHES]]
            unit = split_unit(c.y_name)[1]
            rows += [_row(f"  branch {k}", p, unit) for k, p in parts if p.inside.any()]
        if len(numbers) > _MOST_BRANCHES:
            rows.append((f"  and {len(numbers) - _MOST_BRANCHES} more", "", "", ""))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    return [
        "  ".join(f"{cell:<{w}}" for cell, w in zip(r, widths, strict=True)).rstrip() for r in rows
    ]


def _row(name: str, c: Comparison, unit: str | None = None) -> tuple[str, str, str, str]:
    inside, total = int(c.inside.sum()), len(c.x)
    points = str(total) if inside == total else f"{inside} of {total}"
    unit = split_unit(c.y_name)[1] if unit is None else unit
    return name, points, f"{c.rmse:.5g} {unit}".rstrip(), f"{c.r2:.6f}"
