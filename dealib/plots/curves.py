"""Curves from the histories of one or several runs."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from dealib.device.records import TERMINAL, Port
from dealib.errors import ConfigError, did_you_mean
from dealib.plots import limits
from dealib.plots.branches import draw_history, key
from dealib.plots.labels import kind, label, plain, split
from dealib.plots.style import DASHES
from dealib.results import stages
from dealib.results.reader import Run
from dealib.results.summary import MARGINS, drive, motion, under_voltage

_NOISE = 1e-12  # in the unit of any column
_TERMINALS = 6  # of a device, of which the overview shows curves
_LENGTH = 24  # characters that a label of a low panel has room for


def overview(runs: Sequence[Run]) -> Any:
    """A 2 x 2 figure of motion, motion and drive over time, capacitance, and field.

    The motion is that of the first run's first mount, chamber or probes (see `summary.motion`).
    A single run shows up to six terminals, and their charges too.
    """
    ports = _terminals(runs)
    figure, axes = plt.subplots(
        2, 2, figsize=(10.5, 9.2 if ports else 7.2), layout="constrained",
        height_ratios=(1.5 if ports else 1, 1),
    )  # fmt: skip
    (force, time), (capacitance, last) = axes
    below, *charges = _panels_below(time, 2 if ports else 1)
    clock, moves = clock_of(runs), motion(runs[0])
    driven = _strongest(runs[0], ports) if ports else drive(runs[0])
    u = moves[0] if moves else driven
    beside = moves[1] if len(moves) > 1 else driven if moves else "elastic_energy_mJ"
    capacitances = [c for c in map(str, runs[0].history) if c.startswith("capacitance_pF")]
    stored = [*capacitances, "elastic_energy_mJ"][0]
    under = any(under_voltage(run.history).any() for run in runs)
    panels = (
        (force, u, beside),
        (capacitance, u, stored),
        (last, driven, "field_max_MV_per_m") if under else (last, u, "thickness_stretch_min"),
    )
    for run in runs:
        for column in {u, beside, stored, driven}:
            check_column(run, column)
    for k, run in enumerate(runs):
        h, name = run.history, "; ".join([names(runs)[k], *limits.told(run)])
        dash = {"color": f"C{k}", "ls": DASHES[k % len(DASHES)]}
        for axis, x, y in panels:
            if not ports or axis is not capacitance:
                draw_history(axis, h, x, y, label=name, marker=".", ms=4, **dash)
            limits.mark(axis, run, x, y)
        timed = _in_time(run)
        draw_history(time, timed, clock, u, **dash)
        if len(runs) == 1:
            if beside not in (u, driven):
                second = time.twinx()
                draw_history(second, timed, clock, beside, color="C1", ls="-.")
                _colour(time, "left", "C0")
                _colour(second, "right", "C1")
                second.set_ylabel(textwrap.fill(label(beside), _LENGTH))
                steady(second)
            dash["color"] = "C2"
        if not ports:
            draw_history(below, timed, clock, driven, **dash)
        for port, line in zip(ports[:_TERMINALS], _lines(ports), strict=True):
            draw_history(below, timed, clock, port.column(TERMINAL.primal), **line)
            draw_history(charges[0], timed, clock, port.column(TERMINAL.dual), **line)
            own = f"capacitance_pF.{port.name}.{port.name}"
            if own in h:
                draw_history(capacitance, h, u, own, marker=".", ms=4, **line)
    for axis, x, y in panels:
        axis.set(xlabel=label(x), ylabel=label(y))
    time.set_ylabel(textwrap.fill(label(u), _LENGTH))
    lowest = [below, *charges][-1]
    for axis in (time, below, *charges):
        axis.tick_params(labelbottom=axis is lowest)
    lowest.set_xlabel(label(clock))
    below.set_ylabel(kind("kV") if ports else label(driven))
    for axis in charges:
        axis.set_ylabel(kind("µC"))
        capacitance.set_ylabel(kind("pF"))
    for axis in (below, *charges):
        axis.margins(y=0.15)  # a low panel
    steady(force, capacitance, time, below, last, *charges)
    if ports:
        figure.align_ylabels([time, below, *charges])
    curves = force.get_legend_handles_labels()[0]
    _keys(figure, runs, [y for _, _, y in panels], curves, _terminal_key(ports))
    return figure


def clock_of(runs: Sequence[Run]) -> str:
    """Column that orders the states of all runs: `time_s`, or `step` if one follows a branch."""
    clocks = {stages.clock(run.config.program) for run in runs}
    return "step" if "step" in clocks else "time_s"


def _in_time(run: Run) -> Any:
    """Rows to draw over time: those of dynamic stages and the rows before them, else all."""
    history = run.history
    moving = history["stage"].isin([s.stage for s in run.config.program if s.dynamic]).to_numpy()
    chosen = moving | np.append(moving[1:], False)
    return history[chosen].reset_index(drop=True) if chosen.any() else history


def curves(runs: Sequence[Run], x: str | None, ys: Sequence[str]) -> Any:
    """Columns over another column: one panel per unit, runs by colour, columns by dashes.

    By default x is the time, or the step if a run follows a branch.

    Raises:
        ConfigError: If a run has no such column.
    """
    x = x or clock_of(runs)
    for run in runs:
        for column in (x, *ys):
            check_column(run, column)
    panels: dict[str, list[str]] = {}
    for column in ys:
        name, unit = split(column)
        panels.setdefault(unit or name, []).append(column)
    figure, axes = plt.subplots(
        len(panels), 1, figsize=(8.5 if len(ys) > len(panels) else 7, 2 + 2.6 * len(panels)),
        sharex=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    titles = names(runs)
    for axis, columns in zip(axes[:, 0], panels.values(), strict=True):
        for k, (run, title) in enumerate(zip(runs, titles, strict=True)):
            for n, column in enumerate(columns):
                several = [title] if len(runs) > 1 else []
                several += [split(column)[0]] if len(columns) > 1 else limits.told(run)
                draw_history(
                    axis,
                    run.history,
                    x,
                    column,
                    color=f"C{k if len(runs) > 1 else n}",
                    ls=DASHES[(k + n) % len(DASHES)],
                    marker=".",
                    ms=4,
                    label="; ".join(several),
                )
                limits.mark(axis, run, x, column)
        unit = split(columns[0])[1]
        axis.set_ylabel(label(columns[0]) if len(columns) == 1 else kind(unit))
        steady(axis)
        if all(column in MARGINS for column in columns):
            limits.limit(axis, columns)
        if len(columns) > 1:
            axis.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    followed = x == "time_s" and clock_of(runs) == "step"
    time = "Time, along a branch the length of its path (s)"
    axes[-1, 0].set_xlabel(time if followed else label(x))
    single = len(runs) > 1 and max(map(len, panels.values())) == 1
    _keys(figure, runs, ys, axes[0, 0].get_legend_handles_labels()[0] if single else [])
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
    """Distinct names of runs: their titles, or their paths if titles are equal."""
    given = [plain(run.title) for run in runs]
    return given if len(set(given)) == len(given) else [plain(run.directory) for run in runs]


def _panels_below(axis: Any, count: int) -> list[Any]:
    """Split the place of a panel, and add panels of half its height below it."""
    spec = axis.get_subplotspec()
    inner = spec.subgridspec(1 + count, 1, height_ratios=(2, *[1] * count), hspace=0.08)
    axis.set_subplotspec(inner[0])
    return [axis.figure.add_subplot(inner[1 + k], sharex=axis) for k in range(count)]


def _terminals(runs: Sequence[Run]) -> Sequence[Port]:
    """The terminals of a single run if it has several, driven ones before floating ones."""
    found = sorted(runs[0].config.device.of(TERMINAL), key=lambda port: port.floating)
    return found if len(runs) == 1 and len(found) > 1 else []


def _strongest(run: Run, ports: Sequence[Port]) -> str:
    """Column of the largest voltage."""
    return max((p.column(TERMINAL.primal) for p in ports), key=lambda c: run.history[c].abs().max())


def _lines(ports: Sequence[Port]) -> list[dict[str, Any]]:
    """Colour and dashes of the terminals that are shown."""
    shown = range(min(len(ports), _TERMINALS))
    return [{"color": f"C{2 + k}", "ls": DASHES[k % len(DASHES)]} for k in shown]


def _terminal_key(ports: Sequence[Port]) -> list[Line2D]:
    """Legend entries of the terminals, and of how many are left out."""
    named = zip(ports, _lines(ports), strict=False)
    found = [Line2D([], [], label=f"terminal {plain(port.name)}", **line) for port, line in named]
    left = len(ports) - len(found)
    return found + [Line2D([], [], ls="", label=f"and {left} more")] * (left > 0)


def _colour(axis: Any, side: str, colour: str) -> None:
    """Give an axis the colour of its curve."""
    axis.tick_params(axis="y", colors=colour)
    axis.yaxis.label.set_color(colour)
    if side == "right":
        axis.spines["right"].set_visible(True)
        axis.spines["right"].set_color(colour)
        axis.grid(False)


def _keys(
    figure: Any,
    runs: Sequence[Run],
    columns: Sequence[str],
    curves: Sequence[Any],
    terminals: Sequence[Any] = (),
) -> None:
    """Add legends: above the figure for curves and limits, below it for others."""
    bands = limits.key(runs, columns)
    above = [*curves, *bands] if len(runs) > 1 else bands
    title = names(runs)[0] if len(runs) == 1 else None
    if above:
        legend = figure.legend(
            handles=above, title=title, title_fontsize="large", loc="outside upper center",
            ncols=1 if bands else min(len(above), 4),
        )  # fmt: skip
        for text, handle in zip(legend.get_texts(), above, strict=True):
            if handle in bands:
                text.set(color=handle.get_color(), weight="bold")
    elif title:
        figure.suptitle(title)
    colour = "C0" if len(runs) == 1 else plt.rcParams["text.color"]
    marks = [*terminals, *key([run.history for run in runs], colour)]
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=min(len(marks), 7))


def steady(*axes: Any) -> None:
    """Set limits where a value is constant, so that its rounding does not fill the panel."""
    for axis in axes:
        for ends, limit in (
            (axis.dataLim.intervalx, axis.set_xlim),
            (axis.dataLim.intervaly, axis.set_ylim),
        ):
            size = np.abs(ends).max()
            if np.isfinite(size) and np.ptp(ends) <= max(1e-6 * size, _NOISE):
                limit(*(ends + np.array([-1, 1]) * (0.05 * size if size > _NOISE else 1.0)))
