"""Constraint map, ports, one-way air, clamps: the mechanisms of the solver."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from conftest import case, history

import dealib
from dealib.errors import NotConverged
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import build_problem
from dealib.fem.timings import Timings

SMALL = {"mesh__columns": 16, "mesh__film_rows": 2}


def test_reduced_tangent_equals_the_projected_one():
    """Assembly through the constraint map equals T^T A T of the full tangent."""
    problem = build_problem(case("benchmark_strip", **SMALL).config, MPI.COMM_SELF)
    problem.set_prestretch(1.0)
    newton = Newton(problem, Timings())
    system, m = newton.system, problem.constraints
    rng = np.random.default_rng(0)
    system.q.array[:] = 1e-5 * rng.standard_normal(system.q.size)
    system.residual(system.q, system.residual_vector)
    for port in system.ports.values():
        port.value = None  # keep the ports' rows as assembled
    system.tangent(system.matrix)

    from dolfinx.fem import petsc as fem_petsc

    full = fem_petsc.create_matrix(problem.form("tangent"))
    fem_petsc.assemble_matrix(full, problem.form("tangent"))
    full.assemble()
    T = PETSc.Mat().createAIJ((full.size[0], m.owned), nnz=1, comm=MPI.COMM_SELF)
    for i in np.flatnonzero(m.columns >= 0):
        T.setValue(int(i), int(m.columns[i]), 1.0)
    T.assemble()
    difference = full.ptap(T)
    difference.axpy(-1, system.matrix)
    assert difference.norm() < 1e-12 * system.matrix.norm()


def test_tangent_is_the_derivative_of_the_residual_with_air():
    """Also of the one-way rows, whose tangent is not symmetric."""
    problem = build_problem(case("benchmark_strip_air", **SMALL).config, MPI.COMM_SELF)
    problem.set_prestretch(1.0)
    system = Newton(problem, Timings()).system
    system.ports = {name: PortLaw() for name in system.ports}  # prescribed ones are eliminated
    rng = np.random.default_rng(0)
    q = system.q
    q.array[:] = 1e-5 * rng.standard_normal(q.size)
    direction = q.duplicate()
    direction.array[:] = rng.standard_normal(q.size)
    out, plus, minus = q.duplicate(), q.duplicate(), q.duplicate()
    system.residual(q, out)
    system.tangent(system.matrix)
    system.matrix.mult(direction, out)
    h = 1e-7
    for step, target in ((h, plus), (-h, minus)):
        moved = q.copy()
        moved.axpy(step, direction)
        system.residual(moved, target)
    numeric = (plus.array - minus.array) / (2 * h)
    solid = system.map.field != 2
    for part in (solid, ~solid):
        rows = np.append(part, [False, False])
        assert numeric[rows] == pytest.approx(
            out.array[rows], abs=2e-6 * np.abs(out.array[rows]).max()
        )


@pytest.mark.once
def test_air_stiffness_does_not_matter():
    reference = history("benchmark_strip_air", **SMALL)
    for stiffness in ("1e-9 MPa", "1e-3 MPa"):
        h = history("benchmark_strip_air", physics__air_stiffness=stiffness, **SMALL)
        for column in ("force_N", "capacitance_pF", "charge_uC"):
            scale = np.abs(reference[column]).max()
            assert np.abs(h[column] - reference[column]).max() < 1e-6 * scale


def drive(name, *stages, **changes):
    """History of a config under another program."""
    program = [{"stage": "prestrain"}, *stages]
    text = str(program).replace("'", "")
    return history(name, program=text, **SMALL, **changes)


PUSH = {"stage": "push", "steps": 4}
ACTUATE = {"stage": "actuate", "steps": 4}


def test_force_and_displacement_control_are_inverse():
    a = drive("benchmark_strip", {**PUSH, "mount": {"displacement": "-1 mm"}})
    force = float(a["force_N"].iloc[-1])
    b = drive("benchmark_strip", {**PUSH, "mount": {"force": f"{force!r} N"}})
    assert b["displacement_mm"].iloc[-1] == pytest.approx(-1, rel=1e-7)


def test_charge_and_voltage_control_are_inverse():
    push = {**PUSH, "mount": {"displacement": "-1 mm"}}
    a = drive("benchmark_strip", push, {**ACTUATE, "terminal": {"voltage": "2 kV"}})
    charge = float(a["charge_uC"].iloc[-1])
    b = drive("benchmark_strip", push, {**ACTUATE, "terminal": {"charge": f"{charge!r} uC"}})
    last_a, last_b = a.iloc[-1], b.iloc[-1]
    assert last_b["voltage_kV"] == pytest.approx(2, rel=1e-7)
    assert last_b["force_N"] == pytest.approx(last_a["force_N"], rel=1e-7)
    assert last_b["capacitance_pF"] == pytest.approx(last_a["capacitance_pF"], rel=1e-7)


def test_spring_balances_the_mount():
    spring = {"stiffness": "0.5 N/mm", "anchor": "-2 mm"}
    h = drive("benchmark_strip", {**PUSH, "mount": {"spring": spring}})
    anchors = np.linspace(0, -2, 5)
    assert h["force_N"].to_numpy() == pytest.approx(
        -0.5 * (h["displacement_mm"] - anchors), abs=1e-8
    )
    assert -2 < h["displacement_mm"].iloc[-1] < -0.5


def test_capacitance_at_rest_needs_no_voltage():
    """The test voltage with the body frozen gives the limit of Q/V."""
    push = {**PUSH, "mount": {"displacement": "-1 mm"}}
    h = drive("benchmark_strip", push, {**ACTUATE, "terminal": {"voltage": "1e-3 kV"}})
    at_rest, small = h["capacitance_pF"].iloc[[4, 8]]
    assert at_rest == pytest.approx(small, rel=1e-6)


@pytest.mark.parametrize("electrodes", ["10 um", "0 um"])
def test_film_of_a_flat_device_is_a_plate_capacitor(electrodes):
    h = history("benchmark_strip", geometry__electrode_thickness=electrodes, **SMALL)
    flat = 8.8541878128 * 3 * np.pi * (12.35**2 - 8.35**2) / 0.030 * 1e-3
    assert h["capacitance_pF"].iloc[0] == pytest.approx(flat, rel=1e-9)
    assert h["displacement_mm"].iloc[0] == 0
    assert h["force_N"].iloc[0] == pytest.approx(0, abs=1e-9)


def test_changing_parameters_compiles_nothing(monkeypatch):
    """Moduli, dimensions, pre-stretch, permittivity, voltage: constants of the compiled forms."""
    history("benchmark_strip_air", **SMALL)  # compiled here at the latest
    from cffi import FFI

    def compile_called(*args, **kwargs):
        raise AssertionError("a form was compiled again")

    monkeypatch.setattr(FFI, "compile", compile_called)
    h = history(
        "benchmark_strip_air",
        materials__film__shear_modulus="0.4 MPa",
        materials__film__relative_permittivity=2.8,
        materials__film__prestretch="[1.12, 1.1]",
        materials__electrode__shear_modulus="0.8 MPa",
        geometry__film_thickness="25 um",
        geometry__outer_radius="12 mm",
        physics__air_stiffness="1e-5 MPa",
        **{**SMALL, "mesh__columns": 12},
    )
    assert h["displacement_mm"].iloc[-1] == pytest.approx(-3)


@pytest.mark.once
def test_clamped_device_cycles_and_fringes():
    """Mount and frame blocks: the cycle converges, charge density rises at the electrode ends."""
    h_case = case(
        "benchmark_strip_air",
        geometry__clamps="{width: 2 mm, height: 1.5 mm, relative_permittivity: 3.0}",
        program="[{stage: push, mount: {displacement: -2 mm}, steps: 8},"
        " {stage: cycle, terminal: {voltage: [0 kV, 2.5 kV, 0 kV]}, steps: 8}]",
    )
    states = []
    simulation = dealib.Simulation(h_case)
    for state in simulation:
        states.append(state.row)
        if state.row["step"] == 12:
            nodal = state.nodal()
    assert states[12]["voltage_kV"] == pytest.approx(2.5)
    assert states[16]["displacement_mm"] == pytest.approx(-2)
    assert states[16]["force_N"] == pytest.approx(states[8]["force_N"], rel=1e-7)

    from dealib.results.fields import fields

    mesh = simulation.engine.layout.mesh
    D = fields(h_case.config, mesh, nodal)["D"]
    film = np.unique(mesh.cells[mesh.in_region("film")])
    for height in (0.015, -0.015):
        face = film[np.abs(mesh.points[film, 1] - height) < 1e-9]
        face = face[np.argsort(mesh.points[face, 0])]
        density = np.linalg.norm(D[face], axis=1)  # uC/mm^2 = C/m^2
        assert 0.002 < np.median(density) < 0.003  # the plateau of the thesis's Fig. 29
        assert density[0] > 1.2 * density[2]  # singular at the electrode's ends
        assert density[-1] > 1.2 * density[-3]


def test_a_run_that_cannot_converge_says_where(tmp_path):
    """A free film has no equilibrium past pull-in."""
    hopeless = case(
        "benchmark_strip",
        program="[{stage: prestrain}, {stage: pull_in, duration: 10 s, mount: {force: 0 N},"
        " terminal: {voltage: 50 kV}, steps: 4}]",
        solver__max_cuts=3,
        **SMALL,
    )
    with pytest.raises(NotConverged, match=r"'pull_in' stopped after t = .*terminal\.voltage = "):
        dealib.simulate(hopeless, tmp_path / "run")
    run = dealib.open(tmp_path / "run")
    assert run.info["status"] == "not converged"
    assert len(run.history) == len(run.stored_steps) > 0
    assert np.isfinite(run.state(-1)).all()
