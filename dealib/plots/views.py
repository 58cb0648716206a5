"""Views in space of devices in three dimensions and of bodies of revolution."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.arrays import Array
from dealib.errors import ConfigError
from dealib.plots import contours
from dealib.plots.contours import Scale, magnification, scale
from dealib.plots.crests import TURN, lines, note, peel
from dealib.plots.labels import plain
from dealib.plots.render import PIXELS, Bodies, check_rendering, picture
from dealib.plots.shape import LayerShape
from dealib.plots.style import Theme
from dealib.plots.surface import blocks
from dealib.results.quantities import FieldQuantity
from dealib.results.sampling import Sampler

_PLAIN_ANGLE = 60.0  # degrees by which layers without values are turned, to show those below
CONDUCTORS, RIGID = "#3b3f52", "#8a939d"  # layers without a field; mount and frame


def draw_field(shape: LayerShape, what: FieldQuantity, look: Theme) -> Any:
    """Draw a quantity on a device as a figure: contours in a plane, views in three dimensions.

    Wrinkles of a body of revolution are drawn in space, since their crests leave the section.
    """
    if shape.kinematics.revolved and what.field == "wrinkling":
        return draw_revolved(shape, what, look)
    size, draw = ((13, 5.2), fill) if shape.solid else ((12, 8), contours.fill)
    figure = plt.figure(figsize=size, layout="constrained")
    draw(figure, shape, what, look)
    figure.suptitle(plain(f"{shape.run.title}, {shape.when}"), fontsize="medium")
    return figure


def fill(
    part: Any,
    shape: LayerShape,
    what: FieldQuantity,
    look: Theme,
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw a deformed device in space into a figure or subfigure.

    The left view shows it with half of its conductors removed, the right one cut in half.

    Raises:
        PlatformError: If the machine cannot render.
    """
    check_rendering()
    values, factor = shape.values(what), magnification(shape)
    colours = scale(shape, values, look, what, limits)
    every = bodies(shape, what, shape.moved(factor), values)
    crests = lines(shape, what)
    whole, cut = _opened(every) + crests, _half(every + crests)
    axes = part.subplots(1, 2)
    notes = (note(shape, what, factor), "cut in half")
    for axis, seen, title in zip(axes, (whole, cut), notes, strict=True):
        axis.imshow(picture(seen, colours, look.paper))
        axis.set_axis_off()
        axis.set_title(title, loc="left")
    colours.bar(part, what.title, ax=list(axes), shrink=0.8, pad=0.01)


def _half(every: Bodies) -> Bodies:
    """The half of bodies that is farther along Y."""
    y = np.concatenate([body.points for body, _ in every])[:, 1]
    centre = (0, (y.min() + y.max()) / 2 + 1e-6 * np.ptp(y), 0)
    cut = [(body.clip("y", origin=centre, invert=False), colour) for body, colour in every]
    return [(body, colour) for body, colour in cut if body.n_cells]


def _opened(every: Bodies) -> Bodies:
    """The bodies with values, and one half of those without."""
    return [part for part in every if not part[1]] + [part for part in _half(every) if part[1]]


def bodies(shape: LayerShape, what: FieldQuantity, x: Array, values: Array) -> Bodies:
    """The layers of a device in space, with all of its symmetric parts.

    Args:
        shape: The device.
        what: The quantity; some of its components change their sign when mirrored.
        x: Positions of the points, (points, 3), mm.
        values: Values at the points, (points,); NaN where there are none.
    """
    import pyvista as pv

    mesh, found = shape.mesh, []
    for name in shape.layers:
        cells = mesh.cells[mesh.in_region(name)]
        kinds = np.full(len(cells), mesh.cell.vtk_type, dtype=np.uint8)
        rows = np.column_stack([np.full(len(cells), cells.shape[1]), cells])
        part = pv.UnstructuredGrid(rows.ravel(), kinds, x)
        part.point_data["values"] = values
        parts = [part.extract_cells(np.arange(len(cells)))]
        for k in shape.symmetry:
            sign = (-1) ** (what.component or ()).count(k)
            for one in list(parts):
                other = one.copy()
                other.points[:, k] *= -1
                other.point_data["values"] *= sign
                parts.append(other)
        empty = bool(np.isnan(values[cells]).any())
        found += [(part, CONDUCTORS if empty else "") for part in parts]
    return found


