"""`dealib study` and `dealib sweep`: solve what is missing, then collect, draw and compare."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dealib.cases.cache import DONE, Cache
from dealib.cases.job import Ended
from dealib.cases.workers import Pool, cores, in_ranks
from dealib.cli.jobs import watcher
from dealib.errors import ConfigError, DealibError, Interrupted, NotConverged
from dealib.files import guarded, write_bytes, write_text
from dealib.study import plan as planning
from dealib.study import sweep
from dealib.study.plan import Plan
from dealib.study.sweep import CaseStatus
from dealib.units import counted

if TYPE_CHECKING:
    from dealib.study.evaluate import Results
    from dealib.study.gallery import Entry


def run_study(path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool) -> None:
    """Solve, collect, draw and compare one study or a folder of them."""
    plans, store = _read(path), Cache(cache)
    folder = _folder(out, path, plans)
    failed = solve_plans(plans, store, jobs, retry)
    stands = [sweep.statuses(p, store, failed) for p in plans]
    _explain(stands, _report(plans, stands, store, folder, path))


def run_sweep(path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool) -> None:
    """Solve the cases of a study (or several), with a summary that grows as they end."""
    plans, store = _read(path), Cache(cache)
    folder = _folder(out, path, plans)
    if int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1"))) == 1:
        _sweep(plans, folder, store, jobs, retry)
        return
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor

    import dealib.fem.compat  # noqa: F401 - PETSc starts on all ranks together

    code = 0
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:  # rank 0 hands out the jobs
        if executor is not None:
            try:
                _sweep(plans, folder, store, None, retry, executor)
            except (DealibError, Interrupted) as error:
                typer.echo(f"dealib: {error}", err=True)
                code = error.exit_code
    raise typer.Exit(MPI.COMM_WORLD.bcast(code, root=0))


def _sweep(
    plans: list[Plan],
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
        failed = solve_plans(plans, store, jobs, retry, executor, summary)
    finally:
        summary.write()
    stands = [sweep.statuses(p, store, failed) for p in plans]
    typer.echo(f"{summary.path}: {len(summary.rows)} cases")
    results = [Results(p, store, s) for p, s in zip(plans, stands, strict=True)]
    _explain(stands, [fault for found in results for fault in found.faults])


def _read(path: Path) -> list[Plan]:
    found = planning.find(path)
    others = sorted(set(path.glob("*.yaml")) - set(found)) if path.is_dir() else []
    if others:
        typer.echo(f"no studies, left out: {', '.join(p.name for p in others)}")
    return [planning.read(p) for p in found]


def _folder(out: Path | None, path: Path, plans: list[Plan]) -> Path:
    """Where results go; it is made."""
    name = path.resolve().name if path.is_dir() else plans[0].study.name
    folder = out or Path("runs/studies") / name
    with guarded(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def solve_plans(
    plans: Sequence[Plan],
    store: Cache,
    count: int | None,
    retry: bool,
    executor: Any = None,
    summary: Any = None,
    of: str = "study",
) -> dict[str, Ended]:
    """Solve what is missing, in processes or an executor; returns what failed, by key."""
    jobs = sweep.missing(plans, store, retry)
    cases = sum(len(p.cases) for p in plans)
    typer.echo(f"{counted(cases, 'case')} in {counted(len(plans), of)}; {len(jobs)} to solve")
    failed: dict[str, Ended] = {}
    done = 0
    workers = 0 if executor is not None else min(count or cores(), len(jobs))
    with watcher(workers, len(jobs)) as watch, Pool(workers, watch) as pool:
        try:
            ends = pool.solve(jobs) if executor is None else in_ranks(jobs, watch, executor)
            for ended in ends:
                done += 1
                if ended.status != DONE:
                    failed[ended.job.key] = ended
                if summary is not None:
                    summary.update(ended)
        except Interrupted as stop:
            raise Interrupted(
                f"{stop} after {done} of {len(jobs)} cases, which are kept; the same command goes "
                "on with the others",
                stop.signal,
            ) from None
    return failed


def _explain(stands: Sequence[Sequence[CaseStatus]], faults: list[str]) -> None:
    """Say which cases have failed, and which numbers are none.

    Raises:
        NotConverged: If a case has failed.
        ConfigError: If a number is none.
    """
    every = [s for stand in stands for s in stand]
    failed = [s for s in every if s.status != DONE]
    if failed:
        lines = [f"  {s.case.label}: {s.status}: {s.error}" for s in failed]
        head = f"{len(every) - len(failed)} of {len(every)} cases are solved; these are not:"
        raise NotConverged("\n".join([*faults, head, *lines]))
    if faults:
        raise ConfigError("\n".join(faults))


def _report(
    plans: list[Plan],
    stands: list[list[CaseStatus]],
    store: Cache,
    folder: Path,
    path: Path,
) -> list[str]:
    """Figures, tables and gallery; returns the numbers that are none."""
    import pandas as pd

    from dealib.study.evaluate import Results
    from dealib.study.gallery import Entry, page

    entries: list[Entry] = []
    for plan, stand in zip(plans, stands, strict=True):
        try:
            results = Results(plan, store, stand)
            entries.append(Entry(results, _draw(results, folder), results.windows))
        except Exception as error:
            error.add_note(f"while {plan.path} was collected and drawn; its cases are kept")
            raise
        _tell(entries[-1])
    windows = [row for entry in entries for row in entry.table]
    write_text(folder / "windows.csv", pd.DataFrame(windows).to_csv(index=False))
    title = plans[0].study.title if len(plans) == 1 else f"Studies of {path}"
    gallery = folder / "gallery.html"
    write_text(gallery, page(title, entries))
    typer.echo(str(gallery))
    return [fault for entry in entries for fault in entry.results.faults]


def _draw(results: Results, folder: Path) -> str:
    """Write table and pictures of a study; returns the SVG's text."""
    with warnings.catch_warnings():
        # Debian's and pip's matplotlib side by side: 3-D axes, which nothing here uses, do not load
        warnings.filterwarnings("ignore", message="Unable to import Axes3D")
        from dealib.study.panels import draw
    name, drawn = results.study.name, draw(results)
    write_text(folder / f"{name}.csv", results.table.to_csv(index=False))
    if drawn is None:
        return ""
    write_text(folder / f"{name}.svg", drawn[0])
    write_bytes(folder / f"{name}.png", drawn[1])
    return drawn[0]


def _tell(entry: Entry) -> None:
    """Say which windows hold."""
    name, verdicts = entry.results.study.name, entry.windows
    typer.echo(f"{name}: {entry.held} of {len(verdicts)} windows hold")
    for v in verdicts:
        if not v.holds:
            typer.echo(f"    {v.window.name}: {v.value}, expected {v.range}")
