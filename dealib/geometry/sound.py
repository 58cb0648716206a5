"""Whether the cells of a mesh file fit together: what does not makes dolfinx crash, or lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dealib.errors import ConfigError
from dealib.geometry.msh import Array, Ints, MeshFile, read


def sound_mesh(path: Path) -> MeshFile:
    """Read a mesh file.

    Raises:
        ConfigError: If it is none, is damaged, or its cells do not fit together.
    """
    found = read(path)
    if problem := fault(found):
        raise ConfigError(f"mesh.file {path}: {problem}")
    return found


def fault(mesh: MeshFile) -> str:
    """What is wrong with the cells of a mesh; empty if they tile a plane region without gaps."""
    points = mesh.points[:, :2]
    cells = [_turned(points, n) for (dim, _, _), n in mesh.elements.items() if dim == 2]
    if not cells:
        return "it has no cells"
    used = np.unique(np.concatenate([nodes.ravel() for nodes in cells]))
    places, counts = np.unique(points[used].round(9), axis=0, return_counts=True)
    if (counts > 1).any():
        return f"several nodes are {_at(places[counts > 1][0])}: what meets there is not connected"
    for nodes in cells:
        corners = points[nodes]
        flat = np.flatnonzero((_turns(corners) <= 0).any(axis=1))
        if len(flat):
            return f"the cell {_at(corners[flat[0]].mean(axis=0))} is flat or folded"
    edges = np.concatenate([_edges(nodes) for nodes in cells])  # two cells run along one both ways
    found, counts = np.unique(edges, axis=0, return_counts=True)
    if (counts > 1).any():
        return f"cells overlap {_at(points[found[counts > 1][0]].mean(axis=0))}"
    sides = {tuple(edge) for edge in np.sort(found, axis=1).tolist()}
    for (_, entity, kind), nodes in mesh.elements.items():
        for line in np.sort(nodes, axis=1).tolist() if kind == 1 else ():
            if tuple(line) not in sides and mesh.groups.get((1, entity)):
                return f"the line {_at(points[line].mean(axis=0))} is no edge of a cell"
    return ""


def _turns(corners: Array) -> Array:
    """Sine of each corner's angle times both edges, (cells, corners)."""
    out, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return out[..., 0] * back[..., 1] - out[..., 1] * back[..., 0]


def _turned(points: Array, nodes: Ints) -> Ints:
    """The cells, each counter-clockwise."""
    clockwise = _turns(points[nodes]).sum(axis=1) < 0
    return np.where(clockwise[:, None], nodes[:, ::-1], nodes)


def _edges(nodes: Ints) -> Ints:
    return np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=-1).reshape(-1, 2)


def _at(point: Array) -> str:
    return f"at R = {point[0]:.6g}, Z = {point[1]:.6g} mm"
