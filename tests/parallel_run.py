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
from dealib.fem.viscous import Viscosity
from dealib.program import Simulation, State, simulate
from dealib.results import rows

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
        if engine.viscosity is not None:
            self.see_memory(engine.viscosity, state.row["dissipated_energy_mJ"])

    def see_memory(self, viscosity: Viscosity, dissipated: float) -> None:
        """The same of what materials remember, which other ranks give without holding it all."""
        parts = viscosity._parts.values()
        before, gathered = [part.now for part in parts], viscosity.gather()
        for part in parts:
            part.now = part.now._replace(internal=np.full_like(part.now.internal, np.nan))
        viscosity.restore(gathered, dissipated)
        for part, now in zip(parts, before, strict=True):
            assert np.array_equal(part.now.internal, now.internal)
            assert np.array_equal(part.now.peak, now.peak)

    def stop(self, error: BaseException | None) -> None:
        pass


if __name__ == "__main__":
    layout._PIECE = rows.ROOM = 4096  # what small meshes have comes in several pieces, too
    for config in map(Path, sys.argv[2:]):
        directory = Path(sys.argv[1]) / config.stem
        simulate(dealib.load(config), directory, observers=[Split(directory)], comm=MPI.COMM_WORLD)
