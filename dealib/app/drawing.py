"""Figures of a page as plain data for Plotly: curves, and the deformed device."""

from __future__ import annotations

from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.plots.contours import magnification, scale_note
from dealib.plots.labels import label, split
from dealib.plots.limits import BEYOND, beyond
from dealib.plots.shape import LayerShape
from dealib.plots.style import LIGHT
from dealib.plots.views import CONDUCTORS, bodies
from dealib.report.figures import turned
from dealib.report.space import coloured
from dealib.results.quantities import quantities
from dealib.results.reader import Run
from dealib.results.summary import VERDICTS, drive, motion

RED = BEYOND[VERDICTS[0]]
_EYE = {"x": 1.5, "y": -2.1, "z": 1.5}
_LIGHTING = {"ambient": 0.65, "diffuse": 0.5, "specular": 0.05, "facenormalsepsilon": 0}


def columns(run: Run) -> tuple[list[str], str, list[str]]:
    """Columns that can be drawn, the initial abscissa and the initial ordinates."""
    every = [c for c in map(str, run.history) if c != "stage"]
    first = [*motion(run), drive(run), *(c for c in every if c.startswith("capacitance_pF"))]
    return every, "time_s", list(dict.fromkeys(first))[:4]


def curves(run: Run, x: str, chosen: list[str], solid: Any = None) -> dict[str, Any]:
    """Columns over another one, red where a limit is exceeded.

    Args:
        run: The run.
        x: Column of the abscissa.
        chosen: Columns of the ordinates.
        solid: A second run, whose columns are dotted; None: there is none.
    """
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
            shown = [v if np.isfinite(v) else None for v in values.tolist()]
            mode = "lines" if of is solid else "lines+markers"
            traces.append({"x": at, "y": shown, "yaxis": f"y{k}", "line": line, "mode": mode})
            traces[-1] |= {"type": "scatter", "marker": {"size": 4}, "name": name}
    return {"data": traces, "layout": layout}


def fields(run: Run) -> dict[str, str]:
    """Titles of the fields of a run, by name; those that a report shows come first."""
    if not run.stored_steps:
        return {}
    shape = LayerShape(run, n=1)
    known = quantities(shape.kinematics)
    names = dict.fromkeys([q.name for q in turned(run)] + list(known))
    there = [known[n] for n in names if known[n].field in shape.arrays]
    return {q.name: f"{q.name}: {q.label.partition(f' {q.name[0]}$')[0]}" for q in there}


def cuts(run: Run) -> list[str]:
    """Views of the device: whole and cut across an axis, or a section."""
    solid = run.config.device.kinematics.dim == 3
    return ["whole", *(f"cut across {axis}" for axis in "XYZ")] if solid else ["section"]


def device(run: Run, step: int, field: str, cut: str, share: float) -> dict[str, Any]:
    """The deformed device at a stored step, coloured by a field.

    Args:
        run: The run.
        step: Step of the history.
        field: Name of the field.
        cut: A view of `cuts`.
        share: Place of the cut of a three-dimensional device, from 0 to 1 of its extent.
    """
    shape = LayerShape(run, step, n=2)
    what = quantities(shape.kinematics)[field]
    values, factor = shape.values(what), magnification(shape)
    look, x = coloured(shape, what, values), shape.moved(factor)
    (low, high), bar = look["range"], {"title": {"text": what.unit}, "thickness": 12, "len": 0.8}
    shades = {"cmin": low, "cmax": high, "colorscale": look["colours"], "colorbar": bar}
    title = {"text": f"{shape.when}<br>{scale_note(factor)}", "font": {"size": 12}}
    layout: dict[str, Any] = {"title": title, "uirevision": cut, "showlegend": False}
    layout["margin"] = {"l": 55, "r": 0, "t": 70, "b": 45}
    if shape.solid:
        bodies_ = bodies(shape, what, x, values)
        layout["scene"] = _scene(bodies_)
        return {"data": _solid(bodies_, "XYZ".find(cut[-1]), share, shades), "layout": layout}
    a, b = ({"title": {"text": f"{axis} (mm)"}} for axis in shape.kinematics.axes)
    layout |= {"xaxis": a, "yaxis": b | {"scaleanchor": "x"}, "hovermode": False}
    bar_alone = {"color": [low], "size": 0.1} | shades
    first: dict[str, Any] = {"type": "scatter", "mode": "markers", "x": [x[0, 0]], "y": [x[0, 1]]}
    first["marker"] = bar_alone
    flat = _flat(x[shape.strips.triangles], shape, values, look)
    return {"data": [first, *flat], "layout": layout}


