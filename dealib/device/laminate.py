"""Layers stacked on a base: their regions, faces and ends, and the grid of their mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from dealib.device import grading
from dealib.device.bases import Base
from dealib.device.grading import Array
from dealib.device.grid import (
    AIR_BOTTOM,
    AIR_END,
    AIR_RATIO,
    AIR_START,
    AIR_TOP,
    Grid,
    Line,
    growing,
)
from dealib.device.records import AIR, Region, Sizes, Support, air

MOUNT_BLOCK, FRAME_BLOCK = "mount_block", "frame_block"
AXIS = "axis"
_BLOCK_RATIO = 1.35  # growth of the blocks' cells away from the layers' ends
_FEWEST = 6  # columns of a part of the base
JOIN = "&"  # between the names of a boundary that has several

Span = tuple[float, float]


@dataclass(frozen=True)
class Layer:
    """One layer, as mounted.

    Attributes:
        name: Of its region.
        material: Key of `materials`.
        thickness: In mm.
        conducts: Whether it is a conductor.
        rows: Cells across it; None: the mesh's default.
        within: Part of the base that it covers; None: all of it.
    """

    name: str
    material: str
    thickness: float
    conducts: bool
    rows: int | None = None
    within: Span | None = None


@dataclass(frozen=True)
class Blocks:
    """Rigid dielectric blocks around both ends.

    Attributes:
        width: Of each, mm.
        height: Above and below the middle plane, mm.
        permittivity: Relative one.
    """

    width: float
    height: float
    permittivity: float


@dataclass(frozen=True)
class Laminate:
    """A stack of layers on a base.

    Attributes:
        base: The base.
        layers: From the bottom, or from the inside.
        air_height: Of the air above and below the middle, mm; 0 without.
        blocks: Rigid blocks at both ends, if there are some.
        patches: Parts of faces with names of their own: face and part.
        face: Pattern of the names of faces.
    """

    base: Base
    layers: tuple[Layer, ...]
    air_height: float = 0.0
    blocks: Blocks | None = None
    patches: Mapping[str, tuple[str, Span]] = field(default_factory=dict)
    face: str = "{layer}.{side}"

    # --- names -----------------------------------------------------------------------------------

    @property
    def normal(self) -> int:
        """Component across the layers."""
        return self.base.kinematics.components.index(self.base.across)

    @property
    def regions(self) -> tuple[Region, ...]:
        """Layers, blocks and air."""
        found = [Region(x.name, x.material, normal=self.normal) for x in self.layers]
        if self.blocks is not None:
            eps = self.blocks.permittivity
            found += [Region(name, None, eps) for name in (MOUNT_BLOCK, FRAME_BLOCK)]
        return (*found, *([air()] if self.air_height > 0 else []))

    @property
    def faces(self) -> dict[str, tuple[int, str]]:
        """Layer and side of each face."""
        return {
            self.face.format(layer=layer.name, side=side): (k, side)
            for k, layer in enumerate(self.layers)
            for side in ("bottom", "top")
        }

    @property
    def boundaries(self) -> tuple[str, ...]:
        """Names of boundaries that supports, terminals and chambers may take."""
        names = (name for group in self._lines(self._breaks()) for name in group.split(JOIN))
        return tuple(dict.fromkeys(names))

    def middle(self) -> float:
        """Coordinate of the middle of the stack across the base, mm."""
        return self.base.bottom(self.thickness) + self.thickness / 2

    @property
    def thickness(self) -> float:
        """Of all layers together, mm."""
        return sum(layer.thickness for layer in self.layers)

    @property
    def film(self) -> Layer:
        """The first layer that does not conduct."""
        return next((x for x in self.layers if not x.conducts), self.layers[0])

    @property
    def sizes(self) -> Sizes:
        """See `Sizes`."""
        base, film = self.base, self.film
        first, last = base.limits
        around = 2 * np.pi * last if base.kinematics.revolved else base.girth
        return Sizes(
            film.thickness, last - first, base.girth, base.area, float(around), self.air_height
        )

    def supports(self, held: Mapping[str, tuple[str, ...]]) -> list[Support]:
        """What the shape itself holds: the axis, and the air's sides, which slide or stay.

        Args:
            held: Axes that are held at each end of the base.
        """
        base, axes = self.base, self.base.kinematics.axes
        found = []
        if base.along == "R" and base.limits[0] == 0:
            found.append(Support("R", AXIS))
        if self.air_height == 0:
            return found
        for end, side in zip(base.ends, (AIR_START, AIR_END), strict=True):
            fixed = held.get(end, ()) if end is not None else (base.along,)
            whole = set(fixed) == set(axes)
            found += [Support(a, side) for a in axes if a in fixed and (whole or a == base.along)]
        far = [AIR_TOP, AIR_BOTTOM]
        return found + [Support(a, side) for side in far for a in axes]

    # --- mesh ------------------------------------------------------------------------------------

    def grid(self, mesh: Any) -> Grid:
        """Grid of the mesh.

        Args:
            mesh: The config's section.
        """
        base = self.base
        along = self._breaks()
        levels = list(
            accumulate((x.thickness for x in self.layers), initial=base.bottom(self.thickness))
        )
        columns = self._columns(along, mesh)
        spacing = {("along", i): s for i, s in enumerate(columns)}
        for j, layer in enumerate(self.layers):
            rows = layer.rows or (mesh.electrode_rows if layer.conducts else mesh.film_rows)
            spacing["across", j] = np.linspace(0, 1, rows + 1)
        cells, lines = self._cells(along), self._lines(along)
        if self.blocks is not None:
            along, levels = self._add_blocks(along, levels, spacing, cells, lines)
        size = None
        if self.air_height > 0:
            size = mesh.air_size or self.air_height / 5
            levels = self._add_air(along, levels, spacing, cells, lines)
        swapped = base.across == base.kinematics.axes[0]
        return Grid(tuple(along), tuple(levels), spacing, cells, lines, size, swapped)

    def _breaks(self) -> list[float]:
        """Coordinates along the base at which a layer or a patch begins or ends."""
        spans = [x.within for x in self.layers if x.within is not None]
        spans += [span for _, span in self.patches.values()]
        first, last = self.base.limits
        found, apart = [first], 1e-9 * (last - first)
        for x in sorted({x for span in spans for x in span}):
            if found[-1] + apart < x < last - apart:
                found.append(x)
        return [*found, last]

    def _columns(self, along: list[float], mesh: Any) -> list[Array]:
        """Spacing of each part of the base: fine at ends, clamps and edges of electrodes."""
        length = along[-1] - along[0]
        cross = min(x.thickness / (x.rows or mesh.film_rows) for x in self.layers if not x.conducts)
        found = []
        for k, (a, b) in enumerate(pairwise(along)):
            cells = mesh.columns
            if len(along) > 2:
                cells = max(_FEWEST, 2 * round(mesh.columns * (b - a) / length / 2))
            end = min(cross, (b - a) / cells) / (b - a)
            if mesh.grading == "uniform":
                found.append(np.linspace(0, 1, cells + 1))
            elif mesh.grading == "tanh":
                found.append(grading.tanh(cells))
            elif k == 0 and self.base.ends[0] is None:  # at the axis nothing is steep
                found.append(1 - grading.geometric(cells, end)[::-1])
            else:
                found.append(grading.ends(cells, end))
        return found

    def _covers(self, within: Span | None, a: float, b: float) -> bool:
        return within is None or within[0] <= (a + b) / 2 <= within[1]

    def _cells(self, along: list[float]) -> dict[tuple[int, int], str]:
        found = {}
        for i, (a, b) in enumerate(pairwise(along)):
            for j, layer in enumerate(self.layers):
                if self._covers(layer.within, a, b):
                    found[i, j] = layer.name
        return found

    def _lines(self, along: list[float]) -> dict[str, list[Line]]:
        """Ends and faces; a line of several names is in a group of its own (see `JOIN`).

        Where a conductor touches a dielectric, their interface has the dielectric's name alone.
        """
        parts, n = list(enumerate(pairwise(along))), len(along) - 1
        found: dict[str, list[Line]] = {}
        for end, (i, k) in zip(self.base.ends, ((0, 0), (n, n - 1)), strict=True):
            name = end if end is not None else AXIS
            a, b = along[k : k + 2]
            found[name] = [
                (i, j, "across")
                for j, layer in enumerate(self.layers)
                if self._covers(layer.within, a, b)
            ]
        names: dict[Line, list[str]] = {}
        conductors: dict[Line, list[str]] = {}
        for face, (j, side) in self.faces.items():
            layer, level = self.layers[j], j + (side == "top")
            for i, (a, b) in parts:
                if self._covers(layer.within, a, b):
                    of = conductors if layer.conducts else names
                    of.setdefault((i, level, "along"), []).append(face)
        for line, faces in conductors.items():
            names.setdefault(line, faces)
        for patch, (face, span) in self.patches.items():
            for (i, _, _), faces in names.items():
                if face in faces and self._covers(span, *along[i : i + 2]):
                    faces.append(patch)
        for line, faces in names.items():
            found.setdefault(JOIN.join(faces), []).append(line)
        return found

    def _add_blocks(
        self,
        along: list[float],
        levels: list[float],
        spacing: dict[tuple[str, int], Array],
        cells: dict[tuple[int, int], str],
        lines: dict[str, list[Line]],
    ) -> tuple[list[float], list[float]]:
        """Put the blocks around what there is; returns the new grid lines."""
        assert self.blocks is not None
        width, height = self.blocks.width, self.blocks.height
        columns, rows = len(along) - 1, len(levels) - 1
        end = float(spacing["along", 0][1]) * (along[1] - along[0])
        across = growing(width, end, _BLOCK_RATIO)
        up = growing(height - self.thickness / 2, end, _BLOCK_RATIO)
        _shift(spacing, cells, lines, 1, 1)
        spacing |= {("across", 0): 1 - up[::-1], ("across", rows + 1): up}
        spacing |= {("along", 0): 1 - across[::-1], ("along", columns + 1): across}
        for j in range(rows + 2):
            cells[0, j] = MOUNT_BLOCK
            cells[columns + 1, j] = FRAME_BLOCK
        middle = self.middle()
        return (
            [along[0] - width, *along, along[-1] + width],
            [middle - height, *levels, middle + height],
        )

    def _add_air(
        self,
        along: list[float],
        levels: list[float],
        spacing: dict[tuple[str, int], Array],
        cells: dict[tuple[int, int], str],
        lines: dict[str, list[Line]],
    ) -> list[float]:
        """Put air above and below; returns the new levels."""
        first, low, high = spacing["along", 0], levels[0], levels[-1]
        if self.blocks is None:  # gaps beside layers that cover a part only
            for i in range(len(along) - 1):
                for j in range(len(levels) - 1):
                    cells.setdefault((i, j), AIR)
            nearest = 2 * min(
                float(d) * (b - a)
                for k, (a, b) in enumerate(pairwise(along))
                for d in (np.diff(spacing["along", k])[[0, -1]])
            )
        else:
            nearest = self.blocks.width * float(first[-1] - first[-2])
        bottom = self.middle() - self.air_height
        if self.base.across == "R":
            bottom = max(bottom, 0.0)
        top = self.middle() + self.air_height
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
