"""A case that takes over the solver of the one before it: the same results as with its own."""

import subprocess
import sys
from itertools import islice
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import dealib
from dealib.cases.job import Job, reuse, run
from dealib.design.evaluate import evaluate
from dealib.errors import NotConverged
from dealib.fem.reuse import Reuse
from dealib.program import Simulation
from dealib.results.reader import Run

HERE = Path(__file__).parent
CONFIGS = HERE.parent / "configs"
SMALL = HERE / "small.yaml"
COARSE = {"mesh.columns": 8, "mesh.film_rows": 1}
_ROWS = 12
MODULUS, THICKNESS = "materials.film.youngs_modulus", "geometry.film_thickness"
SHEET = {"physics.model": "membrane"}
LAYER = "geometry.layers.0.thickness"
FAILING = {"program.1.terminal.voltage": "30 kV", "program.1.steps": 1}


def history(case, newton=None):
    """Rows of the numbers of a case, in full or its first ones, and its columns."""
    rows = [s.row for s in islice(Simulation(case, MPI.COMM_SELF, newton=newton), _ROWS)]
    columns = [name for name, value in rows[0].items() if isinstance(value, (int, float))]
    return np.array([[row[name] for name in columns] for row in rows], float)


def check_next(solvers, before, config, changes):
    """Solve a case with the solver of the one before, and compare with its own."""
    case = dealib.load(config, set=changes)
    newton = solvers.newton(case.config, MPI.COMM_SELF)
    assert newton is before
    found, fresh = history(case, newton), history(case)
    assert found.shape == fresh.shape
    size = np.maximum(np.ptp(fresh, axis=0), 1e-9 * np.abs(fresh).max(axis=0))
    assert (np.abs(found - fresh) <= 1e-12 * size).all()
    assert np.ptp(fresh, axis=0).max() > 0


@pytest.mark.parametrize(
    ("config", "base", "changes"),
    [
        (SMALL, {}, [{THICKNESS: "60 um"}, {MODULUS: "2 MPa"}, {"program.0.steps": 3}]),
        (SMALL, {"physics.formulation": "mixed"}, [{MODULUS: "2 MPa"}]),
        (SMALL, {"physics.coupling": "maxwell_traction"}, [{THICKNESS: "60 um"}]),
        (HERE / "viscous.yaml", {}, [{"materials.film.branches.0.shear_modulus": "90 kPa"}]),
        (CONFIGS / "benchmark_strip_air.yaml", COARSE, [{"materials.film.prestretch": 1.1}]),
        (CONFIGS / "devices/annulus_with_chamber.yaml", COARSE, [{LAYER: "45 um"}]),
        (CONFIGS / "devices/annulus_with_chamber.yaml", COARSE | SHEET, [{LAYER: "45 um"}]),
        (CONFIGS / "softening.yaml", COARSE, [{LAYER: "45 um"}]),
        (CONFIGS / "snap_through.yaml", COARSE, [{"geometry.inner_radius": "8.1 mm"}]),
    ],
    ids=["strip", "mixed", "traction", "viscous", "air", "chamber", "sheet", "softening", "follow"],
)
def test_the_next_case_is_that_of_a_new_solver(config, base, changes):
    solvers, case = Reuse(), dealib.load(config, set=base)
    newton = solvers.newton(case.config, MPI.COMM_SELF)
    history(case, newton)
    for change in changes:
        check_next(solvers, newton, config, base | change)


def test_a_case_after_one_that_failed_starts_at_rest():
    solvers, case = Reuse(), dealib.load(SMALL, set=FAILING)
    newton = solvers.newton(case.config, MPI.COMM_SELF)
    with pytest.raises(NotConverged):
        list(Simulation(case, MPI.COMM_SELF, newton=newton))
    check_next(solvers, newton, SMALL, {THICKNESS: "60 um"})


