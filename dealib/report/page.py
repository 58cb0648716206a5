"""The report of a run: one self-contained HTML page."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from dealib.report import css, facts, figures
from dealib.results.reader import Run
from dealib.results.summary import margins

_CAPTIONS = {
    "E": "Electric field at the largest voltage of a stored state.",
    "S_RR": "Second Piola-Kirchhoff stress, radial.",
    "S_ZZ": "Second Piola-Kirchhoff stress, through the thickness.",
}


def render(run: Run) -> str:
    """The page.

    Raises:
        ConfigError: If no step has converged.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    config, info = run.config, run.info
    pictures, lost = figures.pictures(run)
    page: dict[str, Any] = {
        "css": css(),
        "run": info,
        "title": run.title,
        "status": run.status,
        "config": config,
        "headline": facts.headline(run),
        "device": facts.device(config),
        "program": facts.program(config),
        "margins": facts.margins(run),
        "uses": margins(run),
        "energy": facts.energy(run),
        "cycles": facts.cycle_table(run),
        "solution": facts.solution(run),
        "warnings": [*facts.warnings(run), *lost],
        "pictures": pictures,
        "captions": _CAPTIONS,
        "text": facts.text,
        "given": run.text("config.yaml"),
        "resolved": run.text("config.resolved.yaml"),
        "version": version("dealib"),
    }
    return environment.get_template("page.html.j2").render(page)
