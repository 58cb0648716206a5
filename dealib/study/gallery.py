"""The gallery: one self-contained HTML page for all studies, for light and dark screens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader
from markupsafe import Markup

from dealib.study.evaluate import Results
from dealib.study.schema import Curves, Points
from dealib.study.windows import Verdict


@dataclass(frozen=True)
class GalleryEntry:
    """A study on the page.

    Attributes:
        results: The results of the study.
        svg: The SVG of its panels; empty without panels.
        windows: The comparisons with its windows.
    """

    results: Results
    svg: str
    windows: Sequence[Verdict]

    @property
    def picture(self) -> Markup:
        """The SVG as HTML that is not escaped."""
        return Markup(self.svg)

    @property
    def axes(self) -> list[str]:
        """The ranges of axes with limits, in words."""
        found: dict[str, None] = {}
        for panel in self.results.study.panels:
            if not isinstance(panel, (Curves, Points)):
                continue
            for axis in (panel.x, panel.y):
                if axis.limits is not None:
                    label, _, unit = axis.label.partition(" (")
                    low, high = axis.limits
                    found[f"{label} {low:g} .. {high:g} {unit.rstrip(')')}".strip()] = None
        return list(found)

    @property
    def held(self) -> int:
        """Number of windows that hold."""
        return sum(v.holds for v in self.windows)

    @property
    def table(self) -> list[dict[str, Any]]:
        """The rows of `windows.csv`, one for each window."""
        return [
            {
                "study": self.results.study.name,
                "window": v.window.name,
                "low": v.window.low,
                "high": v.window.high,
                "unit": v.window.unit,
                "smallest": v.smallest,
                "largest": v.largest,
                "verdict": "holds" if v.holds else "does not hold",
                "source": v.window.source,
            }
            for v in self.windows
        ]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The rows of the table on the page: label, status and quantities of each case."""
        out = []
        for i, s in enumerate(self.results.statuses):
            values = {k: f"{v[i]:.4g}" for k, v in self.results.values.items()}
            out.append({"case": s.case.label, "status": s.status, "error": s.error, **values})
        return out


def page(title: str, entries: Sequence[GalleryEntry]) -> str:
    """The HTML of the gallery.

    Args:
        title: Its heading.
        entries: The studies.
    """
    environment = Environment(
        loader=PackageLoader("dealib.study"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    held = sum(e.held for e in entries)
    total = sum(len(e.windows) for e in entries)
    return environment.get_template("gallery.html").render(
        title=title, entries=entries, held=held, total=total, shaded=any(e.axes for e in entries)
    )
