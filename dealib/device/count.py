"""How many unknowns a device has, before it is meshed: nodes that are there, less those held."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Mapping
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dealib.arrays import Ints
from dealib.device.device import Device
from dealib.device.laminate import Laminate
from dealib.device.msh import TYPES, read
from dealib.device.records import PHI
from dealib.device.sheet import line
from dealib.device.solid import LaminateDraft
from dealib.device.sound import SIDES

# what is counted one by one, at most; more is in proportion
_COLUMNS, _COLUMNS_SOLID, _SECTORS, _ROWS = 800, 40, 12, 16
_MOST = 10**15  # a config may have more
_QUADS = {4: [[0, 1, 2, 3]], 8: [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5],
          [2, 3, 7, 6], [3, 0, 4, 7]]}  # fmt: skip


def of_layers(device: Device, laminate: Laminate, mesh: Any, mixed: bool) -> float:
    """Unknowns of a laminate's layers, without air and blocks around them.

    Args:
        device: The device.
        laminate: Its layers.
        mesh: The config's section.
        mixed: Whether solids have a pressure, linear in each cell.
    """
    few, times = _few(laminate, mesh)
    cells, count, ends, at = _base(laminate, few)
    wanted = [
        x.rows or (mesh.electrode_rows if x.conducts else mesh.film_rows) for x in laminate.layers
    ]
    rows = [min(n, _MOST) for n in wanted]
    kept = [0 if laminate.sheet else min(n, _ROWS) for n in rows]
    times *= 1 if laminate.sheet else sum(rows) / sum(kept)
    first = list(accumulate((mesh.order * n for n in kept), initial=0))
    there, solids = np.zeros((count, first[-1] + 1), bool), 0
    named: dict[str, Any] = defaultdict(lambda: np.zeros_like(there))
    for layer, (a, b), n in zip(laminate.layers, pairwise(first), kept, strict=True):
        mask = slice(None) if layer.within is None else layer.within.covers(at)
        named[layer.name][np.unique(cells[mask]), a : b + 1] = True
        there |= named[layer.name]
        solids += n * len(cells[mask])
    for names, level, mask in laminate.interfaces(at):
        for name in names:
            named[name][np.unique(cells[mask]), first[level]] = True
    for name, nodes in ends.items():
        named[name][np.unique(nodes)] = True
    held = {axis: np.zeros_like(there) for axis in (*device.kinematics.axes, PHI)}
    for support in device.supports:
        held[support.quantity] |= named[support.where]
    if laminate.sheet:
        held.pop(PHI)
    free = sum(int((there & ~nodes).sum()) for nodes in held.values())
    if mixed:
        free += (device.kinematics.dim + 1) * solids
    return times * free + len(device.ports)


def of_file(device: Device, path: Path, order: int, mixed: bool) -> float:
    """Unknowns on a mesh of one's own.

    Args:
        device: The device.
        path: The mesh file.
        order: Of the displacements.
        mixed: Whether solids have a pressure, linear in each cell.

    Raises:
        ConfigError: If the file is no mesh.
    """
    dim = device.kinematics.dim
    nodes, cells = _named(path, path.stat().st_mtime_ns, order, dim)
    none = np.empty(0, np.int64)
    regions = [region.name for region in device.regions]
    there = np.unique(np.concatenate([none, *(nodes.get(name, none) for name in regions)]))
    held: dict[str, list[Ints]] = {axis: [none] for axis in (*device.kinematics.axes, PHI)}
    for support in device.supports:
        held[support.quantity].append(nodes.get(support.where, none))
    free = sum(len(there) - len(np.unique(np.concatenate(found))) for found in held.values())
    if mixed:
        free += (dim + 1) * sum(cells.get(region.name, 0) for region in device.solids)
    return float(free + len(device.ports))


def centres(laminate: Laminate, mesh: Any) -> dict[str, Any]:
    """Centres of the base's cells by axis, mm, (cells,) each, in no more cells than are counted.

    Args:
        laminate: The layers.
        mesh: The config's section.
    """
    return _base(laminate, _few(laminate, mesh)[0])[3]


def _few(laminate: Laminate, mesh: Any) -> tuple[Any, float]:
    """A section with no more columns and sectors than are counted, and what it leaves out."""
    most = _COLUMNS_SOLID if laminate.solid else _COLUMNS
    few, times = {"columns": min(mesh.columns, most)}, max(1.0, min(mesh.columns, _MOST) / most)
    if laminate.solid:
        few["sectors"] = min(mesh.sectors, _SECTORS)
        times *= max(1.0, min(mesh.sectors, _MOST) / _SECTORS)
    return mesh.model_copy(update=few), times


def _base(laminate: Laminate, mesh: Any) -> tuple[Ints, int, Mapping[str, Ints], dict[str, Any]]:
    """Nodes of the base's cells and their number, those of its ends, and the cells' centres."""
    if laminate.solid:
        plan = laminate.base.plan(LaminateDraft(laminate, mesh))
        x, y = plan.centres.T
        at = {"X": x, "Y": y, "R": np.hypot(x, y)}
        cells, ends, corners = plan.cells, plan.edges, 4
    else:
        points, cells, ends = line(laminate, mesh)
        at, corners = {laminate.base.along: points[cells[:, 2], 0]}, 2
    if mesh.order == 1:
        cells = cells[:, :corners]
        ends = {name: nodes[:, : max(1, corners - 2)] for name, nodes in ends.items()}
    used, flat = np.unique(cells, return_inverse=True)
    ends = {name: np.searchsorted(used, nodes) for name, nodes in ends.items()}
    return flat.reshape(cells.shape), len(used), ends, at


@functools.lru_cache(maxsize=8)
def _named(path: Path, _: int, order: int, dim: int) -> tuple[dict[str, Ints], dict[str, int]]:
    """Keys of the nodes of each name in a mesh file, and its number of cells."""
    mesh = read(path)
    found: dict[str, list[Ints]] = defaultdict(list)
    cells: dict[str, int] = defaultdict(int)
    for (of, entity, kind), nodes in mesh.elements.items():
        corners = nodes[:, : TYPES[kind][2]]
        keys = _keys(corners, of, len(mesh.points), order)
        for tag in mesh.groups.get((of, entity), ()):
            if name := mesh.names.get((of, tag)):
                found[name].append(keys)
                cells[name] += len(corners) if of == dim else 0
    return {name: np.unique(np.concatenate(keys)) for name, keys in found.items()}, dict(cells)


def _keys(corners: Ints, dim: int, points: int, order: int) -> Ints:
    """A number for each node: corners, and with order 2 sides, quadrilaterals and hexahedra.

    What lies between corners is known by two of them: the ends of a side, and the smallest corner
    of a quadrilateral with the one across.
    """
    count = corners.shape[1]
    found = [corners.ravel()]
    if order == 1 or dim == 0:
        return np.unique(np.concatenate(found))
    sides = np.array([[0, 1]]) if dim == 1 else SIDES[dim, count]
    ends = np.sort(corners[:, sides].reshape(-1, 2), axis=1)
    found.append(points + ends[:, 0] * points + ends[:, 1])
    kind = points * (points + 1)  # beyond all of these
    if dim > 1 and (dim, count) != (3, 4):
        for quad in _QUADS.get(count, []):
            face = corners[:, quad]
            least, rows = face.argmin(axis=1), np.arange(len(face))
            found.append(kind + face[rows, least] * points + face[rows, (least + 2) % 4])
    if (dim, count) == (3, 8):
        found.append(2 * kind + corners[:, 0] * points + corners[:, 6])
    return np.unique(np.concatenate(found))
