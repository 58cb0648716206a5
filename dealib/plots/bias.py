"""The chart of a biased film: film at 0 V, film under voltage, and bias."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from dealib.plots.labels import label, plain
from dealib.plots.style import Theme
from dealib.results.bias import BiasChart


def draw_bias(chart: BiasChart, look: Theme, whole: bool = False) -> Any:
    """Force over displacement, equilibria as dots (hollow: unstable), strokes as arrows.

    Args:
        chart: The solved chart.
        look: Colours.
        whole: Show all displacements, not only those near the equilibria.
    """
    figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
    u = chart.displacement
    for k, (volts, force) in enumerate(chart.film.items()):
        colour = f"C{k}"
        axis.plot(u, force, color=colour, label=f"film at {volts:g} kV")
        for e in chart.equilibria[volts]:
            inside = colour if e.stable else look.paper
            axis.plot(e.displacement, e.force, "o", ms=8, mec=colour, mfc=inside, mew=1.6, zorder=4)
    left, right = (u[0], u[-1]) if whole else _about(chart)
    shown = (u >= left) & (u <= right)
    low, high = _limits(chart, shown)
    seen = ((chart.bias[shown] >= low) & (chart.bias[shown] <= high)).any()
    name = "bias" if seen else "bias (beyond these forces)"
    axis.plot(u, chart.bias, color=look.ink, ls="--", label=name)
    margin = 0.08 * (high - low)
    strokes = chart.strokes()
    axis.set(xlim=(left, right), ylim=(low - margin, high + margin * (1 + len(strokes))))
    for k, stroke in enumerate(strokes):
        y = high + margin * (0.5 + k)
        start, end = stroke.start, stroke.end
        arrow = {"arrowstyle": "-|>", "color": look.ink}
        axis.annotate("", (end.displacement, y), (start.displacement, y), arrowprops=arrow)
        text = f"stroke {stroke.length:.3f} mm" + ("" if stroke.returns else ", stays")
        middle = ((start.displacement + end.displacement) / 2, y)
        axis.annotate(text, middle, (0, 4), textcoords="offset points", ha="center")
        for e in (start, end):
            axis.plot([e.displacement] * 2, [e.force, y], color=look.faint, lw=0.8, zorder=1)
    title = "\n".join([plain(chart.name), *chart.notes()])
    axis.set(xlabel=label("displacement_mm"), ylabel=label("force_N"), title=title)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _about(chart: BiasChart) -> tuple[float, float]:
    """Range of displacements to show: that of the equilibria, with room on both sides."""
    u = chart.displacement
    at = [e.displacement for found in chart.equilibria.values() for e in found]
    if not at:
        return float(u[0]), float(u[-1])
    room = max(1.2 * (max(at) - min(at)), 0.12 * (u[-1] - u[0]))
    return max(float(u[0]), min(at) - room), min(float(u[-1]), max(at) + room)


def _limits(chart: BiasChart, shown: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """Range of forces to show: that of the film, and of the bias where it is of similar size."""
    film = np.concatenate([force[shown] for force in chart.film.values()])
    bias = chart.bias[shown]
    low, high = film.min(), film.max()
    span = high - low
    near = bias[(bias > low - span / 2) & (bias < high + span / 2)]
    shown = np.concatenate([film, near])
    return float(shown.min()), float(shown.max())
