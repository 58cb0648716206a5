"""Lines along the crests of wrinkles, and how much of a film wrinkles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.plots.contours import magnification, scale_note
from dealib.plots.shape import LayerShape
from dealib.results.quantities import FieldQuantity

TURN = 270.0  # degrees by which a section is turned to a body of revolution
_STEP = 30.0  # degrees by which each layer is turned less than the one below it, at most
COLOUR = "#d55e00"  # of the lines
_LINES = 24  # number of lines along the device
_LEAST = 0.02  # share of the largest wrinkling below which no line is drawn


def peel(shape: LayerShape) -> float:
    """Degrees by which each layer of a body of revolution is turned less than the one below it."""
    return min(_STEP, TURN / 2 / len(shape.layers))


def note(shape: LayerShape, what: FieldQuantity, factor: float) -> str:
    """Note on the scale, and for wrinkles on the wrinkled area."""
    area = shape.row.get("wrinkled_area_mm2") if what.field == "wrinkling" else None
    told = "" if area is None else f"; {area:.4g} mm² wrinkled, lines on the crests"
    return scale_note(factor) + told


def lines(shape: LayerShape, what: FieldQuantity) -> list[tuple[Any, str]]:
    """Short lines along the crests with their colour, if the quantity is wrinkling."""
    import pyvista as pv

    if what.field != "wrinkling":
        return []
    ends, size = strokes(shape)
    count = len(ends)
    pairs = np.column_stack([np.full(count, 2), np.arange(2 * count).reshape(-1, 2)])
    drawn = pv.PolyData(ends.reshape(-1, 3), lines=pairs.ravel())
    return [(drawn.tube(radius=0.035 * size / _LINES, capping=False), COLOUR)]


def strokes(shape: LayerShape) -> tuple[Array, float]:
    """Ends of short lines along the crests of wrinkles, in space (lines, 2, 3), mm.

    Returns:
        The ends, and the size of the whole device, mm.
    """
    if not shape.solid:
        # points at nodes only, since crests have no sign
        shape = LayerShape(shape.run, shape.step, n=2)
    x, crest = shape.moved(magnification(shape)), shape.arrays["crest"]
    if not shape.solid:
        crest = shape.strips(crest)
    share = np.linalg.norm(crest, axis=1)
    where = np.flatnonzero(share > _LEAST * share.max())
    if not shape.solid:  # on the upper face
        across = shape.points[:, shape.section.across]
        where = where[across[where] > across.max() - 1e-9]
    copies = _turns(shape) if shape.kinematics.revolved else shape.mirrors
    size = float(max(np.ptp(np.concatenate([x @ m[:, : x.shape[1]].T for m in copies]), axis=0)))
    spots = np.round(shape.points[where] * _LINES / size)
    where = where[np.unique(spots, axis=0, return_index=True)[1]]
    half = 0.4 * size / _LINES * crest[where] / share[where, None]
    centre = np.concatenate([x[where] @ m[:, : x.shape[1]].T for m in copies])
    along = np.concatenate([half @ m.T for m in copies])
    return np.stack([centre - along, centre + along], axis=1), size


def _turns(shape: LayerShape) -> Sequence[Array]:
    """Maps (3, 3) from radial, axial and hoop components to space, at angles of the top layer."""
    angles = np.radians(np.arange(4, TURN - peel(shape) * (len(shape.layers) - 1), 8))
    return [
        np.array([[np.cos(a), 0, -np.sin(a)], [np.sin(a), 0, np.cos(a)], [0, 1, 0]]) for a in angles
    ]
