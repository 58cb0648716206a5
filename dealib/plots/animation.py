"""Animations of the deforming device with its fields, beside curves of motion and drive."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.errors import ConfigError
from dealib.files import whole
from dealib.plots.contours import Painted, frame, magnification, paint, scale, scale_note
from dealib.plots.curves import steady
from dealib.plots.labels import label, plain, split
from dealib.plots.shape import LayerShape
from dealib.plots.style import Theme
from dealib.plots.views import Scene
from dealib.results import stages
from dealib.results.quantities import FieldQuantity, main_stress, quantity
from dealib.results.reader import Run
from dealib.results.summary import drive, moment, motion, under_voltage
from dealib.units import neat

FORMATS = (".mp4", ".gif")
SIZE, DPI = (12.8, 7.2), 100  # 1280 x 720: H.264 wants even numbers
Image = npt.NDArray[np.uint8]


def usual(run: Run) -> list[FieldQuantity]:
    """Quantities shown by default: a stress, and under voltage the electric field."""
    device = run.config.device
    names = [main_stress(device), *(["E"] if under_voltage(run.history).any() else [])]
    return [quantity(name, device.kinematics) for name in names]


def frames(run: Run, whats: Sequence[FieldQuantity], look: Theme, count: int) -> Iterator[Image]:
    """Pictures (height, width, 3) at equal intervals of time, linearly interpolated between steps.

    Raises:
        ConfigError: If fewer than two steps are stored.
    """
    steps = run.stored_steps
    if len(steps) < 2:
        raise ConfigError(
            f"{run.directory}: an animation needs at least two stored steps (see output.fields)"
        )
    rows = run.history.set_index("step", drop=False)
    clock = stages.clock(run.config.program)
    times = rows.loc[steps, clock].to_numpy(float)
    factor = magnification(LayerShape(run))

    @lru_cache(maxsize=2)
    def at(k: int) -> list[Array]:
        shape = LayerShape(run, steps[k], n=2)
        return [shape.moved(factor), *(shape.values(what) for what in whats)]

    figure, painted, markers, note = _scene(run, whats, look, factor, clock)
    for t in np.linspace(times[0], times[-1], count):
        k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
        s = (t - times[k]) / (times[k + 1] - times[k])
        x, *values = ((1 - s) * a + s * b for a, b in zip(at(k), at(k + 1), strict=True))
        for part, now in zip(painted, values, strict=True):
            part.move(x, now)
        inputs = {c: float(np.interp(t, rows[clock], rows[c])) for c in markers}
        for column, marker in markers.items():
            marker.set_data([t], [inputs[column]])
        row = {"step": round(t), "time_s": t, "stage": rows["stage"][steps[k + (s > 0)]]}
        told = [f"{neat(inputs[c], 3)} {split(c)[1]}".rstrip() for c in markers]
        when = moment(run, row) if clock == "step" else f"t = {t:.2f} s, {row['stage']}"
        inputs_told = ",  ".join(told).replace("-", "−")
        note.set_text(plain(f"{run.title}     {when}     {inputs_told}"))
        yield grabbed(figure)


def settle(figure: Any) -> None:
    """Lay a figure's panels out, and keep them where they are from then on."""
    for _ in range(2):  # which labels the ticks have is known after a first drawing
        figure.canvas.draw()
    figure.set_layout_engine("none")


def grabbed(figure: Any) -> Image:
    """The current picture of a figure, (height, width, 3)."""
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()


def _shown(run: Run) -> list[str]:
    """Columns of the curves."""
    return list(dict.fromkeys([*motion(run), drive(run)]))


def _typical(run: Run) -> list[int]:
    """Stored steps that span the range of values: nine at equal intervals, and the extremes."""
    steps = run.stored_steps
    rows = run.history.set_index("step").loc[steps, _shown(run)].abs()
    some = {steps[k] for k in np.linspace(0, len(steps) - 1, 9, dtype=int)}
    return sorted(some | {int(k) for k in rows.idxmax()})


def _scene(
    run: Run, whats: Sequence[FieldQuantity], look: Theme, factor: float, clock: str
) -> tuple[Any, list[Painted | Scene], dict[str, Any], Any]:
    """The figure, its drawings of the device, the markers by column, and the line of text."""
    shapes = [LayerShape(run, step, n=2) for step in _typical(run)]
    moved = np.concatenate([shape.moved(factor) for shape in shapes])
    low, high = moved.min(axis=0), moved.max(axis=0)
    figure = plt.figure(figsize=SIZE, dpi=DPI, layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=(1.15, 1))
    left, right = halves
    painted: list[Painted | Scene] = []
    for axis, what in zip(left.subplots(len(whats), 1, squeeze=False)[:, 0], whats, strict=True):
        values = [shape.values(what) for shape in shapes]
        colours = scale(shapes[0], np.array(values), look, what)
        if shapes[0].solid:
            painted.append(Scene(axis, shapes[0], what, colours, look, (low, high)))
        else:
            first = (shapes[0].moved(factor), values[0])
            painted.append(paint(axis, shapes[0], *first, colours, look))
            frame(axis, shapes[0])
            axis.set_adjustable("box")
            a, b = np.stack([low, high], axis=1) + 0.04 * (high - low)[:, None] * (-1, 1)
            axis.set(xlim=a, ylim=b)
        axis.set_title(scale_note(factor), loc="left")
        colours.bar(left, what.title, ax=axis)
    markers, history = {}, run.history
    shown = _shown(run)
    axes = right.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for k, (axis, column) in enumerate(zip(axes, shown, strict=True)):
        axis.plot(history[clock], history[column], color=f"C{k}")
        markers[column] = axis.plot([], [], "o", color=look.ink, ms=7)[0]
        axis.set_ylabel(label(column))
    steady(*axes)
    axes[-1].set_xlabel(label(clock))
    note = figure.suptitle(" ", fontsize="large", fontfamily="monospace")
    settle(figure)
    return figure, painted, markers, note


def write(images: Iterator[Image], path: Path, rate: int) -> None:
    """Write pictures as MP4 (H.264) or GIF, by the suffix.

    Raises:
        PlatformError: If the disk refuses.
    """
    with whole(path) as temporary:
        (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(images, temporary, rate)


def _write_mp4(images: Iterator[Image], path: Path, rate: int) -> None:
    import av  # brings its own encoder

    with av.open(str(path), "w") as film:
        stream: Any = film.add_stream("libx264", rate=rate, options={"crf": "20"})
        stream.pix_fmt = "yuv420p"
        stream.width, stream.height = (round(DPI * inches) for inches in SIZE)
        for image in images:
            film.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        film.mux(stream.encode())


def _write_gif(images: Iterator[Image], path: Path, rate: int) -> None:
    from PIL import Image as pillow

    first, *others = (pillow.fromarray(image).quantize(256) for image in images)
    first.save(path, save_all=True, append_images=others, duration=round(1000 / rate), loop=0)
