"""The grid of a laminate's mesh in a plane: cells of layers, blocks and air, and named lines."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from dealib.device import grading
from dealib.device.grading import Array
from dealib.device.grid import (
    AIR_RATIO,
    Grid,
    Line,
    growing,
)
from dealib.device.laminate import FRAME_BLOCK, MOUNT_BLOCK, Laminate
from dealib.device.records import AIR

_BLOCK_RATIO = 1.35  # growth of the blocks' cells away from the layers' ends
_FEWEST = 6  # columns of a part of the base


def grid(laminate: Laminate, mesh: Any) -> Grid:
    """Grid of a plane mesh.

    Args:
        laminate: The laminate.
        mesh: The config's section.
    """
    base = laminate.base
    along = laminate.breaks(base.along, base.limits)
    levels = list(
        accumulate((x.thickness for x in laminate.layers), initial=base.bottom(laminate.thickness))
    )
    spacings = columns(laminate, along, mesh)
    spacing = {("along", i): s for i, s in enumerate(spacings)}
    for j, layer in enumerate(laminate.layers):
        rows = layer.rows or (mesh.electrode_rows if layer.conducts else mesh.film_rows)
        spacing["across", j] = np.linspace(0, 1, rows + 1)
    cells, lines = _cells(laminate, along), laminate.lines(along)
    if laminate.blocks is not None:
        along, levels = _add_blocks(laminate, along, levels, spacing, cells, lines)
    size = None
    if laminate.air_height > 0:
        size = mesh.air_size or laminate.air_height / 5
        levels = _add_air(laminate, along, levels, spacing, cells, lines)
    swapped = base.across == laminate.kinematics.axes[0]
    return Grid(tuple(along), tuple(levels), spacing, cells, lines, size, swapped)


def columns(
    laminate: Laminate,
    along: list[float],
    mesh: Any,
    fine: tuple[bool, bool] | None = None,
    across: bool = False,
) -> list[Array]:
    """Spacing of each part of a line: fine at ends, clamps and edges of electrodes.

    Args:
        laminate: The laminate.
        along: Where parts begin and end.
        mesh: The config's section.
        fine: Whether it is fine at both ends; by default but where the base has no end.
        across: Whether it is a line across the base.
    """
    first, last = fine or (laminate.base.ends[0] is not None, True)
    length, wanted = along[-1] - along[0], 2 * mesh.sectors if across else mesh.columns
    films = [x for x in laminate.layers if not x.conducts]
    cross = min(x.thickness / (x.rows or mesh.film_rows) for x in films)
    if laminate.solid:  # cells are few: they shall resolve the layer of this width at a clamp
        cross = min(x.thickness / 2 for x in films)
    if laminate.sheet:  # which has no such layer
        cross = length
    found = []
    for k, (a, b) in enumerate(pairwise(along)):
        cells = wanted
        if len(along) > 2:
            cells = max(_FEWEST, 2 * round(wanted * (b - a) / length / 2))
        end = min(cross, (b - a) / cells) / (b - a)
        ends = (first or k > 0, last or k < len(along) - 2)
        if mesh.grading == "uniform":
            found.append(np.linspace(0, 1, cells + 1))
        elif mesh.grading == "tanh":
            found.append(grading.tanh(cells))
        elif all(ends):
            found.append(grading.ends(cells, end))
        else:  # at the axis, or a plane of symmetry, nothing is steep
            one = grading.geometric(cells, end)
            found.append(one if ends[0] else 1 - one[::-1])
    return found


def _cells(laminate: Laminate, along: list[float]) -> dict[tuple[int, int], str]:
    found = {}
    for i, (a, b) in enumerate(pairwise(along)):
        for j, layer in enumerate(laminate.layers):
            if laminate.covers(layer.within, a, b):
                found[i, j] = layer.name
    return found


def _add_blocks(
    laminate: Laminate,
    along: list[float],
    levels: list[float],
    spacing: dict[tuple[str, int], Array],
    cells: dict[tuple[int, int], str],
    lines: dict[str, list[Line]],
) -> tuple[list[float], list[float]]:
    """Put the blocks around what there is; returns the new grid lines."""
    assert laminate.blocks is not None
    width, height = laminate.blocks.width, laminate.blocks.height
    columns, rows = len(along) - 1, len(levels) - 1
    end = float(spacing["along", 0][1]) * (along[1] - along[0])
    across = growing(width, end, _BLOCK_RATIO)
    up = growing(height - laminate.thickness / 2, end, _BLOCK_RATIO)
    _shift(spacing, cells, lines, 1, 1)
    spacing |= {("across", 0): 1 - up[::-1], ("across", rows + 1): up}
    spacing |= {("along", 0): 1 - across[::-1], ("along", columns + 1): across}
    for j in range(rows + 2):
        cells[0, j] = MOUNT_BLOCK
        cells[columns + 1, j] = FRAME_BLOCK
    middle = laminate.middle()
    return (
        [along[0] - width, *along, along[-1] + width],
        [middle - height, *levels, middle + height],
    )


def _add_air(
    laminate: Laminate,
    along: list[float],
    levels: list[float],
    spacing: dict[tuple[str, int], Array],
    cells: dict[tuple[int, int], str],
    lines: dict[str, list[Line]],
) -> list[float]:
    """Put air above and below; returns the new levels."""
    first, low, high = spacing["along", 0], levels[0], levels[-1]
    if laminate.blocks is None:  # gaps beside layers that cover a part only
        for i in range(len(along) - 1):
            for j in range(len(levels) - 1):
                cells.setdefault((i, j), AIR)
        nearest = 2 * min(
            float(d) * (b - a)
            for k, (a, b) in enumerate(pairwise(along))
            for d in (np.diff(spacing["along", k])[[0, -1]])
        )
    else:
        nearest = laminate.blocks.width * float(first[-1] - first[-2])
    bottom = laminate.middle() - laminate.air_height
    if laminate.base.across == "R":
        bottom = max(bottom, 0.0)
    top = laminate.middle() + laminate.air_height
    _shift(spacing, cells, lines, 0, 1)
    spacing["across", 0] = 1 - growing(low - bottom, nearest, AIR_RATIO)[::-1]
    spacing["across", len(levels)] = growing(top - high, nearest, AIR_RATIO)
    return [bottom, *levels, top]


def _shift(
    spacing: dict[tuple[str, int], Array],
    cells: dict[tuple[int, int], str],
    lines: dict[str, list[Line]],
    along: int,
    across: int,
) -> None:
    """Number everything anew after grid lines were put before the first ones."""
    moved = {(w, k + (along if w == "along" else across)): s for (w, k), s in spacing.items()}
    spacing.clear()
    spacing |= moved
    shifted = {(i + along, j + across): region for (i, j), region in cells.items()}
    cells.clear()
    cells |= shifted
    for name, found in lines.items():
        lines[name] = [(i + along, j + across, way) for i, j, way in found]
