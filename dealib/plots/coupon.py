"""Measured and fitted tests of a material, with residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from dealib.arrays import Array
from dealib.plots.labels import plain
from dealib.plots.style import save, theme


@dataclass(frozen=True)
class CouponCurve:
    """One test.

    Attributes:
        panel: Heading of the axes that it is drawn into.
        label: Label in the legend.
        x_label: Label of the abscissa.
        x: Measured abscissae, (points,).
        y: Measured stresses, (points,).
        off: Computed minus measured stresses, (points,).
        path: Abscissae and computed stresses along the test, (2, states).
    """

    panel: str
    label: str
    x_label: str
    x: Array
    y: Array
    off: Array
    path: Array


def draw_coupon(curves: Sequence[CouponCurve], title: str, unit: str, picture: Path) -> None:
    """Draw tests, a panel for each kind, and their residuals below.

    Args:
        curves: The tests.
        title: Of the figure.
        unit: Of the stresses.
        picture: PNG, SVG or PDF file.
    """
    panels = list(dict.fromkeys((c.panel, c.x_label) for c in curves))
    with theme() as look:
        figure, axes = plt.subplots(
            2, len(panels), figsize=(1.5 + 5 * len(panels), 6), layout="constrained",
            sharex="col", squeeze=False, height_ratios=(3, 1),
        )  # fmt: skip
        for k, panel in enumerate(panels):
            above, below = axes[:, k]
            own = [c for c in curves if (c.panel, c.x_label) == panel]
            for i, c in enumerate(own):
                colour = look.lines[i % len(look.lines)]
                many = len(c.x) > 200
                above.plot(c.x, c.y, "." if many else "o", ms=2 if many else 4, mfc="none",
                           color=colour, alpha=0.6)  # fmt: skip
                above.plot(*c.path, color=colour, label=c.label)
                below.plot(c.x, c.off, ".", ms=3, color=colour)
            below.axhline(0, color=look.ink, lw=0.6)
            above.set(title=panel[0])
            above.legend(title="points measured, lines fitted")
            below.set_xlabel(panel[1])
            if panel[1].startswith("Time"):
                times = np.concatenate([c.x for c in own])
                if times.max() > 100 * times[times > 0].min():
                    above.set_xscale("log")
        axes[0, 0].set_ylabel(f"Nominal stress ({unit})")
        axes[1, 0].set_ylabel(f"fitted − measured\n({unit})")
        figure.align_ylabels(axes)
        figure.suptitle(plain(title), fontsize=11)
        save(figure, picture)
