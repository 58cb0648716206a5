"""`dealib study` and `dealib sweep`: solve what is missing, then collect, draw and compare."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import typer

from dealib.cli.jobs import watcher
from dealib.errors import DealibError, Interrupted, NotConverged
from dealib.results.store import write_text
from dealib.study import plan as planning
from dealib.study import sweep
from dealib.study.cache import DONE, Cache
from dealib.study.job import Outcome
from dealib.study.plan import Plan
from dealib.study.sweep import CaseStatus, Solve
from dealib.study.workers import in_processes, in_ranks
from dealib.units import counted


def run_study(path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool) -> None:
    """Solve, collect, draw and compare one study or a folder of them."""
    plans = _read(path)
    folder = out or Path("runs/studies") / _name(path, plans)
    store = Cache(cache)
    failures = _solve(plans, store, jobs, retry, None)
    stands = [sweep.statuses(p, store, failures) for p in plans]
    _report(plans, stands, store, folder, path)
    _explain(stands)


def run_sweep(path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool) -> None:
    """Solve the cases of a study (or several), with a summary that grows as they end."""
    plans = _read(path)
    folder = out or Path("runs/studies") / _name(path, plans)
    if int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1"))) > 1:
        _sweep_in_ranks(plans, folder, Cache(cache), retry)
        return
    _sweep(plans, folder, Cache(cache), retry, None, jobs)


def _sweep(
    plans: list[Plan], folder: Path, store: Cache, retry: bool, how: Solve | None, jobs: int | None
) -> None:
    from dealib.study.summary import Summary

    summary = Summary(plans, store, folder / "summary.csv")
    try:
        failures = _solve(plans, store, jobs, retry, how, summary)
    finally:
        summary.write()
    stands = [sweep.statuses(p, store, failures) for p in plans]
    typer.echo(f"{summary.path}: {counted(len(summary.rows), 'case')}")
    _explain(stands)


def _sweep_in_ranks(plans: list[Plan], folder: Path, store: Cache, retry: bool) -> None:
    """The same in the ranks of mpirun: rank 0 hands out the jobs."""
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor

    import dealib.fem.compat  # noqa: F401 - PETSc starts on all ranks together

    code = 0
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:
        if executor is not None:
            watch = watcher(0, 0)
            try:
                how = functools.partial(in_ranks, watcher=watch, executor=executor)
                _sweep(plans, folder, store, retry, how, None)
            except DealibError as error:
                typer.echo(f"dealib: {error}", err=True)
                code = error.exit_code
    raise typer.Exit(MPI.COMM_WORLD.bcast(code, root=0))


def _read(path: Path) -> list[Plan]:
    found = planning.find(path)
    others = sorted(set(path.glob("*.yaml")) - set(found)) if path.is_dir() else []
    if others:
        typer.echo(f"no studies, left out: {', '.join(p.name for p in others)}")
    return [planning.read(p) for p in found]


def _name(path: Path, plans: list[Plan]) -> str:
    return path.resolve().name if path.is_dir() else plans[0].study.name


def _solve(
    plans: list[Plan],
    store: Cache,
    count: int | None,
    retry: bool,
    how: Solve | None,
    summary: Any = None,
) -> dict[str, Outcome]:
    """Solve what is missing; returns what failed, by key."""
    jobs = sweep.missing(plans, store, retry)
    cases = sum(len(p.cases) for p in plans)
    typer.echo(f"{counted(cases, 'case')} in {counted(len(plans), 'study')}; {len(jobs)} to solve")
    failures: dict[str, Outcome] = {}
    if not jobs:
        return failures
    workers = min(count or sweep.cores(), len(jobs))
    if how is None:
        watch = watcher(workers, len(jobs))
        how = functools.partial(in_processes, count=workers, watcher=watch)
    done = 0
    try:
        with _stoppable():
            for outcome in sweep.solve(jobs, how):
                done += 1
                if outcome.status != DONE:
                    failures[outcome.job.key] = outcome
                if summary is not None:
                    summary.update(outcome)
    except _Stop as stop:
        raise Interrupted(
            f"interrupted after {done} of {len(jobs)} cases, which are kept; the same command goes "
            "on with the others",
            stop.signal,
        ) from None
    return failures


class _Stop(BaseException):
    def __init__(self, number: int) -> None:
        self.signal = number


@contextlib.contextmanager
def _stoppable() -> Iterator[None]:
    """Turn Ctrl-C and SIGTERM into an orderly end."""

    def stop(number: int, frame: object) -> None:
        raise _Stop(number)

    before = {s: signal.signal(s, stop) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _explain(stands: Sequence[Sequence[CaseStatus]]) -> None:
    """Say which cases have failed.

    Raises:
        NotConverged: If any has.
    """
    every = [s for stand in stands for s in stand]
    failed = [s for s in every if s.status != DONE]
    if failed:
        lines = [f"  {s.case.label}: {s.status}: {s.error}" for s in failed]
        head = f"{len(every) - len(failed)} of {len(every)} cases are solved; these are not:"
        raise NotConverged("\n".join([head, *lines]))


def _report(
    plans: list[Plan],
    stands: list[list[CaseStatus]],
    store: Cache,
    folder: Path,
    path: Path,
) -> None:
    """Figures, tables and gallery."""
    import pandas as pd

    with warnings.catch_warnings():
        # Debian's and pip's matplotlib side by side: 3-D axes, which nothing here uses, do not load
        warnings.filterwarnings("ignore", message="Unable to import Axes3D")
        from dealib.plots.panels import draw
    from dealib.study.evaluate import Results
    from dealib.study.gallery import Entry, page

    folder.mkdir(parents=True, exist_ok=True)
    entries, windows = [], []
    for plan, stand in zip(plans, stands, strict=True):
        results, name = Results(plan, store, stand), plan.study.name
        drawn = draw(results)
        if drawn is not None:
            write_text(folder / f"{name}.svg", drawn[0])
            (folder / f"{name}.png").write_bytes(drawn[1])
        write_text(folder / f"{name}.csv", results.table.to_csv(index=False))
        verdicts = results.windows
        entries.append(Entry(results, drawn[0] if drawn else "", verdicts))
        typer.echo(f"{name}: {sum(v.holds for v in verdicts)} of {len(verdicts)} windows hold")
        for v in verdicts:
            mark = "holds" if v.holds else "does not hold"
            if not v.holds:
                typer.echo(f"    {v.window.name}: {v.value}, expected {v.range}")
            row = {"study": name, "window": v.window.name, "low": v.window.low}
            row |= {"high": v.window.high, "unit": v.window.unit, "smallest": v.smallest}
            windows.append(row | {"largest": v.largest, "verdict": mark, "source": v.window.source})
    write_text(folder / "windows.csv", pd.DataFrame(windows).to_csv(index=False))
    title = plans[0].study.title if len(plans) == 1 else f"Studies of {path}"
    gallery = folder / "gallery.html"
    write_text(gallery, page(title, entries))
    typer.echo(str(gallery))
