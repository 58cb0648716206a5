"""Figures of a page, as plain data for plotly: curves, and the deformed device."""

from __future__ import annotations

from typing import Any

import numpy as np

from dealib.plots.contours import magnification, scale_note
from dealib.plots.labels import label, split
from dealib.plots.limits import BEYOND, beyond
from dealib.plots.shape import Shape, drawn
from dealib.plots.style import LIGHT
from dealib.plots.surface import patches
from dealib.plots.views import CONDUCTORS, bodies
from dealib.report.figures import turned
from dealib.report.space import coloured
from dealib.results.elements import Array
from dealib.results.quantities import Quantity, quantities
from dealib.results.reader import Run
from dealib.results.summary import MARGINS, VERDICTS, drive, margins, motion

RED = BEYOND[VERDICTS[0]]
SECTION, SPACE = "section", "in space"
_TRIANGLES = 8000  # of a body of revolution
_LIGHTING = {"ambient": 0.65, "diffuse": 0.5, "specular": 0.05, "facenormalsepsilon": 0}


def columns(run: Run) -> tuple[list[str], str, list[str]]:
    """Columns that can be drawn, the abscissa and those that are drawn at first."""
    every = [c for c in map(str, run.history) if c != "stage"]
    first = [*motion(run), drive(run), *(c for c in every if c.startswith("capacitance_pF"))][:4]
    return every, "time_s", list(dict.fromkeys(first))


def curves(run: Run, x: str, chosen: list[str], solid: Run | None = None) -> dict[str, Any]:
    """Columns over another one, red where a limit is passed; a second run is dotted."""
    traces: list[dict[str, Any]] = []
    gap = 0.06
    high = (1 + gap) / max(len(chosen), 1)
    layout: dict[str, Any] = {"xaxis": {"title": {"text": label(x)}}, "showlegend": False}
    layout["margin"] = {"l": 70, "r": 15, "t": 10, "b": 45}
    for k, y in enumerate(chosen):
        number = str(k + 1) if k else ""
        top = 1 - k * high
        name, unit = split(y)
        layout[f"yaxis{number}"] = {"domain": [max(0.0, top - high + gap), top],
                                    "title": {"text": f"{name}<br>({unit})" if unit else name}}  # fmt: skip
        for of, line in ((run, {"color": LIGHT.lines[k % len(LIGHT.lines)]}),
                         (solid, {"color": "#777777", "dash": "dot"})):  # fmt: skip
            if of is not None and y in of.history and x in of.history:
                h = of.history
                found = {"x": h[x].tolist(), "y": h[y].tolist(), "yaxis": f"y{number}"}
                traces.append({"type": "scatter", "mode": "lines+markers", "line": line,
                               "marker": {"size": 4}, "name": name, **found})  # fmt: skip
        if y not in run.history or x not in run.history:
            continue
        passed = np.any([beyond(run.history, verdict, y) for verdict in VERDICTS], axis=0)
        red = np.where(passed, run.history[y], np.nan)
        if passed.any():
            traces.append({"type": "scatter", "mode": "lines+markers", "line": {"color": RED,
                           "width": 4}, "x": run.history[x].tolist(), "yaxis": f"y{number}",
                           "y": [None if v != v else v for v in red.tolist()],
                           "name": "beyond a limit"})  # fmt: skip
    layout["xaxis"]["anchor"] = f"y{len(chosen) if len(chosen) > 1 else ''}"
    return {"data": traces, "layout": layout | {"uirevision": f"{x} {chosen}"}}


def uses(run: Run) -> list[tuple[str, str, bool]]:
    """Each margin: its name and use, where and when, and whether it holds."""
    return [(f"{m.name} {m.used}", f"{m.meaning}; {m.when} {m.where}", m.ok) for m in margins(run)]


def fields(run: Run) -> dict[str, str]:
    """Names and titles of the fields that a run has; those of a report come first."""
    if not run.stored_steps:
        return {}
    shape = Shape(run, n=1)
    first = turned(run)
    names = dict.fromkeys([q.name for q in first] + list(quantities(shape.kinematics)))
    known = quantities(shape.kinematics)
    there = [known[n] for n in names if known[n].field in shape.arrays]
    return {q.name: f"{q.name}: {q.label.partition('$')[0].strip(' |')}" for q in there}


