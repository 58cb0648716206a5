"""A simulation that is dropped leaves nothing behind: MPI's communicators are few."""

import gc
import subprocess
import sys
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
    next(iter(Simulation(dealib.load(config, set=changes))))  # ffcx leaves cycles as it compiles
    gc.collect()
    gc.disable()
    try:
        simulation = Simulation(dealib.load(config, set=changes))
        steps = sum(1 for _ in islice(simulation, 3))
        watched = {
            "newton": weakref.ref(simulation.engine.newton),
            "problem": weakref.ref(simulation.engine.problem),
            "space": weakref.ref(simulation.engine.problem.spaces.W),
            "layout": weakref.ref(simulation.engine.layout),
        }
        del simulation
        assert steps == 3
        assert {name for name, found in watched.items() if found() is not None} == set()
    finally:
        gc.enable()


GROWTH = """
import ctypes, sys
import psutil, dealib
from dealib.program import Simulation

config, changes, repeats, states = sys.argv[1], sys.argv[2].split(";"), *map(int, sys.argv[3:])
used, process = [], psutil.Process()
for _ in range(repeats):
    for count, state in enumerate(Simulation(dealib.load(config, set=changes)), start=1):
        ctypes.CDLL(None).malloc_trim(0)  # what is free goes back, and is not counted
        used.append(process.memory_info().rss / 1e6)
        if count == states:
            break
print(*used)
"""


@pytest.mark.parametrize(
    ("config", "changes", "repeats", "states"),
    [
        ("benchmark_strip_air.yaml", "mesh.columns=30", 8, 2),
        ("snap_through.yaml", "mesh.columns=30", 1, 40),
    ],
    ids=["simulations", "steps"],
)
def test_memory_does_not_grow(config, changes, repeats, states):
    """PETSc's objects are destroyed, not kept for the end of the process."""
    line = [sys.executable, "-c", GROWTH, str(CONFIGS / config), changes, str(repeats), str(states)]
    output = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    used = [float(word) for word in output.split()]
    assert len(used) == repeats * states
    half = len(used) // 2
    assert max(used[half:]) - max(used[:half]) < 4
