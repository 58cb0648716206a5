"""`dealib calibrate`: fit parameters to measured curves, in a directory that can be resumed."""

from __future__ import annotations

import shutil
from pathlib import Path

import typer

from dealib.calibration.cases import Cases
from dealib.calibration.schema import Plan
from dealib.cases.cache import Cache
from dealib.cases.workers import Pool, cores
from dealib.errors import ConfigError, Interrupted, PlatformError
from dealib.files import write_text

FIT = "fit.yaml"


def run_fit(
    path: Path,
    out: Path | None,
    folder: Path,
    jobs: int | None,
    *,
    resume: bool,
    overwrite: bool,
) -> None:
    """Run a fit and print its report.

    Raises:
        ConfigError: If the fit or the options are wrong, or its directory exists.
        Interrupted: With how to go on.
    """
    if resume and overwrite:
        raise ConfigError("--overwrite and --resume exclude each other")
    plan = Plan(path)
    directory = out or Path(plan.fit.directory)
    _prepare(directory, resume=resume, overwrite=overwrite)
    write_text(directory / FIT, plan.source.text)
    wanted = len(plan.fit.data) * (len(plan.fit.parameters) + 1)
    processes = jobs or min(cores(), wanted)
    from dealib.calibration.fit import run_search
    from dealib.calibration.report import as_text, write_report

    with Pool(processes) as pool:
        cases = Cases(Cache(folder), pool)
        try:
            fitted = run_search(plan, cases, typer.echo)
        except Interrupted as stop:
            raise Interrupted(
                f"{stop}; the {cases.solved} cases solved now are kept, --resume goes on with them",
                stop.signal,
            ) from None
    write_report(fitted, directory)
    typer.echo(f"\n{as_text(fitted)}\n\n{directory / 'report.html'}")


def _prepare(directory: Path, *, resume: bool, overwrite: bool) -> None:
    if directory.exists() and any(directory.iterdir() if directory.is_dir() else [directory]):
        if not (resume or overwrite):
            raise ConfigError(
                f"{directory} exists and is not empty; --resume it, --overwrite it, or choose "
                "another --out"
            )
        if not (directory / FIT).is_file():
            raise ConfigError(f"{directory} is no directory of a fit; it is left as it is")
        if overwrite:
            shutil.rmtree(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlatformError(f"cannot make {directory}: {error.strerror}") from None
