"""Figures of a page, as plain data for plotly: curves, and the deformed device."""

from __future__ import annotations

from typing import Any

import numpy as np

from dealib.plots.contours import magnification, scale_note
from dealib.plots.labels import label, split
from dealib.plots.limits import BEYOND, beyond
from dealib.plots.shape import Shape
from dealib.plots.style import LIGHT
from dealib.plots.views import CONDUCTORS, bodies
from dealib.report.figures import turned
from dealib.report.space import coloured, surfaces
from dealib.results.elements import Array
from dealib.results.quantities import Quantity, quantities
from dealib.results.reader import Run
from dealib.results.summary import VERDICTS, drive, motion

RED, TOLD = BEYOND[VERDICTS[0]], 2
_SECTION, _SPACE = "section", "in space"
_TRIANGLES = 8000  # of a body of revolution
_LIGHTING = {"ambient": 0.65, "diffuse": 0.5, "specular": 0.05, "facenormalsepsilon": 0}
Part = tuple[Array, Any, Array]  # points, triangles, values


def columns(run: Run) -> tuple[list[str], str, list[str]]:
    """Columns that can be drawn, the abscissa and those that are drawn at first."""
    every = [c for c in map(str, run.history) if c != "stage"]
    first = [*motion(run), drive(run), *(c for c in every if c.startswith("capacitance_pF"))]
    return every, "time_s", list(dict.fromkeys(first))[:4]


def curves(run: Run, x: str, chosen: list[str], solid: Any = None) -> dict[str, Any]:
    """Columns over another one, red where a limit is passed; those of a second run are dotted."""
    traces: list[dict[str, Any]] = []
    high = 1.06 / max(len(chosen), 1)
    layout: dict[str, Any] = {"showlegend": False, "uirevision": f"{x} {chosen}"}
    layout["margin"] = {"l": 70, "r": 15, "t": 10, "b": 45}
    layout["xaxis"] = {"title": {"text": label(x)}, "anchor": f"y{len(chosen)}"}
    for k, y in enumerate(chosen, start=1):
        name, unit = split(y)
        title = {"text": f"{name}<br>({unit})" if unit else name}
        domain = [max(0.0, 1.06 - k * high), 1 - (k - 1) * high]
        layout[f"yaxis{k}"] = {"domain": domain, "title": title}
        colour = LIGHT.lines[(k - 1) % len(LIGHT.lines)]
        passed = np.any([beyond(run.history, verdict, y) for verdict in VERDICTS], axis=0)
        for of, line, there in (
            (run, {"color": colour}, True),
            (solid, {"color": "#777777", "dash": "dot"}, True),
            (run, {"color": RED, "width": 4}, passed),
        ):
            if of is None or not {x, y} <= {*of.history} or not np.any(there):
                continue
            at, values = of.history[x].tolist(), np.where(there, of.history[y], np.nan)
            values = [v if np.isfinite(v) else None for v in values.tolist()]
            mode = "lines" if of is solid else "lines+markers"
            traces.append({"x": at, "y": values, "yaxis": f"y{k}", "line": line, "mode": mode})
            traces[-1] |= {"type": "scatter", "marker": {"size": 4}, "name": name}
    return {"data": traces, "layout": layout}


def fields(run: Run) -> dict[str, str]:
    """Names and titles of the fields that a run has; those of a report come first."""
    if not run.stored_steps:
        return {}
    shape = Shape(run, n=1)
    known = quantities(shape.kinematics)
    names = dict.fromkeys([q.name for q in turned(run)] + list(known))
    there = [known[n] for n in names if known[n].field in shape.arrays]
    return {q.name: f"{q.name}: {q.label.partition(f' {q.name[0]}$')[0]}" for q in there}


def cuts(run: Run) -> list[str]:
    """Ways in which the device can be looked at."""
    kinematics = run.config.device.kinematics
    if kinematics.dim == 3:
        return ["whole", "cut across X", "cut across Y", "cut across Z"]
    return [_SECTION, _SPACE] if kinematics.revolved else [_SECTION]


