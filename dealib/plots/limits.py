"""Limits in curves: bands where a limit is exceeded, and the used share of each limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from dealib.plots.labels import label
from dealib.results import stages
from dealib.results.reader import Run
from dealib.results.summary import GIVEN, MARGINS, VERDICTS, alarms

if TYPE_CHECKING:
    import matplotlib.axes
    import pandas

BEYOND = dict(zip(VERDICTS, ("#d1242f", "#e08700"), strict=True))
_BAND: dict[str, Any] = {"alpha": 0.4, "lw": 7, "zorder": 1.5}


def beyond(history: pandas.DataFrame, verdict: str, column: str = "") -> Any:
    """Whether a limit is exceeded, one value per row.

    Args:
        history: The history.
        verdict: One of `VERDICTS`: for limits of the config, or of the film itself.
        column: If this is a margin, only this one is considered.
    """
    uses = [column] if column in MARGINS else [c for c in MARGINS if c in history]
    uses = [c for c in uses if (c in GIVEN) == (verdict == VERDICTS[0])]
    return (history[uses] > 1 + 1e-9).any(axis=1).to_numpy()


def mark(axis: matplotlib.axes.Axes, run: Run, x: str, y: str) -> None:
    """Draw a band behind the part of a curve where a limit is exceeded."""
    for verdict, colour in reversed(BEYOND.items()):
        there = beyond(run.history, verdict, y)
        if not there.any():
            continue
        alone = there & ~np.append(False, there[:-1]) & ~np.append(there[1:], False)
        dots: dict[str, Any] = {
            "marker": "o",
            "ms": 7,
            "mew": 0,
            "markevery": np.flatnonzero(alone).tolist(),
        }
        values = np.where(there, run.history[y], np.nan)
        axis.plot(run.history[x], values, color=colour, **_BAND, **dots)


def told(run: Run) -> list[str]:
    """Texts on exceeded limits of a run: 'limit exceeded: breakdown 1.630', 'beyond: ...'."""
    return [f"{verdict}: {text}" for verdict, text in alarms(run).items()]


def key(runs: Sequence[Run], columns: Sequence[str]) -> list[Line2D]:
    """Legend entries for the bands of `mark`; for a single run with the largest values."""
    found = []
    for verdict, colour in BEYOND.items():
        if any(beyond(r.history, verdict, c).any() for r in runs for c in columns):
            text = f"{verdict}: {alarms(runs[0])[verdict]}" if len(runs) == 1 else verdict
            found.append(Line2D([], [], color=colour, label=f"{text} (1 is the limit)", **_BAND))
    return found


def limit(axis: matplotlib.axes.Axes, columns: Sequence[str]) -> None:
    """Draw the limit 1 of margins, and shade what is above it."""
    colour = BEYOND[VERDICTS[not set(columns) & set(GIVEN)]]
    top = max(axis.get_ylim()[1], 1.15)
    axis.set_ylim(top=top)
    axis.axhline(1, color=colour, lw=1)
    axis.axhspan(1, top, color=colour, alpha=0.08, lw=0)


def uses(run: Run) -> Any:
    """The use of each limit in time."""
    h, clock = run.history, stages.clock(run.config.program)
    figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
    columns = [c for c in MARGINS if c in h]
    for column in columns:
        axis.plot(h[clock], h[column], label=MARGINS[column][0])
    limit(axis, columns)
    axis.set(xlabel=label(clock), ylabel="Use (1 is the limit)")
    figure.legend(loc="outside upper center", ncols=5)
    return figure
