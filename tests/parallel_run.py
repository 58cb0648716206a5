"""Runs configs on the ranks of one mpirun, and says how their parts are split over the ranks.

Started by test_parallel.py: python -m mpi4py parallel_run.py DIRECTORY CONFIG...
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np

import dealib
from dealib.fem import compat, layout
from dealib.program import Simulation, State, simulate

PARTS = ("film_top", "film_bottom", "inner", "outer", "film", "top_electrode")


class Split:
    """An observer that writes, for each named part, how many entities each rank owns."""

    def __init__(self, directory: Path) -> None:
        self.path = directory / "split.json"

    def start(self, simulation: Simulation) -> None:
        domain, comm = simulation.engine.problem.domain, simulation.comm
        cells_of = domain.mesh.topology.connectivity(domain.dim - 1, domain.dim)
        owned = compat.local_cells(domain.mesh)
        parts = [name for name in PARTS if domain.has(name)]

        def mine(name: str) -> int:
            dim, entities = domain.entities(name)
            if dim == domain.dim:
                return int(np.sum(entities < owned))
            return sum(int(cells_of.links(facet).min() < owned) for facet in entities)

        counts = comm.gather({name: mine(name) for name in parts}, root=0)
        if comm.rank == 0:
            split = {name: [of_rank[name] for of_rank in counts] for name in parts}
            self.path.write_text(json.dumps(split))

    def see(self, state: State) -> None:
        """Gather the state and hand it out again: nothing of it may change."""
        engine, x = state.engine, state.engine.problem.spaces.w.x
        before, nodal = x.array.copy(), engine.layout.gather()
        x.array[:] = np.nan
        engine.layout.scatter(nodal)
        assert np.array_equal(x.array, before)

    def stop(self, error: BaseException | None) -> None:
        pass


if __name__ == "__main__":
    layout._PIECE = 4096  # so that what small meshes have is sent in several pieces, too
    for config in map(Path, sys.argv[2:]):
        directory = Path(sys.argv[1]) / config.stem
        simulate(dealib.load(config), directory, observers=[Split(directory)], comm=MPI.COMM_WORLD)
