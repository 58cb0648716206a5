"""The grid of a laminate's mesh in a plane: cells of layers, blocks and air, and named lines."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device import grading
from dealib.device.grid import AIR_RATIO, Grid, Line, growing
from dealib.device.laminate import FRAME_BLOCK, MOUNT_BLOCK, Blocks, Laminate
from dealib.device.records import AIR

_BLOCK_RATIO = 1.35  # growth of the blocks' cells away from the layers' ends
_FEWEST = 6  # columns of a part of the base


def grid(laminate: Laminate, mesh: Any) -> Grid:
    """Grid of a plane mesh.

    Args:
        laminate: The laminate.
        mesh: The config's section `mesh`.
    """
    base, layers = laminate.base, laminate.layers
    along = laminate.breaks(base.along, base.limits)
    bottom = base.bottom(laminate.thickness)
    levels = list(accumulate((x.thickness for x in layers), initial=bottom))
    spacing = {("along", i): s for i, s in enumerate(columns(laminate, along, mesh))}
    for j, layer in enumerate(layers):
        rows = layer.rows or (mesh.electrode_rows if layer.conducts else mesh.film_rows)
        spacing["across", j] = np.linspace(0, 1, rows + 1)
    cells = {
        (i, j): layer.name
        for i, (a, b) in enumerate(pairwise(along))
        for j, layer in enumerate(layers)
        if laminate.covers(layer.within, a, b)
    }
    found = _Parts(laminate, along, levels, spacing, cells, laminate.lines(along))
    if laminate.blocks is not None:
        found.add_blocks(laminate.blocks)
    size = None
    if laminate.air_height > 0:
        size = mesh.air_size or laminate.air_height / 5
        found.add_air()
    swapped = base.across == laminate.kinematics.axes[0]
    return Grid(
        *(tuple(found.along), tuple(found.levels), found.spacing, found.cells, found.lines),
        *(size, swapped),
    )


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
        fine: Whether cells are fine at each end; by default they are, except at an axis.
        across: Whether it is a line along Y instead of the base's own axis.
    """
    first, last = fine or (laminate.base.ends[0] is not None, True)
    length, wanted = along[-1] - along[0], 2 * mesh.sectors if across else mesh.columns
    films = [x for x in laminate.layers if not x.conducts]
    cross = min(x.thickness / (x.rows or mesh.film_rows) for x in films)
    if laminate.solid:  # few cells: the first one resolves the edge layer at a clamp, of this width
        cross = min(x.thickness / 2 for x in films)
    if laminate.sheet:  # a membrane has no edge layer
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


@dataclass
class _Parts:
    """The parts of a `Grid` (see there), to which blocks and air are added around the layers."""

    laminate: Laminate
    along: list[float]
    levels: list[float]
    spacing: dict[tuple[str, int], Array]
    cells: dict[tuple[int, int], str]
    lines: dict[str, list[Line]]

    def add_blocks(self, blocks: Blocks) -> None:
        """Put a block at each end, the first one the mount and the last one the frame."""
        columns, rows = len(self.along) - 1, len(self.levels) - 1
        end = float(self.spacing["along", 0][1]) * (self.along[1] - self.along[0])
        across = growing(blocks.width, end, _BLOCK_RATIO)
        up = growing(blocks.height - self.laminate.thickness / 2, end, _BLOCK_RATIO)
        self._shift(1, 1)
        self.spacing |= {("across", 0): 1 - up[::-1], ("across", rows + 1): up}
        self.spacing |= {("along", 0): 1 - across[::-1], ("along", columns + 1): across}
        for j in range(rows + 2):
            self.cells[0, j] = MOUNT_BLOCK
            self.cells[columns + 1, j] = FRAME_BLOCK
        middle = self.laminate.middle()
        self.along = [self.along[0] - blocks.width, *self.along, self.along[-1] + blocks.width]
        self.levels = [middle - blocks.height, *self.levels, middle + blocks.height]

    def add_air(self) -> None:
        """Put air above and below, and into gaps beside layers that cover a part of the base."""
        first, low, high = self.spacing["along", 0], self.levels[0], self.levels[-1]
        if self.laminate.blocks is None:
            for i in range(len(self.along) - 1):
                for j in range(len(self.levels) - 1):
                    self.cells.setdefault((i, j), AIR)
            nearest = 2 * min(
                float(d) * (b - a)
                for k, (a, b) in enumerate(pairwise(self.along))
                for d in (np.diff(self.spacing["along", k])[[0, -1]])
            )
        else:
            nearest = self.laminate.blocks.width * float(first[-1] - first[-2])
        middle = self.laminate.middle()
        bottom, top = middle - self.laminate.air_height, middle + self.laminate.air_height
        if self.laminate.base.across == "R":
            bottom = max(bottom, 0.0)
        self._shift(0, 1)
        self.spacing["across", 0] = 1 - growing(low - bottom, nearest, AIR_RATIO)[::-1]
        self.spacing["across", len(self.levels)] = growing(top - high, nearest, AIR_RATIO)
        self.levels = [bottom, *self.levels, top]

    def _shift(self, along: int, across: int) -> None:
        """Renumber everything for grid lines that are put before the first ones."""
        by = {"along": along, "across": across}
        self.spacing = {(way, k + by[way]): s for (way, k), s in self.spacing.items()}
        self.cells = {(i + along, j + across): region for (i, j), region in self.cells.items()}
        self.lines = {
            name: [(i + along, j + across, way) for i, j, way in found]
            for name, found in self.lines.items()
        }
