"""`dealib export`: tables of a device for system simulation, and its FMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer

from dealib.cli.run import solve
from dealib.config.case import Case
from dealib.config.size import refuse_full_disk
from dealib.errors import ConfigError
from dealib.export.fmu import compiler, write_fmu
from dealib.program.tables import tables_case
from dealib.results.tables import Tables, collect


def export(case: Case, out: Path | None, *, fmu: bool, overwrite: bool, resume: bool) -> None:
    """Solve the states of a config's tables, and write the tables beside them, and an FMU.

    Raises:
        ConfigError: If the config has no `tables`, or the directory exists.
        NotConverged: If a state failed; the others are kept.
        PlatformError: If an FMU cannot be compiled.
    """
    if overwrite and resume:
        raise ConfigError("--overwrite and --resume exclude each other")
    walk = tables_case(case, fmu)
    if fmu:
        compiler()  # before all the work
    directory = out or Path(f"{case.config.directory}-tables")
    refuse_full_disk(walk.config, directory)
    run = solve(walk, directory, overwrite=overwrite, resume=resume)
    tables = collect(run)
    for path in tables.save(directory):
        typer.echo(str(path))
    typer.echo(_between(tables))
    if fmu:
        path = directory / f"{case.config.name}.fmu"
        typer.echo(f"{path}: {write_fmu(path, run, tables, case.config)}")


def _between(tables: Tables) -> str:
    """How well the tables know what lies between their nodes: against every other node alone."""
    grids = list(tables.axes.values())
    if any(len(grid) < 5 or len(grid) % 2 == 0 for grid in grids):
        return "an odd number of points, at least 5, on each axis would show the error between them"
    coarse = Tables({n: a[(slice(None, None, 2),) * a.ndim] for n, a in tables.plain().items()})
    nodes = np.meshgrid(*((grid[1:] + grid[:-1]) / 2 for grid in grids), indexing="ij")
    errors = []
    for name, values in tables.duals.items():
        off = np.abs(coarse.dual(name, *nodes) - tables.dual(name, *nodes)).max()
        errors.append(f"{name} {off / np.abs(values).max() / 8:.1e}")  # third order in the spacing
    return f"estimated error between the nodes: {', '.join(errors)} of the largest"
