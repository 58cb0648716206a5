"""The surface of a device in space as triangles, the same ones at all steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array, Ints
from dealib.plots.shape import LayerShape
from dealib.results.elements import Cell
from dealib.results.sampling import reference_grid

_TURN = 0.75 * 2 * np.pi  # of a body of revolution; the open quarter shows the section
_FEWEST, _MOST_COPIES = 16, 60  # least and largest number of parts of that turn


@dataclass(frozen=True)
class Patch:
    """Triangles between mirrored or turned copies of a device's points.

    Attributes:
        nodes: Indices of the shape's points, (n,).
        maps: Matrix of each copy, (copies, 3, axes), that maps the points to space.
        triangles: Corners, (triangles, 3); the index copy * n + k is the k-th point of a copy.
        left_out: Number of triangles that were left out by thinning.
    """

    nodes: Ints
    maps: Array
    triangles: Ints
    left_out: int = 0


def patches(shape: LayerShape, names: Sequence[str], opened: bool, most: int) -> list[Patch]:
    """The surface of some layers, with all of their symmetric parts.

    Args:
        shape: A device in space, or a body of revolution.
        names: Names of the layers.
        opened: Whether half of the surface is left out, to show what lies below.
        most: Approximate largest number of triangles.
    """
    return (_of_solid if shape.solid else _of_section)(shape, names, opened, most)


def _of_solid(shape: LayerShape, names: Sequence[str], opened: bool, most: int) -> list[Patch]:
    mesh, maps = shape.mesh, shape.mirrors
    if opened:
        maps = [one for one in maps if one[1, 1] > 0]
    faces, triangles = _faces(mesh.cell)
    cells = mesh.in_region(*names)
    sides = mesh.cells[cells][:, faces].reshape(-1, faces.shape[1])
    middle = mesh.points[sides].mean(axis=1)
    _, first, count = np.unique(
        np.round(middle, 9), axis=0, return_index=True, return_counts=True
    )  # of a sheet all, once where layers lie on each other; of a solid those of one cell
    outer = np.sort(first if mesh.cell.dim == 2 else first[count == 1])
    if opened and 1 not in shape.symmetry:
        y = mesh.points[:, 1]
        outer = outer[middle[outer, 1] > (y.min() + y.max()) / 2]
    found = sides[outer][:, triangles]
    if mesh.cell.dim == 3:  # turned so that all look outwards
        centre = mesh.corners[cells].mean(axis=1).repeat(len(faces), axis=0)[outer]
        a, b, c = (mesh.points[found[..., k]] for k in range(3))
        out = np.einsum("ftk,fk->ft", np.cross(b - a, c - a), middle[outer] - centre)
        found = np.where((out < 0)[..., None], found[..., ::-1], found)
    found = found.reshape(-1, 3)
    thin = _thinned(mesh.points, shape.region, found, most // len(maps))
    nodes, corners = np.unique(thin, return_inverse=True)
    corners = corners.reshape(-1, 3)
    copies = [
        k * len(nodes) + (corners if np.linalg.det(one) > 0 else corners[:, ::-1])
        for k, one in enumerate(maps)
    ]
    lost = (len(found) - len(thin)) * len(maps)
    return [Patch(nodes, np.array(maps), np.concatenate(copies), lost)]


def _faces(cell: Cell) -> tuple[Ints, Ints]:
    """Nodes of each face of a cell, (faces, nodes of a face), and the triangles between them.

    A cell of a sheet is its own face.
    """
    flat = {"hexahedron": "quadrilateral", "tetrahedron": "triangle"}.get(cell.name, cell.name)
    at, triangles = reference_grid(Cell(flat, cell.order), cell.order)
    if cell.dim == 2:
        faces = [at]
    elif cell.name == "hexahedron":
        faces = [np.insert(at, k, end, axis=1) for k in range(3) for end in (0, 1)]
    else:
        faces = [np.insert(at, k, 0, axis=1) for k in range(3)]
        faces.append(np.column_stack([at, 1 - at.sum(axis=1)]))
    apart = np.abs(cell.nodes - np.array(faces)[:, :, None]).sum(axis=-1)
    return apart.argmin(axis=-1), triangles


def _of_section(shape: LayerShape, names: Sequence[str], opened: bool, most: int) -> list[Patch]:
    """The outline turned about the axis, and the section at both ends of the turn."""
    points, region = shape.points, shape.region
    ids = [shape.mesh.names.index(name) for name in names]
    places = np.round(points / (np.ptp(points, axis=0).max() or 1.0), 9)
    _, own, which = np.unique(
        np.column_stack([places, region]), axis=0, return_index=True, return_inverse=True
    )  # cells share no sampled points: those of a region at one place are joined
    triangles = own[which.ravel()[shape.strips.triangles]]
    triangles = triangles[np.isin(region[triangles[:, 0]], ids)]
    (r1, z1), (r2, z2) = ((points[triangles[:, k]] - points[triangles[:, 0]]).T for k in (1, 2))
    triangles = np.where((r1 * z2 < r2 * z1)[:, None], triangles[:, ::-1], triangles)
    _, place = np.unique(places, axis=0, return_inverse=True)
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    ends = np.sort(place.ravel()[edges], axis=1)
    _, one, count = np.unique(ends, axis=0, return_index=True, return_counts=True)
    edges = edges[one[count == 1]]
    edges = edges[points[edges, 0].max(axis=1) > 1e-9]  # those on the axis sweep nothing
    turn = _TURN / 2 if opened else _TURN
    n = int(np.clip(most // (2 * len(edges)), _FEWEST, _MOST_COPIES))
    thin = _thinned(points, region, triangles, most // 2)
    return _turned(edges, thin, turn, n, 2 * (len(triangles) - len(thin)))


def blocks(shape: LayerShape, factor: float) -> list[Array]:
    """Sections of the mount and of the frame that hold a flat laminate of revolution.

    Args:
        shape: The device.
        factor: Magnification of the thickness.

    Returns:
        The corners of each, (4, 2), counter-clockwise, mm; none for other devices.
    """
    device = shape.run.config.device
    base = None if shape.laminate is None else shape.laminate.base
    if base is None or base.along != "R" or shape.core is None:
        return []
    held = {support.where for support in device.supports if support.quantity == "Z"}
    R, middle = shape.middle
    half, width = factor * shape.thickness, 0.1 * R[-1]
    inner, outer = (1e-6 * R[-1], R[0]), (R[-1], R[-1] + width)
    found = []
    for end, (left, right), z in zip(base.ends, (inner, outer), middle[[0, -1], 1], strict=True):
        if end in held:
            found.append(
                np.array([[left, z - half], [right, z - half], [right, z + half], [left, z + half]])
            )
    return found


def turned_block(first: int) -> list[Patch]:
    """The surface of a block of four points, from a given index on, turned about the axis."""
    corners = first + np.arange(4)
    edges = np.stack([corners, np.roll(corners, -1)], axis=1)
    return _turned(edges, corners[[[0, 1, 2], [0, 2, 3]]], _TURN, _MOST_COPIES)


def _turned(
    edges: Ints, triangles: Ints, turn: float, copies: int, left_out: int = 0
) -> list[Patch]:
    """An outline turned about the axis, and the section at both ends of the turn."""
    angles = np.linspace(0, turn, copies + 1)
    maps = np.zeros((copies + 1, 3, 2))
    maps[:, 0, 0], maps[:, 1, 0], maps[:, 2, 1] = np.cos(angles), np.sin(angles), 1
    nodes, corners = np.unique(edges, return_inverse=True)
    a, b = (len(nodes) * np.arange(copies)[:, None] + end for end in corners.reshape(-1, 2).T)
    c, d = b + len(nodes), a + len(nodes)  # the same edge, one angle on
    swept = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)
    inside, corners = np.unique(triangles, return_inverse=True)
    corners = corners.reshape(-1, 3)
    caps = np.concatenate([corners, corners[:, ::-1] + len(inside)])
    return [Patch(nodes, maps, swept), Patch(inside, maps[[0, -1]], caps, left_out)]


def _thinned(points: Array, region: Ints, triangles: Ints, most: int) -> Ints:
    """Reduce the number of triangles by merging corners of a region that are near each other.

    The corners that remain are points of the shape, so that their values and motion are exact.
    """
    used = np.unique(triangles)
    mine, which = points[used], np.searchsorted(used, triangles)
    size, low = np.ptp(mine, axis=0), mine.min(axis=0)
    at = (mine - low) / np.where(size > 0, size, 1)
    found, parts = triangles, 256.0
    while len(found) > most:
        box = np.round(at * parts)  # those at the ends hold what lies there
        order = np.argsort(np.abs(at * parts - box).max(axis=1), kind="stable")
        keys = np.column_stack([box, region[used]])[order]
        _, first, own = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        kept = np.empty(len(used), dtype=np.int64)
        kept[order] = used[order[first]][own.ravel()]  # of a box the one that is nearest to it
        found = kept[which]
        a, b, c = found.T
        found = found[(a != b) & (b != c) & (c != a)]
        found = found[np.unique(np.sort(found, axis=1), axis=0, return_index=True)[1]]
        parts *= 0.8
    return found
