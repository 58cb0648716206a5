"""Mullins softening and permanent set in devices."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from laminates import config, rows, simulation
from watch import At

import dealib
from dealib.config import resolved
from dealib.materials import LAWS, coupon
from dealib.materials.softening import withheld

LENGTH, AREA, VOLUME = 10.0, 5 * 0.5, 10 * 5 * 0.5  # of the strip
LAW = {"c10": 0.2, "c20": -0.015, "c30": 0.004}
MULLINS, SET = {"r": 1.8, "m": 0.12}, {"shear_modulus": 0.08, "energy": 0.2}
STRETCHES = [1, 1.8, 1.0, 2.4, 1.1, 2.6]


def film(mullins=MULLINS, permanent_set=SET, **more):
    """A filled elastomer."""
    given = {"law": "yeoh", "bulk_modulus": "100 GPa", "relative_permittivity": 3.0, **more}
    given |= {name: f"{value} MPa" for name, value in LAW.items()}
    if mullins:
        given["mullins"] = {"r": mullins["r"], "m": f"{mullins['m']} MPa"}
    if permanent_set:
        given["permanent_set"] = {k: f"{v} MPa" for k, v in permanent_set.items()}
    return given


def strip(stretches=STRETCHES, steps=12, sections=None, **given):
    """A strip in pure shear that is pulled and released."""
    device = {
        "mesh": {"columns": 4, "grading": "uniform"},
        "physics": {"formulation": "mixed"},
        "holds": [{"on": "left", "fix": "X"}, {"on": "film.bottom", "fix": "Z"}],
        "mounts": {"bar": {"on": "right", "along": "X", "free": ["Z"]}},
    }
    device |= sections or {}
    made = config("strip", materials={"film": film(**given)}, **device)
    start = stretches[0]
    program = [{"stage": "prestrain"}] + [
        {"stage": f"to {k}", "mount": {"displacement": f"{LENGTH * (l / start - 1)} mm"},
         "steps": steps}
        for k, l in enumerate(stretches[1:], 1)
    ]  # fmt: skip
    tree = made.model_dump(mode="json", exclude_unset=True) | {"program": program}
    return type(made).model_validate(tree)


MEMBRANE = {"physics": {"model": "membrane"}}


def expected(stretches, mullins=MULLINS, permanent_set=SET, fine=400):
    """Nominal stress at the corners of a path, by fine steps of the homogeneous test, MPa."""
    material = coupon.IncompressibleMaterial(
        LAWS["yeoh"], SimpleNamespace(**LAW, bulk_modulus=0.0),
        mullins=None if mullins is None else SimpleNamespace(**mullins),
        set=None if permanent_set is None else SimpleNamespace(**permanent_set),
    )  # fmt: skip
    way = [np.linspace(a, b, fine + 1)[1:] for a, b in itertools.pairwise(stretches)]
    path = np.concatenate([stretches[:1], *way])
    (P,) = coupon.stresses(coupon.Path("pure shear", np.arange(len(path)), path), [material])
    return P[fine::fine]


@pytest.mark.once
@pytest.mark.parametrize(
    ("given", "within", "sections"),
    [
        ({"permanent_set": None}, 1e-4, None),
        ({"mullins": None}, 2e-3, None),
        ({}, 2e-3, None),
        ({}, 2e-3, MEMBRANE),
    ],
    ids=["mullins", "set", "both", "membrane"],
)
def test_a_strip_softens_as_the_homogeneous_test(given, within, sections):
    found = pd.DataFrame(rows(strip(sections=sections, **given)))
    force = found.groupby("stage", sort=False)["force_N"].last().to_numpy()[1:]
    stress = expected(STRETCHES, **given)
    assert force / AREA == pytest.approx(stress, abs=within * np.abs(stress).max())


@pytest.mark.once
def test_more_steps_do_not_change_softening_and_set_converges_with_second_order():
    exact = expected(STRETCHES)[-2]  # of the released strip, where the set shows
    errors = []
    for steps in (3, 6, 12):
        found = pd.DataFrame(rows(strip(steps=steps)))
        force = found.groupby("stage", sort=False)["force_N"].last().to_numpy()[-2]
        errors.append(abs(force / AREA - exact))
    assert errors[2] < 2e-4
    assert np.divide(errors[:2], errors[1:]) == pytest.approx(4, abs=0.5)
    alone = [rows(strip(steps=n, permanent_set=None))[-1]["force_N"] for n in (3, 12)]
    assert alone[0] == pytest.approx(alone[1], rel=1e-9)


@pytest.mark.parametrize(
    ("sections", "steps", "within"),
    [
        pytest.param(None, 96, 1e-4, marks=pytest.mark.slow),
        pytest.param(MEMBRANE, 24, 2e-3, marks=pytest.mark.once),
    ],
    ids=["solid", "membrane"],
)
def test_work_is_stored_or_dissipated(sections, steps, within):
    found = pd.DataFrame(rows(strip(steps=steps, sections=sections)))
    x, force = found["displacement_mm"], found["force_N"]
    work = float((force.rolling(2).mean() * x.diff()).sum())
    kept = found["elastic_energy_mJ"].iloc[-1] - found["elastic_energy_mJ"].iloc[0]
    lost = found["dissipated_energy_mJ"]
    assert work == pytest.approx(kept + lost.iloc[-1], rel=within)  # of the trapezoidal work
    assert lost.diff().min() > -1e-6 * lost.iloc[-1]
    assert lost.iloc[-1] > 0.1 * work


def test_what_softening_dissipates_is_known_from_the_largest_stretch():
    found = rows(strip(steps=6, permanent_set=None))
    l = max(STRETCHES)
    W, _ = coupon.energy(LAWS["yeoh"], SimpleNamespace(**LAW, bulk_modulus=0.0), "pure shear",
                         np.array(l))  # fmt: skip
    lost = VOLUME * withheld(W, W, SimpleNamespace(**MULLINS))
    assert found[-1]["dissipated_energy_mJ"] == pytest.approx(lost, rel=1e-3)


def test_a_stretched_mounted_film_has_its_set():
    """Mounted at 1.6, it carries what the test of the same path to 1.6 carries."""
    stretches = [1.6, 2.2, 1.6]
    found = pd.DataFrame(rows(strip(stretches, prestretch=[1.6, 1.0])))
    force = found.groupby("stage", sort=False)["force_N"].last().to_numpy()
    stress = expected([1, *stretches])
    area = AREA * 1.6  # per unstretched length, so that nominal stresses count
    assert force / area == pytest.approx(stress, abs=5e-3 * stress.max())
    assert stress[2] < 0.8 * stress[0]


def test_a_resumed_run_remembers(tmp_path):
    given = strip(steps=4)
    case = dealib.Case(given, resolved(given), tmp_path)
    whole = dealib.simulate(case, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        dealib.simulate(case, tmp_path / "run", observers=[At(9, KeyboardInterrupt())])
    resumed = dealib.simulate(case, tmp_path / "run", resume=True)
    assert len(resumed.history) == len(whole.history)
    for name in ("force_N", "dissipated_energy_mJ", "elastic_energy_mJ"):
        assert resumed.history[name].to_numpy() == pytest.approx(
            whole.history[name].to_numpy(), abs=1e-9
        )
    assert resumed.internal() == pytest.approx(whole.internal(), abs=1e-9)


@pytest.mark.parametrize("sections", [None, MEMBRANE], ids=["solid", "membrane"])
def test_stress_fields_are_those_of_the_softened_film(tmp_path, sections):
    given = strip(STRETCHES[:3], steps=6, sections=sections)
    run = dealib.simulate(dealib.Case(given, resolved(given), tmp_path), tmp_path / "run")
    fields, force = run.arrays(-1), run.history["force_N"].iloc[-1]
    assert force / AREA < -0.01  # pushed back to its length it is under pressure
    assert fields["cauchy_stress"][:, 0, 0] == pytest.approx(force / AREA, rel=1e-3)


def test_a_film_that_is_never_unloaded_is_that_of_the_law():
    soft = rows(strip([1, 1.8], permanent_set=None))[-1]["force_N"]
    plain = rows(strip([1, 1.8], permanent_set=None, mullins=None))[-1]["force_N"]
    assert soft == pytest.approx(plain, rel=1e-9)


def test_a_device_of_softening_material_is_followed_in_time_only():
    made = strip()
    follow = {"vary": "displacement", "along": "force", "until": {"force": "1 N"}}
    tree = made.model_dump(mode="json", exclude_unset=True)
    tree["program"] = [{"stage": "prestrain"}, {"stage": "way", "follow": follow}]
    with pytest.raises(ValueError, match="computes equilibria, independent of time"):
        type(made).model_validate(tree)
    tree["program"] = [{"stage": "prestrain"}]
    tree["tables"] = {"displacement": ["0 mm", "1 mm"], "voltage": ["0 kV", "1 kV"]}
    with pytest.raises(
        ValueError, match="has mullins and permanent_set: tables cannot hold forces that"
    ):
        type(made).model_validate(tree)


def test_bad_numbers_of_softening_are_refused():
    with pytest.raises(ValueError, match="greater than or equal to 1"):
        strip(mullins={"r": 0.9, "m": 0.1})


def test_the_tangent_of_a_softening_film_is_symmetric():
    for state in simulation(strip(steps=3)):
        system = state.engine.newton.system
        system.residual(system.q, system.residual_vector)
        system.tangent(system.matrix)
        assert system.matrix.isSymmetric(1e-12 * system.matrix.norm())
