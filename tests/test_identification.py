"""The identification: its membrane model, its windows, and what the configs took from it."""

import csv
import sys

import numpy as np
import pytest
from conftest import CONFIGS, case

sys.path.insert(0, str(CONFIGS / "thesis"))
from devices import COUPLINGS, MASSES, Device, Parameters, Target, by_finite_elements, by_membrane
from maps import larger_prestretch_of_200
from membrane import Layer, Membrane
from quantities import strokes
from windows import WINDOWS, Window

EPSILON_0 = 8.8541878128e-6


def table(kind):
    with (CONFIGS / "thesis" / "identification.csv").open(encoding="utf-8") as file:
        return {r["name"]: r for r in csv.DictReader(file) if r["kind"] == kind}


def identified():
    return Parameters(**{name: float(row["value"]) for name, row in table("parameter").items()})


def test_membrane_with_a_rigid_disc():
    # annulus a = 10, b = 20 mm, pre-stretch 1.2, mu = 1 MPa, 0.1 mm unstretched, u = a:
    # F / (mu H a) = 8.307286 at rest voltage and 7.119352 at (V/H) sqrt(eps/mu) = 0.3
    film = Layer(0.5, 0.0, 1e6, 0.1 / 1.2**2, 1.2)
    model = Membrane(10.0, 20.0, film, None, 3.0)
    forces = [model.solve(0.0, u) for u in np.linspace(1, 10, 10)]
    assert forces[-1] == pytest.approx(8.307286, rel=5e-5)
    per_kilovolt = EPSILON_0 * 3.0 / 0.1 * 10**2 * 1e3  # eps a^2 / H in pF
    assert model.capacitance() / per_kilovolt == pytest.approx(26.584370, rel=5e-5)
    volts = 0.3 * 0.1 / np.sqrt(EPSILON_0 * 3.0)
    for v in np.linspace(0, volts, 5)[1:]:
        force = model.solve(v, 10.0)
    assert force == pytest.approx(7.119352, rel=5e-5)
    assert model.solve(volts, None, force) == pytest.approx(10.0, abs=1e-6)


def test_windows_are_soft_intervals():
    w = Window("1", "x", 2.0, 4.0, "N", "axis", "")
    assert [w.misfit(v) for v in (1.0, 2.0, 3.0, 4.0, 5.0)] == [-0.5, 0, 0, 0, 0.5]
    assert len({w.quantity for w in WINDOWS}) == len(WINDOWS)
    assert all(w.low < w.high for w in WINDOWS)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_membrane_and_finite_elements_agree_on_the_identified_device(coupling):
    device = Device.of(identified())
    targets = [Target(u=1.0), Target(u=2.0), Target(u=2.0, V=2.5)]
    thin = by_membrane(coupling)(device, targets)
    full = by_finite_elements(device, targets, coupling)
    for a, b in zip(thin, full, strict=True):
        assert pytest.approx(b.F, rel=0.05) == a.F  # no bending in the membrane
        assert pytest.approx(b.C, rel=0.005) == a.C
        assert pytest.approx(b.radial_stress, rel=0.02) == a.radial_stress
        assert pytest.approx(b.electrode_stress, rel=0.05) == a.electrode_stress
    assert pytest.approx(full[1].F - full[2].F, rel=0.01) == thin[1].F - thin[2].F
    assert thin[-1].charge_density == pytest.approx(full[-1].charge_density, rel=0.01)


@pytest.mark.once
def test_less_pre_stretch_and_a_constant_pressure_make_strokes_fall():
    """Fig. 31's map: both laws, around the identified parameters."""

    def slope(coupling, law, prestretch):
        device = Device.of(Parameters(**{**vars(identified()), "prestretch": prestretch}), law=law)
        found = strokes(device, by_membrane(coupling))
        return found[f"stroke_{MASSES[-1]:g}"] - found[f"stroke_{MASSES[0]:g}"]

    for law in ("nh", "mr"):
        by_energy = [slope("energy", law, s) for s in (1.14, 1.17, 1.20)]
        by_rest = [slope("pelrine_undeformed", law, s) for s in (1.14, 1.17, 1.20)]
        assert np.all(np.diff(by_energy) > 0.02)
        assert np.all(np.diff(by_rest) > 0.02)
        assert np.all(np.array(by_rest) < np.array(by_energy) - 0.05)
        assert by_energy[-1] > 0  # mm: at 1.2 strokes rise
        assert by_rest[0] < 0


@pytest.mark.parametrize("name", ["deap75", "deap100", "deap100_displacement", "deap200"])
def test_configs_hold_the_identified_values(name):
    p, config = identified(), case(name).config
    size = name.split("_")[0].removeprefix("deap")
    g, film = config.geometry, config.materials["film"]
    assert g.inner_radius == pytest.approx(getattr(p, f"inner_{size}"), abs=0.005)
    assert g.outer_radius == pytest.approx(getattr(p, f"outer_{size}"), abs=0.005)
    assert g.film_thickness == pytest.approx(p.film_thickness, abs=5e-5)
    assert film.prestretch == pytest.approx((p.prestretch,) * 2, abs=5e-4)
    assert film.relative_permittivity == pytest.approx(p.permittivity, abs=5e-3)


@pytest.mark.once
def test_report_counts_what_the_table_says():
    rows = table("window")
    fitted = [w for w in WINDOWS if w.fitted]
    off = {w: float(rows[f"fig {w.figure} {w.quantity}"]["misfit_widths"]) for w in fitted}
    for w, misfit in off.items():
        value = float(rows[f"fig {w.figure} {w.quantity}"]["value"])
        assert w.misfit(value) == pytest.approx(misfit, abs=2e-4)
    held = sum(misfit == 0 for misfit in off.values())
    hard = [w for w in fitted if w.hard]
    values = {w: float(rows[f"fig {w.figure} {w.quantity}"]["value"]) for w in hard}
    met = [w for w in hard if off[w] == 0 or not w.printed(values[w])]
    assert [w.quantity for w in hard if w not in met] == ["nh_stroke_28_25"]  # 1.0013 by energy
    report = (CONFIGS / "thesis" / "identification.md").read_text(encoding="utf-8")
    assert f"{held} of {len(fitted)} windows hold, {len(met)} of {len(hard)} constraints" in report


@pytest.mark.once
def test_fig_37_needs_more_pre_stretch_in_the_largest_device():
    """One displacement strains a longer strip less: with one film the stress cannot increase."""
    p = identified()
    push = [Target(u=1.0), Target(u=2.0)]
    small, large = (by_membrane()(Device.of(p, size), push)[-1] for size in (100, 200))
    assert large.radial_stress < 0.95 * small.radial_stress
    needed, stress = larger_prestretch_of_200(p)
    assert stress == pytest.approx(small.radial_stress)
    assert 0.02 < needed - p.prestretch < 0.05
