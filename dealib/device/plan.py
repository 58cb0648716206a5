"""The mesh of a base in its own plane: layers are stacked on it, membranes lie on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints

# nodes of a second-order quadrilateral in VTK's and Gmsh's order, on a grid of 3 x 3
_NINE = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
_CORE = 0.6  # half the diagonal of a disc's square core, of its first ring's radius
SQUARE = 1.4  # half the side of the square around a circle, of its radius
_BULGE = 0.12  # how far the core's sides bulge, of its size


@dataclass(frozen=True)
class Plan:
    """Second-order quadrilaterals in a plane.

    Attributes:
        points: Coordinates of the nodes, (nodes, 2), mm.
        cells: Nodes of each cell, (cells, 9), corners first.
        edges: Nodes of the cells' edges on each named boundary, (edges, 3), the middle last.
    """

    points: Array
    cells: Ints
    edges: Mapping[str, Ints] = field(default_factory=dict)

    @property
    def centres(self) -> Array:
        """Centre of each cell, (cells, 2)."""
        return np.asarray(self.points[self.cells[:, 8]])

    def merged(self) -> Plan:
        """The same plan with coinciding nodes merged, found by their distance."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        n, size = len(self.points), np.ptp(self.points, axis=0).max()
        i, j = cKDTree(self.points).query_pairs(1e-9 * size, output_type="ndarray").T
        same = coo_array((np.ones(len(i)), (i, j)), (n, n))
        index = connected_components(same, directed=False)[1]
        first = np.unique(index, return_index=True)[1]
        edges = {name: index[nodes] for name, nodes in self.edges.items()}
        return Plan(self.points[first], index[self.cells], edges)


def middles(lines: Array) -> Array:
    """Coordinates of grid lines with the middles between them, as second-order cells need."""
    found = np.empty(2 * len(lines) - 1)
    found[::2], found[1::2] = lines, (lines[1:] + lines[:-1]) / 2
    return found


def tensor(
    x: Array,
    y: Array,
    mapping: Callable[[Array, Array], tuple[Array, Array]] = lambda x, y: (x, y),
    sides: tuple[str | None, str | None, str | None, str | None] = (None, None, None, None),
) -> Plan:
    """A mapped grid.

    Args:
        x: Coordinates of the lines in the first direction, ascending.
        y: The same in the second direction.
        mapping: From these coordinates to the plane.
        sides: Names of the sides at the first and last x and at the first and last y.
    """
    a, b = np.meshgrid(middles(x), middles(y), indexing="ij")
    points = np.stack(mapping(a.ravel(), b.ravel()), axis=1)
    number = np.arange(a.size).reshape(a.shape)
    i, j = (2 * k.ravel() for k in np.indices((len(x) - 1, len(y) - 1)))
    cells = np.stack([number[i + p, j + q] for p, q in _NINE], axis=1)
    rows = (number[0], number[-1], number[:, 0], number[:, -1])
    edges = {
        name: np.stack([row[:-1:2], row[2::2], row[1::2]], axis=1)
        for name, row in zip(sides, rows, strict=True)
        if name is not None
    }
    return Plan(points, cells, edges)


def joined(parts: list[Plan]) -> Plan:
    """Several plans as one, coinciding nodes merged."""
    start = np.cumsum([0, *(len(part.points) for part in parts)])
    cells = np.concatenate([part.cells + n for part, n in zip(parts, start, strict=False)])
    edges: dict[str, list[Ints]] = {}
    for part, n in zip(parts, start, strict=False):
        for name, nodes in part.edges.items():
            edges.setdefault(name, []).append(nodes + n)
    whole = {name: np.concatenate(found) for name, found in edges.items()}
    return Plan(np.concatenate([part.points for part in parts]), cells, whole).merged()


def polar(radii: Array, sectors: int, symmetry: str, sides: tuple[str | None, str | None]) -> Plan:
    """A ring, or a symmetric part of it.

    Args:
        radii: Radii of its grid lines, ascending, above zero.
        sectors: Cells in a quarter.
        symmetry: Axes across which it is symmetric: '', 'X', 'Y' or 'XY'.
        sides: Names of its inner and its outer end.
    """
    first, quarters = _QUARTERS[symmetry]
    angles = np.linspace(first, first + quarters, quarters * sectors + 1) * np.pi / 2

    def mapping(r: Array, t: Array) -> tuple[Array, Array]:
        return r * np.cos(t), r * np.sin(t)

    return symmetric(tensor(radii, angles, mapping, (*sides, None, None)).merged(), symmetry)


# first quarter, and number of quarters
_QUARTERS = {"": (0, 4), "X": (-1, 2), "Y": (0, 2), "XY": (0, 1)}


