"""`dealib compare`: compare a run with measured curves."""

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

_MOST_BRANCHES = 8  # branches of a curve that are printed


def compare_run(
    run: Run,
    files: Sequence[Path],
    wanted: dict[str, Any],
    settings: Sequence[str],
    out: Path | None,
    overwrite: bool,
) -> None:
    """Print RMSE and R2 of each measured curve, and draw the curves if `out` is given.

    Args:
        run: The run.
        files: The files of data.
        wanted: Keys of a `Selection` without `file`, for all files.
        settings: Further keys, as KEY=VALUE.
        out: Picture.
        overwrite: Replace the picture if it exists.

    Raises:
        ConfigError: If data and run cannot be compared, or the picture exists already.
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
    """A warning for each curve that lies mostly outside the run, with a likely reason."""
    return [
        f"{c.y_name}: only {c.inside.mean():.0%} of the points lie inside the run's range of "
        f"{c.x_name}{remedy(c.x_name, c.x, history[c.x_name])}"
        for c in curves
        if c.inside.mean() < 0.5
    ]


def chosen(file: Path, wanted: dict[str, Any], settings: Sequence[str]) -> Selection:
    """The selection of data in a file that options of the command line describe.

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
    """A table with a line for each curve, and for each branch if there are several."""
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
    return aligned(rows)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table with columns of equal width."""
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    return ["  ".join(f"{c:<{w}}" for c, w in zip(r, widths, strict=True)).rstrip() for r in rows]


def _row(name: str, c: Comparison, unit: str | None = None) -> tuple[str, str, str, str]:
    inside, total = int(c.inside.sum()), len(c.x)
    points = str(total) if inside == total else f"{inside} of {total}"
    unit = split_unit(c.y_name)[1] if unit is None else unit
    return name, points, f"{c.rmse:.5g} {unit}".rstrip(), f"{c.r2:.6f}"
