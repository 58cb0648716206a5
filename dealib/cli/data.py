"""`dealib data`: show how a measured file is read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer

from dealib.cli.compare import aligned, chosen
from dealib.data.read import read
from dealib.data.table import DataTable
from dealib.errors import ConfigError

_DRAWN = 12  # largest number of columns in the picture


def show(
    file: Path,
    settings: Sequence[str],
    x: str | None,
    out: Path | None,
    dark: bool,
    overwrite: bool,
) -> None:
    """Print how a file is read and its columns, and draw them.

    Raises:
        ConfigError: If the file is ambiguous or cannot be read, or the picture exists already.
    """
    from dealib.plots import style

    picture = out or Path(f"{file.stem}-data.png")
    table = read(file, chosen(file, {}, settings).format)
    if not table.columns:
        raise ConfigError(f"{file}: there is no column of numbers")
    abscissa = table.find(x) if x is not None else table.columns[0]
    typer.echo("\n".join([table.account, *described(table)]))
    others = [c for c in table.columns if c.header != abscissa.header][:_DRAWN]
    if others:
        style.check_target(picture, style.FORMATS, overwrite)
        from dealib.plots.data import draw_columns

        with style.theme(dark) as look:
            style.save(draw_columns(abscissa, others, look), picture)
        typer.echo(str(picture))


def described(table: DataTable) -> list[str]:
    """A table of the columns: unit, count of numbers, first, smallest and largest value."""
    rows = [("column", "unit", "numbers", "first", "least", "largest")]
    for c in table.columns:
        values = c.values[np.isfinite(c.values)]
        numbers = (values[0], values.min(), values.max()) if len(values) else (np.nan,) * 3
        first, least, largest = (f"{v:.6g}" for v in numbers)
        rows.append((c.name, c.unit or "none", str(len(values)), first, least, largest))
    return aligned(rows)
