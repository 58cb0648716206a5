"""`dealib report`: write the page of a run."""

from __future__ import annotations

from pathlib import Path

from dealib.files import write_text
from dealib.results.reader import Run


def report(directory: Path, out: Path | None, overwrite: bool) -> Path:
    """Write the page and return its file; `report.html` of the run is dealib's own.

    Raises:
        ConfigError: If there is no run, nothing to report, or a file in the way.
    """
    run = Run(directory)
    if out is not None:
        from dealib.plots.style import check_target

        check_target(out, (".html",), overwrite)
    from dealib.report.page import render

    target = out or run.directory / "report.html"
    write_text(target, render(run))
    return target
