"""Limits in curves: what lies beyond one, and how much of each is used."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.results.reader import Run
from dealib.results.summary import MARGINS

if TYPE_CHECKING:
    import matplotlib.axes
    import pandas

BEYOND = "#d1242f"  # on light and dark paper
BAND: dict[str, Any] = {"color": BEYOND, "alpha": 0.35, "lw": 7, "zorder": 1.5}


def beyond(history: pandas.DataFrame, column: str = "") -> Any:
    """Whether a margin is used up, one value a row: that of a column, else any of them."""
    uses = [column] if column in MARGINS else [c for c in MARGINS if c in history]
    return (history[uses] > 1 + 1e-9).any(axis=1).to_numpy()


def mark(axis: matplotlib.axes.Axes, run: Run, x: str, y: str) -> bool:
    """Draw a red band behind the part of a curve that lies beyond a limit.

    Returns:
        Whether anything lies there.
    """
    there = beyond(run.history, y)
    if there.any():
        alone = there & ~np.append(False, there[:-1]) & ~np.append(there[1:], False)
        dots: dict[str, Any] = {"marker": "o", "ms": 7, "mew": 0}
        dots["markevery"] = np.flatnonzero(alone).tolist()
        axis.plot(run.history[x], np.where(there, run.history[y], np.nan), **BAND, **dots)
    return bool(there.any())


def limit(axis: matplotlib.axes.Axes) -> None:
    """The limit of utilisations, and what is beyond it."""
    top = max(axis.get_ylim()[1], 1.15)
    axis.set_ylim(top=top)
    axis.axhline(1, color=BEYOND, lw=1)
    axis.axhspan(1, top, color=BEYOND, alpha=0.08, lw=0)


def uses(run: Run) -> Any:
    """The use of each limit in time."""
    import matplotlib.pyplot as plt

    h = run.history
    figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
    for column, (name, _) in MARGINS.items():
        if column in h:
            axis.plot(h["time_s"], h[column], label=name)
    limit(axis)
    axis.set(xlabel="Time (s)", ylabel="Use (1 is the limit)")
    figure.legend(loc="outside upper center", ncols=5)
    return figure
