"""`dealib run`: solve a case, show its progress, print its summary."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import typer

from dealib.cli.clock import STARTED
from dealib.config.case import Case
from dealib.config.doubts import warn
from dealib.config.size import refuse_full_disk, size
from dealib.errors import Interrupted, NotConverged
from dealib.log import verbose
from dealib.program import Simulation, simulate
from dealib.results.beside import Beside
from dealib.results.reader import Run
from dealib.results.summary import VERDICTS
from dealib.tasks.arguments import exclude
from dealib.tasks.info import resume_command, summary
from dealib.tasks.progress import Progress
from dealib.units import counted

_COLOURS = dict(zip(VERDICTS, (typer.colors.RED, typer.colors.YELLOW), strict=True))


def run_case(
    case: Case,
    out: Path | None,
    *,
    overwrite: bool,
    resume: bool,
    dry_run: bool,
    beside: Beside | None = None,
) -> None:
    """Run a case, or mesh it only if `dry_run`; print a summary with the run directory."""
    comm = MPI.COMM_WORLD
    exclude(overwrite, resume)
    directory = Path(out or case.config.directory)
    refuse_full_disk(case.config, directory)
    if dry_run:
        simulation = Simulation(case, comm)
        if comm.rank == 0:
            warn(case.config)
            typer.echo(
                f"{case.config.name}: {simulation.unknowns} unknowns, "
                f"{counted(simulation.steps_planned, 'step')}; nothing solved, nothing written\n"
                f"{size(case.config, simulation.unknowns)}"
            )
        return
    with explained(directory):
        result = simulate(
            case, directory, overwrite=overwrite, resume=resume, beside=beside, **watched()
        )
    if comm.rank == 0:
        typer.echo(summary(Run(result.directory, case.config), loud))


def loud(verdict: str, text: str) -> str:
    """A verdict in colour; `typer.echo` removes the colour if the output is not a terminal."""
    return typer.style(text, fg=_COLOURS[verdict], bold=True)


def watched() -> dict[str, Any]:
    """Options of `simulate` that show its progress."""
    shows = MPI.COMM_WORLD.rank == 0 and not verbose()  # the verbose log has the steps itself
    return {"observers": [Progress()] if shows else [], "started": STARTED}


@contextmanager
def explained(directory: Path) -> Iterator[None]:
    """Add to the error of a run that ends early what is kept.

    Raises:
        NotConverged: With the directory of the converged steps.
        Interrupted: With the command that continues the run.
    """
    try:
        yield
    except NotConverged as error:
        raise NotConverged(f"{error}\nThe converged steps are in {directory}") from None
    except Interrupted as error:
        message = f"{error} before the first step"
        if error.everywhere:
            message = f"{error}; what converged is in {directory}"
            message += "\nGo on with: " + resume_command(Run(directory))
        raise Interrupted(message, error.signal, error.everywhere) from None
