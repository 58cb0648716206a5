"""Studies: solve the missing cases, then collect, draw and compare the results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal
from typing import TYPE_CHECKING, Any

from dealib.cases.cache import DONE, Cache
from dealib.cases.job import Ended
from dealib.cases.workers import Pool, Watcher, cores, in_ranks
from dealib.errors import Interrupted, PlatformError, by_caller
from dealib.files import guarded, write_bytes, write_text
from dealib.log import LOGGER
from dealib.study import plan as planning
from dealib.study import sweep
from dealib.study.plan import StudyPlan
from dealib.study.sweep import CaseStatus
from dealib.tasks.arguments import CASES, silent
from dealib.units import counted

if TYPE_CHECKING:
    from dealib.study.evaluate import Results
    from dealib.study.gallery import GalleryEntry

Tell = Callable[[str], None]
Picture = tuple[str, bytes]  # SVG and PNG
_SHOWN = 20  # cases whose quantities are printed


def run_study(
    path: str | Path,
    directory: str | Path | None = None,
    jobs: int | None = None,
    *,
    cache: str | Path = CASES,
    retry: bool = False,
    tell: Tell = silent,
    watch: Callable[[int, int], Watcher] = lambda workers, total: Watcher(),
) -> list[Results]:
    """Solve the missing cases of studies, collect, draw and compare them, and write a gallery.

    Cases that do not converge give a warning, and have no values.

    Args:
        path: A study's YAML file, or a folder of them.
        directory: Folder of tables, pictures and gallery; default runs/studies/NAME.
        jobs: Number of processes; default all cores. With more than one, a script needs the guard
            `if __name__ == "__main__":`.
        cache: Folder of solved cases.
        retry: Solve cases again that did not converge.
        tell: Called with each line about the progress.
        watch: Makes the observer of the cases, from the numbers of processes and of cases.

    Returns:
        The results of each study: `table` has a row for each case, `values` its quantities.

    Raises:
        ConfigError: If a study is wrong.
        Interrupted: With what is kept.
    """
    out = None if directory is None else Path(directory)
    states, found = results(Path(path), out, jobs, Cache(Path(cache)), retry, tell, watch)
    for s in (s for of_a_study in states for s in of_a_study if s.status != DONE):
        LOGGER.warning("%s: %s: %s", s.case.label, s.status, s.error)
    for fault in (fault for one in found for fault in one.faults):
        LOGGER.warning("%s", fault)
    return found


def results(
    path: Path,
    out: Path | None,
    jobs: int | None,
    store: Cache,
    retry: bool,
    tell: Tell,
    watch: Callable[[int, int], Watcher],
) -> tuple[list[list[CaseStatus]], list[Results]]:
    """States of the cases of each study, and its results; arguments are those of `run_study`."""
    plans = read(path, tell)
    folder = made(out, path, plans)
    failed = solve(plans, store, jobs, retry, tell, watch)
    states = [sweep.statuses(p, store, failed) for p in plans]
    return states, report(plans, states, store, folder, path, tell, jobs)


def read(path: Path, tell: Tell) -> list[StudyPlan]:
    """The studies of a file or of a folder; tells which files of the folder are no studies."""
    found = planning.find(path)
    others = sorted(set(path.glob("*.yaml")) - set(found)) if path.is_dir() else []
    if others:
        tell(f"left out, since they are no studies: {', '.join(p.name for p in others)}")
    return [planning.read(p) for p in found]


def made(out: Path | None, path: Path, plans: list[StudyPlan]) -> Path:
    """The folder of the results, which is created; default runs/studies/NAME."""
    name = path.resolve().name if path.is_dir() else plans[0].study.name
    folder = out or Path("runs/studies") / name
    with guarded(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def solve(
    plans: Sequence[StudyPlan],
    store: Cache,
    count: int | None,
    retry: bool,
    tell: Tell,
    watch: Callable[[int, int], Watcher],
    executor: Any = None,
    summary: Any = None,
    of: str = "study",
) -> dict[str, Ended]:
    """Solve the missing cases of studies.

    Args:
        plans: The studies.
        store: Folder of solved cases.
        count: Number of processes; None: all cores.
        retry: Solve cases again that did not converge.
        tell: Called with each line about the progress.
        watch: Makes the observer of the cases.
        executor: Solves cases in ranks of MPI instead of processes.
        summary: `Summary` to which each case that ends is added.
        of: What the plans are called, 'study' or 'benchmark'.

    Returns:
        The cases that failed, by key.

    Raises:
        Interrupted: With how to continue.
    """
    jobs = sweep.missing(plans, store, retry)
    cases = sum(len(p.cases) for p in plans)
    tell(f"{counted(cases, 'case')} in {counted(len(plans), of)}; {len(jobs)} to solve")
    failed: dict[str, Ended] = {}
    done = 0
    workers = 0 if executor is not None else min(count or cores(), len(jobs))
    with watch(workers, len(jobs)) as watcher, Pool(workers, watcher) as pool:
        try:
            ends = pool.solve(jobs) if executor is None else in_ranks(jobs, watcher, executor)
            for ended in ends:
                done += 1
                if ended.status != DONE:
                    failed[ended.job.key] = ended
                if summary is not None:
                    summary.update(ended)
        except Interrupted as stop:
            raise Interrupted(
                f"{stop} after {done} of {len(jobs)} cases, which are kept; the same "
                + by_caller("command", "call")
                + " goes on with the others",
                stop.signal,
            ) from None
    return failed


def report(
    plans: list[StudyPlan],
    states: list[list[CaseStatus]],
    store: Cache,
    folder: Path,
    path: Path,
    tell: Tell,
    jobs: int | None = None,
) -> list[Results]:
    """Write figures, tables and gallery of studies; returns the results of each."""
    import pandas as pd

    from dealib.study.evaluate import Results
    from dealib.study.gallery import GalleryEntry, page

    entries: list[GalleryEntry] = []
    with _drawing(plans, states, store, jobs or cores()) as pictures:
        for plan, of_a_study in zip(plans, states, strict=True):
            try:
                results = Results(plan, store, of_a_study)
                svg = _write(results, next(pictures), folder)
                entries.append(GalleryEntry(results, svg, results.windows))
            except Exception as error:
                error.add_note(f"while {plan.path} was collected and drawn; its cases are kept")
                raise
            _verdict(entries[-1], folder, tell)
    windows = [row for entry in entries for row in entry.table]
    write_text(folder / "windows.csv", pd.DataFrame(windows).to_csv(index=False))
    title = plans[0].study.title if len(plans) == 1 else f"Studies of {path}"
    gallery = folder / "gallery.html"
    write_text(gallery, page(title, entries))
    tell(str(gallery))
    return [entry.results for entry in entries]


@contextmanager
def _drawing(
    plans: list[StudyPlan], states: list[list[CaseStatus]], store: Cache, count: int
) -> Iterator[Iterator[Picture | None]]:
    """The pictures of studies; several studies are drawn by several processes."""
    processes = min(count, len(plans))
    if processes < 2:
        yield map(_drawn, plans, states, repeat(store))
        return
    pool = ProcessPoolExecutor(processes, get_context("spawn"), _ignore_interrupt)
    try:
        yield pool.map(_drawn, plans, states, repeat(store))
    except BrokenProcessPool:
        raise PlatformError(
            "a process that draws studies was ended, perhaps since memory ran out; all solved cases"
            f" are kept; {by_caller('-j 1 draws', 'jobs=1 draws')} in one process"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _ignore_interrupt() -> None:
    signal(SIGINT, SIG_IGN)  # Ctrl-C reaches all processes; the parent acts


def _drawn(plan: StudyPlan, states: list[CaseStatus], store: Cache) -> Picture | None:
    from dealib.study.evaluate import Results

    return draw_panels(Results(plan, store, states))


def _write(results: Results, picture: Picture | None, folder: Path) -> str:
    """Write table and pictures of a study; returns the SVG's text."""
    name = results.study.name
    write_text(folder / f"{name}.csv", results.table.to_csv(index=False))
    if picture is None:
        return ""
    svg, png = picture
    write_text(folder / f"{name}.svg", svg)
    write_bytes(folder / f"{name}.png", png)
    return svg


def draw_panels(results: Results) -> Picture | None:
    """The panels of a study as SVG and PNG (see `study.panels.draw`)."""
    import dealib.plots  # noqa: F401 - before Matplotlib, of which it hides a warning
    from dealib.study.panels import draw

    return draw(results)


def _verdict(entry: GalleryEntry, folder: Path, tell: Tell) -> None:
    """Tell the quantities of a small study, its files, and which windows hold."""
    name, verdicts, table = entry.results.study.name, entry.windows, entry.results.table
    names = ["case", *entry.results.values, *(["ended_by"] if table["ended_by"].any() else [])]
    if len(table) <= _SHOWN and entry.results.values:
        tell(table[names].to_string(index=False, float_format="{:.6g}".format))
    tell(str(folder / f"{name}.csv"))
    if verdicts:
        tell(f"{name}: {entry.held} of {len(verdicts)} windows hold")
    for v in verdicts:
        if not v.holds:
            tell(f"    {v.window.name}: {v.value}, expected {v.range}")
