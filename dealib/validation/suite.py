"""A suite of benchmarks: choosing, solving and comparing them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dealib.cases.cache import DONE, Cache
from dealib.cases.job import Ended, run
from dealib.cases.workers import Pool
from dealib.errors import ConfigError, NotConverged
from dealib.study import sweep
from dealib.study.evaluate import Results
from dealib.validation.definition import Definition, find, read
from dealib.validation.rows import Row, rows

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class BenchmarkResult:
    """A benchmark and its results.

    Attributes:
        definition: The benchmark.
        results: Results of its cases; None if they are not solved.
        rows: Rows of its quantities.
    """

    definition: Definition
    results: Results | None
    rows: list[Row]


def definitions(names: Sequence[str | Path] = (), kind: str | None = None) -> list[Definition]:
    """Read benchmarks.

    Args:
        names: Names in the suite, files or folders; default the whole suite.
        kind: Only benchmarks of this kind.

    Raises:
        ConfigError: If a file is wrong (the message names the place), or if there is no benchmark.
    """
    found = [d for path in find(names) if kind in (None, (d := read(path)).benchmark.kind)]
    if not found:
        raise ConfigError(f"none of these benchmarks is of the kind {kind!r}")
    return found


def evaluated(
    given: Sequence[Definition], cache: Cache, ended: Mapping[str, Ended], whole: bool = False
) -> list[BenchmarkResult]:
    """Compare solved benchmarks with their references.

    Args:
        given: The benchmarks.
        cache: Cache of solved cases.
        ended: Cases that have just failed, by key.
        whole: Compare only benchmarks of which all cases are solved.
    """
    found = []
    for one in given:
        stands = sweep.statuses(one, cache, ended)
        left_out = not one.comparable or (whole and any(s.status != DONE for s in stands))
        results = None if left_out else Results(one, cache, stands)
        found.append(BenchmarkResult(one, results, rows(one, results)))
    return found


def solvable(given: Sequence[Definition]) -> list[Definition]:
    """The benchmarks with a reference; those whose files of curves are missing are left out."""
    return [one for one in given if one.comparable]


def check(found: Sequence[BenchmarkResult]) -> None:
    """Raise the errors of cases and expressions.

    Raises:
        NotConverged: If a case has failed.
        ConfigError: If an expression has no value.
    """
    solved = [f.results for f in found if f.results is not None]
    faults = [fault for results in solved for fault in results.faults]
    failed = [
        f"  {r.study.name}, {s.case.label}: {s.status}: {s.error}"
        for r in solved
        for s in r.statuses
        if s.status != DONE
    ]
    if failed:
        raise NotConverged("\n".join([*faults, "these cases are not solved:", *failed]))
    if faults:
        raise ConfigError("\n".join(faults))


def validate(
    benchmarks: Sequence[str | Path] | str | Path = (),
    *,
    kind: str | None = None,
    jobs: int = 1,
    cache: str | Path = "runs/studies/cases",
) -> pandas.DataFrame:
    """Solve benchmarks and compare them with their references.

    Args:
        benchmarks: Names in configs/validation, files or folders; default all of them.
        kind: 'analytical', 'code' or 'measured': those only.
        jobs: Processes that solve them; with more than one, a script guards what it does by
            `if __name__ == "__main__":`.
        cache: Folder of solved cases, which are not solved again.

    Returns:
        A row a quantity: benchmark, kind, quantity, unit, value, reference, allowed, tolerance,
        verdict ('within', 'outside', 'skipped' where measured data are not at hand), note and
        difference.

    Raises:
        ConfigError: If a file is wrong, with its place.
        NotConverged: If a case has failed.
    """
    import pandas as pd

    names = [benchmarks] if isinstance(benchmarks, (str, Path)) else benchmarks
    given, store = definitions(names, kind), Cache(Path(cache))
    missing = sweep.missing(solvable(given), store)
    with Pool(min(jobs, len(missing))) as pool:
        ends = pool.solve(missing) if jobs > 1 else map(run, missing)
        failed = {ended.job.key: ended for ended in ends if ended.status != DONE}
    found = evaluated(given, store, failed)
    check(found)
    return pd.DataFrame([row.record() for one in found for row in one.rows])
