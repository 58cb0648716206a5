"""Layers stacked on a base: their regions, faces and ends, and the grid of their mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.bases import Base
from dealib.device.grid import AIR_BOTTOM, AIR_END, AIR_START, AIR_TOP, Line
from dealib.device.kinematics import SOLID, Kinematics
from dealib.device.part import Part, Span
from dealib.device.records import Region, Sizes, Support, air
from dealib.device.sheet_kinematics import SheetKinematics

MOUNT_BLOCK, FRAME_BLOCK = "mount_block", "frame_block"
AXIS = "axis"
JOIN = "&"  # between the names of a boundary that has several


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
        layers: From the bottom, or from the inside of a tube.
        air_height: Of the air above and below the middle, mm; 0 without air.
        blocks: Rigid blocks at both ends, if there are some.
        patches: Face and part of each part of a face that has a name of its own.
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
        """Boundaries and axes that are held by default."""
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
        groups = self.lines(self.breaks(base.along, base.limits))
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
        """Supports of the planes of symmetry and of the outer sides of the air.

        Args:
            held: Axes that are held at each end of the base; the air's side there follows.
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

    # --- where layers and patches are ------------------------------------------------------------

    def breaks(self, axis: str, limits: Span) -> list[float]:
        """Coordinates along an axis at which a layer or a patch begins or ends."""
        found, apart = [limits[0]], 1e-9 * (limits[1] - limits[0])
        for x in sorted({x for part in self.parts for x in part.breaks(axis)}):
            if found[-1] + apart < x < limits[1] - apart:
                found.append(x)
        return [*found, limits[1]]

    def covers(self, within: Part | None, a: float, b: float) -> bool:
        """Whether a part (None: the whole base) covers the interval from a to b along the base."""
        return within is None or bool(within.covers({self.base.along: (a + b) / 2}))

    def covered(self, layer: Layer, at: Mapping[str, Array]) -> Any:
        """Mask of the given points, by axis, that a layer covers."""
        if layer.within is None:
            return np.ones(len(next(iter(at.values()))), dtype=bool)
        return layer.within.covers(at)

    def lines(self, along: list[float]) -> dict[str, list[Line]]:
        """Grid lines on ends and faces by name; see `interfaces` for the names of faces.

        Lines with several names are under all of them, joined by `JOIN`.

        Args:
            along: Coordinates along the base between which nothing begins or ends, mm.
        """
        parts, n = list(enumerate(pairwise(along))), len(along) - 1
        found: dict[str, list[Line]] = {}
        for end, (i, k) in zip(self.base.ends, ((0, 0), (n, n - 1)), strict=True):
            name = end if end is not None else AXIS
            a, b = along[k : k + 2]
            found[name] = [
                (i, j, "across")
                for j, layer in enumerate(self.layers)
                if self.covers(layer.within, a, b)
            ]
        middles = {self.base.along: np.array([(a + b) / 2 for _, (a, b) in parts])}
        for names, level, mask in self.interfaces(middles):
            here = [(int(i), level, "along") for i in np.flatnonzero(mask)]
            found.setdefault(JOIN.join(names), []).extend(here)
        return found

    def interfaces(self, at: Mapping[str, Array]) -> Iterator[tuple[tuple[str, ...], int, Any]]:
        """Faces by level: names, level, and the mask of the given points that lie on them.

        Where a conductor touches a dielectric, their interface has the name of the dielectric's
        face only.

        Args:
            at: Coordinates of the points by axis.
        """
        none = np.zeros(len(next(iter(at.values()))), dtype=bool)
        covered = [self.covered(layer, at) for layer in self.layers]
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
        """Split the points of a face by the patches that cover them."""
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
