"""Reports: self-contained HTML pages about results."""

from __future__ import annotations

from pathlib import Path


def css() -> str:
    """The look of all pages, light and dark by the reader's preference."""
    return (Path(__file__).parent / "page.css").read_text(encoding="utf-8")
