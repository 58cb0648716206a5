"""Contours of devices in a plane: deformed, and for laminates straightened and at each end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize, TwoSlopeNorm
from matplotlib.tri import Triangulation

from dealib.arrays import Array
from dealib.plots.labels import plain
from dealib.plots.shape import LayerShape
from dealib.plots.style import Theme
from dealib.results.quantities import FieldQuantity

# which ends of the colour bar are pointed, by whether values are below or above the scale
_EXCEEDED = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}


@dataclass(frozen=True)
class Scale:
    """Colours of values.

    Attributes:
        norm: Maps values to 0 .. 1.
        cmap: Name of the colour map.
        extend: Ends of the colour bar that are pointed, in Matplotlib's words.
    """

    norm: Normalize
    cmap: str
    extend: str

    def bar(self, part: Any, label: str, **where: Any) -> None:
        """Draw the colour bar beside axes of a figure or subfigure."""
        colours = plt.cm.ScalarMappable(self.norm, self.cmap)
        bar = part.colorbar(colours, extend=self.extend, label=label, **where)
        bar.solids.set_rasterized(True)


def fill(
    part: Any,
    shape: LayerShape,
    what: FieldQuantity,
    look: Theme,
    limits: tuple[float, float] | None = None,
    zoom: float | None = None,
) -> None:
    """Draw a quantity on the layers at one step (thesis, Figs. 26-28) into a figure or subfigure.

    The colour scale covers all but 0.6 % of the area, since fields are singular at the ends of the
    layers.

    Args:
        part: The figure or subfigure.
        shape: A stored step of a device in a plane.
        what: The quantity.
        look: Colours.
        limits: Lowest and highest value of the colour scale.
        zoom: Length shown of each end, mm.

    Raises:
        ValueError: If the device is in space.
    """
    if shape.solid:
        raise ValueError("contours are drawn of devices in a plane; this one is in space")
    values = shape.values(what)
    colours = scale(shape, values, look, what, limits)
    ends = [] if shape.laminate is None else [e for e in shape.laminate.base.ends if e]
    rows = [["whole", "straight"], ends * (3 - len(ends))] if shape.core else [["whole"]]
    ratios = (1.25, 1) if shape.core else (1,)
    axes = part.subplot_mosaic(rows, height_ratios=ratios)
    factor = magnification(shape)
    paint(axes["whole"], shape, shape.moved(factor), values, colours, look)
    _blocks(axes["whole"], shape, look)
    frame(axes["whole"], shape)
    axes["whole"].set_title(scale_note(factor), loc="left")
    if shape.core:
        _straightened(axes["straight"], shape, values, colours, look)
        for end in ends:
            axis = axes[end]
            paint(axis, shape, shape.moved(), values, colours, look)
            _blocks(axis, shape, look)
            _zoom(axis, shape, end, zoom)
            axis.set_title(plain(f"{end} end, true scale"), loc="left")
    colours.bar(part, what.title, ax=list(axes.values()), aspect=40, pad=0.02)


def _straightened(axis: Any, shape: LayerShape, values: Array, colours: Scale, look: Theme) -> None:
    """Draw the layers as in the mesh, with their thickness over the whole height."""
    across, names = shape.section.across, shape.kinematics.axes
    unit, factor = ("µm", 1e3) if shape.thickness < 0.5 else ("mm", 1.0)
    points = shape.points[:, [1 - across, across]] * (1, factor)
    paint(axis, shape, points, values, colours, look)
    axis.set(
        xlabel=f"{names[1 - across]} on the mesh (mm)",
        ylabel=f"{names[across]} on the mesh ({unit})",
        title="",
    )
    axis.set_title("straightened", loc="left")
    axis.margins(0.02, 0.05)


def scale(
    shape: LayerShape,
    values: Array,
    look: Theme,
    what: FieldQuantity | None = None,
    limits: tuple[float, float] | None = None,
) -> Scale:
    """Colour scale of sampled values, centred at zero if they have both signs.

    The scale of a margin is centred at its limit.

    Args:
        shape: The layers.
        values: Values at the sampled points, (points,), or (steps, points) for a common scale;
            NaN is ignored.
        look: The theme.
        what: The quantity.
        limits: Lowest and highest value of the scale.
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
    if high - low < 1e-3 * size:
        low, high = low - 0.05 * size, high + 0.05 * size
    return Scale(Normalize(low, high), look.sequential, extend)


