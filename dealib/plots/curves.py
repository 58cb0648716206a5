"""Curves from the histories of one or several runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from dealib.errors import ConfigError, did_you_mean
from dealib.plots import limits
from dealib.plots.branches import draw_history, key
from dealib.plots.labels import kind, label, plain, split
from dealib.plots.style import DASHES
from dealib.results.reader import Run
from dealib.results.summary import MARGINS

_NOISE = 1e-12  # in the unit of any column


def overview(runs: Sequence[Run]) -> Any:
    """Force-displacement, the inputs in time, capacitance and field: a 2 x 2 figure."""
    figure, axes = plt.subplots(2, 2, figsize=(10.5, 7.2), layout="constrained")
    (force, time), (capacitance, last) = axes
    voltage = _panel_beside(time)
    axes_of_last = ("voltage_kV", "field_max_MV_per_m")
    if not any(run.history["voltage_kV"].any() for run in runs):
        axes_of_last = ("displacement_mm", "thickness_stretch_min")
    for k, run in enumerate(runs):
        h = run.history
        dash = {"color": f"C{k}", "ls": DASHES[k % len(DASHES)]}
        style = dash | {"marker": ".", "ms": 4}
        draw_history(force, h, "displacement_mm", "force_N", label=names(runs)[k], **style)
        draw_history(time, h, "time_s", "displacement_mm", **dash)
        if len(runs) == 1:
            force_axis = time.twinx()
            draw_history(force_axis, h, "time_s", "force_N", color="C1", ls="-.")
            _colour(time, "left", "C0")
            _colour(force_axis, "right", "C1")
            force_axis.set_ylabel(label("force_N"))
            _steady(force_axis)
        if len(runs) == 1:
            dash["color"] = "C2"
        draw_history(voltage, h, "time_s", "voltage_kV", **dash)
        draw_history(capacitance, h, "displacement_mm", "capacitance_pF", **style)
        draw_history(last, h, axes_of_last[0], axes_of_last[1], **style)
        for axis, x, y in (
            (force, "displacement_mm", "force_N"),
            (capacitance, "displacement_mm", "capacitance_pF"),
            (last, *axes_of_last),
        ):
            limits.mark(axis, run, x, y)
    force.set(xlabel=label("displacement_mm"), ylabel=label("force_N"))
    time.set_ylabel(label("displacement_mm"))
    time.tick_params(labelbottom=False)
    voltage.set(xlabel=label("time_s"), ylabel=label("voltage_kV"))
    voltage.margins(y=0.15)  # a low panel
    capacitance.set(xlabel=label("displacement_mm"), ylabel=label("capacitance_pF"))
    last.set(xlabel=label(axes_of_last[0]), ylabel=label(axes_of_last[1]))
    _steady(force, capacitance, time, voltage, last)
    _key(figure, runs, ("", "", axes_of_last[1]))
    if len(runs) > 1:
        figure.legend(loc="outside upper center", ncols=min(len(runs), 4))
    else:
        figure.suptitle(names(runs)[0])
    return figure


def curves(runs: Sequence[Run], x: str, ys: Sequence[str]) -> Any:
    """Any columns against another: one panel a unit, runs by colour, columns by dashes.

    Raises:
        ConfigError: If a run has no such column.
    """
    for run in runs:
        for column in (x, *ys):
            check_column(run, column)
    panels: dict[str, list[str]] = {}
    for column in ys:
        name, unit = split(column)
        panels.setdefault(unit or name, []).append(column)
    figure, axes = plt.subplots(
        len(panels), 1, figsize=(7, 2 + 2.6 * len(panels)), sharex=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    titles = names(runs)
    for axis, columns in zip(axes[:, 0], panels.values(), strict=True):
        for k, (run, title) in enumerate(zip(runs, titles, strict=True)):
            for n, column in enumerate(columns):
                several = [title] if len(runs) > 1 else []
                several += [split(column)[0]] if len(columns) > 1 else []
                draw_history(
                    axis,
                    run.history,
                    x,
                    column,
                    color=f"C{k if len(runs) > 1 else n}",
                    ls=DASHES[(k + n) % len(DASHES)],
                    marker=".",
                    ms=4,
                    label=", ".join(several),
                )
                limits.mark(axis, run, x, column)
        unit = split(columns[0])[1]
        axis.set_ylabel(label(columns[0]) if len(columns) == 1 else kind(unit))
        _steady(axis)
        if all(column in MARGINS for column in columns):
            limits.limit(axis)
        if len(columns) > 1 or (len(runs) > 1 and axis is axes[0, 0]):
            axis.legend()
    axes[-1, 0].set_xlabel(label(x))
    _key(figure, runs, ys)
    if len(runs) == 1:
        figure.suptitle(titles[0])
    return figure


def check_column(run: Run, column: str) -> None:
    """Raise `ConfigError` if a run's history has no such column."""
    known = list(run.history.columns)
    if column == "stage" or column not in known:
        numbers = [c for c in known if c != "stage"]
        raise ConfigError(
            f"{run.directory}: no column {column!r} to plot{did_you_mean(column, numbers)}"
        )


def names(runs: Sequence[Run]) -> list[str]:
    """Names that tell runs apart: of the config, else of the directory."""
    given = [plain(run.info["name"]) for run in runs]
    if len(set(given)) == len(given):
        return given
    directories = [plain(run.directory.resolve().name) for run in runs]
    if len(set(directories)) == len(directories):
        return directories
    return [plain(run.directory) for run in runs]


def _panel_beside(axis: Any) -> Any:
    """A panel under another one, in its place."""
    spec = axis.get_subplotspec()
    inner = spec.subgridspec(2, 1, height_ratios=(2, 1), hspace=0.08)
    axis.set_subplotspec(inner[0])
    return axis.figure.add_subplot(inner[1], sharex=axis)


def _colour(axis: Any, side: str, colour: str) -> None:
    """An axis in the colour of its curve."""
    axis.tick_params(axis="y", colors=colour)
    axis.yaxis.label.set_color(colour)
    if side == "right":
        axis.spines["right"].set_visible(True)
        axis.spines["right"].set_color(colour)
        axis.grid(False)


def _key(figure: Any, runs: Sequence[Run], columns: Sequence[str]) -> None:
    """Say what bands, dashes and marks mean, where there are some."""
    colour = "C0" if len(runs) == 1 else plt.rcParams["text.color"]
    handles = key([run.history for run in runs], colour)
    if any(limits.beyond(run.history, column).any() for run in runs for column in columns):
        handles.append(Line2D([], [], label="beyond a limit", **limits.BAND))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def _steady(*axes: Any) -> None:
    """Do not blow rounding up to the size of the panel where a value does not change."""
    for axis in axes:
        for ends, limit in (
            (axis.dataLim.intervalx, axis.set_xlim),
            (axis.dataLim.intervaly, axis.set_ylim),
        ):
            size = np.abs(ends).max()
            if np.isfinite(size) and np.ptp(ends) <= max(1e-6 * size, _NOISE):
                limit(*(ends + np.array([-1, 1]) * (0.05 * size if size > _NOISE else 1.0)))
