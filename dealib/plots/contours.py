"""Contours on the layers: deformed, straightened, and true to scale at both ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize, TwoSlopeNorm
from matplotlib.tri import Triangulation

from dealib.geometry.names import FRAME_BLOCK, MOUNT_BLOCK
from dealib.plots.labels import plain
from dealib.plots.shape import Shape
from dealib.plots.style import Theme
from dealib.results.elements import Array
from dealib.results.quantities import Quantity

_EXCEEDED = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}  # colour bar's ends
_RIGID = (MOUNT_BLOCK, FRAME_BLOCK)


@dataclass(frozen=True)
class Scale:
    """Colours of values.

    Attributes:
        norm: From values to 0 .. 1.
        cmap: Colour map.
        extend: Which ends are exceeded, for the colour bar.
    """

    norm: Normalize
    cmap: str
    extend: str

    def bar(self, part: Any, label: str, **where: Any) -> None:
        """Draw the colour bar beside axes of a figure or a part of one."""
        colours = plt.cm.ScalarMappable(self.norm, self.cmap)
        bar = part.colorbar(colours, extend=self.extend, label=label, **where)
        bar.solids.set_rasterized(True)


def contours(shape: Shape, what: Quantity, look: Theme) -> Any:
    """Draw a quantity on the layers at one step (thesis, Figs. 26-28), as a figure of its own."""
    figure = plt.figure(figsize=(12, 8), layout="constrained")
    fill(figure, shape, what, look)
    figure.suptitle(plain(f"{shape.run.title}, {shape.when}"), fontsize="medium")
    return figure


def fill(
    part: Any,
    shape: Shape,
    what: Quantity,
    look: Theme,
    limits: tuple[float, float] | None = None,
    zoom: float | None = None,
) -> None:
    """Draw a quantity into a figure or a part of one.

    The colours cover all but 0.6 % of the area: the ends of the layers hold singular points.

    Args:
        part: The figure.
        shape: The step.
        what: The quantity.
        look: Colours.
        limits: Of the colours.
        zoom: Length shown of each end, mm.
    """
    values = shape.values(what)
    colours = scale(shape, values, look, what, limits)
    axes = part.subplot_mosaic([["whole", "straight"], ["inner", "outer"]], height_ratios=(1.25, 1))
    factor = magnification(shape)
    paint(axes["whole"], shape, shape.moved(factor), values, colours, look)
    frame(axes["whole"])
    axes["whole"].set_title(scale_note(factor), loc="left")
    straight = axes["straight"]
    paint(straight, shape, shape.strips.points * (1, 1e3), values, colours, look)
    straight.set(xlabel="R on the mesh (mm)", ylabel="Z on the mesh (µm)")
    straight.set_title("straightened", loc="left")
    straight.margins(0.02, 0.05)
    for side in ("inner", "outer"):
        axis = axes[side]
        paint(axis, shape, shape.moved(), values, colours, look)
        _blocks(axis, shape, look)
        _zoom(axis, shape, side, zoom)
        axis.set_title(f"{side} end, true scale", loc="left")
    colours.bar(part, what.title, ax=list(axes.values()), aspect=40, pad=0.02)


def scale(
    shape: Shape,
    values: Array,
    look: Theme,
    what: Quantity | None = None,
    limits: tuple[float, float] | None = None,
) -> Scale:
    """Colour scale of sampled values: centred at zero if they have both signs.

    That of a margin is centred at its limit.

    Args:
        shape: The layers.
        values: Values at the sampled points, (points,), or (steps, points) for one scale of all;
            NaN is left out.
        look: The theme.
        what: The quantity.
        limits: Ends of the scale.
    """
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    if what is not None and what.is_use:
        span = min(1.0, max(1 - least, most - 1, 0.1))
        ends = _EXCEEDED[least < 1 - span, most > 1 + span]
        return Scale(TwoSlopeNorm(1, 1 - span, 1 + span), look.diverging, ends)
    ranges: Any = [_by_area(shape, v, np.array([0.003, 0.997])) for v in np.atleast_2d(values)]
    low, high = limits or (float(np.min(ranges)), float(np.max(ranges)))
    size = max(abs(low), abs(high)) or 1.0
    extend = _EXCEEDED[least < low - 0.02 * size, most > high + 0.02 * size]
    if min(-low, high) > 0.15 * size:
        return Scale(TwoSlopeNorm(0, *(limits or (-size, size))), look.diverging, extend)
    if high - low < 1e-6 * size:
        low, high = low - 0.05 * size, high + 0.05 * size
    return Scale(Normalize(low, high), look.sequential, extend)


def _by_area(shape: Shape, values: Array, fractions: Array) -> Array:
    """Values below which the given fractions of the area lie that has any."""
    triangles = shape.strips.triangles
    mean = values[triangles].mean(axis=1)
    triangles, mean = triangles[np.isfinite(mean)], mean[np.isfinite(mean)]
    a, b, c = np.moveaxis(shape.strips.points[triangles], 1, 0)
    (x1, y1), (x2, y2) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
    area = np.abs(x1 * y2 - x2 * y1)  # NumPy 2.5 has no cross product in the plane
    order = np.argsort(mean)
    share = np.cumsum(area[order])
    return np.asarray(np.interp(fractions * share[-1], share, mean[order]))


def magnification(shape: Shape) -> float:
    """A round factor that makes the thickness about a fifteenth of the length."""
    return float(max(1, round(shape.length / 15 / shape.thickness)))


def scale_note(factor: float) -> str:
    """Title of a deformed shape."""
    return "true scale" if factor == 1 else f"thickness magnified {factor:g} times"


@dataclass(frozen=True)
class Painted:
    """Colours and outlines of the layers, which can be moved."""

    shape: Shape
    colours: Any
    others: tuple[Any, ...]
    rim: Any

    def move(self, x: Array, values: Array) -> None:
        """Put the sampled points elsewhere, with new values."""
        for part in (self.colours, *self.others):
            grid = part._triangulation
            grid.x, grid.y = x[:, 0].copy(), x[:, 1].copy()
        self.colours.set_array(np.nan_to_num(values))
        self.rim.set_segments(list(x[self.shape.strips.outline]))


def paint(axis: Any, shape: Shape, x: Array, values: Array, colours: Scale, look: Theme) -> Painted:
    """Smooth colours on the sampled triangles at the points x, each layer in a thin outline.

    Layers without values are grey.
    """
    triangles = shape.strips.triangles
    empty = np.isnan(values)[triangles].any(axis=1)
    style: dict[str, Any] = {"shading": "gouraud", "rasterized": True}
    axis.grid(False)
    rim = LineCollection(list(x[shape.strips.outline]), colors=look.ink, lw=0.4)
    axis.add_collection(rim)

    def grid(chosen: Any) -> Triangulation:
        return Triangulation(x[:, 0], x[:, 1], triangles[chosen])

    painted = axis.tripcolor(
        grid(~empty), np.nan_to_num(values), norm=colours.norm, cmap=colours.cmap, **style
    )
    plain = ListedColormap([look.faint])
    others: tuple[Any, ...] = ()
    if empty.any():
        others = (axis.tripcolor(grid(empty), np.zeros(len(x)), cmap=plain, **style),)
    return Painted(shape, painted, others, rim)


def frame(axis: Any) -> None:
    """Equal scales and labels for a whole strip."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="r (mm)", ylabel="z (mm)")
    axis.margins(0.02, 0.1)


