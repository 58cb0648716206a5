"""A grid of mapped quadrilaterals between lines of equal coordinates, with free air, in Gmsh.

The mapped cells' edges are meshed first and their nodes moved to the wanted spacing, then Gmsh
fills the air with quadrilaterals that match them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device import grading
from dealib.device.records import AIR
from dealib.errors import ConfigError

AIR_START, AIR_END = "axis_air", "outer_air"  # the air's sides at both ends of the base
AIR_TOP, AIR_BOTTOM = "top_air", "bottom_air"
AIR_RATIO = 1.5  # growth of the air's cells along its sides
_TRIANGLE = 2  # Gmsh's number of this element type

Line = tuple[int, int, str]  # it leaves the point (i, j) 'along' or 'across' the base


@dataclass(frozen=True)
class Grid:
    """Cells between grid lines, each of one region.

    Attributes:
        along: Coordinates along the base of the grid lines across it, ascending, mm.
        across: Coordinates across it of the lines along it, with the far sides of free air, mm.
        spacing: Nodes between neighbouring lines as fractions from 0 to 1, by direction ('along'
            or 'across') and index.
        cells: Region of each cell (i, j) that exists.
        lines: Boundaries by name.
        air_size: Size of free air's cells at its far sides; None: there is no free air.
        swapped: Whether layers are stacked along the first coordinate.
    """

    along: tuple[float, ...]
    across: tuple[float, ...]
    spacing: Mapping[tuple[str, int], Array]
    cells: Mapping[tuple[int, int], str]
    lines: Mapping[str, list[Line]] = field(default_factory=dict)
    air_size: float | None = None
    swapped: bool = False

    def build(self, gmsh: Any) -> None:
        """Mesh it in the current Gmsh model, with named physical groups.

        Raises:
            ConfigError: If the air cannot be meshed so.
        """
        _Model(gmsh, self).build()


class _Model:
    """A grid being built in Gmsh: points, lines and surfaces are shared by neighbours."""

    def __init__(self, gmsh: Any, grid: Grid) -> None:
        self.gmsh, self.geo, self.grid = gmsh, gmsh.model.geo, grid
        self._points: dict[tuple[int, int], int] = {}
        self._lines: dict[Line, int] = {}
        self.groups: dict[tuple[int, str], list[int]] = defaultdict(list)

    def build(self) -> None:
        grid = self.grid
        for (i, j), region in grid.cells.items():
            self.groups[2, region].append(self._rectangle(i, j))
        for name, lines in grid.lines.items():
            self.groups[1, name] += [self._line(*line) for line in lines]
        mapped = [tag for (dim, _), tags in self.groups.items() if dim == 2 for tag in tags]
        narrow = False
        if grid.air_size is not None:
            self.gmsh.option.setNumber("Mesh.MeshSizeMax", grid.air_size)
            narrow = grid.along[-1] - grid.along[0] < grid.air_size
            for side in (-1, 1):
                self._air(side)
        self._generate(mapped, narrow)

    # --- geometry --------------------------------------------------------------------------------

    def _point(self, i: int, j: int) -> int:
        if (i, j) not in self._points:
            at = (self.grid.along[i], self.grid.across[j])
            x, y = reversed(at) if self.grid.swapped else at
            self._points[i, j] = self.geo.addPoint(x, y, 0)
        return self._points[i, j]

    def _line(self, i: int, j: int, way: str) -> int:
        if (i, j, way) not in self._lines:
            end = (i + 1, j) if way == "along" else (i, j + 1)
            self._lines[i, j, way] = self.geo.addLine(self._point(i, j), self._point(*end))
        return self._lines[i, j, way]

    def _rectangle(self, i: int, j: int) -> int:
        """The mapped surface between (i, j) and (i + 1, j + 1)."""
        loop = [self._line(i, j, "along"), self._line(i + 1, j, "across")]
        loop += [-self._line(i, j + 1, "along"), -self._line(i, j, "across")]
        return self._surface(loop)

    def _surface(self, loop: list[int]) -> int:
        if self.grid.swapped:  # counter-clockwise too
            loop = [-line for line in reversed(loop)]
        return int(self.geo.addPlaneSurface([self.geo.addCurveLoop(loop)]))

    def _air(self, side: int) -> None:
        """The air above or below, a free surface that follows the outline of the cells."""
        columns, last = len(self.grid.along) - 1, len(self.grid.across) - 1
        far = last if side > 0 else 0
        outline = []
        for i in range(columns):
            rows = [j for k, j in self.grid.cells if k == i]
            outline.append(max(rows) + 1 if side > 0 else min(rows))
        path = [(0, far)]
        for i, level in enumerate(outline):
            if i:  # up or down to the level of this column, line by line
                before = outline[i - 1]
                step = 1 if level > before else -1
                path += [(i, j) for j in range(before + step, level + step, step)]
            else:
                path.append((0, level))
            path.append((i + 1, level))
        path.append((columns, far))
        loop = [self._between(a, b) for a, b in pairwise(path)]
        loop.append(int(self.geo.addLine(self._point(columns, far), self._point(0, far))))
        self.groups[1, AIR_START].append(abs(loop[0]))
        self.groups[1, AIR_END].append(abs(loop[-2]))
        self.groups[1, AIR_TOP if side > 0 else AIR_BOTTOM].append(loop[-1])
        if side < 0:  # counter-clockwise too
            loop = [-line for line in reversed(loop)]
        self.groups[2, AIR].append(self._surface(loop))

    def _between(self, a: tuple[int, int], b: tuple[int, int]) -> int:
        """The line from a to b; negative if it runs against the grid's direction."""
        start, sign = (a, 1) if a <= b else (b, -1)
        return sign * self._line(*start, "along" if a[1] == b[1] else "across")

    # --- mesh ------------------------------------------------------------------------------------

    def _generate(self, mapped: list[int], narrow: bool) -> None:
        model = self.gmsh.model
        model.geo.synchronize()
        for tag, ((dim, name), entities) in enumerate(self.groups.items(), start=1):
            model.addPhysicalGroup(dim, sorted(set(entities)), tag, name)
        for option, value in {
            "Mesh.Algorithm": 8,  # frontal quadrilaterals
            "Mesh.RecombinationAlgorithm": 3,  # blossom, no triangle left
            "Mesh.RecombineAll": 1,
            "Mesh.MeshSizeExtendFromBoundary": 1,
            "Mesh.RandomSeed": 1,
        }.items():
            self.gmsh.option.setNumber(option, value)
        for surface in mapped:
            model.mesh.setTransfiniteSurface(surface)
        if narrow:  # the far sides of the air need two cells, since recombination halves them
            for line in (*self.groups[1, AIR_TOP], *self.groups[1, AIR_BOTTOM]):
                model.mesh.setTransfiniteCurve(line, 3)
        self._space()
        model.mesh.generate(2)
        if _TRIANGLE in model.mesh.getElementTypes(2):
            raise ConfigError(
                "Gmsh leaves triangles among the quadrilaterals of the air; choose another "
                "mesh.air_size"
            )

    def _space(self) -> None:
        """Mesh the mapped lines and move their nodes to the spacing of their row or column."""
        mesh, spacing = self.gmsh.model.mesh, self.grid.spacing
        mapped = [(k, t) for k, t in self._lines.items() if _slot(k) in spacing]
        for key, tag in mapped:
            mesh.setTransfiniteCurve(tag, len(spacing[_slot(key)]))
        mesh.generate(1)
        for key, tag in mapped:
            nodes, xyz, parameters = mesh.getNodes(1, tag)
            order = np.argsort(parameters)
            s = spacing[_slot(key)][1:-1]
            i, j, way = key
            x = np.array(xyz).reshape(-1, 3)[order]
            line = self.grid.along[i : i + 2] if way == "along" else self.grid.across[j : j + 2]
            moved = (way == "along") == self.grid.swapped
            x[:, int(moved)] = line[0] + s * (line[1] - line[0])
            for node, where, at in zip(nodes[order], x, s, strict=True):
                mesh.setNode(node, where, [at])


def _slot(key: Line) -> tuple[str, int]:
    i, j, way = key
    return way, i if way == "along" else j


def growing(length: float, first: float, ratio: float) -> Array:
    """Nodes of cells that grow along a length, as fractions from 0 to 1.

    Args:
        length: In mm.
        first: Size of the first cell, mm.
        ratio: Of each cell to the one before.
    """
    cells = grading.growing_cells(length, first, ratio)
    return grading.geometric(cells, first / length)
