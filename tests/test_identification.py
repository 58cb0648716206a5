"""The identification: its membrane model, its windows, and what the configs took from it."""

import csv
import sys

import numpy as np
import pytest
from conftest import CONFIGS, case

sys.path.insert(0, str(CONFIGS / "thesis"))
from devices import Device, Parameters, Target, by_finite_elements, by_membrane
from membrane import Layer, Membrane
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


def test_membrane_and_finite_elements_agree_on_the_identified_device():
    device = Device.of(identified())
    targets = [Target(u=1.0), Target(u=2.0), Target(u=2.0, V=2.5)]
    thin, full = by_membrane()(device, targets), by_finite_elements(device, targets)
    for a, b in zip(thin, full, strict=True):
        assert pytest.approx(b.F, rel=0.05) == a.F  # no bending in the membrane
        assert pytest.approx(b.C, rel=0.005) == a.C
    assert thin[-1].charge_density == pytest.approx(full[-1].charge_density, rel=0.01)


def test_strokes_fall_with_the_mass_at_the_identified_parameters():
    # Fig. 31; at more pre-stretch, or with half the Maxwell stress, they do not
    def strokes(solve, **changes):
        device = Device.of(Parameters(**{**vars(identified()), **changes}))
        targets = [Target(F=f, V=v) for f in (0.05, 0.1, 0.2745) for v in (0.0, 2.5, 0.0)]
        states = solve(device, targets)
        return [states[k + 1].u - states[k].u for k in (0, 3, 6)]

    falling = strokes(by_finite_elements)
    assert falling[0] > falling[1] > falling[2] > 0.3
    rising = strokes(by_membrane(), prestretch=1.25)
    assert rising[0] < rising[1] < rising[2]
    half = strokes(by_membrane("maxwell_traction"))
    assert max(half) < 0.6 * max(falling)


@pytest.mark.parametrize("name", ["deap75", "deap100", "deap100_displacement", "deap200"])
def test_configs_hold_the_identified_values(name):
    p, config = identified(), case(name).config
    size = name.split("_")[0].removeprefix("deap")
    g, film = config.geometry, config.materials.film
    assert g.inner_radius == pytest.approx(getattr(p, f"inner_{size}"), abs=0.005)
    assert g.outer_radius == pytest.approx(getattr(p, f"outer_{size}"), abs=0.005)
    assert g.film_thickness == pytest.approx(p.film_thickness, abs=5e-5)
    assert film.prestretch == pytest.approx((p.prestretch,) * 2, abs=5e-4)
    assert film.relative_permittivity == pytest.approx(p.permittivity, abs=5e-3)


def test_report_counts_what_the_table_says():
    rows = table("window")
    fitted = [w for w in WINDOWS if w.fitted]
    off = {w: float(rows[f"fig {w.figure} {w.quantity}"]["misfit_widths"]) for w in fitted}
    for w, misfit in off.items():
        value = float(rows[f"fig {w.figure} {w.quantity}"]["value"])
        assert w.misfit(value) == pytest.approx(misfit, abs=2e-4)
    held = sum(misfit == 0 for misfit in off.values())
    report = (CONFIGS / "thesis" / "identification.md").read_text(encoding="utf-8")
    assert f"{held} of {len(fitted)} windows hold" in report
