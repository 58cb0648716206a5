"""`dealib calibrate`."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from dealib.config.source import Source
from dealib.errors import ConfigError, Interrupted, NotConverged, PlatformError
from dealib.files import write_text

if TYPE_CHECKING:
    from dealib.calibration.report import Fitted

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
    """Run a fit of a config, or of tests of a material, and print its report.

    Raises:
        ConfigError: If the fit or the options are wrong, or its directory exists.
        NotConverged: If the fit is no success; its report is there.
        Interrupted: With how to go on.
    """
    if resume and overwrite:
        raise ConfigError("--overwrite and --resume exclude each other")
    if "tests" in Source(path).tree:
        _fit_coupon(path, out, resume, overwrite)
    else:
        _fit_config(path, out, folder, jobs, resume, overwrite)


def _fit_config(
    path: Path, out: Path | None, folder: Path, jobs: int | None, resume: bool, over: bool
) -> None:
    from dealib.calibration.cases import Cases
    from dealib.calibration.fit import run_search
    from dealib.calibration.schema import Plan
    from dealib.cases.cache import Cache
    from dealib.cases.workers import Pool, cores

    plan = Plan(path)
    directory = out or Path(plan.fit.directory)
    _prepare(directory, plan.source.text, resume=resume, overwrite=over)
    wanted = len(plan.fit.data) * (len(plan.fit.parameters) + 1)
    with Pool(jobs or min(cores(), wanted)) as pool:
        cases = Cases(Cache(folder), pool)
        try:
            fitted = run_search(plan, cases, typer.echo)
        except Interrupted as stop:
            raise Interrupted(
                f"{stop}; the {cases.solved} cases solved now are kept, --resume goes on with them",
                stop.signal,
            ) from None
    _tell(fitted, directory)


def _fit_coupon(path: Path, out: Path | None, resume: bool, over: bool) -> None:
    from dealib.calibration.coupon_data import CouponPlan
    from dealib.calibration.coupon_fit import run_coupon
    from dealib.calibration.report import failures
    from dealib.config.library import add, read_library

    plan = CouponPlan(path)
    name, library = plan.coupon.material_name, plan.library
    if library is not None and library.exists() and name in read_library(library) and not over:
        raise ConfigError(
            f"{library} has a material {name!r}; --overwrite it, or give output.material"
        )
    directory = out or Path(plan.coupon.directory)
    _prepare(directory, plan.source.text, resume=resume, overwrite=over)
    fitted = run_coupon(plan, typer.echo)
    if library is not None and not failures(fitted.found):
        write_text(library, add(library, name, fitted.material or {}))
        typer.echo(f"{library}: {name}")
    _tell(fitted, directory)


def _tell(fitted: Fitted, directory: Path) -> None:
    from dealib.calibration.report import as_text, failures, write_report

    write_report(fitted, directory)
    typer.echo(f"\n{as_text(fitted)}\n\n{directory / 'report.html'}")
    if failed := failures(fitted.found):
        raise NotConverged(f"{fitted.name}: the fit is no success: {' '.join(failed)}")


def _prepare(directory: Path, fit: str, *, resume: bool, overwrite: bool) -> None:
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
    write_text(directory / FIT, fit)
