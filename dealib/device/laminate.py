"""Layers stacked on a base: their regions, faces and ends, and the grid of their mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
from dealib.device.kinematics import SOLID, Kinematics, SheetKinematics
from dealib.device.records import AIR, Region, Sizes, Support, air

MOUNT_BLOCK, FRAME_BLOCK = "mount_block", "frame_block"
AXIS = "axis"
_BLOCK_RATIO = 1.35  # growth of the blocks' cells away from the layers' ends
_FEWEST = 6  # columns of a part of the base
JOIN = "&"  # between the names of a boundary that has several

Span = tuple[float, float]


@dataclass(frozen=True)
class Part:
    """A part of a base.

    Attributes:
        spans: From where to where it goes along some axes.
        circle: Centre and radius, if it is one.
    """

    spans: Mapping[str, Span] = field(default_factory=dict)
    circle: tuple[float, float, float] | None = None

    def covers(self, at: Mapping[str, Any]) -> Any:
        """Whether it covers points, given by their coordinates along each axis."""
        inside = np.ones(np.shape(next(iter(at.values()))), dtype=bool)
        for axis, (a, b) in self.spans.items():
            inside &= (a <= at[axis]) & (at[axis] <= b)
        if self.circle is not None:
            x, y, radius = self.circle
            inside &= np.hypot(at["X"] - x, at["Y"] - y) <= radius
        return inside

    def breaks(self, axis: str) -> tuple[float, ...]:
        """Where it begins and ends along an axis."""
        return self.spans.get(axis, ())


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
    within: Part | None = None


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
        solid: Whether it is solved in three dimensions.
        symmetry: Axes across which it is cut in half there: '', 'X', 'Y' or 'XY'.
        sheet: Whether it is solved on its middle surface, as a membrane.
    """

    base: Base
    layers: tuple[Layer, ...]
    air_height: float = 0.0
    blocks: Blocks | None = None
    patches: Mapping[str, tuple[str, Part]] = field(default_factory=dict)
    face: str = "{layer}.{side}"
    solid: bool = False
    symmetry: str = ""
    sheet: bool = False

    @property
    def kinematics(self) -> Kinematics:
        """Its space."""
        base = self.base
        space = SOLID.times(2 ** len(self.symmetry)) if self.solid else base.kinematics
        if not self.sheet:
            return space
        lies = (0, 1) if self.solid else (space.axes.index(base.along),)
        normal = space.components.index(base.across)
        offset = base.bottom(self.thickness) + self.thickness / 2
        return SheetKinematics(
            *(space.space, space.axes, space.components, space.multiple),
            *(lies, normal, offset),
        )

    @property
    def held(self) -> list[tuple[str, tuple[str, ...]]]:
        """What is held if the config does not say so."""
        every = self.kinematics.axes if self.solid else None
        return [(name, every or axes) for name, axes in self.base.holds]

    @property
    def parts(self) -> list[Part]:
        """Parts of the base that a layer or a patch covers."""
        found = [x.within for x in self.layers if x.within is not None]
        return found + [part for _, part in self.patches.values()]

    # --- names -----------------------------------------------------------------------------------

    @property
    def normal(self) -> int:
        """Component across the layers."""
        return self.kinematics.components.index(self.base.across)

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
        base = self.base
        ends = [end if end is not None else AXIS for end in base.ends]
        if len(self.kinematics.axes) == 3:
            symmetry = [f"symmetry_{axis}" for axis in self.symmetry]
            return (*filter(None, ends), *symmetry, *self.faces, *self.patches)
        groups = self._lines(self.breaks(base.along, base.limits))
        return tuple(dict.fromkeys(name for group in groups for name in group.split(JOIN)))

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
        around = 2 * np.pi * last if base.along == "R" else base.girth
        return Sizes(
            film.thickness, last - first, base.girth, base.area, float(around), self.air_height
        )

    def supports(self, held: Mapping[str, tuple[str, ...]]) -> list[Support]:
        """What the shape itself holds: symmetry, and the air's sides.

        Args:
            held: Axes that are held at each end of the base.
        """
        base, axes = self.base, self.kinematics.axes
        found = [Support(axis, f"symmetry_{axis}") for axis in self.symmetry]
        if self.air_height == 0:
            return found
        for end, side in zip(base.ends, self.air_sides, strict=True):
            fixed = held.get(end, ()) if end is not None else (base.along,)
            found += [Support(axis, side) for axis in axes if axis in fixed]
        return found + [Support(axis, side) for side in (AIR_TOP, AIR_BOTTOM) for axis in axes]

    @property
    def air_sides(self) -> tuple[str, ...]:
        """Names of the air's sides at the ends of the base."""
        if len(self.kinematics.axes) == 2:
            return AIR_START, AIR_END
        return tuple(f"air_{end}" for end in self.base.ends)

    # --- mesh ------------------------------------------------------------------------------------

    def grid(self, mesh: Any) -> Grid:
        """Grid of a plane mesh.

        Args:
            mesh: The config's section.
        """
        base = self.base
        along = self.breaks(base.along, base.limits)
        levels = list(
            accumulate((x.thickness for x in self.layers), initial=base.bottom(self.thickness))
        )
        columns = self.columns(along, mesh)
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
        swapped = base.across == self.kinematics.axes[0]
        return Grid(tuple(along), tuple(levels), spacing, cells, lines, size, swapped)

    def breaks(self, axis: str, limits: Span) -> list[float]:
        """Coordinates along an axis at which a layer or a patch begins or ends."""
        found, apart = [limits[0]], 1e-9 * (limits[1] - limits[0])
        for x in sorted({x for part in self.parts for x in part.breaks(axis)}):
            if found[-1] + apart < x < limits[1] - apart:
                found.append(x)
        return [*found, limits[1]]

    def columns(
        self,
        along: list[float],
        mesh: Any,
        fine: tuple[bool, bool] | None = None,
        across: bool = False,
    ) -> list[Array]:
        """Spacing of each part of a line: fine at ends, clamps and edges of electrodes.

        Args:
            along: Where parts begin and end.
            mesh: The config's section.
            fine: Whether it is fine at both ends; by default but where the base has no end.
            across: Whether it is a line across the base.
        """
        first, last = fine or (self.base.ends[0] is not None, True)
        length, wanted = along[-1] - along[0], 2 * mesh.sectors if across else mesh.columns
        films = [x for x in self.layers if not x.conducts]
        cross = min(x.thickness / (x.rows or mesh.film_rows) for x in films)
        if self.solid:  # cells are few: they shall resolve the layer of this width at a clamp
            cross = min(x.thickness / 2 for x in films)
        if self.sheet:  # which has no such layer
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

    def _covers(self, within: Part | None, a: float, b: float) -> bool:
        return within is None or bool(within.covers({self.base.along: (a + b) / 2}))

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
        middles = {self.base.along: np.array([(a + b) / 2 for _, (a, b) in parts])}
        for names, level, mask in self.interfaces(middles):
            here = [(int(i), level, "along") for i in np.flatnonzero(mask)]
            found.setdefault(JOIN.join(names), []).extend(here)
        return found

    def interfaces(self, at: Mapping[str, Array]) -> Iterator[tuple[tuple[str, ...], int, Any]]:
        """Faces by level: names, level, and which of some points along the base are on them.

        Where a conductor touches a dielectric, their interface has the dielectric's name alone.

        Args:
            at: Coordinates of the points by axis.
        """
        none = np.zeros(len(next(iter(at.values()))), dtype=bool)
        covered = [
            ~none if layer.within is None else layer.within.covers(at) for layer in self.layers
        ]
        for level in range(len(self.layers) + 1):
            low = covered[level - 1] if level else none
            high = covered[level] if level < len(self.layers) else none
            sides = [(level - 1, "top"), (level, "bottom")]
            for mask, of in (
                (low & ~high, sides[:1]),
                (high & ~low, sides[1:]),
                (low & high, sides),
            ):
                if not mask.any():
                    continue
                dielectric = [(k, side) for k, side in of if not self.layers[k].conducts]
                names = [
                    self.face.format(layer=self.layers[k].name, side=side)
                    for k, side in (dielectric or of)
                ]
                yield from self._patched(tuple(names), level, mask, at)

    def _patched(
        self, names: tuple[str, ...], level: int, mask: Any, at: Mapping[str, Array]
    ) -> Iterator[tuple[tuple[str, ...], int, Any]]:
        """Points of faces by the patches on them."""
        parts = [(names, mask)]
        for patch, (face, part) in self.patches.items():
            if face in names:
                inside = part.covers(at)
                parts = [
                    found
                    for names, mask in parts
                    for found in (((*names, patch), mask & inside), (names, mask & ~inside))
                ]
        yield from ((names, level, mask) for names, mask in parts if mask.any())

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