def within(shape: LayerShape, low: Array, high: Array) -> list[float]:
    """Bounds of all symmetric parts for `picture`, from those of the solved part, mm."""
    ends = np.stack([low, high])
    reached = np.concatenate([ends @ one for one in shape.mirrors])
    return np.stack([reached.min(axis=0), reached.max(axis=0)], axis=1).ravel().tolist()


class Scene:
    """A picture of a device in space that can be moved.

    Args:
        axis: Axes to draw into.
        shape: The device.
        what: The quantity.
        colours: Colour scale of the values.
        look: The theme.
        span: Lowest and highest coordinates that the device reaches, (3,) each, mm.
    """

    def __init__(
        self,
        axis: Any,
        shape: LayerShape,
        what: FieldQuantity,
        colours: Scale,
        look: Theme,
        span: tuple[Array, Array],
    ) -> None:
        check_rendering()
        self._of, self._style = (shape, what), (colours, look.paper)
        self._within = within(shape, *span)
        self._image = axis.imshow(np.zeros((*PIXELS[::-1], 3), dtype=np.uint8))
        axis.set_axis_off()

    def move(self, x: Array, values: Array) -> None:
        """Move the points to x, (points, 3), and colour them by new values, (points,)."""
        seen = _opened(bodies(*self._of, x, values))
        self._image.set_data(picture(seen, *self._style, self._within))


# --- bodies of revolution ------------------------------------------------------------------------


def draw_revolved(shape: LayerShape, what: FieldQuantity, look: Theme) -> Any:
    """Draw three quarters of a body of revolution, each layer peeled off the one below it.

    Raises:
        ConfigError: If the device is no body of revolution.
        PlatformError: If the machine cannot render.
    """
    if not shape.kinematics.revolved:
        raise ConfigError(f"{shape.run.directory}: this device is no body of revolution")
    check_rendering()
    values = shape.values(what)
    colours = scale(shape, values, look, what)
    figure, axis = plt.subplots(figsize=(11, 5.8), layout="constrained")
    seen = _turned(shape, values) + lines(shape, what)
    axis.imshow(picture(seen, colours, look.paper))
    axis.set_axis_off()
    colours.bar(figure, what.title, ax=axis, shrink=0.8, pad=0.01)
    told = note(shape, what, magnification(shape))
    axis.set_title(plain(f"{shape.run.title}, {shape.when}\n{told}"), fontsize="medium")
    return figure


def _turned(shape: LayerShape, values: Array) -> Bodies:
    """The layers, and grey discs for mount and frame at the ends of a flat laminate."""
    factor = magnification(shape)
    moved, start = shape.moved(factor), 0
    seen, found, step = False, [], peel(shape)
    for k, name in enumerate(shape.layers):
        part = Sampler.of(shape.mesh, (name,), n=shape.strips.n)
        own = slice(start, start + len(part.points))
        start = own.stop
        empty = bool(np.isnan(values[own]).any())
        angle = _PLAIN_ANGLE if empty and seen else TURN - step * k
        seen = seen or not empty
        body = _revolve(moved[own], part.triangles, values[own], angle)
        found.append((body, CONDUCTORS if empty else ""))
    for corners in blocks(shape, factor):
        rigid = _revolve(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(4), TURN)
        found.append((rigid, RIGID))
    return found


def _revolve(points: Array, triangles: Any, values: Array, angle: float) -> Any:
    """A surface (r, z) turned about the axis, open for a quarter to show the section."""
    import pyvista as pv

    xyz = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    section = pv.PolyData.from_regular_faces(xyz, triangles)
    section.point_data["values"] = values
    return section.clean(tolerance=1e-9).extrude_rotate(
        resolution=round(angle), angle=angle, capping=True, rotation_axis=(0, 0, 1)
    )