def _zoom(axis: Any, shape: Shape, side: str, length: float | None) -> None:
    """Show one end, by default about six thicknesses of it."""
    size = shape.thickness
    R, middle = shape.middle
    k, inwards = (0, 1) if side == "inner" else (-1, -1)
    near = np.abs(R - R[k]) < 3 * size
    height = middle[near, 1]
    span = max(3 * size, np.ptp(height) + 1.6 * size) if length is None else length / 1.7
    r, z = middle[k, 0], (height.min() + height.max()) / 2
    axis.set_aspect("equal", adjustable="box")
    axis.set_xlim(*sorted((r - inwards * 0.3 * span, r + inwards * 1.7 * span)))
    axis.set_ylim(z - span / 2, z + span / 2)
    axis.set(xlabel="r (mm)", ylabel="z (mm)")
    axis.locator_params(nbins=5)
    axis.ticklabel_format(useOffset=False)


def _blocks(axis: Any, shape: Shape, look: Theme) -> None:
    """The rigid blocks, where there are some."""
    for name in _RIGID:
        if name in shape.mesh.names:
            corners = shape.mesh.cells[shape.mesh.in_region(name)][:, : shape.mesh.cell.corners]
            x = (shape.mesh.points + shape.displacement)[corners]
            axis.add_collection(PolyCollection(list(x), fc=look.faint, ec=look.faint))