def _flat(x: Array, shape: LayerShape, values: Array, look: dict[str, Any]) -> list[dict[str, Any]]:
    """Triangles in a plane, (triangles, 3, 2), as filled paths, one for each colour."""
    (low, high), colours = look["range"], look["colours"]
    mean, last = values[shape.strips.triangles].mean(axis=1), len(colours) - 1
    share = np.clip(np.nan_to_num((mean - low) / (high - low)), 0, 1)
    shade = np.where(np.isnan(mean), -1, np.round(last * share)).astype(int)
    traces = list[dict[str, Any]]()
    for k in np.unique(shade):
        corners = np.insert(x[shade == k][:, [0, 1, 2, 0]], 4, np.nan, axis=1)  # closed, a gap
        a, b = ([None if v != v else v for v in c] for c in corners.reshape(-1, 2).T.tolist())
        colour = CONDUCTORS if k < 0 else colours[k][1]
        traces.append({"type": "scatter", "mode": "lines", "x": a, "y": b, "fill": "toself"})
        traces[-1] |= {"fillcolor": colour, "line": {"width": 0.6, "color": colour}}
    return traces


def _ends(every: Any) -> tuple[Array, Array]:
    points = np.concatenate([body.points for body, _ in every])
    return points.min(axis=0), points.max(axis=0)


def _scene(every: Any) -> dict[str, Any]:
    """Axes in true scale; from the camera's place the sphere around them is seen."""
    low, high = _ends(every)
    room = 0.02 * (high - low).max()
    sizes = high - low + 2 * room
    ratio = 2.2 * sizes / np.linalg.norm(sizes)
    scene: dict[str, Any] = {"aspectmode": "manual", "camera": {"eye": _EYE}}
    scene["aspectratio"] = dict(zip("xyz", ratio.tolist(), strict=True))
    for name, start, end in zip("xyz", low.tolist(), high.tolist(), strict=True):
        title = {"text": f"{name.upper()} (mm)"}
        scene[f"{name}axis"] = {"title": title, "range": [start - room, end + room]}
    return scene


def _solid(every: Any, axis: int, share: float, shades: dict[str, Any]) -> list[dict[str, Any]]:
    """The surface of a three-dimensional device, cut across an axis; -1: whole."""
    low, high = _ends(every)
    at, traces = low + (high - low) * np.clip(share, 1e-6, 1 - 1e-6), list[dict[str, Any]]()
    for body, colour in every:
        part = body if axis < 0 else body.clip("xyz"[axis], origin=at, invert=False)
        surface = part.extract_geometry().triangulate()
        if not surface.n_cells:
            continue
        mesh: dict[str, Any]
        (a, b, c), (i, j, k) = surface.points.T.tolist(), surface.faces.reshape(-1, 4)[:, 1:].T
        mesh = {"type": "mesh3d", "x": a, "y": b, "z": c, "lighting": _LIGHTING}
        mesh |= {"i": i.tolist(), "j": j.tolist(), "k": k.tolist(), "flatshading": True}
        there = {"intensity": surface.point_data["values"].tolist()} | shades
        there["showscale"] = not any("intensity" in t for t in traces)
        traces.append(mesh | ({"color": colour} if colour else there))
    return traces
