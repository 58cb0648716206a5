"""How far the three couplings agree: stroke, blocking force and thickness stress of three strips.

Nearly incompressible film (mixed form, kappa/G = 1e4 in the film), 0 -> 2.5 kV.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import ufl

import dealib
from dealib.fem import couplings
from dealib.fem.energies import constant
from dealib.results.fields import fields
from dealib.units import EPSILON_0

STRIP = Path(__file__).parents[2] / "configs" / "benchmark_strip.yaml"
INCOMPRESSIBLE = {"physics.formulation": "mixed", "materials.film.bulk_modulus": "3340 MPa"}
PUSH = {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4}
PROGRAM = [
    {"stage": "prestrain"},
    PUSH,
    {"stage": "blocked", "terminal": {"voltage": "2.5 kV"}, "steps": 3},
    {"stage": "free", "mount": {"force": "-0.5 N"}, "steps": 4},
    {"stage": "off", "terminal": {"voltage": "0 kV"}, "steps": 3},
]


@cache
def measured(coupling, compressible=False, **mesh):
    """Blocking force at 2 mm (N), stroke under 0.5 N (mm), thickness stress over eps e^2, e^2."""
    changes = {"physics.coupling": coupling, "program": PROGRAM}
    changes |= {f"mesh.{k}": v for k, v in mesh.items()}
    case = dealib.load(STRIP, set=changes | ({} if compressible else INCOMPRESSIBLE))
    simulation = dealib.Simulation(case)
    ends = {}
    for state in simulation:
        if state.end_of_stage:
            ends[state.row["stage"]] = state.row
            if state.row["stage"] == "blocked":
                mesh, nodal = simulation.engine.layout.mesh, state.nodal()
    found = fields(case.config, mesh, nodal)
    middle = np.unique(mesh.cells[mesh.in_region("film")])
    middle = middle[np.abs(mesh.points[middle] - [10.35, 0]).sum(axis=1) < 0.3]
    e, sigma = found["E"][middle], found["cauchy_stress"][middle]
    square = np.einsum("ni,ni->n", e, e)
    thickness = np.einsum("ni,nij,nj->n", e, sigma, e) / square
    ratio = (thickness / (3 * EPSILON_0 * square)).mean()
    blocking = ends["blocked"]["force_N"] - ends["push"]["force_N"]
    stroke = ends["free"]["displacement_mm"] - ends["off"]["displacement_mm"]
    return blocking, stroke, ratio, square.mean()


def test_energy_form_carries_half_the_pressure_as_thickness_stress():
    """The elastic stress balances T n = eps e^2/2 n on the faces; the rest is in the plane."""
    assert measured("energy")[2] == pytest.approx(-0.5, abs=0.005)


def test_pelrine_agrees_and_doubles_the_thickness_stress():
    """Eps e (x) e is Maxwell's stress up to a pressure, which an incompressible film takes up."""
    energy, pelrine = measured("energy"), measured("pelrine")
    assert pelrine[:2] == pytest.approx(energy[:2], rel=2e-3)
    assert pelrine[2] == pytest.approx(-1, abs=0.01)


@pytest.mark.once
def test_pelrine_with_the_thickness_at_rest_keeps_its_pressure():
    """The film is pressed by eps (V/H)^2 where the true field has grown; so it does less."""
    energy, rest = measured("energy"), measured("pelrine_undeformed")
    assert rest[2] * rest[3] == pytest.approx(-((2.5 / 0.03) ** 2), rel=0.01)
    assert rest[3] > 1.15 * (2.5 / 0.03) ** 2
    assert 0.7 < rest[0] / energy[0] < 0.9
    assert 0.7 < rest[1] / energy[1] < 0.9


def test_pelrine_differs_by_compressibility():
    """At the thesis's kappa/G = 50 the film gives way to the pressure: 1 % of the force."""
    energy, pelrine = measured("energy", True), measured("pelrine", True)
    assert pelrine[0] != pytest.approx(energy[0], rel=3e-3)
    assert pelrine[:2] == pytest.approx(energy[:2], rel=0.03)


@pytest.mark.once
def test_maxwell_traction_agrees_between_clamps():
    """div T = 0 in the film and the clamps take no axial T n: the same problem as the energy's."""
    energy, traction = measured("energy"), measured("maxwell_traction")
    assert traction[2] == pytest.approx(energy[2], rel=0.01)
    assert traction[:2] == pytest.approx(energy[:2], rel=0.015)


@pytest.mark.slow
def test_difference_of_the_traction_falls_with_the_mesh():
    """It is the field's error at the singular ends of the electrodes."""
    finer = {"columns": 120, "film_rows": 8, "electrode_rows": 2}
    difference = [
        abs(measured("maxwell_traction", True, **m)[0] / measured("energy", True, **m)[0] - 1)
        for m in ({}, finer)
    ]
    assert difference[1] < 0.6 * difference[0]


def test_a_follower_pressure_on_each_face_is_hydrostatic(monkeypatch):
    """Why Pelrine's pressure is a stress across the film: equal pressures on both faces do nothing.

    The pressure is that of 2.5 kV on the film as mounted, which blocks 0.2 N in the energy form.
    """
    pressure = []

    def load(problem, v):
        if not pressure:
            pressure.append(constant(problem.domain.mesh, 0.0))
        face = problem.integrals.face
        n_da = ufl.det(face.F) * ufl.inv(face.F).T * face.N
        work = -pressure[0] * (n_da[0] * v[0] + n_da[1] * v[1])
        return sum(problem.integrals.over_face(name, work) for name in couplings.FACES)

    monkeypatch.setitem(couplings.COUPLINGS, "pelrine", couplings.Loaded(load))
    changes = INCOMPRESSIBLE | {
        "geometry.electrode_thickness": "0 um",
        "physics.coupling": "pelrine",
        "program": [{"stage": "prestrain"}, PUSH, {"stage": "press", "steps": 1}],
    }
    forces = {}
    for state in dealib.Simulation(dealib.load(STRIP, set=changes)):
        forces[state.row["stage"]] = state.row["force_N"]
        if state.row["stage"] == "push" and state.end_of_stage:
            pressure[0].value[...] = 3 * EPSILON_0 * (2.5 / 0.03) ** 2
    assert pressure[0].value == pytest.approx(0.18446, rel=1e-4)  # MPa
    assert forces["press"] == pytest.approx(forces["push"], abs=5e-4)