def _by_area(shape: LayerShape, values: Array, fractions: Array) -> Array:
    """Quantiles of the values, weighted by area; in space, of the nodal values."""
    if shape.solid:
        return np.nanquantile(values, fractions)
    triangles = shape.strips.triangles
    mean = values[triangles].mean(axis=1)
    triangles, mean = triangles[np.isfinite(mean)], mean[np.isfinite(mean)]
    a, b, c = np.moveaxis(shape.strips.points[triangles], 1, 0)
    (x1, y1), (x2, y2) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
    area = np.abs(x1 * y2 - x2 * y1)  # NumPy 2.5 has no cross product in the plane
    order = np.argsort(mean)
    share = np.cumsum(area[order])
    return np.asarray(np.interp(fractions * share[-1], share, mean[order]))


def magnification(shape: LayerShape) -> float:
    """A whole factor by which the thickness of a laminate becomes a fifteenth of its length."""
    if shape.thickness == 0 or shape.run.config.device.laminate is None:
        return 1.0
    if not shape.solid and shape.core is None:
        return 1.0
    return float(max(1, round(shape.length / 15 / shape.thickness)))


def scale_note(factor: float) -> str:
    """The note on the scale of a deformed shape."""
    return "true scale" if factor == 1 else f"thickness magnified {factor:g} times"


@dataclass(frozen=True)
class Painted:
    """A drawing of the layers that can be moved: colours and outlines."""

    shape: LayerShape
    colours: Any
    others: tuple[Any, ...]
    rim: Any

    def move(self, x: Array, values: Array) -> None:
        """Move the sampled points to x, (points, 2), and colour them by new values, (points,)."""
        for part in (self.colours, *self.others):
            grid = part._triangulation
            grid.x, grid.y = x[:, 0].copy(), x[:, 1].copy()
        self.colours.set_array(np.nan_to_num(values))
        self.rim.set_segments(list(x[self.shape.strips.outline]))


def paint(
    axis: Any, shape: LayerShape, x: Array, values: Array, colours: Scale, look: Theme
) -> Painted:
    """Draw smooth colours on the sampled triangles at the points x, and outlines of the layers.

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


def frame(axis: Any, shape: LayerShape) -> None:
    """Set equal scales and labels for the whole section."""
    axis.set_aspect("equal", adjustable="datalim")
    _axes(axis, shape)
    axis.margins(0.02, 0.1)


def _axes(axis: Any, shape: LayerShape) -> None:
    x, y = (f"{name.lower()} (mm)" for name in shape.kinematics.axes)
    axis.set(xlabel=x, ylabel=y)


def _zoom(axis: Any, shape: LayerShape, end: str, length: float | None) -> None:
    """Show one end, by default over about six thicknesses."""
    assert shape.laminate is not None
    size, across = shape.thickness, shape.section.across
    along = 1 - across
    X, middle = shape.middle
    k, inwards = (0, 1) if end == shape.laminate.base.ends[0] else (-1, -1)
    height = middle[np.abs(X - X[k]) < 3 * size, across]
    span = max(3 * size, np.ptp(height) + 1.6 * size) if length is None else length / 1.7
    x, y = middle[k, along], (height.min() + height.max()) / 2
    limits = [(0.0, 0.0)] * 2
    limits[along] = tuple(sorted((x - inwards * 0.3 * span, x + inwards * 1.7 * span)))
    limits[across] = (y - span / 2, y + span / 2)
    axis.set_aspect("equal", adjustable="box")
    axis.set(xlim=limits[0], ylim=limits[1])
    _axes(axis, shape)
    axis.locator_params(nbins=5)
    axis.ticklabel_format(useOffset=False)


def _blocks(axis: Any, shape: LayerShape, look: Theme) -> None:
    """Draw the rigid blocks, if there are any."""
    mesh, x = shape.mesh, shape.mesh.points + shape.displacement
    for region in shape.run.config.device.regions:
        if region.material is None and not region.air:
            corners = mesh.cells[mesh.in_region(region.name)][:, : mesh.cell.corners]
            polygons = PolyCollection(list(x[corners]), fc=look.faint, ec=look.faint)
            axis.add_collection(polygons, autolim=False)
