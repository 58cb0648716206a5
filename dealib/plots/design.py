"""Pictures of designs: searches, Pareto fronts, sensitivities and uncertain quantities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.plots.labels import plain
from dealib.plots.style import Theme

_MOST = 15  # sensitivities of a quantity
_BARS = 12  # Sobol indices of a quantity


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


def draw_sensitivities(table: Any, title: str, look: Theme) -> Any:
    """Draw a tornado chart: a bar for each number, the longest on top, coloured by its sign.

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


def draw_uncertainty(samples: Any, summary: Any, sobol: Any, title: str, look: Theme) -> Any:
    """Draw a row per quantity: a histogram with quantiles, and Sobol indices with their errors.

    Args:
        samples: Table of `samples.csv`.
        summary: Table of `summary.csv`.
        sobol: Table of `sobol.csv`.
        title: Title of the picture.
        look: Colours.
    """
    names = list(dict.fromkeys(sobol["quantity"]))
    figure, axes = plt.subplots(
        *(len(names), 2), figsize=(10, 0.6 + 2.6 * len(names)), layout="constrained", squeeze=False
    )
    levels = [c for c in summary if c.startswith("q") and c[1:].replace(".", "").isdigit()]
    for (left, right), name in zip(axes, names, strict=True):
        values = samples[name].dropna()
        left.hist(values, bins="auto", density=True, color=look.lines[0], alpha=0.6)
        row = summary[summary["quantity"] == name]
        for level in levels if len(row) else ():
            left.axvline(row[level].iloc[0], color=look.lines[1], lw=1)
            left.annotate(
                *(f"{level[1:]} %", (row[level].iloc[0], 1)),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize="x-small",
            )
        left.set(xlabel=plain(name), ylabel="density", yticks=[])
        part = sobol[sobol["quantity"] == name].nlargest(_BARS, "total")[::-1]
        at = np.arange(len(part))
        for k, (kind, shift) in enumerate((("total", -0.2), ("first", 0.2))):
            errors = part[f"{kind}_error"]
            right.barh(
                *(at + shift, part[kind], 0.38),
                xerr=errors,
                color=look.lines[1 - k],
                ecolor=look.ink,
                label={"first": "first order", "total": "total"}[kind],
            )
        right.set_yticks(at, [plain(key) for key in part["key"]], fontsize="small")
        right.set_xlim(left=0)
        right.set_xlabel(plain(f"Sobol indices of {name}"), fontsize="small")
        right.grid(visible=False, axis="y")
        right.legend(fontsize="x-small", loc="lower right", reverse=True)
    figure.suptitle(plain(title), fontsize="medium")
    return figure
