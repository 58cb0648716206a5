"""The report of a run: one self-contained HTML page."""

from __future__ import annotations

from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dealib.errors import ConfigError, PlatformError
from dealib.report import facts, figures, rendered, space
from dealib.results.reader import Run
from dealib.results.summary import margins


def _captions(run: Run) -> dict[str, str]:
    """Captions of the pictures of fields, by name."""
    found = {}
    with suppress(ConfigError):  # damaged states, which have no pictures
        for q in figures.shown(run):
            found[q.name] = f"{q.label.partition(' ' + q.name[0] + '$')[0]} {q.name}."
    return found | {
        "E": "Electric field at the largest voltage of a stored state.",
        "wrinkling": "Wrinkling: the share by which the film is longer than its smooth surface.",
        "mode": "The softest mode where stability is lost, of any height.",
    }


def _view(run: Run) -> dict[str, Any]:
    """The data of the interactive view in space, if there is one, and the scripts that draw it."""
    found = space.view(run, figures.turned(run))
    if not found:
        return {"space": {}}
    script = (Path(__file__).parent / "space.js").read_text(encoding="utf-8")
    return {"space": found, "library": space.library(), "script": script}


def render(run: Run) -> str:
    """The page as HTML.

    Raises:
        ConfigError: If no step has converged.
    """
    config, info = run.config, run.info
    pictures, lost = figures.pictures(run)
    view: dict[str, Any] = {"space": {}}
    try:
        view = _view(run)
    except (ConfigError, PlatformError) as error:
        lost.append(f"{error}; the interactive view is left out.")
    page: dict[str, Any] = {
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
        "captions": _captions(run),
        "text": facts.text,
        "given": run.text("config.yaml"),
        "resolved": run.text("config.resolved.yaml"),
        "version": version("dealib"),
        **view,
    }
    return rendered(Path(__file__).parent, **page)
