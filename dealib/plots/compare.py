"""Measured and computed curves over each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt

from dealib.data.compare import Comparison
from dealib.data.measured import split_unit

matplotlib.use("Agg")
import matplotlib.pyplot as plt

MEASURED, COMPUTED = "#d1495b", "#30638e"


def draw_comparison(
    comparisons: Sequence[Comparison],
    picture: Path,
    history: Mapping[str, npt.ArrayLike] | None = None,
    titles: Sequence[str] | None = None,
) -> None:
    """Draw each measured curve with the computed one, and their difference below.

    Args:
        comparisons: What to draw, one column of axes each.
        picture: PNG, SVG or PDF file.
        history: The whole run, drawn behind.
        titles: One a comparison.
    """
    n = len(comparisons)
    figure, axes = plt.subplots(
        2, n, figsize=(1.5 + 4.5 * n, 5.5), layout="constrained", sharex="col", squeeze=False,
        height_ratios=(3, 1),
    )  # fmt: skip
    for k, c in enumerate(comparisons):
        above, below = axes[0, k], axes[1, k]
        if history is not None:
            x, y = np.asarray(history[c.x_name]), np.asarray(history[c.y_name])
            above.plot(x, y, color=COMPUTED, lw=0.8, alpha=0.4, label="whole run")
        above.plot(c.x, c.measured, "o", ms=3.5, mfc="none", color=MEASURED, label="measured")
        for number in np.unique(c.branch):
            part = c.of_branch(int(number))
            label = "computed" if number == 0 else None
            order = np.argsort(part.x)
            above.plot(part.x[order], part.computed[order], color=COMPUTED, lw=1.6, label=label)
        below.axhline(0, color="#999999", lw=0.8)
        below.plot(c.x, c.computed - c.measured, ".", ms=4, color=COMPUTED)
        note = f"RMSE {c.rmse:.3g} {split_unit(c.y_name)[1]}, R² {c.r2:.5f}"
        above.set(ylabel=axis_label(c.y_name))
        above.set_title("\n".join(t for t in (titles[k] if titles else "", note) if t), fontsize=10)
        below.set(xlabel=axis_label(c.x_name), ylabel="computed - measured")
        above.legend(frameon=False)
        for axis in (above, below):
            axis.spines[["top", "right"]].set_visible(False)
            axis.grid(color="#e5e5e5", lw=0.6)
    save(figure, picture)


def axis_label(column: str) -> str:
    """'force (N)' for force_N."""
    name, unit = split_unit(column)
    return f"{name.replace('_', ' ')} ({unit})" if unit else name.replace("_", " ")


def save(figure: Any, picture: Path) -> None:
    """Write a figure and forget it."""
    figure.savefig(picture, dpi=150)
    plt.close(figure)
