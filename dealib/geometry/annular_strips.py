"""Electrode - elastomer - electrode strips, rigid blocks and air as a Gmsh model.

Strips and blocks are mapped quadrilaterals; their edges are meshed first and their nodes moved to
the wanted spacing, then Gmsh fills the air with quadrilaterals that match them.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from typing import Any

import numpy as np

from dealib.config.schema import Geometry, Mesh
from dealib.errors import ConfigError
from dealib.geometry import grading, names
from dealib.geometry.grading import Array

_BLOCK_RATIO = 1.35  # growth of the blocks' cells away from the strips' ends
_AIR_RATIO = 1.5  # the same for the air's sides
_TRIANGLE = 2  # Gmsh's number of this element type


class _Grid:
    """A grid of points (R_i, Z_j) with shared lines between neighbours, made on demand."""

    def __init__(self, gmsh: Any, radii: list[float], heights: list[float]) -> None:
        self.gmsh, self.geo = gmsh, gmsh.model.geo
        self.radii, self.heights = radii, heights
        self._points: dict[tuple[int, int], int] = {}
        self._lines: dict[tuple[int, int, str], int] = {}

    def point(self, i: int, j: int) -> int:
        if (i, j) not in self._points:
            self._points[i, j] = self.geo.addPoint(self.radii[i], self.heights[j], 0)
        return self._points[i, j]

    def line(self, i: int, j: int, way: str) -> int:
        """The line that leaves point (i, j) outwards ('R') or upwards ('Z')."""
        if (i, j, way) not in self._lines:
            end = (i + 1, j) if way == "R" else (i, j + 1)
            self._lines[i, j, way] = self.geo.addLine(self.point(i, j), self.point(*end))
        return self._lines[i, j, way]

    def rectangle(self, i: int, j: int) -> int:
        """The mapped surface between (i, j) and (i + 1, j + 1)."""
        loop = [self.line(i, j, "R"), self.line(i + 1, j, "Z")]
        loop += [-self.line(i, j + 1, "R"), -self.line(i, j, "Z")]
        return int(self.geo.addPlaneSurface([self.geo.addCurveLoop(loop)]))

    def space(self, spacing: dict[tuple[str, int], Array]) -> None:
        """Mesh the mapped lines and move their nodes to the spacing of their row or column."""
        mesh = self.gmsh.model.mesh
        mapped = [(k, t) for k, t in self._lines.items() if self._slot(k) in spacing]
        for key, tag in mapped:
            mesh.setTransfiniteCurve(tag, len(spacing[self._slot(key)]))
        mesh.generate(1)
        for key, tag in mapped:
            nodes, xyz, parameters = mesh.getNodes(1, tag)
            order = np.argsort(parameters)
            s = spacing[self._slot(key)][1:-1]
            i, j, way = key
            x = np.array(xyz).reshape(-1, 3)[order]
            line = self.radii[i : i + 2] if way == "R" else self.heights[j : j + 2]
            x[:, 0 if way == "R" else 1] = line[0] + s * (line[1] - line[0])
            for node, where, at in zip(nodes[order], x, s, strict=True):
                mesh.setNode(node, where, [at])

    @staticmethod
    def _slot(key: tuple[int, int, str]) -> tuple[str, int]:
        i, j, way = key
        return way, i if way == "R" else j


def build(gmsh: Any, geometry: Geometry, mesh: Mesh) -> None:
    """Build and mesh the device in the current Gmsh model, with named physical groups.

    Args:
        gmsh: The initialised gmsh module.
        geometry: Dimensions in mm.
        mesh: Numbers of cells and grading.

    Raises:
        ConfigError: If the air cannot be meshed so.
    """
    g, has_electrodes = geometry, geometry.electrode_thickness > 0
    half = g.film_thickness / 2
    levels = [-half, half]
    layers = [names.FILM]
    rows = [mesh.film_rows]
    if has_electrodes:
        levels = [-g.half_thickness, *levels, g.half_thickness]
        layers = [names.BOTTOM_ELECTRODE, names.FILM, names.TOP_ELECTRODE]
        rows = [mesh.electrode_rows, mesh.film_rows, mesh.electrode_rows]

    length = g.outer_radius - g.inner_radius
    end = min(g.film_thickness / mesh.film_rows, length / mesh.columns)
    if mesh.grading == "ends":
        columns = grading.ends(mesh.columns, end / length)
    elif mesh.grading == "tanh":
        columns = grading.tanh(mesh.columns)
    else:
        columns = np.linspace(0, 1, mesh.columns + 1)
    end = float(columns[1]) * length

    radii, heights = [g.inner_radius, g.outer_radius], levels
    spacing = {("Z", j): np.linspace(0, 1, n + 1) for j, n in enumerate(rows)}
    strip, first = 0, 0  # column and lowest row of the strips in the grid
    if g.clamps is not None:
        strip, first = 1, 1
        radii = [radii[0] - g.clamps.width, *radii, radii[1] + g.clamps.width]
        heights = [-g.clamps.height, *heights, g.clamps.height]
        across = _growing(g.clamps.width, end, _BLOCK_RATIO)
        along = _growing(g.clamps.height - g.half_thickness, end, _BLOCK_RATIO)
        spacing = {("Z", j + 1): s for (_, j), s in spacing.items()}
        spacing |= {("Z", 0): 1 - along[::-1], ("Z", len(heights) - 2): along}
        spacing |= {("R", 0): 1 - across[::-1], ("R", 2): across}
    spacing["R", strip] = columns
    if g.air_height > 0:
        heights = [-g.air_height, *heights, g.air_height]
        first += 1
        spacing = {(w, j + 1 if w == "Z" else j): s for (w, j), s in spacing.items()}
        nearest = g.clamps.width * float(across[-1] - across[-2]) if g.clamps else 2 * end
        free = g.air_height - (g.clamps.height if g.clamps else g.half_thickness)
        side = _growing(free, nearest, _AIR_RATIO)
        spacing |= {("Z", 0): 1 - side[::-1], ("Z", len(heights) - 2): side}

    grid, narrow = _Grid(gmsh, radii, heights), False
    groups: dict[tuple[int, str], list[int]] = defaultdict(list)
    for j, layer in enumerate(layers, start=first):
        groups[2, layer].append(grid.rectangle(strip, j))
        groups[1, names.INNER].append(grid.line(strip, j, "Z"))
        groups[1, names.OUTER].append(grid.line(strip + 1, j, "Z"))
    film = first + layers.index(names.FILM)
    groups[1, names.FILM_BOTTOM].append(grid.line(strip, film, "R"))
    groups[1, names.FILM_TOP].append(grid.line(strip, film + 1, "R"))
    if g.clamps is not None:
        low, high = first - 1, first + len(layers)
        for j in range(low, high + 1):
            groups[2, names.MOUNT_BLOCK].append(grid.rectangle(0, j))
            groups[2, names.FRAME_BLOCK].append(grid.rectangle(2, j))
    mapped = [s for (d, _), tags in groups.items() if d == 2 for s in tags]
    if g.air_height > 0:
        size = mesh.air_size or g.air_height / 5
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        narrow = radii[-1] - radii[0] < size
        _air(grid, groups, strip, first, first + len(layers))
    _generate(gmsh, grid, groups, mapped, spacing, narrow)


def _air(
    grid: _Grid,
    groups: dict[tuple[int, str], list[int]],
    strip: int,
    low: int,
    high: int,
) -> None:
    """The air below and above the solid, each one free surface that follows its outline."""
    last, top = len(grid.radii) - 1, len(grid.heights) - 1
    for j, far, side in ((low, 0, -1), (high, top, 1)):
        near = j + side * (1 if strip else 0)  # the blocks' outer face, if there are blocks
        path = [(0, far), (0, near)]
        if strip:
            path += [(1, near), (1, j), (2, j), (2, near), (3, near)]
        else:
            path += [(1, near)]
        path += [(last, far)]
        loop = [_between(grid, a, b) for a, b in pairwise(path)]
        loop.append(int(grid.geo.addLine(grid.point(last, far), grid.point(0, far))))
        groups[1, names.AXIS_AIR].append(abs(loop[0]))
        groups[1, names.OUTER_AIR].append(abs(loop[-2]))
        groups[1, names.TOP_AIR if side > 0 else names.BOTTOM_AIR].append(loop[-1])
        if side < 0:  # counter-clockwise too
            loop = [-line for line in reversed(loop)]
        surface = grid.geo.addPlaneSurface([grid.geo.addCurveLoop(loop)])
        groups[2, names.AIR].append(int(surface))


def _between(grid: _Grid, a: tuple[int, int], b: tuple[int, int]) -> int:
    """The line from a to b; negative if it runs against the grid's direction."""
    start, sign = (a, 1) if a <= b else (b, -1)
    return sign * grid.line(*start, "R" if a[1] == b[1] else "Z")


