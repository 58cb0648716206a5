"""Columns of a measured file over one of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.data.table import DataColumn
from dealib.plots.labels import plain
from dealib.plots.style import Theme

_POINTS = 5000  # up to this number points are drawn as markers, above it as a line


def draw_columns(x: DataColumn, columns: Sequence[DataColumn], look: Theme) -> Any:
    """Draw columns over another one, each into axes of its own; returns the figure."""
    rows = -(-len(columns) // 3)
    across = min(len(columns), 3)
    figure, axes = plt.subplots(
        rows, across, figsize=(1.5 + 4 * across, 0.7 + 2.8 * rows), layout="constrained",
        squeeze=False, sharex=True,
    )  # fmt: skip
    for k, (ax, column) in enumerate(zip(axes.flat, columns, strict=False)):
        good = np.flatnonzero(np.isfinite(x.values) & np.isfinite(column.values))
        few = thinned(column.values[good])
        style = "." if len(good) <= _POINTS else "-"
        colour = look.lines[k % len(look.lines)]
        ax.plot(x.values[good][few], column.values[good][few], style, ms=3, lw=0.8, color=colour)
        ax.set_xlabel(plain(x.header))
        ax.set_ylabel(plain(column.header))
    for ax in axes.flat[len(columns) :]:
        ax.set_visible(False)
    return figure


def thinned(values: Any, points: int = _POINTS) -> Any:
    """Rows that give the same picture as all: minimum and maximum of each of many blocks."""
    if len(values) <= points:
        return np.arange(len(values))
    size = -(-2 * len(values) // points)
    blocks = np.resize(values, (-(-len(values) // size), size))
    at = np.arange(len(blocks)) * size
    found = np.unique(np.concatenate([at + blocks.argmin(1), at + blocks.argmax(1)]))
    return found[found < len(values)]
