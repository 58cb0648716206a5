"""Panels of a study: curves, points, contours and deformed shapes.

One SVG suits light and dark pages: text and axes have the colour of the text around it.
"""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from cycler import cycler
from matplotlib.collections import PolyCollection

from dealib.errors import PlatformError
from dealib.plots import contours, render, views
from dealib.plots.labels import plain
from dealib.plots.shape import LayerShape
from dealib.plots.style import LIGHT, theme
from dealib.results.quantities import quantity
from dealib.results.summary import values_told
from dealib.study.evaluate import Curve, Results
from dealib.study.schema import Axis, Contour, Curves, Points, Reference, Shapes

REFERENCE = "#7d8590"
# after Okabe and Ito, distinguishable by colour-blind readers, on light and dark pages
COLOURS = ("#2b83ba", "#d55e00", "#009e73", "#c2649c", "#b8860b", "#7570b3", "#56b4e9", "#8c564b")
_MARKS = "osD^vP*X"
_WIDTH, _HEIGHT = 4.6, 3.5  # inches of a panel
_VIEWS = 3  # views of a three-dimensional device in a row
_SETTINGS: dict[Any, Any] = {  # changes of the light theme
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "grid.color": "#8b949e",
    "grid.alpha": 0.25,
    "axes.prop_cycle": cycler(color=COLOURS),
    "axes.formatter.limits": (-3, 4),
    "legend.fontsize": "small",
    "font.size": 9.5,
    "svg.fonttype": "none",  # text stays text
}


def draw(results: Results) -> tuple[str, bytes] | None:
    """Draw all panels of a study.

    Args:
        results: The study.

    Returns:
        The text of an SVG (transparent, with `currentColor` for text and axes) and a PNG on white;
        None if the study has no panels.
    """
    study = results.study
    if not study.panels:
        return None
    with theme(), plt.rc_context({**_SETTINGS, "svg.hashsalt": study.name}):
        figure = plt.figure(layout="constrained", figsize=(1, 1))
        _fill(figure, results)
        text, picture = io.StringIO(), io.BytesIO()
        figure.savefig(text, format="svg", dpi=180, metadata={"Date": None, "Creator": None})
        figure.savefig(picture, format="png", dpi=150, facecolor="white")
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :].replace(LIGHT.ink, "currentColor")
    return svg, picture.getvalue()


