"""`dealib study` and `dealib sweep`: solve the cases of studies."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from dealib.cases.cache import DONE, Cache
from dealib.errors import ConfigError, DealibError, Interrupted, NotConverged
from dealib.study import sweep
from dealib.study.plan import StudyPlan
from dealib.study.sweep import CaseStatus
from dealib.tasks.jobs import watcher
from dealib.tasks.studies import made, read, results, solve


def run_study(path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool) -> None:
    """Solve, collect, draw and compare one study or a folder of them."""
    states, found = results(path, out, jobs, Cache(cache), retry, typer.echo, watcher)
    _explain(states, [fault for one in found for fault in one.faults])


def run_sweep(path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool) -> None:
    """Solve the cases of one or several studies; each case that ends is added to summary.csv."""
    plans, store = read(path, typer.echo), Cache(cache)
    folder = made(out, path, plans)
    if int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1"))) == 1:
        _sweep(plans, folder, store, jobs, retry)
        return
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor

    import dealib.fem.compat  # noqa: F401 - PETSc has to start on all ranks together

    code = 0
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:  # rank 0 distributes the cases
        if executor is not None:
            try:
                _sweep(plans, folder, store, None, retry, executor)
            except (DealibError, Interrupted) as error:
                typer.echo(f"dealib: {error}", err=True)
                code = error.exit_code
    raise typer.Exit(MPI.COMM_WORLD.bcast(code, root=0))


def _sweep(
    plans: list[StudyPlan],
    folder: Path,
    store: Cache,
    jobs: int | None,
    retry: bool,
    executor: Any = None,
) -> None:
    from dealib.study.evaluate import Results
    from dealib.study.summary import Summary

    summary = Summary(plans, store, folder / "summary.csv")
    try:
        failed = solve(plans, store, jobs, retry, typer.echo, watcher, executor, summary)
    finally:
        summary.write()
    states = [sweep.statuses(p, store, failed) for p in plans]
    typer.echo(f"{summary.path}: {len(summary.rows)} cases")
    found = [Results(p, store, s) for p, s in zip(plans, states, strict=True)]
    _explain(states, [fault for one in found for fault in one.faults])


def _explain(states: Sequence[Sequence[CaseStatus]], faults: list[str]) -> None:
    """Report failed cases, and quantities that could not be computed.

    Raises:
        NotConverged: If a case failed.
        ConfigError: If a quantity could not be computed.
    """
    every = [s for of_a_study in states for s in of_a_study]
    failed = [s for s in every if s.status != DONE]
    if failed:
        lines = [f"  {s.case.label}: {s.status}: {s.error}" for s in failed]
        head = f"{len(every) - len(failed)} of {len(every)} cases are solved; these are not:"
        raise NotConverged("\n".join([*faults, head, *lines]))
    if faults:
        raise ConfigError("\n".join(faults))
