"""Curves of a history, their unstable parts dashed and their limit points marked."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas

_MODES, _LIMIT, _BIFURCATION = "unstable_modes", "limit_point", "bifurcation"


def draw_history(axis: Any, history: pandas.DataFrame, x: str, y: str, **style: Any) -> None:
    """Draw a column over another.

    Args:
        axis: Where.
        history: With or without the columns that tell stable states from unstable ones.
        x: Column across.
        y: Column up.
        style: Of the line, with its label.
    """
    if _MODES not in history or not history[_MODES].any():
        axis.plot(history[x], history[y], **style)
        return
    xs, ys = history[x].to_numpy(), history[y].to_numpy()
    # a limit point counts the modes before it, so it ends what it belongs to
    unstable = history[_MODES].to_numpy()[1:] > 0
    ends = [0, *(np.flatnonzero(np.diff(unstable)) + 1), len(unstable)]
    label = style.pop("label", None)
    for first, last in pairwise(ends):
        part = slice(first, last + 1)
        line = style | ({"ls": (0, (2, 1.5))} if unstable[first] else {"label": label})
        axis.plot(xs[part], ys[part], **line)
        label = None if not unstable[first] else label
    colour = style.get("color", "C0")
    for column, mark in ((_LIMIT, "o"), (_BIFURCATION, "s")):
        at = history[column].to_numpy() > 0
        axis.plot(xs[at], ys[at], mark, ms=6, mfc="none", mec=colour, zorder=4)