def _fill(figure: Any, results: Results) -> None:
    rows: list[list[int]] = []
    wide = (Contour, Shapes)
    for i, panel in enumerate(results.study.panels):
        last = rows[-1] if rows else None
        fits = last and not isinstance(results.study.panels[last[0]], wide)
        if fits and not isinstance(panel, wide) and len(last or []) < results.study.columns:
            rows[-1].append(i)
        else:
            rows.append([i])
    heights = [_height(results, row[0]) for row in rows]
    most = max(len(row) for row in rows)
    any_wide = any(isinstance(p, wide) for p in results.study.panels)
    width = most * (_WIDTH if most < 3 else 0.8 * _WIDTH)
    width = max(width, 1.9 * _WIDTH if any_wide else 1.35 * _WIDTH)
    figure.set_size_inches(width, sum(heights))
    parts = figure.subfigures(len(rows), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, row in zip(parts, rows, strict=True):
        part.set_facecolor("none")
        if isinstance(results.study.panels[row[0]], wide):
            _fields(part, results, row[0])
            continue
        axes = part.subplots(1, len(row), squeeze=False)[0]
        for axis, i in zip(axes, row, strict=True):
            _lines(axis, results, i)
        _legend(part, axes)


def _height(results: Results, index: int) -> float:
    """Height of a row of panels, inches."""
    panel = results.study.panels[index]
    if not isinstance(panel, (Contour, Shapes)):
        return _HEIGHT
    outcome = results.chosen(index)
    solid = outcome and outcome.run and outcome.run.config.device.kinematics.dim == 3
    if isinstance(panel, Contour):
        return 3.0 if solid else 5.8
    return 1.9 * -(-len(panel.times) // _VIEWS) if solid else 3.6


def _fields(part: Any, results: Results, index: int) -> None:
    panel = results.study.panels[index]
    outcome = results.chosen(index)
    if outcome is None:
        name = panel.title or results.study.title
        part.text(0.5, 0.5, plain(f"{name}: the case has not converged"), ha="center")
        return
    assert outcome.run is not None
    assert isinstance(panel, (Contour, Shapes))
    try:
        if isinstance(panel, Contour):
            name = plain(panel.label)
            shape = LayerShape(outcome.run, outcome.step(panel.stage))
            what = quantity(panel.field, shape.kinematics)
            what = replace(what, label=name, unit="", factor=panel.factor)
            if shape.solid:
                views.fill(part, shape, what, LIGHT, panel.limits)
            else:
                contours.fill(part, shape, what, LIGHT, panel.limits, panel.zoom)
        else:
            shapes = [LayerShape(outcome.run, outcome.nearest(t)) for t in panel.times]
            (_views if shapes[0].solid else _shapes)(part, shapes)
        _clear(part)
    except PlatformError as error:
        part.text(0.5, 0.5, plain(error), ha="center", wrap=True)
    except ValueError as error:
        raise results.plan.fault(("panels", index), str(error)) from None
    if panel.title:
        part.suptitle(plain(panel.title), fontsize="medium")


def _views(part: Any, shapes: list[LayerShape]) -> None:
    """A three-dimensional device at several steps, true to scale, from one point of view."""
    render.check_rendering()
    moved = [shape.moved() for shape in shapes]
    every = np.concatenate(moved)
    bounds = views.within(shapes[0], every.min(axis=0), every.max(axis=0))
    rows = -(-len(shapes) // _VIEWS)
    axes = part.subplots(rows, min(len(shapes), _VIEWS), squeeze=False).ravel()
    u = quantity("u", shapes[0].kinematics)
    for i, (shape, x) in enumerate(zip(shapes, moved, strict=True)):
        colour = COLOURS[i % len(COLOURS)]
        seen = [(body, colour) for body, _ in views.bodies(shape, u, x, shape.values(u))]
        axes[i].imshow(render.picture(seen, None, LIGHT.paper, bounds))
        axes[i].set_title(_told(shape), fontsize="small")
    for axis in axes:
        axis.set_axis_off()


def _told(shape: LayerShape) -> str:
    return plain(f"{shape.row['time_s']:g} s: {values_told(shape.run, shape.row, 3)}")


def _clear(part: Any) -> None:
    """Make the background of pictures transparent, like that of the panels."""
    for image in (image for axis in part.axes for image in axis.images):
        seen = np.asarray(image.get_array())
        image.set_data(np.dstack([seen, 255 * (seen != 255).any(axis=2).astype(np.uint8)]))


def _shapes(part: Any, shapes: list[LayerShape]) -> None:
    """The layers at several steps, true to scale."""
    axis = part.subplots()
    for i, shape in enumerate(shapes):
        x, colour = shape.moved()[shape.strips.triangles], COLOURS[i % len(COLOURS)]
        label = _told(shape)
        # as pixels: an SVG of all cells has 12 MB
        style: dict[str, Any] = {"fc": colour, "ec": colour, "lw": 0.3, "rasterized": True}
        axis.add_collection(PolyCollection(list(x), label=label, **style))
    axis.autoscale_view()
    names = shapes[0].kinematics.axes
    axis.set(xlabel=f"{names[0].lower()} (mm)", ylabel=f"{names[1].lower()} (mm)")
    axis.set_aspect("equal")
    axis.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))


def _lines(axis: Any, results: Results, index: int) -> None:
    panel = results.study.panels[index]
    assert isinstance(panel, (Curves, Points))
    curves = results.curves(index)
    for i, curve in enumerate(curves):
        _line(axis, curve, i, isinstance(panel, Points), len(curves))
    for reference in panel.references:
        _reference(axis, reference)
    axis.margins(x=0.04, y=0.06)
    axis.set(xlabel=plain(panel.x.label), ylabel=plain(panel.y.label), title=plain(panel.title))
    axis.set(xscale=panel.x.scale, yscale=panel.y.scale)
    _limits(axis, panel.x, panel.y)


def _legend(part: Any, axes: Any) -> None:
    """One legend below the panels of a row, or, if they differ, one in each."""
    by_panel = [dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True)) for axis in axes]
    looks = [{n: (h.get_color(), h.get_linestyle(), h.get_marker()) for n, h in found.items()}
             for found in by_panel]  # fmt: skip
    every = {name: handle for found in by_panel for name, handle in found.items()}
    if len(every) < 2:
        return
    if all(look[n] == other[n] for look in looks for other in looks for n in look.keys() & other):
        columns = max(1, min(len(every), int(90 / (6 + max(map(len, every))))))
        part.legend(every.values(), every.keys(), loc="outside lower center", ncols=columns)
        return
    for axis in axes:
        axis.legend(loc="best")


def _line(axis: Any, curve: Curve, index: int, points: bool, count: int) -> None:
    style: dict[str, Any] = {
        "color": COLOURS[index % len(COLOURS)],
        "label": plain(curve.label) or None,
    }
    if points:
        style |= {"marker": _MARKS[index % len(_MARKS)], "ms": 5}
    elif count > 3 and index >= (count + 1) // 2:
        style["ls"] = "--"
    axis.plot(curve.x, curve.y, **style)


def _reference(axis: Any, reference: Reference) -> None:
    style = {"ls": ":", "lw": 1.8} if reference.style == "line" else {"ls": "", "marker": "x"}
    axis.plot(reference.x, reference.y, color=REFERENCE, label=plain(reference.label), **style)


def _limits(axis: Any, x: Axis, y: Axis) -> None:
    """Show the reference's axes as a shaded window, and everything that leaves it."""
    given = [x.limits, y.limits]
    if given == [None, None]:
        return
    auto = [axis.get_xlim(), axis.get_ylim()]
    shown = []
    for limits, data in zip(given, auto, strict=True):
        if limits is None:
            shown.append(data)
            continue
        low, high = sorted(limits)
        room = 0.04 * (high - low)
        outside_low, outside_high = data[0] < low - 1.6 * room, data[1] > high + 1.6 * room
        shown.append(
            (data[0] if outside_low else low - room, data[1] if outside_high else high + room)
        )
    axis.set(xlim=shown[0], ylim=shown[1])
    (x0, x1), (y0, y1) = (sorted(g) if g else s for g, s in zip(given, shown, strict=True))
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    dashes = (0, (2, 2))
    window = PolyCollection([corners], fc=(REFERENCE, 0.1), ec=REFERENCE, ls=[dashes], lw=0.8)
    window.set_zorder(0)
    axis.add_collection(window, autolim=False)
    for ends, invert in zip(given, (axis.invert_xaxis, axis.invert_yaxis), strict=True):
        if ends and ends[0] > ends[1]:
            invert()
