"""`dealib run`: solve a case, show its progress, print its summary."""

from __future__ import annotations

import sys
from pathlib import Path

from mpi4py import MPI

import typer

from dealib.cli.clock import STARTED
from dealib.cli.info import resume_command, summary
from dealib.cli.progress import Progress
from dealib.config.case import Case
from dealib.errors import ConfigError, Interrupted, NotConverged
from dealib.program import Observer, Simulation, simulate
from dealib.program.log import to_terminal
from dealib.results.reader import Run


def run_case(
    case: Case, out: Path | None, *, overwrite: bool, resume: bool, dry_run: bool, verbose: bool
) -> None:
    """Run a case and print where its results are."""
    comm = MPI.COMM_WORLD
    if overwrite and resume:
        raise ConfigError("--overwrite and --resume exclude each other")
    to_terminal(verbose, comm.rank == 0)
    if dry_run:
        simulation = Simulation(case, comm)
        if comm.rank == 0:
            typer.echo(
                f"{case.config.name}: {simulation.unknowns} unknowns, "
                f"{simulation.steps_planned} steps; nothing solved, nothing written"
            )
        return
    directory = Path(out or case.config.directory)
    # verbose shows the whole log, which has the steps
    observers: list[Observer] = [Progress()] if comm.rank == 0 and not verbose else []
    try:
        result = simulate(
            case,
            directory,
            overwrite=overwrite,
            resume=resume,
            observers=observers,
            comm=comm,
            argv=sys.argv,
            started=STARTED,
        )
    except NotConverged as error:
        raise NotConverged(f"{error}\nThe converged steps are in {directory}") from None
    except Interrupted as error:
        message = f"{error}; what converged is in {directory}"
        if error.everywhere:
            message += "\nGo on with: " + resume_command(Run(directory))
        raise Interrupted(message, error.signal, error.everywhere) from None
    if comm.rank == 0:
        typer.echo(summary(result))
