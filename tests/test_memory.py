"""A simulation that is dropped leaves nothing behind: MPI's communicators are few."""

import gc
import weakref
from itertools import islice
from pathlib import Path

import pytest

import dealib
from dealib.program import Simulation

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
COARSE = {"mesh.columns": 8, "mesh.film_rows": 1}


@pytest.mark.parametrize(
    ("config", "changes"),
    [
        (HERE / "small.yaml", {}),
        (HERE / "small.yaml", {"physics.formulation": "mixed"}),
        (HERE / "small.yaml", {"sensing.differential": True}),
        (HERE / "viscous.yaml", {}),
        (CONFIGS / "benchmark_strip_air.yaml", COARSE),
        (CONFIGS / "pull_in.yaml", COARSE),
        (CONFIGS / "snap_through.yaml", COARSE),
    ],
    ids=["strip", "mixed", "sensing", "viscous", "air", "follow", "bistable"],
)
def test_a_dropped_simulation_is_freed_at_once(config, changes):
    gc.collect()
    gc.disable()
    try:
        simulation = Simulation(dealib.load(config, set=changes))
        steps = sum(1 for _ in islice(simulation, 3))
        watched = {
            "newton": weakref.ref(simulation.newton),
            "problem": weakref.ref(simulation.problem),
            "space": weakref.ref(simulation.problem.spaces.W),
            "layout": weakref.ref(simulation.layout),
        }
        del simulation
        assert steps == 3
        assert {name for name, found in watched.items() if found() is not None} == set()
    finally:
        gc.enable()
