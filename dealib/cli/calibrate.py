"""`dealib calibrate`: fit parameters and print the report."""

from __future__ import annotations

from pathlib import Path

import typer

from dealib.calibration.report import Fitted, as_text
from dealib.errors import NotConverged
from dealib.tasks.fitting import calibrate


def run_fit(
    path: Path,
    out: Path | None,
    folder: Path,
    jobs: int | None,
    *,
    resume: bool,
    overwrite: bool,
) -> None:
    """Run a fit and print its report (see `tasks.fitting.calibrate`).

    Raises:
        NotConverged: If the fit failed; its report is written.
    """
    options = {"resume": resume, "overwrite": overwrite}
    tell(calibrate(path, out, jobs, cache=folder, tell=typer.echo, **options))


def tell(fitted: Fitted) -> None:
    """Print the report of a fit.

    Raises:
        NotConverged: If the fit failed.
    """
    assert fitted.directory is not None
    typer.echo(f"\n{as_text(fitted)}\n\n{fitted.directory / 'report.html'}")
    if fitted.failures:
        raise NotConverged(f"{fitted.name}: the fit failed: {' '.join(fitted.failures)}")
