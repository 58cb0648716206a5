"""`dealib modes`: frequencies and shapes about states of a program."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import typer

from dealib.cli.run import explained, watched
from dealib.config.case import Case
from dealib.errors import PlatformError
from dealib.program.modes import mode_told
from dealib.results import spectra
from dealib.results.reader import Run
from dealib.tasks.pictures import default
from dealib.tasks.solving import modes

log = logging.getLogger(__name__)


def find_modes(
    case: Case,
    stages: Sequence[str],
    along: str | None,
    count: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Compute the modes of a case, draw them and print them (see `tasks.solving.modes`)."""
    directory = out or Path(f"{case.config.directory}-modes")
    with explained(directory):
        run = modes(case, stages, along, count, directory, overwrite=overwrite, **watched())
    if MPI.COMM_WORLD.rank == 0:
        told = [mode_told(dict(row)) for _, row in run.table("modes").iterrows()]
        pictures = _draw(run, along)
        typer.echo("\n".join([*told, *map(str, (directory / spectra.MODES, *pictures))]))


def _draw(run: Run, along: str | None) -> list[Path]:
    """Draw the frequencies, and the shapes of each state if the machine can draw in 3-D."""
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
