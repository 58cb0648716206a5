"""Shapes of modes side by side, still or swinging, and curves of their frequencies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.errors import ConfigError
from dealib.plots.animation import DPI, SIZE, Image, grabbed, settle
from dealib.plots.contours import Scale, magnification, paint
from dealib.plots.labels import label, plain
from dealib.plots.shape import LayerShape
from dealib.plots.style import DASHES, Theme
from dealib.plots.views import Scene
from dealib.results import spectra
from dealib.results.quantities import FieldQuantity
from dealib.results.reader import Run

_AT_ONCE = 8  # modes in one picture


def draw_modes(run: Run, step: int, look: Theme) -> Any:
    """Draw the shapes of a stored step's first eight modes over the equilibrium."""
    figure, moved = _scene(run, step, look, ())
    for part, rest, way, values in moved:
        part.move(rest + way, values)
    return figure


def frames(
    run: Run, step: int, look: Theme, names: Sequence[str], count: int, periods: int
) -> Iterator[Image]:
    """Pictures (height, width, 3) of modes that vibrate for some periods, all in phase."""
    figure, moved = _scene(run, step, look, names)
    for k in range(count):
        share = np.sin(2 * np.pi * periods * k / count)
        for part, rest, way, values in moved:
            part.move(rest + share * way, values)
        yield grabbed(figure)


def _scene(
    run: Run, step: int, look: Theme, names: Sequence[str]
) -> tuple[Any, list[tuple[Any, Any, Any, Any]]]:
    """The figure, and for each mode its drawing, points at rest, amplitudes and values."""
    plain_shape = LayerShape(run, step, n=2)
    known = [name for name in plain_shape.arrays if name.startswith("mode")]
    for name in names:
        if name not in known:
            raise ConfigError(f"{run.directory}: step {step} has no {name}: {', '.join(known)}")
    names = list(names or known[:_AT_ONCE])
    factor, told = magnification(plain_shape), _frequencies(run, plain_shape.step)
    rest, moved = plain_shape.moved(factor), []
    for name in names:
        shape = LayerShape(run, step, n=2, mode=name)
        what = FieldQuantity(name, "Displacement over the largest", "", name)
        moved.append((shape, what, shape.moved(factor) - rest, shape.values(what)))
    ends = np.concatenate([rest + s * way for _, _, way, _ in moved for s in (-1, 1)])
    low, high = ends.min(axis=0), ends.max(axis=0)
    figure = plt.figure(figsize=SIZE, dpi=DPI, layout="constrained")
    wide = np.ptp(ends[:, 0]) > 3 * np.ptp(ends[:, 1])
    columns = min(3 if plain_shape.solid else 2 if wide else 4, len(names))
    rows = -(-len(names) // columns)
    axes = figure.subplots(rows, columns, squeeze=False)
    colours = Scale(plt.Normalize(0, 1), look.sequential, "neither")
    parts = []
    for axis, (shape, what, way, values) in zip(axes.T.flat, moved, strict=False):
        part: Any
        if shape.solid:
            part = Scene(axis, shape, what, colours, look, (low, high))
        else:
            part = paint(axis, shape, rest, values, colours, look)
            axis.plot(*rest[shape.strips.outline].T, color=look.faint, lw=0.4, zorder=0)
            axis.set_aspect("equal")
            room = 0.04 * np.ptp(ends, axis=0)
            axis.set(xlim=(low[0] - room[0], high[0] + room[0]))
            axis.set(ylim=(low[1] - room[1], high[1] + room[1]))
            across, up = (f"{name} (mm)" for name in shape.kinematics.axes)
            axis.set_xlabel(across, fontsize="small")
            axis.set_ylabel(up, fontsize="small")
            axis.tick_params(labelsize="small")
        axis.set_title(plain(told.get(what.name, what.name)), loc="left", fontsize="medium")
        parts.append((part, rest, way, values))
    for axis in axes.T.flat[len(names) :]:
        axis.set_axis_off()
    colours.bar(figure, "Displacement over the largest", ax=list(axes.flat), shrink=0.8, pad=0.01)
    figure.suptitle(plain(f"{run.title}, {plain_shape.when}"), fontsize="medium")
    settle(figure)
    return figure, parts


def _frequencies(run: Run, step: int) -> dict[str, str]:
    """Titles of a step's modes by name: 'mode 2: 61.8 Hz'."""
    if not (run.directory / spectra.MODES).is_file():
        return {}
    table = spectra.read(run.directory / spectra.MODES, "step", "mode", "frequency_Hz")
    found = {}
    for _, row in table[table["step"] == step].iterrows():
        n, f = int(row["mode"]), float(row["frequency_Hz"])
        told = f"{f:.5g} Hz" if f >= 0 else f"unstable, e-fold in {1 / (-2 * np.pi * f):.3g} s"
        found["mode" + (str(n) if n > 1 else "")] = f"mode {n}: {told}"
    return found


def draw_frequencies(run: Run, stage: str, look: Theme) -> Any:
    """Draw frequencies along a stage over the variable that drives it.

    Args:
        run: A run with `frequencies.csv`.
        stage: Name of the stage.
        look: Colours.
    """
    table = spectra.read(run.directory / spectra.FREQUENCIES)
    x = driven(run, stage)
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    curves = [name for name in map(str, table) if name.startswith("frequency_Hz")]
    for axis, count, title in zip(axes, (1, len(curves)), ("the lowest", "all"), strict=True):
        for k, name in enumerate(curves[:count]):
            dash = DASHES[k // len(look.lines) % len(DASHES)]
            told = {} if count == 1 else {"label": f"mode {k + 1}"}
            axis.plot(table[x], table[name], marker=".", ls=dash, ms=4, **told)
        if (table[curves[:count]] < 0).any(axis=None):
            axis.axhline(0, color=look.ink, lw=0.8)
            axis.set_ylabel("Frequency; below 0 growth rate over 2π (Hz)")
        else:
            axis.set_ylabel("Frequency (Hz)")
        axis.set_xlabel(label(x))
        axis.set_title(title, loc="left")
    figure.suptitle(plain(f"{run.title}, {stage}"), fontsize="medium")
    figure.legend(loc="outside right upper")
    return figure


def driven(run: Run, stage: str) -> str:
    """Column of the first variable that drives a stage, such as its voltage; else the time."""
    device = run.config.device
    for given in run.config.program:
        if given.stage != stage:
            continue
        if given.follow is not None:
            return device.column(given.follow.pair[1])
        for name, drive in given.driven(device).items():
            port = device.by_name[name]
            for variable in port.kind.variables:
                if drive.given[0] == variable.name:
                    return port.column(variable)
            return port.column(port.kind.primal)
    return "time_s"
