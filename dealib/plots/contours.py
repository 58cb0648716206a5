"""Contours on the deformed strips: true scale, magnified thickness, and both ends."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.tri import Triangulation

from dealib.plots.labels import plain
from dealib.plots.quantities import Quantity
from dealib.plots.shape import BLOCKS, Shape
from dealib.plots.style import Theme
from dealib.results.elements import Array

_EXCEEDED = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}  # colour bar's ends


def contours(shape: Shape, what: Quantity, look: Theme) -> Any:
    """Draw a quantity on the strips at one step (thesis, Figs. 26-28).

    The colours cover all but 0.6 % of the area: the ends of the strips hold singular points.
    """
    values = shape.strips(what.of(shape.arrays))
    norm, cmap, extend = scale(shape, values, look, what)
    figure, axes = plt.subplots(
        2, 2, figsize=(12, 8), layout="constrained", height_ratios=(1.25, 1)
    )
    for axis, factor in zip(axes[0], (1.0, magnification(shape)), strict=True):
        paint(axis, shape, shape.moved(factor), values, norm, cmap)
        axis.set_title(scale_note(factor), loc="left")
        frame(axis)
    for axis, side in zip(axes[1], ("inner", "outer"), strict=True):
        paint(axis, shape, shape.moved(), values, norm, cmap)
        _blocks(axis, shape, look)
        zoom(axis, shape, side)
        axis.set_title(f"{side} end, true scale", loc="left")
    colours = plt.cm.ScalarMappable(norm, cmap)
    figure.colorbar(colours, ax=figure.axes, extend=extend, label=what.title, aspect=40, pad=0.02)
    figure.suptitle(plain(f"{shape.run.info['name']}, {shape.when}"), fontsize="medium")
    return figure


def scale(
    shape: Shape, values: Array, look: Theme, what: Quantity | None = None
) -> tuple[Normalize, str, str]:
    """Colour scale of sampled values: centred at zero if they have both signs.

    That of a margin is centred at its limit.

    Args:
        shape: The strips.
        values: Values at the sampled points, (points,), or (steps, points) for one scale of all.
        look: The theme.
        what: The quantity.

    Returns:
        The scale, its colour map, and which ends of it are exceeded, for the colour bar.
    """
    if what is not None and what.is_use:
        return TwoSlopeNorm(1, 0, 2), look.diverging, _EXCEEDED[values.min() < 0, values.max() > 2]
    ranges: Any = [_by_area(shape, v, np.array([0.003, 0.997])) for v in np.atleast_2d(values)]
    low, high = float(np.min(ranges)), float(np.max(ranges))
    size = max(abs(low), abs(high)) or 1.0
    below = values.min() < low - 0.02 * size
    above = values.max() > high + 0.02 * size
    extend = _EXCEEDED[below, above]
    if low < -0.05 * size and high > 0.05 * size:
        return TwoSlopeNorm(0, -size, size), look.diverging, extend
    if high - low < 1e-6 * size:
        low, high = low - 0.05 * size, high + 0.05 * size
    return Normalize(low, high), look.sequential, extend


def _by_area(shape: Shape, values: Array, fractions: Array) -> Array:
    """Values below which the given fractions of the strips' area lie."""
    a, b, c = np.moveaxis(shape.strips.points[shape.strips.triangles], 1, 0)
    (x1, y1), (x2, y2) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
    area = np.abs(x1 * y2 - x2 * y1)  # NumPy 2.5 has no cross product in the plane
    mean = values[shape.strips.triangles].mean(axis=1)
    order = np.argsort(mean)
    share = np.cumsum(area[order])
    return np.asarray(np.interp(fractions * share[-1], share, mean[order]))


def magnification(shape: Shape) -> float:
    """A round factor that makes the thickness about a fifteenth of the length."""
    g = shape.geometry
    factor = (g.outer_radius - g.inner_radius) / 15 / (2 * g.half_thickness)
    return float(max(1, round(factor)))


def scale_note(factor: float) -> str:
    """Title of a deformed shape."""
    return "true scale" if factor == 1 else f"thickness magnified {factor:g} times"


def paint(
    axis: Any, shape: Shape, x: Array, values: Array, norm: Normalize, cmap: str
) -> tuple[Any, Any]:
    """Smooth colours on the sampled triangles at the points x, in a thin outline.

    Returns:
        The colours and the outline.
    """
    grid = Triangulation(x[:, 0], x[:, 1], shape.strips.triangles)
    axis.grid(False)
    rim = LineCollection(
        list(x[shape.strips.outline]), colors=plt.rcParams["axes.edgecolor"], lw=0.4
    )
    axis.add_collection(rim)
    colours = axis.tripcolor(grid, values, shading="gouraud", norm=norm, cmap=cmap, rasterized=True)
    return colours, rim


def frame(axis: Any) -> None:
    """Equal scales and labels for a whole strip."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="r (mm)", ylabel="z (mm)")
    axis.margins(0.02, 0.1)


def zoom(axis: Any, shape: Shape, side: str) -> None:
    """Show the end of the strips: five thicknesses long, three high; offsets in µm."""
    size = 2 * shape.geometry.half_thickness
    R, middle = shape.middle
    k = 0 if side == "inner" else -1
    inwards = 1 if side == "inner" else -1
    near = np.abs(R - R[k]) < 3 * size
    height = middle[near, 1]
    r = middle[k, 0]
    span = max(3 * size, np.ptp(height) + 1.6 * size)
    z = (height.min() + height.max()) / 2
    axis.set_aspect("equal", adjustable="box")
    axis.set_xlim(*sorted((r - inwards * 0.6 * size, r + inwards * (span * 2 - 0.6 * size))))
    axis.set_ylim(z - span / 2, z + span / 2)
    axis.set(xlabel="r (mm)", ylabel="z (mm)")
    axis.locator_params(nbins=5)
    axis.ticklabel_format(useOffset=False)


def _blocks(axis: Any, shape: Shape, look: Theme) -> None:
    """The rigid blocks, where there are some, else the clamped edge."""
    for name in BLOCKS:
        if name in shape.mesh.names:
            corners = shape.mesh.cells[shape.mesh.in_region(name)][:, : shape.mesh.cell.corners]
            x = (shape.mesh.points + shape.state[:, :2])[corners]
            axis.add_collection(PolyCollection(list(x), fc=look.faint, ec=look.faint))
