"""A film of the deforming strips with their field, beside the curves of the inputs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from dealib.errors import ConfigError
from dealib.files import whole
from dealib.plots.contours import frame, magnification, paint, scale, scale_note
from dealib.plots.labels import label, plain
from dealib.plots.quantities import Quantity
from dealib.plots.shape import Shape
from dealib.plots.style import Theme
from dealib.results.elements import Array
from dealib.results.reader import Run

FORMATS = (".mp4", ".gif")
_HALF = 0.24  # height of a strip's panel, of the figure's width
_SIZE, _DPI = (12.8, 7.2), 100  # 1280 x 720: H.264 wants even numbers
Image = npt.NDArray[np.uint8]


def frames(run: Run, what: Quantity, look: Theme, count: int) -> Iterator[Image]:
    """Pictures (height, width, 3) at equal distances in time; between steps it is linear.

    Raises:
        ConfigError: If fewer than two steps are stored.
    """
    steps = run.stored_steps
    times = run.history.set_index("step").loc[steps, "time_s"].to_numpy()
    if len(steps) < 2:
        raise ConfigError(f"{run.directory}: an animation needs at least two stored steps")
    factor = magnification(Shape(run))
    edges = Shape(run, n=2).strips.outline

    @lru_cache(maxsize=2)
    def at(k: int) -> tuple[Array, Array, Array]:
        shape = Shape(run, steps[k], n=2)
        return shape.moved(), shape.moved(factor), shape.strips(what.of(shape.arrays))

    figure, strips, markers = _stage(run, what, look, factor)
    for t in np.linspace(times[0], times[-1], count):
        k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
        s = (t - times[k]) / (times[k + 1] - times[k])
        now = [(1 - s) * a + s * b for a, b in zip(at(k), at(k + 1), strict=True)]
        for (colours, rim), x in zip(strips, now[:2], strict=True):
            grid = colours._triangulation
            grid.x, grid.y = x[:, 0].copy(), x[:, 1].copy()
            colours.set_array(now[2])
            rim.set_segments(list(x[edges]))
        for marker, values in markers:
            marker.set_data([t], [np.interp(t, run.history["time_s"], values)])
        figure.canvas.draw()
        yield np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()


def _typical(run: Run) -> list[int]:
    """Stored steps that span the range of values: some at equal distances, and the extremes."""
    steps = run.stored_steps
    rows = run.history.set_index("step").loc[steps, ["voltage_kV", "displacement_mm"]].abs()
    some = {steps[k] for k in np.linspace(0, len(steps) - 1, 9, dtype=int)}
    return sorted(some | {int(k) for k in rows.idxmax()})


def _stage(run: Run, what: Quantity, look: Theme, factor: float) -> Any:
    """The figure, the two painted strips, and the markers with their columns."""
    shapes = [Shape(run, step, n=2) for step in _typical(run)]
    values = [shape.strips(what.of(shape.arrays)) for shape in shapes]
    norm, cmap, extend = scale(shapes[0], np.array(values), look, what)
    figure = plt.figure(figsize=_SIZE, dpi=_DPI, layout="constrained")
    width, height = np.ptp(np.concatenate([shape.moved() for shape in shapes]), axis=0)
    share = np.clip(_HALF * width / height, 0.35, 0.6)  # the strips need no more
    grid = figure.add_gridspec(6, 2, width_ratios=(share, 1 - share))
    strips = []
    for rows, magnified in ((slice(0, 3), 1.0), (slice(3, 6), factor)):
        axis = figure.add_subplot(grid[rows, 0])
        moved = np.concatenate([shape.moved(magnified) for shape in shapes])
        strips.append(paint(axis, shapes[0], shapes[0].moved(magnified), values[0], norm, cmap))
        axis.set_title(scale_note(magnified), loc="left")
        frame(axis)
        axis.set_adjustable("box")
        pad = 0.06 * np.ptp(moved[:, 1]) + 0.05
        axis.set_xlim(moved[:, 0].min() - 0.1, moved[:, 0].max() + 0.1)
        axis.set_ylim(moved[:, 1].min() - pad, moved[:, 1].max() + pad)
    figure.colorbar(
        strips[0][0], ax=figure.axes, location="left", extend=extend, label=what.title, aspect=40
    )
    markers = []
    history = run.history
    columns = ("displacement_mm", "force_N", "voltage_kV")
    for k, column in enumerate(columns):
        axis = figure.add_subplot(grid[2 * k : 2 * k + 2, 1])
        axis.plot(history["time_s"], history[column], color=f"C{k}")
        markers.append((axis.plot([], [], "o", color=look.ink, ms=7)[0], history[column]))
        axis.set_ylabel(label(column))
        low, high = history[column].min(), history[column].max()
        if high - low < 1e-6 * max(abs(low), abs(high)) or high == low:
            axis.set_ylim(low - 0.05 * abs(low) - 1e-3, high + 0.05 * abs(high) + 1e-3)
        axis.tick_params(labelbottom=k == len(columns) - 1)
    axis.set_xlabel(label("time_s"))
    figure.suptitle(plain(run.info["name"]), fontsize="medium")
    figure.canvas.draw()
    figure.set_layout_engine("none")  # the panels stay where they are
    return figure, strips, markers


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
        stream.width, stream.height = (round(_DPI * inches) for inches in _SIZE)
        for image in images:
            film.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        film.mux(stream.encode())


def _write_gif(images: Iterator[Image], path: Path, rate: int) -> None:
    from PIL import Image as pillow

    first, *others = (pillow.fromarray(image).quantize(256) for image in images)
    first.save(path, save_all=True, append_images=others, duration=round(1000 / rate), loop=0)
