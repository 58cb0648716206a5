"""Reports: self-contained HTML pages about results."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def rendered(folder: Path, **values: Any) -> str:
    """The template `page.html.j2` of a folder, filled in, with the style sheet of all pages."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    css = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")
    return environment.get_template("page.html.j2").render(css=css, **values)
