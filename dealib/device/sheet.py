"""The middle surface of a laminate as a mesh in Gmsh, its cells grouped by layers and faces."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints
from dealib.device.laminate import AXIS, JOIN, Laminate
from dealib.device.plan import middles
from dealib.device.plane_grid import columns
from dealib.device.solid import LaminateDraft

_TYPES = {(2, 2): 10, (2, 1): 3, (1, 2): 8, (1, 1): 1, (0, 2): 15, (0, 1): 15}  # Gmsh's elements


def build(gmsh: Any, laminate: Laminate, mesh: Any) -> None:
    """Mesh the middle surface in the current Gmsh model, with named physical groups.

    Each part of the base has the names of all its layers and faces, joined (see `JOIN`).

    Args:
        gmsh: The gmsh module.
        laminate: The laminate.
        mesh: The config's section.
    """
    dim, order = (2, mesh.order) if laminate.solid else (1, mesh.order)
    if dim == 2:
        plan = laminate.base.plan(LaminateDraft(laminate, mesh))
        points, cells, ends = plan.points, plan.cells, dict(plan.edges)
        at = {"X": plan.centres[:, 0], "Y": plan.centres[:, 1]}
        at["R"] = np.hypot(at["X"], at["Y"])
    else:
        points, cells, ends = line(laminate, mesh)
        at = {laminate.base.along: points[cells[:, 2], 0]}
    if order == 1:
        cells = cells[:, : 2 * dim]
        ends = {name: nodes[:, : max(1, 2 * (dim - 1))] for name, nodes in ends.items()}
    model, used = gmsh.model, np.unique(cells)
    tags = np.arange(1, len(used) + 1)  # without gaps
    flat = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
    first = True
    for name, mask in _areas(laminate, at).items():
        entity = model.addDiscreteEntity(dim)
        if first:
            model.mesh.addNodes(dim, entity, tags, flat[used].ravel())
            first = False
        nodes = tags[np.searchsorted(used, cells[mask])]
        model.mesh.addElementsByType(entity, _TYPES[dim, order], [], nodes.ravel())
        model.addPhysicalGroup(dim, [entity], name=name)
    for name, nodes in ends.items():
        entity = model.addDiscreteEntity(dim - 1)
        nodes = tags[np.searchsorted(used, nodes)]
        model.mesh.addElementsByType(entity, _TYPES[dim - 1, order], [], nodes.ravel())
        model.addPhysicalGroup(dim - 1, [entity], name=name)


def _areas(laminate: Laminate, at: dict[str, Array]) -> dict[str, Any]:
    """Masks of cells, by the joined names of all layers and faces on them."""
    count = len(next(iter(at.values())))
    names: list[list[str]] = [[] for _ in range(count)]
    every = np.ones(count, dtype=bool)
    for layer in laminate.layers:
        mask = every if layer.within is None else layer.within.covers(at)
        for k in np.flatnonzero(mask):
            names[k].append(layer.name)
    for faces, _, mask in laminate.interfaces(at):
        for k in np.flatnonzero(mask):
            names[k] += faces
    joined = np.array([JOIN.join(found) for found in names])
    return {name: joined == name for name in dict.fromkeys(joined.tolist())}


def line(laminate: Laminate, mesh: Any) -> tuple[Array, Ints, dict[str, Ints]]:
    """Points (nodes, 1), cells (cells, 3; the middle last) and ends of the base as a line."""
    base = laminate.base
    breaks = laminate.breaks(base.along, base.limits)
    spacing = columns(laminate, breaks, mesh)
    parts = [a + s[:-1] * (b - a) for (a, b), s in zip(pairwise(breaks), spacing, strict=True)]
    points = middles(np.append(np.concatenate(parts), breaks[-1]))
    i = np.arange(0, len(points) - 2, 2)
    names = [name if name is not None else AXIS for name in base.ends[:2]]
    ends = {name: np.array([[k]]) for name, k in zip(names, (0, len(points) - 1), strict=True)}
    return points[:, None], np.stack([i, i + 2, i + 1], axis=1), ends
