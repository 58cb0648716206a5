"""`dealib calibrate`: the report of a fit."""

from __future__ import annotations

import typer

from dealib.calibration.report import Fitted, as_text
from dealib.errors import NotConverged


def tell(fitted: Fitted) -> None:
    """Print the report of a fit.

    Raises:
        NotConverged: If the fit failed.
    """
    assert fitted.directory is not None
    typer.echo(f"\n{as_text(fitted)}\n\n{fitted.directory / 'report.html'}")
    if fitted.failures:
        raise NotConverged(f"{fitted.name}: the fit failed: {' '.join(fitted.failures)}")
