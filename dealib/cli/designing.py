"""Commands that design devices; each imports its modules when it runs, so that help is quick."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dealib.cli import solving  # noqa: F401 - help lists its commands first
from dealib.cli.root import (
    FOLDER,
    CacheFolder,
    ConfigFile,
    Jobs,
    Ranks,
    Retry,
    Set,
    app,
    load_on_ranks,
)


@app.command()
def sensitivity(
    config: ConfigFile,
    of: Annotated[
        list[str] | None,
        typer.Option(
            "--of",
            "--quantity",
            metavar="EXPRESSION",
            help="a quantity, such as 'stroke(\"actuate\")' or force_N; repeat for more; default "
            "the dual of each port's input, such as charge for voltage",
        ),
    ] = None,
    key: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY",
            help="a number of the config, or a section; repeat for more; default all",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE", help="stage at whose end columns are taken; default the last"
        ),
    ] = None,
    set: Set = None,
    out: Annotated[Path | None, typer.Option(help="directory; default RUN-sensitivity")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace earlier results")] = False,
    mpi: Ranks = 1,
) -> None:
    """Compute sensitivities of results to the numbers of a config: d ln(quantity) / d ln(key).

    A quantity is an expression over the history, as in studies (configs/studies/REFERENCE.md). The
    numbers are moduli, permittivity, pre-stretch, thicknesses, radii, loads, voltages and so on.
    """
    case = load_on_ranks(config, set, mpi)
    from dealib.cli.sensitivity import find_sensitivities

    find_sensitivities(case, of or [], key or [], at, out, overwrite)


@app.command()
def optimise(
    design: Annotated[Path, typer.Argument(metavar="DESIGN", help="YAML file", readable=False)],
    out: Annotated[Path | None, typer.Option(help="directory; default runs/NAME-optimum")] = None,
    model: Annotated[
        str | None, typer.Option(help="solid, membrane or auto; default the design's")
    ] = None,
    jobs: Jobs = None,
) -> None:
    """Find the best config within bounds and limits; for two objectives, their Pareto front.

    The search uses gradients. The best design has been solved and is within every limit; exit code
    3 if there is none. The same command continues an earlier search.
    """
    from dealib.cli.optimise import run_optimise
    from dealib.errors import ConfigError, did_you_mean

    if model not in (None, *(known := ("auto", "solid", "membrane"))):
        raise ConfigError(f"--model {model}: unknown{did_you_mean(model, known)}")
    run_optimise(design, out, model, jobs)


@app.command()
def uncertainty(
    design: Annotated[Path, typer.Argument(metavar="DESIGN", help="YAML file", readable=False)],
    jobs: Jobs = None,
    out: Annotated[
        Path | None, typer.Option(help="directory; default runs/NAME-uncertainty")
    ] = None,
    cache: CacheFolder = FOLDER,
    retry: Retry = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace earlier results")] = False,
) -> None:
    """Compute quantiles, Sobol indices and probabilities of a design whose numbers scatter.

    Cases solved before are not solved again. Errors are given with 95 % confidence.
    """
    from dealib.cli.uncertainty import find_uncertainty

    find_uncertainty(design, out, cache, jobs, retry, overwrite)


@app.command()
def validate(
    benchmarks: Annotated[
        list[str] | None,
        typer.Argument(metavar="[BENCHMARK]...", help="names, files or folders; default all"),
    ] = None,
    kind: Annotated[
        str | None, typer.Option(help="only references of a kind: analytical, code or measured")
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV",
            help="compare the numbers of another code instead (benchmark,quantity,value); nothing "
            "is solved",
            readable=False,
        ),
    ] = None,
    jobs: Jobs = None,
    out: Annotated[Path, typer.Option(help="folder of results")] = Path("runs/validation"),
    cache: CacheFolder = FOLDER,
    retry: Retry = False,
) -> None:
    """Solve benchmarks (configs/validation) and compare them with known numbers.

    Prints a table, and writes it as CSV, JSON and HTML. Cases solved before are not solved again.
    Exit code 1: a number is outside its tolerance.
    """
    from dealib.cli.validate import run_validation

    run_validation(benchmarks or [], kind, out, cache, jobs, retry, against)
