"""`dealib run`: solve a case, show its progress, print its summary."""

from __future__ import annotations

import sys
from pathlib import Path

from mpi4py import MPI

import typer

from dealib.cli.clock import STARTED
from dealib.cli.info import summary
from dealib.cli.progress import LogFile, Progress
from dealib.config.case import Case
from dealib.errors import DealibError
from dealib.program import Observer, Simulation, simulate


def run_case(case: Case, out: Path | None, *, overwrite: bool, dry_run: bool) -> None:
    """Run a case and print where its results are."""
    comm = MPI.COMM_WORLD
    if dry_run:
        simulation = Simulation(case, comm)
        if comm.rank == 0:
            typer.echo(
                f"{case.config.name}: {simulation.unknowns} unknowns, "
                f"{simulation.steps_planned} steps; nothing solved, nothing written"
            )
        return
    directory = Path(out or case.config.directory)
    observers: list[Observer] = [LogFile(directory), Progress()] if comm.rank == 0 else []
    try:
        result = simulate(
            case,
            directory,
            overwrite=overwrite,
            observers=observers,
            comm=comm,
            argv=sys.argv,
            started=STARTED,
        )
    except DealibError as error:
        if error.exit_code == 3:
            raise type(error)(f"{error}\nThe converged steps are in {directory}") from None
        raise
    if comm.rank == 0:
        typer.echo(summary(result))
