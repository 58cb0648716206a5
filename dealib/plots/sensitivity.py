"""Tornado charts of sensitivities."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from dealib.plots.labels import plain
from dealib.plots.style import Theme

_MOST = 15  # bars


def draw(table: Any, title: str, look: Theme) -> Any:
    """Draw a bar for each number with influence, the longest on top, coloured by its sign.

    Args:
        table: Table of `sensitivity.csv`.
        title: Title of the picture.
        look: Colours.
    """
    names = list(dict.fromkeys(table["quantity"]))
    parts = [table[table["quantity"] == name] for name in names]
    parts = [part[part["logarithmic"].abs() > 1e-6] for part in parts]
    parts = [part.loc[part["logarithmic"].abs().nlargest(_MOST).index[::-1]] for part in parts]
    rows = [max(1, len(part)) for part in parts]
    figure, axes = plt.subplots(
        *(len(names), 1),
        figsize=(7.5, 0.8 + sum(0.7 + 0.26 * n for n in rows)),
        height_ratios=rows,
        layout="constrained",
        squeeze=False,
    )
    for axis, name, part in zip(axes[:, 0], names, parts, strict=True):
        size = part["logarithmic"]
        colours = [look.lines[int(value < 0)] for value in size]
        bars = axis.barh(range(len(part)), size, color=colours)
        axis.bar_label(bars, [f"{value:.3g}" for value in size], padding=3, fontsize="small")
        axis.set_yticks(range(len(part)), [plain(key) for key in part["key"]], fontsize="small")
        axis.axvline(0, color=look.ink, lw=0.8)
        axis.margins(x=0.15)
        axis.set_xlabel(plain(f"d ln {name} / d ln key"), fontsize="small")
        axis.grid(visible=False, axis="y")
    figure.suptitle(plain(title), fontsize="medium")
    return figure
