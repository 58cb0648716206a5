"""Runs configs on the ranks of one mpirun, and says how their parts are split over the ranks.

Started by test_parallel.py: python -m mpi4py parallel_run.py DIRECTORY CONFIG...
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path

from mpi4py import MPI

import numpy as np

import dealib
from dealib.fem import compat
from dealib.fem.viscous import Viscosity
from dealib.program import Simulation, State, simulate
from dealib.results import rows

ENDS = {"force": 6, "bias": 3}  # steps after which runs are ended, and resumed
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
        if engine.layout.exact:
            assert np.array_equal(x.array, before)
        else:  # a pressure that jumps between cells is averaged at nodes
            for k in range(2):
                dofs = np.ravel(engine.problem.spaces.W.sub(k).collapse()[1])
                assert np.array_equal(x.array[dofs], before[dofs])
            assert np.isfinite(x.array).all()
        x.array[:] = before
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


class Enough(Exception):
    """Ends a run as a kill would."""


class End:
    """An observer that ends a run after a step on all ranks."""

    def __init__(self, step: int) -> None:
        self.step = step

    def start(self, simulation: Simulation) -> None:
        pass

    def see(self, state: State) -> None:
        if state.row["step"] == self.step:
            raise Enough

    def stop(self, error: BaseException | None) -> None:
        pass


if __name__ == "__main__":
    rows.ROOM = 4096  # what small meshes have comes in several pieces, too
    for config in map(Path, sys.argv[2:]):
        directory, ends = Path(sys.argv[1]) / config.stem, ENDS.get(config.stem)
        given, watch = dealib.load(config), [Split(directory)]
        if ends is not None:
            with suppress(Enough):
                simulate(given, directory, observers=[End(ends)], comm=MPI.COMM_WORLD)
        simulate(given, directory, observers=watch, comm=MPI.COMM_WORLD, resume=ends is not None)