@pytest.mark.parametrize(
    "changes",
    [
        {"mesh.columns": 10},
        {"materials.film.law": "gent", "materials.film.j_lim": 90},
        {"materials.film.prestretch": 1.0, "physics.formulation": "mixed"},
        {"sensing.charging": True, "sensing.sheet_resistance": "1 kohm"},
        {"solver.linear": "lu"},
        {"geometry.electrode_thickness": "10 um", "materials.electrode": "{law: neo_hookean,"
         " youngs_modulus: 1 MPa}"},
    ],
    ids=["cells", "law", "form", "charging", "solver", "layers"],
)  # fmt: skip
def test_other_equations_or_cells_get_a_new_solver(changes):
    solvers = Reuse()
    first = solvers.newton(dealib.load(SMALL).config, MPI.COMM_SELF)
    other = dealib.load(SMALL, set=changes)
    assert solvers.newton(other.config, MPI.COMM_SELF) is not first


def test_a_worker_writes_what_a_run_of_its_own_does(tmp_path):
    for name, thickness in (("first", "50 um"), ("next", "60 um")):
        changes = (f"{THICKNESS}={thickness}", "output.fields=stage")
        assert run(Job(name, name, SMALL, changes, tmp_path)).status == "done"
    own = dealib.simulate(dealib.load(SMALL, set=changes), tmp_path / "own")
    other = Run(tmp_path / "next")
    own_history, history = own.history, other.history
    assert list(own_history) == list(history)
    numbers = own_history.select_dtypes("number")
    size = np.ptp(numbers.to_numpy(), axis=0)
    assert (np.abs(history[numbers.columns] - numbers) <= 1e-12 * size).to_numpy().all()
    assert (other.directory / "mesh.msh").read_text() == (own.directory / "mesh.msh").read_text()
    assert np.array_equal(other.mesh.points, own.mesh.points)
    assert other.info["newton_iterations"] == own.info["newton_iterations"]


GROWTH = """
import ctypes, sys
import psutil, dealib
from mpi4py import MPI
from dealib.fem.reuse import Reuse
from dealib.program import Simulation

reuse, process, seen = Reuse(), psutil.Process(), set()
for k in range(12):
    kind = {"materials.film.youngs_modulus": f"{1 + k / 20} MPa", "mesh.columns": 30 + 2 * (k // 6)}
    case = dealib.load(sys.argv[1], set=kind)
    newton = reuse.newton(case.config, MPI.COMM_SELF)
    seen.add(id(newton))
    for count, state in enumerate(Simulation(case, MPI.COMM_SELF, newton=newton), start=1):
        if count == 4:
            break
    ctypes.CDLL(None).malloc_trim(0)
    print(process.memory_info().rss / 1e6)
print(len(seen))
"""


def test_memory_does_not_grow_with_the_cases():
    line = [sys.executable, "-c", GROWTH, str(SMALL)]
    output = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    *used, solvers = map(float, output.split())
    assert solvers == 2
    assert max(used[4:6]) - max(used[2:4]) < 2
    assert max(used[9:]) - max(used[6:9]) < 2


def test_slopes_with_a_reused_solver_are_those_of_a_new_one():
    of, keys = {"force": 'end(force_N, "push")'}, (MODULUS, THICKNESS)
    evaluate(dealib.load(SMALL), of, keys)
    before = reuse().newton(dealib.load(SMALL).config, MPI.COMM_SELF)
    case = dealib.load(SMALL, set={THICKNESS: "60 um"})
    found = evaluate(case, of, keys)
    assert reuse().newton(dealib.load(SMALL).config, MPI.COMM_SELF) is before
    reuse.cache_clear()
    fresh = evaluate(case, of, keys)
    assert found.values["force"] == pytest.approx(fresh.values["force"], rel=1e-12)
    assert set(found.slopes["force"]) == set(keys)
    assert found.slopes["force"] == pytest.approx(fresh.slopes["force"], rel=1e-8)