def cuts(run: Run) -> list[str]:
    """Ways in which the device can be looked at."""
    kinematics = run.config.device.kinematics
    if kinematics.dim == 3:
        return ["whole", "cut across X", "cut across Y", "cut across Z"]
    return [SECTION, SPACE] if kinematics.revolved else [SECTION]


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
    if shape.solid:
        parts = _cut(shape, what, x, values, "XYZ".find(cut[-1]), share)
    elif cut == SPACE:
        parts = _turned(shape, x, values)
    else:
        triangles = shape.strips.triangles
        parts = [(np.insert(x, 1, 0.0, axis=1), part, values)
                 for part in _split(triangles, np.isnan(values[triangles]).any(axis=1))]  # fmt: skip
    traces: list[dict[str, Any]] = []
    for points, triangles, there in parts:
        plain = bool(np.isnan(there[triangles]).any())
        (a, b, c), (i, j, k) = points.T.tolist(), triangles.T.tolist()
        mesh = {"type": "mesh3d", "x": a, "y": b, "z": c, "i": i, "j": j, "k": k}
        mesh |= {"flatshading": cut != SECTION, "hoverinfo": "skip" if plain else "all"}
        mesh["lighting"] = {"ambient": 1} if cut == SECTION else _LIGHTING
        bar = {"title": {"text": what.unit}, "thickness": 12, "len": 0.8}
        colours = {"intensity": np.nan_to_num(there).tolist(), "colorscale": look["colours"],
                   "cmin": look["range"][0], "cmax": look["range"][1], "colorbar": bar,
                   "showscale": not any("colorbar" in t for t in traces)}  # fmt: skip
        traces.append(mesh | ({"color": CONDUCTORS} if plain else colours))
    return {"data": traces, "layout": _layout(shape, cut, f"{shape.when}; {scale_note(factor)}")}


def _split(triangles: Any, apart: Any) -> list[Any]:
    return [part for part in (triangles[~apart], triangles[apart]) if len(part)]


def _turned(shape: Shape, x: Array, values: Array) -> list[tuple[Array, Any, Array]]:
    films = set(drawn(shape.run, quantities(shape.kinematics)["E"]))
    found = []
    for conductor in (False, True):
        names = [name for name in shape.layers if (name not in films) == conductor]
        every = patches(shape, names, conductor and bool(films), _TRIANGLES) if names else []
        for patch in every:
            points = np.concatenate([x[patch.nodes] @ one.T for one in patch.maps])
            there = np.tile(values[patch.nodes], len(patch.maps))
            found.append((points, patch.triangles, there))
    return found


def _cut(
    shape: Shape, what: Quantity, x: Array, values: Array, axis: int, share: float
) -> list[tuple[Array, Any, Array]]:
    every, found = bodies(shape, what, x, values), []
    ends = np.concatenate([body.points for body, _ in every])
    low, high = ends.min(axis=0), ends.max(axis=0)
    for body, _ in every:
        if axis >= 0:
            at = low + (high - low) * min(max(share, 1e-6), 1 - 1e-6)
            body = body.clip("xyz"[axis], origin=at, invert=False)
        surface = body.extract_surface().triangulate()
        if surface.n_cells:
            triangles = surface.faces.reshape(-1, 4)[:, 1:]
            found.append((surface.points, triangles, surface.point_data["values"]))
    return found


def _layout(shape: Shape, cut: str, title: str) -> dict[str, Any]:
    axes = shape.kinematics.axes if cut == SECTION else ("X", "Y", "Z")
    named = (axes[0], "", axes[1]) if cut == SECTION else axes
    scene: dict[str, Any] = {f"{name}axis": {"title": {"text": f"{axis} (mm)"}}
                             for name, axis in zip("xyz", named, strict=True)}  # fmt: skip
    scene |= {"aspectmode": "data", "camera": {"eye": {"x": 1.15, "y": -1.55, "z": 1.2}}}
    if cut == SECTION:
        scene["yaxis"] = {"visible": False}
        scene["camera"] = {
            "eye": {"x": 0, "y": -1.3, "z": 0},
            "projection": {"type": "orthographic"},
        }
    return {"scene": scene, "uirevision": cut, "margin": {"l": 0, "r": 0, "t": 28, "b": 0},
            "title": {"text": title, "font": {"size": 13}}}  # fmt: skip


def first_limit(run: Run) -> str:
    """What is beyond a limit, in one line."""
    worst = [f"{MARGINS[c][0]} {run.history[c].max():.3g}" for c in MARGINS
             if c in run.history and run.history[c].max() > 1]  # fmt: skip
    return ", ".join(worst)
