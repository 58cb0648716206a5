"""One HTML page for all studies: self-contained, for light and dark screens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader
from markupsafe import Markup

from dealib.study.evaluate import Results, Verdict
from dealib.study.schema import Curves, Points


@dataclass(frozen=True)
class Entry:
    """A study on the page.

    Attributes:
        results: The study.
        svg: Its picture.
        windows: Its windows.
    """

    results: Results
    svg: str
    windows: Sequence[Verdict]

    @property
    def picture(self) -> Markup:
        """The picture, as part of the page."""
        return Markup(self.svg)

    @property
    def axes(self) -> list[str]:
        """The ranges of the reference's axes, in words."""
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
        """The windows, one row each."""
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
        """The table: labels and quantities of the cases."""
        out = []
        for i, s in enumerate(self.results.statuses):
            values = {k: f"{v[i]:.4g}" for k, v in self.results.values.items()}
            out.append({"case": s.case.label, "status": s.status, "error": s.error, **values})
        return out


def page(title: str, entries: Sequence[Entry]) -> str:
    """The gallery.

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
