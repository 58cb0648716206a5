"""The mixed form from kappa/G = 50 to 1e5 on the annular membrane of configs/membrane.yaml.

F/(mu H a) at u = a, H/a = 0.01, on one row of 24 cells, with Newton's iterations in 20 steps (mesh
converged at 1e5: 8.3118):

| kappa/G | displacement | mixed |
|---|---|---|
| 50 | 8.0409, 48 | 8.0382, 45 |
| 1e3 | 8.3020, 75 | 8.2971, 45 |
| 1e4 | 8.3167, 107 | 8.3101, 45 |
| 1e5 | 8.3204, 129 | 8.3115, 45 |
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
A = 10.0  # inner radius in mm


@cache
def push(formulation, ratio, columns=24, rows=1):
    """Normalised force at the end, and all Newton iterations."""
    steps = [
        {"stage": "prestrain"},
        {"stage": "push", "mount": {"displacement": f"{-A} mm"}, "steps": 20},
    ]
    case = dealib.load(
        MEMBRANE,
        set={
            "physics.formulation": formulation,
            "materials.film.bulk_modulus": f"{ratio} MPa",  # G = 1 MPa
            "mesh.columns": columns,
            "mesh.film_rows": rows,
            "program": steps,
        },
    )
    rows = [state.row for state in dealib.Simulation(case)]
    return -rows[-1]["force_N"] / (0.01 * A * A), sum(r["newton_iterations"] for r in rows)


@pytest.mark.parametrize("ratio", [50, 1e3])
def test_both_forms_agree_where_both_work(ratio):
    mixed, _ = push("mixed", ratio)
    displacement, _ = push("displacement", ratio)
    assert displacement == pytest.approx(mixed, rel=1e-3)


def test_displacement_form_locks_and_labours_at_1e5():
    """On one row of cells: error against the fine mesh, and Newton's work."""
    fine, _ = push("mixed", 1e5, columns=80, rows=2)
    mixed, few = push("mixed", 1e5)
    displacement, many = push("displacement", 1e5)
    errors = [abs(f / fine - 1) for f in (mixed, displacement)]
    assert errors[0] < 1e-4
    assert errors[1] > 8e-4  # 0.1 %
    assert few < 60
    assert many > 2 * few


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
    found = fields(case.config, simulation.engine.layout.mesh, state.nodal())
    S = found["second_pk_stress"]
    # neo-Hooke, incompressible: Cauchy stress mu (l^2 - l^-4), on the mounted area
    assert S[:, 0, 0] == pytest.approx(np.full(len(S), 1.2**2 - 1.2**-4), rel=1e-4)
    assert np.abs(S[:, 1, 1]).max() < 1e-9
    film, g = case.config.materials["film"], case.config.geometry
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
    nodal, layout = last.nodal(), simulation.engine.layout
    system = simulation.engine.newton.system
    system.q.set(0.0)
    layout.scatter(nodal)
    assert layout.gather()[:, :3] == pytest.approx(nodal[:, :3], abs=0)
    system.map.restrict(simulation.engine.problem.spaces.w, system.q, {})
    assert simulation.engine.newton.solve() <= 2
    assert system.internal["mount"] == pytest.approx(last.row["force_N"], rel=1e-9)
    assert layout.gather() == pytest.approx(nodal, abs=1e-7)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_separates(name):
    """What the mixed form replaces is bulk_modulus/2 (J - 1)^2, whatever the law."""
    law = LAWS[name].model_validate({"law": name} | LAWS[name].example())
    p = law.values
    i = invariants_of_stretches(1.3, 0.9, 1.1)
    volumetric = p.bulk_modulus / 2 * (i.J - 1) ** 2
    assert law.energy(i, p) == pytest.approx(law.isochoric_energy(i, p) + volumetric, rel=1e-12)


def test_mixed_needs_second_order():
    with pytest.raises(dealib.ConfigError, match="mixed needs order 2"):
        dealib.load(MEMBRANE, set={"physics.formulation": "mixed", "mesh.order": 1})
