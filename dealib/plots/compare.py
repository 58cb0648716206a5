"""Measured and computed curves in one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from dealib.data.compare import Comparison
from dealib.plots.data import thinned
from dealib.plots.labels import label, plain, split
from dealib.plots.style import save, theme

_CURVES = 50  # branches whose computed curve is drawn


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
        history: The history of the run, whose whole curve is drawn behind.
        titles: One title per comparison.
    """
    with theme():
        n = len(comparisons)
        figure, axes = plt.subplots(
            2, n, figsize=(1.5 + 4.5 * n, 5.5), layout="constrained", sharex="col", squeeze=False,
            height_ratios=(3, 1),
        )  # fmt: skip
        for k, c in enumerate(comparisons):
            above, below = axes[:, k]
            unit = split(c.y_name)[1]
            few = thinned(c.measured)
            above.plot(
                c.x[few], c.measured[few], "o", ms=3.5, mfc="none", color="C1", label="measured"
            )
            for number, curve in enumerate(c.curves[:_CURVES]):
                above.plot(*curve, color="C0", label=None if number else "computed")
            if history is not None:
                x, y = np.asarray(history[c.x_name]), np.asarray(history[c.y_name])
                # the compared part fills the picture, not the whole run
                above.set(xlim=above.get_xlim(), ylim=above.get_ylim())
                above.plot(x, y, color="C0", lw=0.8, alpha=0.4, label="whole run")
            below.axhline(0, color="C1", lw=0.8)
            below.plot(c.x[few], (c.computed - c.measured)[few], ".", ms=4, color="C0")
            note = f"RMSE {c.rmse:.3g} {unit}".rstrip() + f", R² {c.r2:.5f}"
            title = "\n".join(t for t in (plain(titles[k]) if titles else "", note) if t)
            above.set_title(title)
            above.set(ylabel=label(c.y_name))
            difference = "computed −\nmeasured" + (f" ({unit})" if unit else "")
            below.set(xlabel=label(c.x_name), ylabel=difference)
            above.legend(loc="best" if len(c.x) < 1000 else "upper right")  # best is slow
        figure.align_ylabels(axes)
        save(figure, picture)
