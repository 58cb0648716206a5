"""`dealib uncertainty`: scatter of results from scatter of the numbers of a config."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from dealib.cases.job import Ended, Job
from dealib.cases.workers import Pool, cores
from dealib.design.plan import DesignPlan
from dealib.design.propagation import TRUSTED, Probability
from dealib.design.uncertainty import UncertaintyTables, find
from dealib.errors import ConfigError, Interrupted, in_the_way
from dealib.files import guarded
from dealib.results import spectra
from dealib.tasks.jobs import watcher
from dealib.units import counted, neat

_SHOWN = 3  # failed samples whose error is printed


def find_uncertainty(
    path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool, overwrite: bool
) -> None:
    """Solve the samples of a design; write, draw and print the scatter of its quantities.

    Raises:
        ConfigError: If the design is wrong, or its results exist already.
        NotConverged: If too few samples have a result.
        Interrupted: With how to continue.
    """
    from dealib.plots import design, style

    plan = DesignPlan(path)
    given = plan.design.output.directory
    directory = out or Path(given or f"runs/{plan.name}-uncertainty")
    summary = directory / spectra.SUMMARY
    if summary.exists() and not overwrite:
        raise ConfigError(in_the_way(summary))

    def solve(missing: Sequence[Job]) -> Iterator[Ended]:
        typer.echo(f"{plan.name}: {counted(len(missing), 'case')} to solve")
        workers = min(jobs or cores(), len(missing))
        with watcher(workers, len(missing)) as watch, Pool(workers, watch) as pool:
            yield from pool.solve(missing)

    try:
        found = find(plan, cache, solve, retry)
    except Interrupted as stop:
        said = f"{stop}; solved cases are kept, the same command goes on with the others"
        raise Interrupted(said, stop.signal) from None
    with guarded(directory):
        directory.mkdir(parents=True, exist_ok=True)
    files = [directory / name for name in (spectra.SAMPLES, spectra.SUMMARY, spectra.SOBOL)]
    for file, rows in zip(files, found, strict=True):
        spectra.write(file, rows)
    picture = directory / "uncertainty.png"
    with style.theme() as look:
        tables = dict(zip(("samples", "summary", "sobol"), map(spectra.read, files), strict=True))
        title = plan.design.description or plan.name
        style.save(design.draw_uncertainty(**tables, title=title, look=look), picture)
    typer.echo("\n".join([*told(found), *map(str, (*files, picture))]))


def told(found: UncertaintyTables) -> Iterator[str]:
    """Intervals, Sobol indices and probabilities, each with its 95 % error."""
    for row in (r for r in found.summary if "mean" in r):
        value = {n[:-6]: f"{neat(row[n[:-6]])} ± {row[n]:.2g}" for n in row if n.endswith("_error")}
        linear = row["linear_deviation"]
        slopes = f" (by the slopes at the means {neat(linear)})" if linear == linear else ""
        name, mean, deviation = row["quantity"], value.pop("mean"), value.pop("deviation")
        yield f"{name}: mean {mean}, deviation {deviation}{slopes}"
        yield "  " + ", ".join(f"{n[1:]} %: {v}" for n, v in value.items())
        missed = 100 * max(1 - row["explained"], 0) ** 0.5
        yield f"  each sample is predicted from the others within {missed:.2g} % of the deviation"
        if row["explained"] < TRUSTED:
            yield "  not accurate enough: mean, deviation and quantiles are those of the samples"
        indices = sorted(
            (r for r in found.sobol if r["quantity"] == name), key=lambda r: -r["total"]
        )
        width = max(len(r["key"]) for r in indices)
        yield f"  {'Sobol index':<{width}}  {'first order':>16}  {'total':>16}"
        for r in indices:
            first, total = (f"{r[n]:.4f} ± {r[f'{n}_error']:.4f}" for n in ("first", "total"))
            yield f"  {r['key']:<{width}}  {first:>16}  {total:>16}"
    *limits, unsolved = (r for r in found.summary if "probability" in r)
    for row in limits:
        chance, low, high = (f"{100 * row[n]:.3g}" for n in Probability._fields)
        yield f"{row['quantity']} is not met: {chance} % (95 %: {low} to {high} %)"
    if unsolved["probability"]:
        lost = [row for row in found.samples if row["error"]]
        yield (
            f"{len(lost)} of {len(found.samples)} samples have no result: they count as meeting no "
            "limit, and are left out of the rest"
        )
        yield from (f"  sample {row['sample']}: {row['error']}" for row in lost[:_SHOWN])
        yield from [f"  and {len(lost) - _SHOWN} more"] * (len(lost) > _SHOWN)
