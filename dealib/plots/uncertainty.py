"""Pictures of uncertain quantities: their distributions and Sobol indices."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.plots.labels import plain
from dealib.plots.style import Theme

_BARS = 12  # Sobol indices of a quantity


def draw(samples: Any, summary: Any, sobol: Any, title: str, look: Theme) -> Any:
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
