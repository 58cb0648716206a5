"""`dealib run`: solve a case, show its progress, print its summary."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import typer

from dealib.cli.clock import STARTED
from dealib.cli.info import resume_command, summary
from dealib.cli.progress import Progress
from dealib.config.case import Case
from dealib.config.size import refuse_full_disk, size
from dealib.errors import ConfigError, Interrupted, NotConverged
from dealib.log import verbose
from dealib.program import Observer, Simulation, State, simulate
from dealib.results.beside import Beside
from dealib.results.reader import Run
from dealib.units import counted


def run_case(
    case: Case,
    out: Path | None,
    *,
    overwrite: bool,
    resume: bool,
    dry_run: bool,
    beside: Beside | None = None,
) -> None:
    """Run a case and print where its results are."""
    comm = MPI.COMM_WORLD
    if overwrite and resume:
        raise ConfigError("--overwrite and --resume exclude each other")
    directory = Path(out or case.config.directory)
    refuse_full_disk(case.config, directory)
    if dry_run:
        simulation = Simulation(case, comm)
        if comm.rank == 0:
            typer.echo(
                f"{case.config.name}: {simulation.unknowns} unknowns, "
                f"{counted(simulation.steps_planned, 'step')}; nothing solved, nothing written\n"
                f"{size(case.config, simulation.unknowns)}"
            )
        return
    result = solve(case, directory, overwrite=overwrite, resume=resume, beside=beside)
    if comm.rank == 0:
        typer.echo(summary(result))


def solve(
    case: Case,
    directory: Path,
    *,
    overwrite: bool,
    resume: bool = False,
    beside: Beside | None = None,
    look: Callable[[State], State] | None = None,
) -> Run:
    """Run a case into a directory, with its progress.

    Raises:
        NotConverged: With where the converged steps are.
        Interrupted: With how to go on.
    """
    comm = MPI.COMM_WORLD
    # the whole log has the steps
    observers: list[Observer] = [Progress()] if comm.rank == 0 and not verbose() else []
    try:
        return simulate(
            case,
            directory,
            overwrite=overwrite,
            resume=resume,
            observers=observers,
            beside=beside,
            look=look,
            comm=comm,
            argv=sys.argv,
            started=STARTED,
        )
    except NotConverged as error:
        raise NotConverged(f"{error}\nThe converged steps are in {directory}") from None
    except Interrupted as error:
        message = f"{error} before the first step"
        if error.everywhere:
            message = f"{error}; what converged is in {directory}"
            message += "\nGo on with: " + resume_command(Run(directory))
        raise Interrupted(message, error.signal, error.everywhere) from None
