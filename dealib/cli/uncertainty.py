"""`dealib uncertainty`: what is known of the results of a config whose numbers scatter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from dealib.cases.job import Ended, Job
from dealib.cases.workers import Pool, cores
from dealib.cli.jobs import watcher
from dealib.design.propagation import TRUSTED
from dealib.design.schema import Plan
from dealib.design.uncertainty import Found, find
from dealib.errors import ConfigError, Interrupted
from dealib.files import guarded
from dealib.results import spectra
from dealib.units import counted, neat

_SHOWN = 3  # samples without a result whose reason is told


def find_uncertainty(
    path: Path, out: Path | None, cache: Path, jobs: int | None, retry: bool, overwrite: bool
) -> None:
    """Solve the samples of a design; write, draw and print what is known of its quantities.

    Raises:
        ConfigError: If the design is wrong, or its results exist.
        NotConverged: If too few samples have a result.
        Interrupted: With how to go on.
    """
    plan = Plan(path)
    given = plan.design.output.directory
    directory = out or Path(given or f"runs/{plan.name}-uncertainty")
    summary = directory / spectra.SUMMARY
    if summary.exists() and not overwrite:
        raise ConfigError(f"{summary} exists; choose another --out, or --overwrite it")

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
    tables = {spectra.SAMPLES: found.table, spectra.SOBOL: found.sobol}
    for name, rows in {**tables, spectra.SUMMARY: found.summary}.items():
        spectra.write(directory / name, rows)
    picture = _draw(directory, plan.design.description or plan.name)
    typer.echo("\n".join([*told(found), *(str(directory / n) for n in tables), str(summary)]))
    typer.echo(str(picture))


def _draw(directory: Path, title: str) -> Path:
    from dealib.plots import style, uncertainty

    names = (spectra.SAMPLES, spectra.SUMMARY, spectra.SOBOL)
    target = directory / "uncertainty.png"
    with style.theme() as look:
        samples, summary, sobol = (spectra.read(directory / n) for n in names)
        style.save(uncertainty.draw(samples, summary, sobol, title, look), target)
    return target


def told(found: Found) -> Iterator[str]:
    """Tables of intervals, indices and probabilities, each with its 95 % error."""
    for name, known in found.known.items():
        value = {n: f"{neat(v)} ± {error:.2g}" for n, (v, error) in known.numbers.items()}
        linear = found.linear.get(name, float("nan"))
        by_slopes = f" (by the slopes at the means {neat(linear)})" if linear == linear else ""
        yield f"{name}: mean {value.pop('mean')}, deviation {value.pop('deviation')}{by_slopes}"
        yield "  " + ", ".join(f"{n[1:]} %: {v}" for n, v in value.items())
        missed = 100 * max(1 - known.explained, 0) ** 0.5
        yield f"  each sample is foretold from the others within {missed:.2g} % of the deviation"
        if known.explained < TRUSTED:
            yield "  too little: mean, deviation and quantiles are those of the samples themselves"
        width = max(map(len, known.first))
        yield f"  {'Sobol index':<{width}}  {'first order':>16}  {'total':>16}"
        for key in sorted(known.total, key=lambda k: -known.total[k][0]):
            pairs = (known.first[key], known.total[key])
            columns = (f"{f'{v:.4f} ± {error:.4f}':>16}" for v, error in pairs)
            yield f"  {key:<{width}}  {'  '.join(columns)}"
    for text, p in found.missed.items():
        sure = f"95 %: {100 * p.low:.3g} to {100 * p.high:.3g} %"
        yield f"{text} is not met: {100 * p.value:.3g} % ({sure})"
    if found.errors:
        yield (
            f"{len(found.errors)} of {len(found.samples.x)} samples have no result: they meet no "
            "limit, and are left out of the rest"
        )
        yield from (f"  sample {k}: {found.errors[k]}" for k in list(found.errors)[:_SHOWN])
        if len(found.errors) > _SHOWN:
            yield f"  and {len(found.errors) - _SHOWN} more"
