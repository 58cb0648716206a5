"""`dealib export`: tables of a device for system simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer

from dealib.cli.run import solve
from dealib.config.case import Case
from dealib.config.size import refuse_full_disk
from dealib.errors import ConfigError
from dealib.program.tables import tables_case
from dealib.results.tables import Tables, collect


def export(case: Case, out: Path | None, *, overwrite: bool, resume: bool) -> None:
    """Solve the states of a config's tables, and write the tables beside them.

    Raises:
        ConfigError: If the config has no `tables`, or the directory exists.
        NotConverged: If a state failed; the others are kept.
    """
    if overwrite and resume:
        raise ConfigError("--overwrite and --resume exclude each other")
    walk = tables_case(case)
    directory = out or Path(f"{case.config.directory}-tables")
    refuse_full_disk(walk.config, directory)
    tables = collect(solve(walk, directory, overwrite=overwrite, resume=resume))
    for path in tables.save(directory):
        typer.echo(str(path))
    typer.echo(_between(tables))


def _between(tables: Tables) -> str:
    """How well the tables know what lies between their nodes: against every other node alone."""
    u, v = tables.displacement_mm, tables.voltage_kV
    if min(len(u), len(v)) < 5 or len(u) % 2 == 0 or len(v) % 2 == 0:
        return "an odd number of points, at least 5, on each axis would show the error between them"
    half = {n: a[::2, ::2] if a.ndim == 2 else a[::2] for n, a in tables.plain().items()}
    coarse = Tables(**half)
    U, V = np.meshgrid((u[1:] + u[:-1]) / 2, (v[1:] + v[:-1]) / 2, indexing="ij")
    errors = [
        np.abs(rough - fine).max() / np.abs(known).max() / 8  # of third order in the spacing
        for rough, fine, known in (
            (coarse.force(U, V), tables.force(U, V), tables.force_N),
            (coarse.charge(U, V), tables.charge(U, V), tables.charge_uC),
        )
    ]
    return (
        f"estimated error between the nodes: force {errors[0]:.1e}, charge {errors[1]:.1e} "
        "of the largest"
    )
