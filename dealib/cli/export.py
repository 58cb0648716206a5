"""`dealib export`: tables of a device for system simulation, and its FMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer

from dealib.cli.run import explained, watched
from dealib.config.case import Case
from dealib.results.tables import DeviceTables
from dealib.tasks.solving import export_tables


def export(case: Case, out: Path | None, *, fmu: bool, overwrite: bool, resume: bool) -> None:
    """Write the tables of a case, and print an estimate of their interpolation error."""
    directory = out or Path(f"{case.config.directory}-tables")
    given = {"fmu": fmu, "overwrite": overwrite, "resume": resume}
    with explained(directory):
        tables = export_tables(case, directory, tell=typer.echo, **given, **watched())
    typer.echo(_interpolation_error(tables))


def _interpolation_error(tables: DeviceTables) -> str:
    """Estimate of the error between the nodes, by comparison with every other node alone."""
    grids = list(tables.axes.values())
    if any(len(grid) < 5 or len(grid) % 2 == 0 for grid in grids):
        return "an odd number of points, at least 5, on each axis would show the error between them"
    coarse = DeviceTables(
        {n: a[(slice(None, None, 2),) * a.ndim] for n, a in tables.plain().items()}
    )
    nodes = np.meshgrid(*((grid[1:] + grid[:-1]) / 2 for grid in grids), indexing="ij")
    errors = []
    for name, values in tables.duals.items():
        off = np.abs(coarse.dual(name, *nodes) - tables.dual(name, *nodes)).max()
        # the error is of third order, so that half the spacing has an eighth of it
        errors.append(f"{name} {off / np.abs(values).max() / 8:.1e}")
    return f"estimated error between the nodes: {', '.join(errors)} of the largest"
