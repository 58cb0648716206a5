"""A mesh as it is drawn, and the same cells on a slightly other device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dealib.device.gmsh_model import gmsh_model
from dealib.device.grading import Array
from dealib.device.plan import Ints
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
        fixed: Number of the others, whose places the device alone decides.
        cells: Nodes of all cells but those of free air, flat.
        air: Nodes of these, (cells, 4).
    """

    nodes: Array
    fixed: int
    cells: Ints
    air: Ints

    @classmethod
    def of(cls, config: Config) -> Drawing:
        """Draw the mesh of a config.

        Raises:
            ConfigError: If that is not possible.
        """
        with gmsh_model(config) as gmsh:
            model = gmsh.model
            groups = [g for g in model.getPhysicalGroups(2) if model.getPhysicalName(*g) == AIR]
            free = {(2, int(tag)) for g in groups for tag in model.getEntitiesForPhysicalGroup(*g)}
            tags, xyz, _ = model.mesh.getNodes()
            found: dict[bool, list[Ints]] = {True: [], False: []}
            for entity in model.getEntities():
                found[entity in free] += [n - 1 for n in model.mesh.getElements(*entity)[2]]
            inside = sum(len(model.mesh.getNodes(*entity)[0]) for entity in free)
            parts = [np.concatenate([np.empty(0), *found[k]]).astype(np.int64) for k in (0, 1)]
            nodes = xyz.reshape(-1, 3)[np.argsort(tags)]
        return cls(nodes, len(nodes) - inside, parts[0], parts[1].reshape(-1, 4))

    def moved(self, other: Drawing) -> Array:
        """Its nodes where another drawing has them; free air follows what is around it.

        Raises:
            ConfigError: If the other one has other cells.
        """
        n = self.fixed
        if n != other.fixed or not np.array_equal(self.cells, other.cells):
            raise ConfigError("its mesh would have other cells, as where a part ends at an edge")
        shift = other.nodes[:n] - self.nodes[:n]
        return np.concatenate([other.nodes[:n], self.nodes[n:] + self._spread(shift)])

    def _spread(self, shift: Array) -> Array:
        """Shifts of the nodes inside free air, each the mean of its neighbours'."""
        from scipy.sparse import coo_array
        from scipy.sparse.linalg import spsolve

        n, size = self.fixed, len(self.nodes)
        if n == size:
            return np.empty((0, 3))
        ends = np.concatenate([self.air[:, list(edge)] for edge in _EDGES])
        i, j = np.concatenate([ends, ends[:, ::-1]]).T
        near = coo_array((np.ones(len(i)), (i, j)), (size, size)).tocsr()[n:]
        inner = coo_array(
            (near.sum(axis=1), (np.arange(size - n),) * 2), (size - n, size - n)
        ) - near[:, n:]
        return np.asarray(spsolve(inner.tocsc(), near[:, :n] @ shift)).reshape(-1, 3)
