"""The mesh of a config as arrays, and the same cells moved to a slightly changed geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dealib.arrays import Array, Ints
from dealib.device.gmsh_model import gmsh_model
from dealib.device.records import AIR
from dealib.errors import ConfigError

if TYPE_CHECKING:
    from dealib.config.schema import Config

_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0)]


@dataclass(frozen=True)
class Drawing:
    """A mesh as Gmsh gives it.

    Attributes:
        nodes: Coordinates, (nodes, 3), mm; those inside free air are the last.
        fixed: Number of the other nodes, whose positions follow from the geometry alone.
        cells: Nodes of all cells outside free air, one array (cells, nodes) for each kind.
        air: Nodes of the cells of free air, (cells, 4).
    """

    nodes: Array
    fixed: int
    cells: tuple[Ints, ...]
    air: Ints

    @classmethod
    def of(cls, config: Config) -> Drawing:
        """Make the mesh of a config.

        Raises:
            ConfigError: If Gmsh cannot mesh it.
        """
        with gmsh_model(config) as gmsh:
            model = gmsh.model
            groups = [g for g in model.getPhysicalGroups(2) if model.getPhysicalName(*g) == AIR]
            free = {(2, int(tag)) for g in groups for tag in model.getEntitiesForPhysicalGroup(*g)}
            tags, xyz, _ = model.mesh.getNodes()
            air, found = [np.empty((0, 4), np.int64)], dict[int, list[Ints]]()
            for entity in model.getEntities():
                for kind, own, flat in zip(*model.mesh.getElements(*entity), strict=True):
                    cells = flat.astype(np.int64).reshape(len(own), -1) - 1
                    (air if entity in free else found.setdefault(int(kind), [])).append(cells)
            inside = sum(len(model.mesh.getNodes(*entity)[0]) for entity in free)
            nodes = xyz.reshape(-1, 3)[np.argsort(tags)]
        kinds = tuple(np.concatenate(found[kind]) for kind in sorted(found))
        return cls(nodes, len(nodes) - inside, kinds, np.concatenate(air))

    def moved(self, other: Drawing) -> Array:
        """Nodes of this mesh at the positions of another one, (nodes, 3), mm.

        Nodes inside free air move by the mean of their neighbours' displacements.

        Raises:
            ConfigError: If the cells of the two meshes differ.
        """
        n = self.fixed
        number = self._numbers_in(other)
        if number is None:
            problem = "a small change would alter the mesh's cells, as where a part ends at an edge"
            raise ConfigError(problem)
        there = other.nodes[number]
        return np.concatenate([there, self.nodes[n:] + self._spread(there - self.nodes[:n])])

    def _numbers_in(self, other: Drawing) -> Ints | None:
        """Numbers of the fixed nodes in another drawing; None if its cells are others.

        Both may be numbered differently: Gmsh sorts some nodes by coordinates, and where these are
        equal rounding decides.
        """
        n = self.fixed
        if n != other.fixed or [c.shape for c in self.cells] != [c.shape for c in other.cells]:
            return None
        same = np.arange(n)
        if all(map(np.array_equal, self.cells, other.cells)):
            return same
        from scipy.spatial import cKDTree

        found = np.asarray(cKDTree(other.nodes[:n]).query(self.nodes[:n])[1], dtype=np.int64)
        if not np.array_equal(np.sort(found), same):
            return None
        pairs = zip(self.cells, other.cells, strict=True)
        if all(np.array_equal(_sorted(found[a]), _sorted(b)) for a, b in pairs):
            return found
        return None

    def _spread(self, shift: Array) -> Array:
        """Displacements of the nodes inside free air, each the mean of its neighbours'."""
        from scipy.sparse import coo_array
        from scipy.sparse.linalg import spsolve

        n, size = self.fixed, len(self.nodes)
        if n == size:
            return np.empty((0, 3))
        ends = np.concatenate([self.air[:, list(edge)] for edge in _EDGES])
        i, j = np.concatenate([ends, ends[:, ::-1]]).T
        near = coo_array((np.ones(len(i)), (i, j)), (size, size)).tocsr()[n:]
        inner = (
            coo_array((near.sum(axis=1), (np.arange(size - n),) * 2), (size - n, size - n))
            - near[:, n:]
        )
        return np.asarray(spsolve(inner.tocsc(), near[:, :n] @ shift)).reshape(-1, 3)


def _sorted(cells: Ints) -> Ints:
    """Cells in an order that does not depend on the order of their nodes."""
    rows = np.sort(cells, axis=1)
    return np.asarray(rows[np.lexsort(rows.T)])