def device(run: Run, step: int, field: str, cut: str, share: float) -> dict[str, Any]:
    """The deformed device at a stored step, coloured.

    Args:
        run: The run.
        step: Step of the history.
        field: Name of a field.
        cut: Of `cuts`.
        share: Where a device in space is cut, from 0 to 1 of its extent.
    """
    shape = Shape(run, step, n=2)
    what = quantities(shape.kinematics)[field]
    values, factor = shape.values(what), magnification(shape)
    look, x = coloured(shape, what, values), shape.moved(factor)
    title: Any = {"text": f"{shape.when}<br>{scale_note(factor)}", "font": {"size": 12}}
    layout: dict[str, Any] = {
        "title": title,
        "uirevision": cut,
        "margin": {"l": 55, "r": 0, "t": 70, "b": 45},
    }
    bar = {"title": {"text": what.unit}, "thickness": 12, "len": 0.8}
    shades = {"cmin": look["range"][0], "cmax": look["range"][1], "colorscale": look["colours"]}
    if cut == _SECTION:
        traces = _flat(shape.strips.triangles, x, values, look)
        traces[0]["marker"] = {"color": [shades["cmin"]], "colorbar": bar, "size": 0.1} | shades
        for name, axis in zip(("xaxis", "yaxis"), shape.kinematics.axes, strict=False):
            layout[name] = {"title": {"text": f"{axis} (mm)"}}
        layout["yaxis"] |= {"scaleanchor": "x"}
        return {"data": traces, "layout": layout | {"showlegend": False, "hovermode": False}}
    traces = []
    for points, triangles, there in (
        _cut(shape, what, x, values, "XYZ".find(cut[-1]), share)
        if shape.solid
        else surfaces(shape, x, values, _TRIANGLES)
    ):
        coloured_ = np.isfinite(there[triangles]).all()
        (a, b, c), (i, j, k) = points.T.tolist(), triangles.T.tolist()
        mesh = {"type": "mesh3d", "x": a, "y": b, "z": c, "i": i, "j": j, "k": k}
        mesh |= {"flatshading": True, "lighting": _LIGHTING, "color": CONDUCTORS}
        if coloured_:
            shown = not any("intensity" in t for t in traces)
            mesh |= {"intensity": there.tolist(), "colorbar": bar, "showscale": shown} | shades
        traces.append(mesh)
    axes = {f"{n}axis": {"title": {"text": f"{n.upper()} (mm)"}} for n in "xyz"}
    return {"data": traces, "layout": layout | {"scene": axes | {"aspectmode": "data"}}}


def _flat(triangles: Any, x: Array, values: Array, look: dict[str, Any]) -> list[dict[str, Any]]:
    """Triangles in a plane as filled paths, one for each colour."""
    (low, high), colours = look["range"], look["colours"]
    mean, last = values[triangles].mean(axis=1), len(colours) - 1
    share = (mean - low) / ((high - low) or 1.0)
    shade = np.where(np.isnan(mean), -1, np.round(last * np.clip(np.nan_to_num(share), 0, 1)))
    traces = []
    for k in np.unique(shade).astype(int):
        corners = np.full((np.count_nonzero(shade == k), 5, 2), np.nan)  # closed, then a gap
        corners[:, :4] = x[triangles[shade == k]][:, [0, 1, 2, 0]]
        a, b = ([None if v != v else v for v in c.tolist()] for c in corners.reshape(-1, 2).T)
        colour = CONDUCTORS if k < 0 else colours[k][1]
        traces.append({"x": a, "y": b, "mode": "lines", "fill": "toself", "fillcolor": colour})
        traces[-1] |= {"type": "scatter", "line": {"width": 0.6, "color": colour}}
    at = {"x": [x[0, 0]], "y": [x[0, 1]], "mode": "markers", "type": "scatter"}
    return [at, *traces]  # the first has the colour bar


def _cut(
    shape: Shape, what: Quantity, x: Array, values: Array, axis: int, share: float
) -> list[Part]:
    """The surface of a device in space, cut across an axis if one is given."""
    every, found = bodies(shape, what, x, values), list[Part]()
    ends = np.concatenate([body.points for body, _ in every])
    low, high = ends.min(axis=0), ends.max(axis=0)
    at = low + (high - low) * np.clip(share, 1e-6, 1 - 1e-6)
    for body, _ in every:
        part = body if axis < 0 else body.clip("xyz"[axis], origin=at, invert=False)
        surface = part.extract_surface().triangulate()
        if surface.n_cells:
            triangles = surface.faces.reshape(-1, 4)[:, 1:]
            found.append((surface.points, triangles, surface.point_data["values"]))
    return found
