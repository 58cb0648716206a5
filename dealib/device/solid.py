"""Meshes laminates in three dimensions: hexahedra stacked on the plan of the base, in Gmsh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints
from dealib.device.grid import AIR_BOTTOM, AIR_RATIO, AIR_TOP, growing
from dealib.device.laminate import JOIN, Laminate
from dealib.device.plan import Plan, middles
from dealib.device.plane_grid import columns
from dealib.device.records import AIR

# nodes of Gmsh's second-order hexahedron: node of the plan's quadrilateral, and level
_HEXAHEDRON = [
    *((0, 0), (1, 0), (2, 0), (3, 0), (0, 2), (1, 2), (2, 2), (3, 2)),
    *((4, 0), (7, 0), (0, 1), (5, 0), (1, 1), (6, 0), (2, 1), (3, 1)),
    *((4, 2), (7, 2), (5, 2), (6, 2), (8, 0), (4, 1), (7, 1), (5, 1), (6, 1), (8, 2), (8, 1)),
]
# nodes of its side on an edge of the plan: node of the edge (two ends, middle), and level
_SIDE = [(0, 0), (1, 0), (1, 2), (0, 2), (2, 0), (1, 1), (2, 2), (0, 1), (2, 1)]
_TYPES = {(3, 2): (12, 27), (3, 1): (5, 8), (2, 2): (10, 9), (2, 1): (3, 4)}  # Gmsh's, and nodes


@dataclass(frozen=True)
class LaminateDraft:
    """What the plan of a laminate is made from (see `bases.Draft`).

    Attributes:
        laminate: The laminate.
        mesh: The config's section.
    """

    laminate: Laminate
    mesh: Any

    @property
    def sectors(self) -> int:
        """See `bases.Draft`."""
        return int(self.mesh.sectors)

    @property
    def symmetry(self) -> str:
        """See `bases.Draft`."""
        return self.laminate.symmetry

    @property
    def circle(self) -> tuple[float, float, float] | None:
        """See `bases.Draft`."""
        return next((part.circle for part in self.laminate.parts if part.circle), None)

    def parts(self, axis: str, limits: tuple[float, float]) -> list[float]:
        """See `bases.Draft`."""
        return self.laminate.breaks(axis, limits)

    def lines(
        self, axis: str, limits: tuple[float, float], fine: tuple[bool, bool] = (True, True)
    ) -> Array:
        """See `bases.Draft`."""
        breaks = self.parts(axis, limits)
        spacing = columns(self.laminate, breaks, self.mesh, fine, across=axis == "Y")
        found = [np.array([breaks[0]])]
        for (a, b), s in zip(pairwise(breaks), spacing, strict=True):
            found.append(a + s[1:] * (b - a))
        return np.concatenate(found)


def build(gmsh: Any, laminate: Laminate, mesh: Any) -> None:
    """Mesh a laminate in the current Gmsh model, with named physical groups.

    Args:
        gmsh: The gmsh module.
        laminate: The laminate.
        mesh: The config's section.
    """
    plan = laminate.base.plan(LaminateDraft(laminate, mesh))
    _Stack(plan, laminate, mesh).build(gmsh)


class _Stack:
    """A plan with the levels of its layers.

    Args:
        plan: Mesh of the base.
        laminate: The laminate.
        mesh: The config's section.
    """

    def __init__(self, plan: Plan, laminate: Laminate, mesh: Any) -> None:
        self.plan, self.laminate, self.order = plan, laminate, mesh.order
        layers, thickness = laminate.layers, laminate.thickness
        bounds = list(accumulate((x.thickness for x in layers), initial=-thickness / 2))
        lines, rows = [bounds[0]], []
        for k, (layer, (a, b)) in enumerate(zip(layers, pairwise(bounds), strict=True)):
            count = layer.rows or (mesh.electrode_rows if layer.conducts else mesh.film_rows)
            lines += list(np.linspace(a, b, count + 1)[1:])
            rows += [k] * count
        if laminate.air_height > 0:
            end = min(x.thickness for x in layers)
            up = growing(laminate.air_height - thickness / 2, 2 * end, AIR_RATIO)
            reach = laminate.air_height - thickness / 2
            above = bounds[-1] + up[1:] * reach
            lines = [*(-above[::-1]), *lines, *above]
            rows = [-1] * len(above) + rows + [-2] * len(above)
        self.lines, self.rows = np.array(lines), rows
        x, y = plan.centres.T
        self.at = {"X": x, "Y": y, "R": np.hypot(x, y)}

    def build(self, gmsh: Any) -> None:
        """Fill the current Gmsh model."""
        model, z = gmsh.model, middles(self.lines)
        count = len(self.plan.points)
        x = np.column_stack([np.tile(self.plan.points, (len(z), 1)), np.repeat(z, count)])
        solids, faces = self._solids(count), self._faces(count)
        corners = solids if self.order == 2 else [(name, nodes[:, :8]) for name, nodes in solids]
        used = np.unique(np.concatenate([nodes.ravel() for _, nodes in corners]))
        tags = np.arange(1, len(used) + 1)  # without gaps
        first = None
        for dim, groups in ((3, solids), (2, faces)):
            kind, nodes_of = _TYPES[dim, self.order]
            merged: dict[str, list[Ints]] = {}
            for name, nodes in groups:
                merged.setdefault(name, []).append(nodes[:, :nodes_of])
            for name, parts in merged.items():
                entity = model.addDiscreteEntity(dim)
                if first is None:
                    first = entity
                    model.mesh.addNodes(3, entity, tags, x[used].ravel())
                nodes = tags[np.searchsorted(used, np.concatenate(parts))]
                model.mesh.addElementsByType(entity, kind, [], nodes.ravel())
                model.addPhysicalGroup(dim, [entity], name=name)

    def _levels(self, k: int) -> range:
        """Rows of a layer; of the air below for -1 and above for -2."""
        found = [i for i, row in enumerate(self.rows) if row == k]
        return range(found[0], found[-1] + 1)

    def _solids(self, count: int) -> list[tuple[str, Ints]]:
        """Region and nodes of hexahedra, (cells, 27)."""
        every = np.ones(len(self.plan.cells), dtype=bool)
        found = []
        for k in dict.fromkeys(self.rows):
            layer = self.laminate.layers[k] if k >= 0 else None
            mask = every if layer is None or layer.within is None else layer.within.covers(self.at)
            for row in self._levels(k):
                cells = self.plan.cells[mask]
                name = AIR if layer is None else layer.name
                found.append((name, _nodes(cells, _HEXAHEDRON, 2 * row, count)))
                if layer is not None and self.laminate.air_height > 0 and not mask.all():
                    rest = self.plan.cells[~mask]  # air fills the gaps beside a layer
                    found.append((AIR, _nodes(rest, _HEXAHEDRON, 2 * row, count)))
        return found

    def _faces(self, count: int) -> list[tuple[str, Ints]]:
        """Names and nodes of quadrilaterals on faces and ends, (cells, 9)."""
        found = []
        for names, level, mask in self.laminate.interfaces(self.at):
            row = self._levels(level)[0] if level < len(self.laminate.layers) else None
            row = self._levels(level - 1)[-1] + 1 if row is None else row
            found.append((JOIN.join(names), self.plan.cells[mask] + 2 * row * count))
        if self.laminate.air_height > 0:
            for name, row in ((AIR_BOTTOM, 0), (AIR_TOP, len(self.rows))):
                found.append((name, self.plan.cells + 2 * row * count))
        for name, edges in self.plan.edges.items():
            found += self._sides(name, edges, count)
        return found

    def _sides(self, name: str, edges: Ints, count: int) -> Iterator[tuple[str, Ints]]:
        """Quadrilaterals on the sides of layers, and of the air, at edges of the plan."""
        a, b = self.plan.points[edges[:, 0]], self.plan.points[edges[:, 1]]
        x, y = ((a + b) / 2).T
        inwards = 1 - 1e-6  # a hair inside, so that a part that ends at the edge covers it
        at = {"X": x * inwards, "Y": y * inwards, "R": np.hypot(x, y) * inwards}
        if "inner" in name:
            at["R"] = np.hypot(x, y) / inwards
        air = not name.startswith("symmetry") and self.laminate.air_height > 0
        for k in dict.fromkeys(self.rows):
            layer = self.laminate.layers[k] if k >= 0 else None
            mask = np.ones(len(edges), dtype=bool)
            if layer is not None and layer.within is not None:
                mask = layer.within.covers(at)
            for row in self._levels(k):
                of = f"air_{name}" if layer is None and air else name
                yield of, _nodes(edges[mask], _SIDE, 2 * row, count)


def _nodes(cells: Ints, pattern: list[tuple[int, int]], level: int, count: int) -> Ints:
    """Nodes of the stack's cells from nodes of the plan, a pattern and a level.

    Args:
        cells: Nodes in the plan, (cells, nodes).
        pattern: Node in the plan and level of each node of a cell.
        level: Of the cells' lower nodes.
        count: Nodes in the plan.
    """
    return np.stack([cells[:, p] + (level + k) * count for p, k in pattern], axis=1)
