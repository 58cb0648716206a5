"""The style of all pictures, light and dark and colour-blind safe, and how they are saved."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import matplotlib.pyplot as plt
from cycler import cycler

from dealib.errors import ConfigError, by_caller, in_the_way
from dealib.files import write_bytes

FORMATS = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class Theme:
    """Colours of a picture.

    Attributes:
        paper: Background.
        ink: Text and axes.
        faint: Grid lines and rigid parts.
        lines: Colours of curves (after Okabe and Ito, for colour-blind readers).
        sequential: Colour map of quantities of one sign.
        diverging: Colour map of quantities of both signs, centred at zero.
    """

    paper: str
    ink: str
    faint: str
    lines: tuple[str, ...]
    sequential: str
    diverging: str


LIGHT = Theme(
    "#ffffff",
    "#24292f",
    "#d5d9de",
    ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9"),
    "viridis",
    "RdBu_r",
)
DARK = Theme(
    "#15191e",
    "#dde3ea",
    "#3a424b",
    ("#56b4e9", "#ff9d4d", "#2fc598", "#e59ac6", "#f0e442", "#a9c1ff"),
    "viridis",
    "RdBu_r",
)
_COLOUR = re.compile("#[0-9a-f]{6}")
_DARK = dict(zip((LIGHT.paper, LIGHT.ink, LIGHT.faint, *LIGHT.lines),
                 (DARK.paper, DARK.ink, DARK.faint, *DARK.lines), strict=True))  # fmt: skip
# short dashes alone are left out: they mean unstable (see `dealib.plots.branches`)
DASHES = ("-", "--", (0, (6, 1.5, 1, 1.5, 1, 1.5)), "-.")


@contextmanager
def theme(dark: bool = False) -> Iterator[Theme]:
    """Draw in the light or the dark theme within the context; its figures are closed at the end."""
    look = DARK if dark else LIGHT
    settings: dict[Any, Any] = {
        "figure.facecolor": look.paper,
        "axes.facecolor": look.paper,
        "savefig.facecolor": look.paper,
        "text.color": look.ink,
        "axes.labelcolor": look.ink,
        "axes.edgecolor": look.ink,
        "xtick.color": look.ink,
        "ytick.color": look.ink,
        "grid.color": look.faint,
        "grid.linewidth": 0.6,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.8,
        "axes.prop_cycle": cycler(color=look.lines),
        "axes.titlesize": "medium",
        "axes.formatter.limits": (-4, 5),
        "lines.linewidth": 1.6,
        "legend.frameon": False,
        "font.size": 10,
        "svg.hashsalt": "dealib",
        "image.cmap": look.sequential,
    }
    others = set(plt.get_fignums())  # the user's own, in a notebook
    with plt.rc_context(settings):
        try:
            yield look
        finally:
            for number in set(plt.get_fignums()) - others:
                plt.close(number)


def darkened(svg: str) -> str:
    """An SVG of the light theme in the colours of the dark theme."""
    return _COLOUR.sub(lambda found: _DARK.get(found[0], found[0]), svg)


def check_target(path: Path, formats: tuple[str, ...], overwrite: bool) -> None:
    """Refuse a target file before any work is done, if it cannot or must not be written.

    Raises:
        ConfigError: If the suffix is unknown, the folder is missing or the file exists.
    """
    if path.suffix.lower() not in formats:
        given = by_caller("--out ", "")
        raise ConfigError(f"{given}{path}: the name must end in {', '.join(formats)}")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}")
    if path.exists() and not overwrite:
        raise ConfigError(in_the_way(path))


def save(figure: Any, target: Path | IO[bytes], kind: str | None = None, dpi: int = 150) -> None:
    """Save a figure; a file is written completely or not at all, in the format of its suffix.

    Raises:
        PlatformError: If the disk refuses.
    """
    if isinstance(target, Path):  # rendered in memory, since backends fail badly on a full disk
        data = io.BytesIO()
        save(figure, data, target.suffix[1:].lower(), dpi)
        write_bytes(target, data.getvalue())
    else:
        figure.savefig(target, format=kind, dpi=dpi)
