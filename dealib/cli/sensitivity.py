"""`dealib sensitivity`: derivatives of results by the numbers of a config."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from mpi4py import MPI

import typer

from dealib.config.case import Case
from dealib.design.sensitivity import Sensitivities, find
from dealib.errors import ConfigError, in_the_way
from dealib.files import guarded
from dealib.results import spectra
from dealib.units import neat


def find_sensitivities(
    case: Case,
    of: Sequence[str],
    key: Sequence[str],
    at: str | None,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Compute the sensitivities of a config; write, draw and print them.

    Raises:
        ConfigError: If an option is wrong, the program is not suited, or the file exists already.
        NotConverged: If a step failed.
    """
    comm = MPI.COMM_WORLD
    directory = out or Path(f"{case.config.directory}-sensitivity")
    path = directory / spectra.SENSITIVITY
    if path.exists() and not overwrite:
        raise ConfigError(in_the_way(path))
    found = find(case, of, key, at, comm)
    if comm.rank > 0:
        return
    with guarded(directory):
        directory.mkdir(parents=True, exist_ok=True)
    spectra.write(path, found.rows)
    typer.echo("\n".join([*told(found), str(path), str(_draw(path, case))]))


def _draw(path: Path, case: Case) -> Path:
    from dealib.plots import design, style

    target = path.with_suffix(".png")
    with style.theme() as look:
        title = case.config.description or case.config.name
        style.save(design.draw_sensitivities(spectra.read(path, "derivative"), title, look), target)
    return target


def told(found: Sensitivities) -> Iterator[str]:
    """A table for each quantity, with the largest sensitivity first."""
    width = max([3, *(len(row["key"]) for row in found.rows)])
    for name, value in found.values.items():
        rows = [row for row in found.rows if row["quantity"] == name and row["derivative"]]
        rows.sort(key=lambda row: -abs(row["logarithmic"] or row["derivative"]))
        yield f"{name} = {neat(value, 6)}"
        head = f"{'value':>10} {'unit':<7} {'derivative':>12}  {'d ln / d ln':>11}"
        yield f"  {'key':<{width}}  {head}"
        for row in rows:
            yield (
                f"  {row['key']:<{width}}  {row['value']:>10.5g} {row['unit']:<7} "
                f"{row['derivative']:>12.5g}  {row['logarithmic']:>z11.4f}"
            )
        others = [r["key"] for r in found.rows if r["quantity"] == name and not r["derivative"]]
        if others:
            yield f"  without influence: {', '.join(others)}"
    for key, why in found.left_out.items():
        yield f"left out: {key}: {why}"
