"""Permittivity that depends on stretch: one energy for field, charge, stress and capacitance."""

import numpy as np
import pytest
import ufl
from conftest import case, history
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

import dealib
from dealib.config import resolved
from dealib.fem.energies import Point, StretchedDielectric, density
from dealib.results import stress
from dealib.results.fields import fields
from dealib.units import EPSILON_0

BY_STRETCH = "{intercept: 2.76, slope: -0.28}"
FLAT = {"mesh__columns": 8, "mesh__film_rows": 1, "physics__formulation": "displacement"}


def test_config_gives_a_number_or_a_line(tmp_path):
    film = case("membrane").config.materials["film"]
    assert film.relative_permittivity == 3.0
    assert (film.permittivity.intercept, film.permittivity.slope) == (3.0, 0.0)
    config = case("membrane", materials__film__relative_permittivity=BY_STRETCH).config
    assert config.materials["film"].permittivity.at(1.2) == pytest.approx(2.424)
    path = tmp_path / "resolved.yaml"
    path.write_text(resolved(config))
    assert dealib.load(path).config == config


@pytest.mark.once
@pytest.mark.parametrize("normal", range(3))
@pytest.mark.parametrize("seed", range(5))
def test_stress_is_the_derivative_of_the_energy(seed, normal):
    """J sigma = dW_e/dF F^T at a given nominal field: Maxwell's stress and electrostriction."""
    random = np.random.default_rng(seed)
    F, E = np.eye(3), np.zeros(3)
    F[:2, :2] += 0.3 * random.standard_normal((2, 2))
    F[2, 2], E[:2] = 1.3, 50 * random.standard_normal(2)
    mounted = np.array([1.2, 0.7, 1.15])
    variable = ufl.variable(ufl.as_matrix(F.tolist()))
    energy = StretchedDielectric("film", 3e-5, -4e-6, mounted.tolist(), normal=normal)
    point = Point(None, None, variable, ufl.as_vector(E.tolist()))
    P = ufl.diff(density(energy, point), variable)

    def number(expression):
        return float(apply_derivatives(apply_algebra_lowering(expression))(()))

    derived = np.array([[number(P[i, j]) for j in range(3)] for i in range(3)])
    material = stress.RegionMaterial(None, 3e-5, mounted, -4e-6, normal=normal)
    k = stress.Deformation(F, np.linalg.det(F), np.linalg.inv(F), np.linalg.solve(F.T, E))
    wanted = k.J * material.electric_stress(k) @ k.inverse.T
    assert np.allclose(derived, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())


def test_flat_film_by_hand():
    """Mounted at 1.2, clamped: eps_r = 2.76 - 0.28 * 1.2; capacitance, charge, D and stress."""
    given = case(
        "membrane",
        **FLAT,
        materials__film__relative_permittivity=BY_STRETCH,
        materials__film__prestretch=1.2,
        materials__film__bulk_modulus="1e5 MPa",
        program=[{"stage": "on", "terminal": {"voltage": "2 kV"}}],
    )
    simulation = dealib.Simulation(given)
    rest, on = simulation
    eps = EPSILON_0 * (2.76 - 0.28 * 1.2)
    area, h = np.pi * (20**2 - 10**2), given.config.geometry.film_thickness
    assert rest.row["capacitance_pF"] == pytest.approx(1e3 * eps * area / h, rel=1e-9)
    assert on.row["charge_uC"] == pytest.approx(2 * eps * area / h, rel=2e-5)
    found = fields(given.config, simulation.engine.layout.mesh, on.nodal())
    e = 2 / h
    assert found["D"][:, 1] == pytest.approx(-eps * e, rel=1e-3)
    # in the plane -eps e^2/2 + b l e^2/4 and across eps e^2/2, b = 0.28 eps0
    plane = -eps * e**2 / 2 + 0.28 * EPSILON_0 * 1.2 * e**2 / 4
    assert found["maxwell_stress"][:, 0, 0] == pytest.approx(plane, rel=2e-3)
    assert found["maxwell_stress"][:, 2, 2] == pytest.approx(plane, rel=2e-3)
    assert found["maxwell_stress"][:, 1, 1] == pytest.approx(eps * e**2 / 2, rel=2e-3)
    # what the law adds across balances it; the faces are free
    across = found["maxwell_stress"][:, 1, 1] + found["cauchy_stress"][:, 1, 1]
    assert np.abs(across).max() < 2e-3 * eps * e**2 / 2


def test_without_slope_it_is_the_ideal_dielectric():
    program = [
        {"stage": "on", "terminal": {"voltage": "3 kV"}},
        {"stage": "push", "mount": {"displacement": "-5 mm"}, "steps": 4},
    ]
    same = {**FLAT, "program": str(program)}
    ideal = history("membrane", **same)
    slope = "{intercept: 3, slope: 1e-12}"
    tiny = history("membrane", **same, materials__film__relative_permittivity=slope)
    for column in ("force_N", "charge_uC", "capacitance_pF", "electric_energy_mJ"):
        assert tiny[column].to_numpy() == pytest.approx(ideal[column].to_numpy(), rel=1e-9)


def test_falling_permittivity_weakens_the_actuator():
    """Stroke under a mass: less than with the constant permittivity of the mounted state."""
    strokes = []
    for eps in (3.0, "{intercept: 4.2, slope: -1.0}"):  # 3.0 at the pre-stretch 1.2
        given = case(
            "membrane",
            **FLAT,
            materials__film__relative_permittivity=eps,
            materials__film__prestretch=1.2,
            program=[
                {"stage": "load", "mount": {"force": "-1 N"}, "steps": 4},
                {"stage": "on", "terminal": {"voltage": "4 kV"}, "steps": 2},
            ],
        )
        ends = [s.row["displacement_mm"] for s in dealib.Simulation(given) if s.end_of_stage]
        strokes.append(ends[-1] - ends[-2])
    # thin film: the pressure eps e^2 is replaced by e^2 (eps + l eps'/4 ..) at l = 1.2: 10 %
    assert 0.85 < strokes[1] / strokes[0] < 0.92