def _growing(length: float, first: float, ratio: float) -> Array:
    cells = grading.growing_cells(length, first, ratio)
    return grading.geometric(cells, first / length)


def _generate(
    gmsh: Any,
    grid: _Grid,
    groups: dict[tuple[int, str], list[int]],
    mapped: list[int],
    spacing: dict[tuple[str, int], Array],
    narrow: bool,
) -> None:
    model = gmsh.model
    model.geo.synchronize()
    for tag, ((dim, name), entities) in enumerate(groups.items(), start=1):
        model.addPhysicalGroup(dim, sorted(set(entities)), tag, name)
    for option, value in {
        "Mesh.Algorithm": 8,  # frontal quadrilaterals
        "Mesh.RecombinationAlgorithm": 3,  # blossom, no triangle left
        "Mesh.RecombineAll": 1,
        "Mesh.MeshSizeExtendFromBoundary": 1,
        "Mesh.RandomSeed": 1,
    }.items():
        gmsh.option.setNumber(option, value)
    for surface in mapped:
        model.mesh.setTransfiniteSurface(surface)
    if narrow:  # two cells along the air's far sides: Gmsh halves their number on its way
        for line in (*groups[1, names.TOP_AIR], *groups[1, names.BOTTOM_AIR]):
            model.mesh.setTransfiniteCurve(line, 3)
    grid.space(spacing)
    model.mesh.generate(2)
    if _TRIANGLE in model.mesh.getElementTypes(2):
        raise ConfigError(
            "Gmsh leaves triangles among the quadrilaterals of the air; choose another "
            "mesh.air_size"
        )
