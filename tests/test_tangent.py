"""The tangent: symmetric where there is a potential, and its inertia."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from conftest import case
from verification import free_block

import dealib
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import build_problem
from dealib.fem.timings import Timings

SMALL = {"mesh__columns": 16, "mesh__film_rows": 2}
AIR = {**SMALL, "geometry__air_height": "6 mm"}


def plain(matrix):
    rows, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, rows), matrix.getSize())


@pytest.mark.parametrize("changes", [SMALL, AIR], ids=["no air", "air"])
def test_prescribed_ports_step_as_told(changes):
    """Row and column of a prescribed port are eliminated: its step is the one asked for."""
    problem = build_problem(case("benchmark_strip", **changes).config, MPI.COMM_SELF)
    problem.set_prestretch(1.0)
    system = Newton(problem, Timings()).system
    rng = np.random.default_rng(0)
    system.q.array[:] = 1e-5 * rng.standard_normal(system.q.size)
    right = system.residual_vector
    system.residual(system.q, right)
    system.ports["mount"] = system.ports["terminal"] = PortLaw(load=0.0)
    system.tangent(system.matrix)
    whole = plain(system.matrix).tolil()
    for name, row in system.map.ports.items():
        whole[row] = 0
        whole[row, row] = 1
        system.ports[name] = PortLaw(value=0.0)
    wanted = scipy.sparse.linalg.spsolve(whole.tocsc(), right.array)
    system.tangent(system.matrix)
    assert system.matrix.isSymmetric(1e-12 * system.matrix.norm()) is problem.symmetric
    system.eliminate(right)
    step = scipy.sparse.linalg.spsolve(plain(system.matrix).tocsc(), right.array)
    assert step == pytest.approx(wanted, rel=1e-6, abs=1e-9 * np.abs(wanted).max())


@pytest.mark.once
def test_blocks_need_few_iterations_where_the_field_fringes_into_the_air():
    """Body and air's mesh are solved one after the other; the field in the air couples them."""
    clamps = {"width": "2 mm", "height": "1.5 mm", "relative_permittivity": 3.0}
    program = [
        {"stage": "prestrain"},
        {"stage": "actuate", "terminal": {"voltage": "2.5 kV"}, "mount": {"force": "-0.3 N"}},
    ]
    for state in dealib.Simulation(case("deap100", geometry__clamps=clamps, program=program)):
        newton = state.engine.newton
        assert newton.linear_iterations <= 4 * newton.linear_solves
    assert state.engine.problem.constraints.numbers("air mesh").size > 5000


def test_a_block_past_its_peak_voltage_is_unstable_under_voltage_only():
    """The homogeneous motion is the only one that gives way (neo-Hooke, peak at l = 1.2599)."""
    bench, found = free_block.block(free_block.mooney_rivlin_of(0.0), 50.0), []
    top = free_block.charge_at(0.687365, 1.259921)
    for fraction in (0.5, 0.95, 1.05, 1.5):
        bench.load(terminal=fraction * top)
        modes = {"charge": bench.newton.unstable_modes()}
        bench.move(terminal=bench.voltage)
        modes["voltage"] = bench.newton.unstable_modes()
        found.append(modes)
    assert [m["charge"] for m in found] == [0, 0, 0, 0]
    assert [m["voltage"] for m in found] == [0, 0, 1, 1]


def test_stable_devices_have_the_inertia_of_a_stable_one():
    mixed = {**SMALL, "physics__formulation": "mixed"}
    for changes in (SMALL, AIR, mixed):
        *_, last = dealib.Simulation(case("benchmark_strip", **changes))
        newton = last.engine.newton
        negative, zero, positive = newton.inertia()
        assert zero == 0
        assert negative + positive == newton.system.q.size
        assert newton.unstable_modes() == 0


def test_loads_without_a_potential_have_no_inertia():
    problem = build_problem(
        case("benchmark_strip", **SMALL, physics__coupling="pelrine").config, MPI.COMM_SELF
    )
    newton = Newton(problem, Timings())
    assert not problem.symmetric
    with pytest.raises(ValueError, match=r"physics\.coupling is energy"):
        newton.inertia()


@pytest.mark.parametrize("mixed", [False, True], ids=["displacement", "mixed"])
@pytest.mark.parametrize("changes", [SMALL, AIR], ids=["no air", "air"])
def test_capacitances_are_those_of_the_whole_tangent(changes, mixed):
    """The potential condensed out of it; at a voltage too, where it is coupled to the body."""
    if mixed:
        changes = {**changes, "physics__formulation": "mixed"}
    newton = None
    for state in dealib.Simulation(case("benchmark_strip", **changes)):
        newton = state.engine.newton
        if state.row["step"] % 5 == 2:
            system, inner = newton.system, newton.system.map.numbers("potential")
            port = system.map.ports["terminal"]
            system.ports["terminal"] = PortLaw(load=0.0)
            system.tangent(system.matrix)
            whole = plain(system.matrix)
            column = whole[inner][:, [port]].toarray()[:, 0]
            x = scipy.sparse.linalg.spsolve(whole[inner][:, inner].tocsc(), column)
            expected = column @ x - whole[port, port]
            (found,) = newton.electrostatics.capacitances().ravel()
            assert found == pytest.approx(expected, rel=1e-11)
            assert state.row["capacitance_pF"] == pytest.approx(1e3 * expected, rel=1e-8)
    assert newton.system.values["terminal"] == 2.5
