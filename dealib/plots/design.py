"""Pictures of designs: the search for an optimum, and the Pareto front of two objectives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.plots.labels import plain
from dealib.plots.style import Theme


def draw_way(table: Any, aims: Sequence[tuple[str, int]], title: str, look: Theme) -> Any:
    """Draw each objective over the designs in order of their solution, and the best value so far.

    Args:
        table: Table of `designs.csv`.
        aims: Names of the objectives, each with 1 if it is minimised, else -1.
        title: Title of the picture.
        look: Colours.
    """
    figure, axes = plt.subplots(
        *(len(aims), 1),
        figsize=(7.5, 1.2 + 2.6 * len(aims)),
        sharex=True,
        layout="constrained",
        squeeze=False,
    )
    for axis, (name, sign) in zip(axes[:, 0], aims, strict=True):
        for k, (model, part) in enumerate(table.groupby("model")):
            for allowed, style in ((True, {"marker": "o"}), (False, {"marker": "x", "alpha": 0.5})):
                some = part[part["allowed"] == allowed]
                told = model if allowed else f"{model}, beyond a limit"
                colour = look.lines[k % len(look.lines)]
                if len(some):
                    axis.scatter(
                        some["number"], some[name], s=22, color=colour, label=told, **style
                    )
            good = part[part["allowed"]]
            best = sign * np.minimum.accumulate(sign * good[name]) if len(good) else good[name]
            axis.step(good["number"], best, where="post", color=look.lines[k % len(look.lines)])
        axis.set_ylabel(plain(name))
        axis.legend(fontsize="small")
    axes[-1, 0].set_xlabel("Design")
    axes[-1, 0].xaxis.get_major_locator().set_params(integer=True)
    figure.suptitle(plain(title), fontsize="medium")
    return figure


def draw_front(table: Any, front: Any, names: tuple[str, str], title: str, look: Theme) -> Any:
    """Draw all feasible designs and the Pareto front.

    Args:
        table: Table of `designs.csv`.
        front: Table of `front.csv`.
        names: Names of the two objectives.
        title: Title of the picture.
        look: Colours.
    """
    figure, axis = plt.subplots(figsize=(6.5, 5), layout="constrained")
    others = table[table["allowed"] & (table["model"] == front["model"].iloc[0])]
    x, y = names
    axis.scatter(others[x], others[y], s=16, color=look.faint, label="allowed")
    axis.plot(front[x], front[y], "o-", ms=5, color=look.lines[0], label="front")
    axis.set(xlabel=plain(x), ylabel=plain(y))
    axis.legend()
    figure.suptitle(plain(title), fontsize="medium")
    return figure
