"""Fits of parameters to measured curves, and of materials to coupon tests."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dealib.config.source import Source
from dealib.errors import ConfigError, Interrupted, PlatformError, by_caller
from dealib.files import write_text
from dealib.tasks.arguments import CASES, exclude, silent

if TYPE_CHECKING:
    from dealib.calibration.report import Fitted

FIT = "fit.yaml"


def calibrate(
    path: str | Path,
    directory: str | Path | None = None,
    jobs: int | None = None,
    *,
    cache: str | Path = CASES,
    resume: bool = False,
    overwrite: bool = False,
    tell: Callable[[str], None] = silent,
) -> Fitted:
    """Fit parameters of a config to measured curves, or a material to coupon tests.

    Args:
        path: The YAML file of the fit.
        directory: Directory of the report; default that of the file.
        jobs: Number of processes; default all cores. With more than one, a script needs the guard
            `if __name__ == "__main__":`.
        cache: Folder of solved cases.
        resume: Continue an earlier fit.
        overwrite: Replace an earlier fit.
        tell: Called with each line about the progress.

    Returns:
        The result: its `table` of parameters, and `failures`, which is empty if the fit succeeded.

    Raises:
        ConfigError: If the fit is wrong, or its directory exists already.
        Interrupted: With what is kept and how to continue.
    """
    from dealib.calibration.report import write_report

    exclude(overwrite, resume)
    path, given = Path(path), None if directory is None else Path(directory)
    if "tests" in Source(path).tree:
        fitted, found = _coupon(path, given, resume, overwrite, tell)
    else:
        fitted, found = _config(path, given, Path(cache), jobs, resume, overwrite, tell)
    write_report(fitted, found)
    return replace(fitted, directory=found)


def _config(
    path: Path,
    out: Path | None,
    folder: Path,
    jobs: int | None,
    resume: bool,
    over: bool,
    tell: Callable[[str], None],
) -> tuple[Fitted, Path]:
    from dealib.calibration.cases import Cases
    from dealib.calibration.fit import run_search
    from dealib.calibration.schema import FitPlan
    from dealib.cases.cache import Cache
    from dealib.cases.workers import Pool, cores

    plan = FitPlan(path)
    directory = out or Path(plan.fit.directory)
    _prepare(directory, plan.source.text, resume=resume, overwrite=over)
    wanted = len(plan.fit.data) * (len(plan.fit.parameters) + 1)
    with Pool(jobs or min(cores(), wanted)) as pool:
        cases = Cases(Cache(folder), pool)
        try:
            return run_search(plan, cases, tell), directory
        except Interrupted as stop:
            on = by_caller("--resume", "resume=True")
            raise Interrupted(
                f"{stop}; the {cases.solved} cases solved now are kept, {on} goes on with them",
                stop.signal,
            ) from None


def _coupon(
    path: Path, out: Path | None, resume: bool, over: bool, tell: Callable[[str], None]
) -> tuple[Fitted, Path]:
    from dealib.calibration.coupon_data import CouponPlan
    from dealib.calibration.coupon_fit import run_coupon
    from dealib.config.library import add, read_library

    plan = CouponPlan(path)
    name, entries = plan.coupon.material_name, plan.library
    if entries is not None and entries.exists() and name in read_library(entries) and not over:
        ways = by_caller("--overwrite it", "give overwrite=True") + ", or give output.material"
        raise ConfigError(f"{entries} has a material {name!r}; {ways}")
    directory = out or Path(plan.coupon.directory)
    _prepare(directory, plan.source.text, resume=resume, overwrite=over)
    fitted = run_coupon(plan, tell)
    if entries is not None and not fitted.failures:
        write_text(entries, add(entries, name, fitted.material or {}))
        tell(f"{entries}: {name}")
    return fitted, directory


def _prepare(directory: Path, fit: str, *, resume: bool, overwrite: bool) -> None:
    """Create the directory of a fit and copy the text of its file there.

    Raises:
        ConfigError: If the directory is not empty, unless it is a fit to resume or replace.
        PlatformError: If it cannot be created.
    """
    if directory.exists() and any(directory.iterdir() if directory.is_dir() else [directory]):
        if not (resume or overwrite):
            ways = by_caller(
                "--resume it, --overwrite it, or choose another --out",
                "give resume=True or overwrite=True, or choose another directory",
            )
            raise ConfigError(f"{directory} exists and is not empty; {ways}")
        if not (directory / FIT).is_file():
            raise ConfigError(f"{directory} is not the directory of a fit; it is left unchanged")
        if overwrite:
            shutil.rmtree(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlatformError(f"cannot make {directory}: {error.strerror}") from None
    write_text(directory / FIT, fit)
