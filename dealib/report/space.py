"""The interactive view in space of a report: its data, and the library that draws it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from dealib.arrays import Array
from dealib.errors import PlatformError
from dealib.plots.contours import magnification, scale, scale_note
from dealib.plots.crests import COLOUR, strokes
from dealib.plots.shape import LayerShape, drawn, typical_step
from dealib.plots.style import LIGHT
from dealib.plots.surface import Patch, blocks, patches, turned_block
from dealib.plots.views import CONDUCTORS, RIGID
from dealib.results.quantities import FieldQuantity
from dealib.results.reader import Run

_STEPS, _TRIANGLES, _BYTES = 40, 60_000, 20e6  # at most, in a page
_COLOURS = 33  # of a colour scale
_LEVELS = 65535  # of a coordinate or a value, between the smallest and the largest one


def library() -> str:
    """The JavaScript of plotly.

    Raises:
        PlatformError: If it is not installed.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise PlatformError(
            "plotly is not installed (run setup/setup.sh, or pip install plotly)"
        ) from None
    return str(get_plotlyjs())


def view(run: Run, whats: Sequence[FieldQuantity]) -> dict[str, Any]:
    """The data that the page's script draws; empty for devices in a plane or without stored steps.

    Coordinates and values are 16-bit numbers between the ends that are given with them.

    Args:
        run: The run.
        whats: Quantities, the first of which is shown at first; their values must not change sign
            when mirrored.
    """
    device = run.config.device
    if not run.stored_steps or not (device.kinematics.dim == 3 or device.kinematics.revolved):
        return {}
    first = _shape(run, typical_step(run))
    parts = _parts(first)
    every = [patch for _, found in parts for patch in found]
    points = sum(len(patch.nodes) for patch in every)
    bytes_a_step = 2 * 4 / 3 * points * (first.points.shape[1] + len(whats))
    steps = _chosen(run, first.step, int(np.clip(_BYTES // bytes_a_step, 2, _STEPS)))
    factor, labels, places, values, crests = magnification(first), [], [], [], []
    wrinkled = next((what for what in whats if what.field == "wrinkling"), None)
    for step in steps:
        shape = _shape(run, step)
        labels.append(shape.when)
        rigid = blocks(shape, factor) if device.kinematics.revolved else []
        places.append(np.concatenate([shape.moved(factor), *rigid]))
        here = np.array([shape.values(what) for what in whats])
        values.append(np.pad(here, ((0, 0), (0, 4 * len(rigid))), constant_values=np.nan))
        if wrinkled:
            crests.append(strokes(shape)[0])
    moved, found = np.array(places), np.array(values)
    held = [patch for k in range(len(rigid)) for patch in turned_block(len(first.points) + 4 * k)]
    if held:
        parts.append((RIGID, held))
    lost = sum(patch.left_out for patch in every)
    left = sum(len(patch.triangles) for patch in every)
    notes = [scale_note(factor).capitalize()]
    if len(steps) < len(run.stored_steps):
        notes.append(f"{len(steps)} of {len(run.stored_steps)} stored steps")
    if lost:
        notes.append(f"surface thinned out to {left:,} of {left + lost:,} triangles")
    ends = np.stack([moved.min(axis=(0, 1)), moved.max(axis=(0, 1))])
    return {
        "labels": labels,
        "start": steps.index(first.step),
        "note": "; ".join(notes).replace(",", " ") + ".",
        "ends": ends.tolist(),
        "box": _box([*every, *held], moved),
        "quantities": [coloured(first, what, found[:, k]) for k, what in enumerate(whats)],
        "parts": [
            {
                "plain": colour,
                "conductor": colour == CONDUCTORS,
                "patches": [_patch(patch, moved, ends, found, whats) for patch in patches_],
            }
            for colour, patches_ in parts
        ],
        "crests": _crests(wrinkled.name, crests) if wrinkled else None,
    }


def _shape(run: Run, step: int) -> LayerShape:
    return LayerShape(run, step, n=2)


def _parts(shape: LayerShape) -> list[tuple[str, list[Patch]]]:
    """The surfaces of films and of conductors, each with its colour where it has no values.

    Half of the conductors' surface is left out, so that the films below are seen.
    """
    films = set(_dielectrics(shape))
    found = []
    for conductor in (False, True):
        names = [name for name in shape.layers if (name not in films) == conductor]
        if conductor and films and shape.solid and shape.mesh.cell.dim == 2:
            continue  # the layers of a sheet lie in one surface
        if names:
            opened = conductor and bool(films)
            colour = CONDUCTORS if conductor else ""
            found.append((colour, patches(shape, names, opened, _TRIANGLES // 2)))
    return found


def _dielectrics(shape: LayerShape) -> list[str]:
    from dealib.results.quantities import quantity

    return drawn(shape.run, quantity("E", shape.kinematics))


def _chosen(run: Run, typical: int, most: int) -> list[int]:
    """Stored steps at about equal intervals, with the first, the last and the typical one."""
    steps = run.stored_steps
    if len(steps) <= most:
        return steps
    some = [steps[k] for k in np.linspace(0, len(steps) - 1, most).round().astype(int)]
    if typical not in some:
        some[1 + int(np.abs(np.array(some[1:-1]) - typical).argmin()) if most > 2 else 0] = typical
    return sorted(some)


def _box(every: Sequence[Patch], moved: Array) -> list[list[float]]:
    """Lowest and highest coordinates in space of all steps, by axis."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for patch in every:
        for one in patch.maps:
            x = moved[:, patch.nodes] @ one.T
            low, high = np.minimum(low, x.min(axis=(0, 1))), np.maximum(high, x.max(axis=(0, 1)))
    room = 0.02 * (high - low).max()
    return np.stack([low - room, high + room], axis=1).tolist()


def coloured(shape: LayerShape, what: FieldQuantity, values: Array) -> dict[str, Any]:
    """Name, unit and colour scale of a quantity, with the colours of the other pictures."""
    colours, there = scale(shape, values, LIGHT, what), values[np.isfinite(values)]
    shades = colormaps[colours.cmap](np.linspace(0, 1, _COLOURS))
    label, _, component = what.label.partition(f" {what.name[0]}$")
    return {
        "name": what.name,
        "title": f"{label} {what.name}" if component else label,
        "unit": what.unit,
        "ends": [float(there.min()), float(there.max())],
        "range": [float(colours.norm.vmin or 0), float(colours.norm.vmax or 0)],
        "colours": [[k / (_COLOURS - 1), to_hex(shade)] for k, shade in enumerate(shades)],
    }


def _patch(
    patch: Patch, moved: Array, ends: Array, values: Array, whats: Sequence[FieldQuantity]
) -> dict[str, Any]:
    """A patch with its points and values at all steps."""
    mine = {}
    for k, what in enumerate(whats):
        here, every = values[:, k, patch.nodes], values[:, k]
        if np.isfinite(here).all():
            mine[what.name] = _packed(here, np.nanmin(every), np.nanmax(every))
    return {
        "n": len(patch.nodes),
        "maps": patch.maps.round(9).tolist(),
        "triangles": _text(patch.triangles.astype("<u4")),
        "points": _packed(moved[:, patch.nodes], ends[0], ends[1]),
        "values": mine,
    }


def _crests(name: str, steps: Sequence[Array]) -> dict[str, Any] | None:
    """Lines along the crests of wrinkles at all steps, drawn with the quantity of a name."""
    every = np.concatenate(steps).reshape(-1, 3)
    if not len(every):
        return None
    low, high = every.min(axis=0), every.max(axis=0)
    packed = [_packed(ends, low, high) for ends in steps]
    return {"name": name, "colour": COLOUR, "ends": [low.tolist(), high.tolist()], "steps": packed}


def _packed(values: Array, low: Any, high: Any) -> str:
    size = np.where(high > low, high - low, 1.0)
    return _text(np.round((values - low) / size * _LEVELS).astype("<u2"))


def _text(values: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
