"""The mixed form from kappa/G = 50 to 1e5 on the annular membrane of configs/membrane.yaml.

F/(mu H a) at u = a, with H the unstretched thickness. Measured at kappa/G = 1e5, H/a = 0.01 (24 x 1
cells, 120 x 4 cells: 8.3118): mixed 8.3115 with 65 Newton iterations in 24 steps, displacement form
8.3204 with 370 in 45 steps, since its increments are cut.
"""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dealib
from dealib.materials import LAWS, invariants_of_stretches
from dealib.results import local
from dealib.results.fields import fields

MEMBRANE = Path(__file__).parents[2] / "configs" / "membrane.yaml"
A, STRETCH = 10.0, 1.2  # inner radius in mm, pre-stretch of the membrane


@cache
def push(formulation, ratio, relative_thickness=0.01, columns=24, rows=1, voltage=0.0):
    """Normalised forces before and after the voltage, and all Newton iterations."""
    mounted = relative_thickness * A / STRETCH**2
    steps = [
        {"stage": "prestrain"},
        {"stage": "push", "mount": {"displacement": f"{-A} mm"}, "steps": 20},
    ]
    if voltage:
        steps.append({"stage": "on", "terminal": {"voltage": f"{voltage} kV"}, "steps": 3})
    case = dealib.load(
        MEMBRANE,
        set={
            "physics.formulation": formulation,
            "materials.film.bulk_modulus": f"{ratio} MPa",  # G = 1 MPa
            "geometry.film_thickness": f"{mounted} mm",
            "mesh.columns": columns,
            "mesh.film_rows": rows,
            "program": steps,
        },
    )
    rows = [state.row for state in dealib.Simulation(case)]
    unit = -relative_thickness * A * A
    forces = {r["stage"]: r["force_N"] / unit for r in rows}
    return forces, sum(r["newton_iterations"] for r in rows)


@pytest.mark.parametrize(
    ("normalised", "stage", "limit"), [(0, "push", 8.307286), (0.3, "on", 7.119352)]
)
def test_incompressible_membrane_limit(normalised, stage, limit):
    """Extrapolated to H/a = 0 at kappa/G = 1e5: within 0.1 % of the membrane's ODE."""

    def force(relative_thickness):
        volts = 0.3 * relative_thickness * A / np.sqrt(3 * 8.8541878128e-6)
        forces, _ = push("mixed", 1e5, relative_thickness, columns=40, rows=2, voltage=volts)
        return forces[stage]

    thick, thin = force(0.02), force(0.01)
    assert 2 * thin - thick == pytest.approx(limit, rel=1e-3)
    assert abs(thin - limit) < 0.7 * abs(thick - limit)  # first order in H/a


@pytest.mark.parametrize("ratio", [50, 1e3])
def test_both_forms_agree_where_both_work(ratio):
    mixed, _ = push("mixed", ratio)
    displacement, _ = push("displacement", ratio)
    assert displacement["push"] == pytest.approx(mixed["push"], rel=1e-3)


def test_displacement_form_locks_and_labours_at_1e5():
    """On one row of cells: error against the fine mesh, and Newton's work."""
    fine, _ = push("mixed", 1e5, columns=80, rows=2)
    mixed, few = push("mixed", 1e5)
    displacement, many = push("displacement", 1e5)
    errors = [abs(f["push"] / fine["push"] - 1) for f in (mixed, displacement)]
    assert errors[0] < 1e-4
    assert errors[1] > 8e-4  # 0.1 %
    assert few < 75
    assert many > 4 * few


def test_iterations_do_not_grow_with_the_bulk_modulus():
    counts = [push("mixed", ratio)[1] for ratio in (50, 1e3, 1e5)]
    assert max(counts) - min(counts) <= 5


def test_stress_and_energy_of_the_stretched_film_at_rest():
    """Free of thickness stress, and as much energy as the law says, at kappa/G = 1e5."""
    changes = {
        "physics.formulation": "mixed",
        "materials.film.bulk_modulus": "1e5 MPa",
        "mesh.columns": 8,
        "program": [{"stage": "prestrain"}],
    }
    case = dealib.load(MEMBRANE, set=changes)
    simulation = dealib.Simulation(case)
    (state,) = simulation
    found = fields(case.config, simulation.layout.mesh, state.nodal())
    S = found["second_pk_stress"]
    # neo-Hooke, incompressible: Cauchy stress mu (l^2 - l^-4), on the mounted area
    assert S[:, 0, 0] == pytest.approx(np.full(len(S), 1.2**2 - 1.2**-4), rel=1e-4)
    assert np.abs(S[:, 1, 1]).max() < 1e-9
    film, g = case.config.materials.film, case.config.geometry
    lz = local.region_materials(case.config)["film"].prestretch[1]
    volume = np.pi * (g.outer_radius**2 - g.inner_radius**2) * g.film_thickness
    density = film.energy(invariants_of_stretches(1.2, lz, 1.2), SimpleNamespace(**film.parameters))
    expected = density * volume / (1.2**2 * lz)
    assert state.row["elastic_energy_mJ"] == pytest.approx(expected, rel=1e-9)


def test_stored_state_restarts():
    """The stored pressure is averaged at nodes: Newton makes it exact again at once."""
    changes = {
        "physics.formulation": "mixed",
        "materials.film.bulk_modulus": "1e5 MPa",
        "mesh.columns": 24,
        "program": [
            {"stage": "prestrain"},
            {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
        ],
    }
    simulation = dealib.Simulation(dealib.load(MEMBRANE, set=changes))
    *_, last = simulation
    nodal, layout = last.nodal(), simulation.layout
    system = simulation.newton.system
    system.q.set(0.0)
    layout.scatter(nodal)
    assert layout.gather()[:, :3] == pytest.approx(nodal[:, :3], abs=0)
    system.map.restrict(simulation.problem.spaces.w, system.q)
    assert simulation.newton.solve() <= 2
    assert system.internal["mount"] == pytest.approx(last.row["force_N"], rel=1e-9)
    assert layout.gather() == pytest.approx(nodal, abs=1e-7)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_every_law_separates(law):
    """What the mixed form replaces is bulk_modulus/2 (J - 1)^2, whatever the law."""
    p = SimpleNamespace(**law.from_youngs_modulus(1.0))
    i = invariants_of_stretches(1.3, 0.9, 1.1)
    volumetric = p.bulk_modulus / 2 * (i.J - 1) ** 2
    assert law.energy(i, p) == pytest.approx(law.isochoric_energy(i, p) + volumetric, rel=1e-12)


def test_mixed_needs_second_order():
    with pytest.raises(dealib.ConfigError, match="mixed needs order 2"):
        dealib.load(MEMBRANE, set={"physics.formulation": "mixed", "mesh.order": 1})
