"""The mixed form and the other couplings: exact tangents, any cell shape, any number of ranks."""

import json
import os
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from conftest import case, history

import dealib
from dealib.cli.mpi import environment, mpirun
from dealib.device.gmsh_model import gmsh_model
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import build_problem
from dealib.fem.timings import Timings

HERE = Path(__file__).parent
SMALL = {"mesh__columns": 16, "mesh__film_rows": 2}
MIXED = {"physics__formulation": "mixed"}
LAWS = {
    "materials__film": "{law: ogden, mu: [0.3 MPa, -0.1 MPa], alpha: [1.5, -2.5], "
    "bulk_modulus: 17 MPa, prestretch: 1.15, relative_permittivity: {intercept: 4, slope: -0.8}}",
    "materials__electrode": "{law: arruda_boyce, youngs_modulus: 3 MPa, locking_stretch: 3}",
}
VARIANTS = [
    MIXED,
    LAWS,
    {"physics__coupling": "maxwell_traction"},
    {"physics__coupling": "maxwell_traction", "geometry__electrode_thickness": "0 um"},
    {"physics__coupling": "pelrine"} | MIXED,
    {"physics__coupling": "pelrine_undeformed"},
]


@pytest.mark.parametrize("name", ["benchmark_strip", "benchmark_strip_air"])
@pytest.mark.parametrize("changes", VARIANTS)
def test_tangent_is_the_derivative_of_the_residual(name, changes):
    problem = build_problem(case(name, **SMALL, **changes).config, MPI.COMM_SELF)
    problem.set_prestretch(1.0)
    system = Newton(problem, Timings()).system
    system.ports = {name: PortLaw() for name in system.ports}  # prescribed ones are eliminated
    rng = np.random.default_rng(0)
    q = system.q
    size = np.where(problem.constraints.field == 0, 1e-5, 0.1)  # mm; kV and MPa
    size[problem.constraints.field == 2] = 1e-5
    size = np.append(size, [1e-5, 0.1])
    q.array[:] = size * rng.standard_normal(q.size)
    direction = q.duplicate()
    direction.array[:] = size * rng.standard_normal(q.size)
    out, plus, minus = q.duplicate(), q.duplicate(), q.duplicate()
    system.residual(q, out)
    system.tangent(system.matrix)
    system.matrix.mult(direction, out)
    h = 1e-5
    q.axpy(h, direction)
    system.residual(q, plus)
    q.axpy(-2 * h, direction)
    system.residual(q, minus)
    plus.axpy(-1, minus)
    plus.scale(1 / (2 * h))
    plus.axpy(-1, out)
    assert plus.norm() < 1e-7 * out.norm()


def test_pressure_lives_in_the_solids_only():
    problem = build_problem(case("benchmark_strip_air", **SMALL, **MIXED).config, MPI.COMM_SELF)
    solid = len(problem.domain.cells("film", "top_electrode", "bottom_electrode"))
    assert np.count_nonzero(problem.constraints.field == 3) == 3 * solid  # linear in each cell


def test_mixed_form_is_the_displacement_form_at_the_thesis_bulk_modulus():
    """Forces, charge and energy, kappa/G = 50, to the error of the mesh."""
    mixed = history("benchmark_strip", **MIXED)
    displacement = history("benchmark_strip")
    for column in ("force_N", "charge_uC", "elastic_energy_mJ", "electric_energy_mJ"):
        assert mixed[column].iloc[-1] == pytest.approx(displacement[column].iloc[-1], rel=1e-3)
    assert mixed["elastic_energy_mJ"][0] == pytest.approx(
        displacement["elastic_energy_mJ"][0], rel=1e-9
    )


_SCRIPT = """
import json, sys
from mpi4py import MPI
from test_forms import numbers
found = [numbers(changes) for changes in json.loads(sys.argv[1])]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


def numbers(changes):
    """Duals, energy and sums of squares of the nodal fields (on rank 0) of a short run."""
    program = [
        {"stage": "push", "mount": {"displacement": "-1 mm"}, "steps": 2},
        {"stage": "on", "terminal": {"voltage": "2 kV"}},
    ]
    for state in dealib.Simulation(
        case("benchmark_strip_air", **SMALL, **changes, program=program)
    ):
        last = state
    found = [last.row[k] for k in ("force_N", "charge_uC", "elastic_energy_mJ")]
    nodal = last.nodal()
    return found if nodal is None else found + (nodal**2).sum(axis=0).tolist()


@pytest.mark.mpi
@pytest.mark.slow
def test_ranks_do_not_matter():
    cases = VARIANTS[1:]
    serial = [numbers(changes) for changes in cases]  # also compiles, once
    command = [mpirun(), "-n", "2", sys.executable, "-m", "mpi4py"]
    command += ["-c", _SCRIPT, json.dumps(cases)]
    path = os.pathsep.join(filter(None, [str(HERE), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        command,
        env=environment() | {"PYTHONPATH": path},
        cwd=HERE.parent,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    for one, two in zip(serial, json.loads(done.stdout.splitlines()[-1]), strict=True):
        assert two == pytest.approx(one, rel=1e-8)


def test_mixed_form_on_triangles(tmp_path, monkeypatch):
    """A user's mesh of triangles, pressure constant in each: the same device as quadrilaterals."""
    small = SMALL | MIXED | {"geometry__electrode_thickness": "0 um"}
    small |= {"materials__film__bulk_modulus": "3340 MPa"}
    original = gmsh.option.setNumber
    monkeypatch.setattr(
        gmsh.option, "setNumber", lambda k, v: original(k, 0 if k == "Mesh.RecombineAll" else v)
    )
    # dealib's own meshes must not have any
    monkeypatch.setattr(gmsh.model.mesh, "getElementTypes", lambda _: [])
    with gmsh_model(case("benchmark_strip", **small).config):
        gmsh.write(str(tmp_path / "triangles.msh"))
    monkeypatch.undo()
    squares = history("benchmark_strip", **small)
    program = [{"stage": "push", "mount": {"displacement": "-3 mm"}, "steps": 12}]
    changes = small | {"mesh__file": str(tmp_path / "triangles.msh"), "program": program}
    simulation = dealib.Simulation(case("benchmark_strip", **changes))
    *_, last = simulation
    assert simulation.engine.layout.cell.name == "triangle"
    assert last.row["force_N"] == pytest.approx(squares["force_N"][12], rel=5e-3)