def disc(radii: Array, core: float, sectors: int, symmetry: str, side: str) -> Plan:
    """A disc: a square core with bulging sides, and rings around it.

    Args:
        radii: Radii of the grid lines, from zero.
        core: The rings begin at the last grid line below this radius.
        sectors: Cells in a quarter; even.
        symmetry: As for `polar`.
        side: Name of its outer end.
    """
    k = max(1, int(np.searchsorted(radii, core, side="right")) - 1)
    limit, n = radii[k], sectors // 2
    size = _CORE * limit / np.sqrt(2)

    def square(x: Array, y: Array) -> tuple[Array, Array]:
        """A quarter of the core, its corner on the diagonal."""
        bulge = 1 + _BULGE * (x**2 + y**2 - 2 * x**2 * y**2)
        return size * x * bulge, size * y * bulge

    def between(t: Array, angle: Array) -> tuple[Array, Array]:
        """From the core's sides (t = 0) to the first circle (t = 1), angle in eighths of a turn."""
        x, y = np.minimum(1.0, 2 - angle), np.minimum(1.0, angle)
        (a, b), phi = square(x, y), np.pi / 4 * angle
        return (1 - t) * a + t * limit * np.cos(phi), (1 - t) * b + t * limit * np.sin(phi)

    def ring(r: Array, angle: Array) -> tuple[Array, Array]:
        return r * np.cos(np.pi / 4 * angle), r * np.sin(np.pi / 4 * angle)

    s, around = np.linspace(0, 1, n + 1), np.linspace(0, 2, 2 * n + 1)
    rings = np.linspace(0, 1, max(2, round((1 - _CORE) / _CORE * n)) + 1)
    outermost = k == len(radii) - 1
    names = (None, side if outermost else None, None, None)
    parts = [tensor(s, s, square), tensor(rings, around, between, names)]
    if not outermost:
        parts.append(tensor(radii[k:], around, ring, (None, side, None, None)))
    one = joined(parts)
    first, quarters = _QUARTERS[symmetry]
    return symmetric(joined([_turned(one, first + k) for k in range(quarters)]), symmetry)


def _turned(plan: Plan, quarters: int) -> Plan:
    """A plan turned by quarters about the origin."""
    c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarters % 4]
    x, y = plan.points.T
    return Plan(np.stack([c * x - s * y, s * x + c * y], axis=1), plan.cells, plan.edges)


def symmetric(plan: Plan, symmetry: str) -> Plan:
    """The same plan, its edges at X = 0 and Y = 0 named 'symmetry_X' and 'symmetry_Y'."""
    return bordered(plan, {f"symmetry_{axis}": ("XY".index(axis), 0.0) for axis in symmetry})


def _sides(plan: Plan) -> Ints:
    """The sides of all cells, (sides, 3), the middle last."""
    corners = [*pairwise((0, 1, 2, 3)), (3, 0)]
    found = [plan.cells[:, [a, b, m]] for (a, b), m in zip(corners, (4, 5, 6, 7), strict=True)]
    return np.concatenate(found)


def with_circle(draft: Any, lines: list[Array]) -> Plan:
    """A rectangle with a circle in it: a disc, a square around it, and the rest.

    Args:
        draft: Circle, sectors and symmetry (see `bases.Draft`); the circle must lie inside.
        lines: Grid lines in both directions; those near the square are left out.
    """
    *centre, radius = draft.circle
    around = SQUARE * radius
    n = draft.sectors
    middle, apart = np.linspace(-around, around, n + 1), 0.7 * around / n
    parts: list[list[Array]] = []
    for axis, at, line in zip("XY", centre, lines, strict=True):
        inner = np.linspace(0, around, n // 2 + 1) if axis in draft.symmetry else at + middle
        low, high = line[line < inner[0] - apart], line[line > inner[-1] + apart]
        before = [] if axis in draft.symmetry else [np.append(low, inner[0])]
        parts.append([*before, inner, np.insert(high, 0, inner[-1])])
    rings = draft.lines("R", (0.0, radius), (False, True))
    circle = disc(rings, 0.5 * radius, n, draft.symmetry, "circle")
    angle = np.linspace(0, 2, n + 1)
    shares = np.linspace(0, 1, max(2, n // 2) + 1)

    def between(t: Array, a: Array) -> tuple[Array, Array]:
        phi = np.pi / 4 * a
        x, y = around * np.minimum(1.0, 2 - a), around * np.minimum(1.0, a)
        return (1 - t) * radius * np.cos(phi) + t * x, (1 - t) * radius * np.sin(phi) + t * y

    quarter, (first, count) = tensor(shares, angle, between), _QUARTERS[draft.symmetry]
    found = [circle, *(_turned(quarter, first + k) for k in range(count))]
    found = [_moved(part, np.array(centre)) for part in found]
    (i0, j0) = (len(p) - 2 for p in parts)
    for i, along in enumerate(parts[0]):
        for j, across in enumerate(parts[1]):
            if (i, j) != (i0, j0) and len(along) > 1 and len(across) > 1:
                found.append(tensor(along, across))
    whole = joined(found)
    return Plan(whole.points, whole.cells)


def _moved(plan: Plan, by: Array) -> Plan:
    return Plan(plan.points + by, plan.cells, plan.edges)


def bordered(plan: Plan, sides: Mapping[str, tuple[int, float]]) -> Plan:
    """The same plan with names for its edges on lines of equal coordinate.

    Args:
        plan: The plan.
        sides: For each name the number of the coordinate and its value, mm.
    """
    found, every = dict(plan.edges), _sides(plan)
    size = 1e-9 * np.abs(plan.points).max()
    for name, (axis, value) in sides.items():
        on = np.abs(plan.points[:, axis] - value) < size
        found[name] = every[on[every].all(axis=1)]
    return Plan(plan.points, plan.cells, found)
