"""Curves of a history, their unstable parts dashed and their limit points marked."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D

if TYPE_CHECKING:
    import pandas

_MODES = "unstable_modes"
_UNSTABLE = (0, (2, 1.5))  # dashes
_POINTS = {"limit_point": ("o", "limit point"), "bifurcation": ("s", "bifurcation")}


def draw_history(axis: Any, history: pandas.DataFrame, x: str, y: str, **style: Any) -> None:
    """Draw one column of a history over another.

    Args:
        axis: Axes to draw into.
        history: The history; unstable parts are dashed if it has the column `unstable_modes`.
        x: Column of the abscissa.
        y: Column of the ordinate.
        style: Matplotlib's style of the line, with its label.
    """
    if len(history) == 1:
        style.setdefault("marker", ".")
    if _MODES not in history or not history[_MODES].any():
        axis.plot(history[x], history[y], **style)
        return
    xs, ys = history[x].to_numpy(), history[y].to_numpy()
    # the row of a limit point counts the modes before it, so it belongs to the part before it
    unstable = history[_MODES].to_numpy()[1:] > 0
    ends = [0, *(np.flatnonzero(np.diff(unstable)) + 1), len(unstable)]
    label = style.pop("label", None)
    for first, last in pairwise(ends):
        part = slice(first, last + 1)
        line = style | ({"ls": _UNSTABLE} if unstable[first] else {"label": label})
        axis.plot(xs[part], ys[part], **line)
        label = None if not unstable[first] else label
    colour = style.get("color", "C0")
    for column, (mark, _) in _POINTS.items():
        at = history.get(column, 0 * history[y]).to_numpy() > 0
        axis.plot(xs[at], ys[at], mark, ms=7, mfc="none", mec=colour, zorder=4)


def key(histories: Iterable[pandas.DataFrame], colour: str) -> list[Any]:
    """Legend entries for the dashes and markers that `draw_history` draws in some histories."""
    drawn = [h for h in histories if _MODES in h and h[_MODES].any()]
    if not drawn:
        return []
    found = [Line2D([], [], color=colour, ls=_UNSTABLE, label="unstable")]
    return found + [
        Line2D([], [], ls="", marker=mark, ms=7, mfc="none", mec=colour, label=name)
        for column, (mark, name) in _POINTS.items()
        if any(column in h and h[column].any() for h in drawn)
    ]
