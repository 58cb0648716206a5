"""`dealib modes`: frequencies and shapes about states of a program."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import typer

from dealib.cli.plot import default
from dealib.cli.run import solve
from dealib.config.case import Case
from dealib.config.size import refuse_full_disk
from dealib.errors import PlatformError
from dealib.program.modes import Watch, at_rest
from dealib.results import spectra
from dealib.results.reader import Run

log = logging.getLogger(__name__)


def find_modes(
    case: Case,
    stages: Sequence[str],
    along: str | None,
    count: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Run a case, find the modes, write and draw them, and print where they are.

    Raises:
        ConfigError: If a stage or a density is missing, or the directory exists.
        NotConverged: If a step failed; what was found before is kept.
    """
    watch = Watch(stages, along, count)
    still = at_rest(case, [*stages, *([along] if along is not None else [])])
    directory = out or Path(f"{case.config.directory}-modes")
    refuse_full_disk(still.config, directory)
    first = MPI.COMM_WORLD.rank == 0
    try:
        run = solve(still, directory, overwrite=overwrite, look=watch)
    finally:
        if first and watch.rows:
            spectra.write(directory / spectra.MODES, watch.rows)
        if first and watch.curve:
            spectra.write(directory / spectra.FREQUENCIES, watch.curve)
    watch.check()
    if first:
        spectra.write_shapes(run)
        pictures = _draw(run, along)
        typer.echo("\n".join([*watch.told(), *map(str, (directory / spectra.MODES, *pictures))]))


def _draw(run: Run, along: str | None) -> list[Path]:
    """Pictures of the shapes of each state and of the curve, as far as the machine can."""
    from dealib.plots import modes, style

    found = []
    with style.theme() as look:
        if along is not None:
            found.append(default([run], "frequencies"))
            style.save(modes.draw_frequencies(run, along, look), found[-1])
        for index, step in enumerate(run.stored_steps):
            if run.modes(index) is None:
                continue
            target = default([run], f"modes-step{step:05d}")
            try:
                style.save(modes.draw_modes(run, step, look), target)
            except PlatformError as error:
                log.warning("%s; the pictures of the shapes are left out", error)
                return found
            found.append(target)
    return found
