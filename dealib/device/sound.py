"""Checks that the cells of a mesh file fit together; dolfinx crashes or errs if they do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dealib.arrays import Array, Ints
from dealib.device.msh import TYPES, MeshFile, read
from dealib.errors import ConfigError

_HEXAHEDRON = np.array(
    [
        *([0, 1, 3, 4], [1, 2, 0, 5], [2, 3, 1, 6], [3, 0, 2, 7]),
        *([4, 7, 5, 0], [5, 4, 6, 1], [6, 5, 7, 2], [7, 6, 4, 3]),
    ]
)
# ends of the sides in the order of their middle nodes, by dimension and number of corners
SIDES = {
    (2, 3): np.array([[0, 1], [1, 2], [2, 0]]),
    (2, 4): np.array([[0, 1], [1, 2], [2, 3], [3, 0]]),
    (3, 4): np.array([[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]]),
    (3, 8): np.array(
        [
            *([0, 1], [0, 3], [0, 4], [1, 2], [1, 5], [2, 3]),
            *([2, 6], [3, 7], [4, 5], [4, 7], [5, 6], [6, 7]),
        ]
    ),
}
# faces of solid cells by their number of corners, from outside, and the corners of mirrored cells
_OUTWARDS = {
    4: np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
    8: np.array(
        [
            *([0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4]),
            *([1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]),
        ]
    ),
}
_MIRRORED = {4: [0, 2, 1, 3], 8: [0, 3, 2, 1, 4, 7, 6, 5]}


def sound_mesh(path: Path, dim: int) -> None:
    """Read a mesh file and check it.

    Args:
        path: The file.
        dim: Dimension of its cells.

    Raises:
        ConfigError: If it is not a mesh, is damaged, or its cells do not fit together.
    """
    if problem := fault(read(path), dim):
        raise ConfigError(f"{path}: {problem}")


def fault(mesh: MeshFile, dim: int = 2) -> str:
    """What is wrong with the cells of a mesh; empty if they tile a region without gaps.

    Args:
        mesh: The mesh.
        dim: Dimension of its cells.
    """
    points = mesh.points[:, :dim]
    kinds = [(n, n[:, : TYPES[kind][2]]) for (d, _, kind), n in mesh.elements.items() if d == dim]
    if not kinds:
        return f"it has no cells of {dim} dimensions"
    if len({nodes.shape == corners.shape for nodes, corners in kinds}) > 1:
        return "it has cells of first and of second order, which do not fit together"
    used = np.unique(np.concatenate([nodes.ravel() for nodes, _ in kinds]))
    places, counts = np.unique(points[used].round(9), axis=0, return_counts=True)
    if (counts > 1).any():
        place = _at(places[counts > 1][0])
        return f"several nodes are {place}: the cells there are not connected; merge the nodes"
    for nodes, corners in kinds:
        x = points[corners]
        sizes = _turns(x) if dim == 2 else _volumes(x)
        # the corners of a cell must all turn the same way, clockwise or not
        flat = np.flatnonzero((sizes * np.sign(sizes.sum(axis=1, keepdims=True)) <= 0).any(axis=1))
        if len(flat):
            return f"the cell {_at(x[flat[0]].mean(axis=0))} is flat or folded"
        if corners.shape != nodes.shape and len(
            off := _off_middle(points[nodes], SIDES[dim, corners.shape[1]])
        ):
            return f"the node {_at(off[0])} is not in the middle of its side"
    cells = [_turned(points, corners) for _, corners in kinds]
    return _overlap(mesh, points, cells) if dim == 2 else _overlap_of_solids(points, cells)


def _off_middle(x: Array, sides: Ints) -> Array:
    """Middle nodes so far from the middle between their ends that the side folds back.

    Args:
        x: Nodes of the cells, (cells, nodes, dim).
        sides: Both ends of each side, whose middles follow the corners.
    """
    corners = sides.max() + 1
    a, b = x[:, sides[:, 0]], x[:, sides[:, 1]]
    middle = x[:, corners : corners + len(sides)]
    along = np.einsum("...i,...i", middle - (a + b) / 2, b - a)
    return middle[np.abs(along) >= np.square(b - a).sum(axis=-1) / 4]


def _overlap(mesh: MeshFile, points: Array, cells: list[Ints]) -> str:
    # two cells that share an edge run along it in opposite directions
    edges = np.concatenate([_edges(nodes) for nodes in cells])
    found, counts = np.unique(edges, axis=0, return_counts=True)
    if (counts > 1).any():
        return f"cells overlap {_at(points[found[counts > 1][0]].mean(axis=0))}"
    sides = {tuple(edge) for edge in np.sort(found, axis=1).tolist()}
    for (dim, entity, _), nodes in mesh.elements.items():
        named = dim == 1 and mesh.groups.get((1, entity))
        for line in np.sort(nodes[:, :2], axis=1).tolist() if named else ():
            if tuple(line) not in sides:
                return f"the line {_at(points[line].mean(axis=0))} is no edge of a cell"
    return ""


def _overlap_of_solids(points: Array, cells: list[Ints]) -> str:
    for size in (3, 4):
        faces = [_faces(nodes) for nodes in cells if _OUTWARDS[nodes.shape[1]].shape[1] == size]
        found, counts = np.unique(
            np.concatenate([np.empty((0, size), int), *faces]), axis=0, return_counts=True
        )
        if (counts > 1).any():  # two cells on one side of a face
            return f"cells overlap {_at(points[found[counts > 1][0]].mean(axis=0))}"
    return ""


def _faces(nodes: Ints) -> Ints:
    """Faces of solid cells, counter-clockwise from outside, beginning with the lowest node."""
    outwards = _OUTWARDS[nodes.shape[1]]
    faces = nodes[:, outwards].reshape(-1, outwards.shape[1])
    turn = faces.argmin(axis=1)[:, None] + np.arange(faces.shape[1])
    return np.take_along_axis(faces, turn % faces.shape[1], axis=1)


def _volumes(corners: Array) -> Array:
    """Six times the volume of a tetrahedron, or of that at each corner, (cells, 1 or 8)."""
    frames = _HEXAHEDRON if corners.shape[1] == 8 else np.array([[0, 1, 2, 3]])
    x = corners[:, frames]  # a corner, and its neighbours as a right-handed frame
    return np.asarray(np.linalg.det(x[:, :, 1:] - x[:, :, :1]))


def _turns(corners: Array) -> Array:
    """Sine of each corner's angle times both edges, (cells, corners)."""
    out, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return out[..., 0] * back[..., 1] - out[..., 1] * back[..., 0]


def _turned(points: Array, nodes: Ints) -> Ints:
    """The cells, each counter-clockwise, or right-handed."""
    solid = points.shape[1] == 3
    wrong = (_volumes if solid else _turns)(points[nodes]).sum(axis=1) < 0
    order = _MIRRORED[nodes.shape[1]] if solid else slice(None, None, -1)
    return np.where(wrong[:, None], nodes[:, order], nodes)


def _edges(nodes: Ints) -> Ints:
    return np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=-1).reshape(-1, 2)


def _at(point: Array) -> str:
    return f"at ({', '.join(f'{x:.6g}' for x in point)}) mm"
