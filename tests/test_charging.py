"""Electrodes that charge through their resistance in time, against the transmission line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from laminates import config, layer, rows
from scipy.optimize import curve_fit
from test_dynamics import SCRIPT, After
from test_parallel import finish, start

import dealib
from dealib.config import resolved
from dealib.config.program import Stage
from dealib.units import EPSILON_0

STIFF = {"law": "neo_hookean", "youngs_modulus": "100 GPa", "relative_permittivity": 3.0}
LENGTH, WIDTH, HEIGHT, SHEET = 10.0, 5.0, 0.1, 1e-3  # mm; Gohm a square, of each electrode
C = 3 * EPSILON_0 / HEIGHT  # nF / mm^2
TAU = 2 * SHEET * C * LENGTH**2  # s
CAPACITANCE = C * LENGTH * WIDTH  # nF


def line(stage: dict[str, object], **sections: object) -> dealib.Config:
    """A stiff strip whose two electrodes are fed at the same end, in one stage."""
    given = config(
        "strip",
        layer(thickness="0.1 mm"),
        materials={"film": STIFF},
        mesh={"columns": 24},
        sensing={"sheet_resistance": "1 Mohm", "charging": True},
        **sections,
    )
    charge = Stage.model_validate({"stage": "charge", **stage})
    return given.model_copy(update={"program": (charge,)})


def sine(t, amplitude, phase):
    """Of the frequency 2 / (pi TAU)."""
    return amplitude * np.sin(4 / TAU * t + phase)


@pytest.mark.once
def test_it_is_a_transmission_line():
    """Z W / (Rs L) = coth(x) / x with x = sqrt(i omega tau): amplitude and phase of the charge."""
    omega = 4 / TAU
    voltage = {"amplitude": "1 kV", "frequency": f"{omega / 2 / np.pi} Hz", "rise": f"{TAU} s"}
    stage = {
        "duration": f"{5 * TAU} s",
        "steps": 800,
        "terminal": {"voltage": voltage},
    }
    h = pd.DataFrame(rows(line(stage, solver={"time_tolerance": 0})))
    late = h["time_s"] > 3.4 * TAU  # a period
    amplitude, phase = curve_fit(sine, h["time_s"][late], h["charge_uC"][late], (0.01, 0.0))[0]
    x = np.sqrt(1j * omega * TAU)
    Z = 2 * SHEET * LENGTH / WIDTH / (x * np.tanh(x))
    charge = 1 / (1j * omega * Z)
    assert amplitude == pytest.approx(abs(charge), rel=2e-3)
    assert phase == pytest.approx(np.angle(charge), abs=2e-3)
    assert h["capacitance_pF"].to_numpy()[1:] == pytest.approx(1e3 * CAPACITANCE, rel=1e-3)


def step(tolerance: float) -> pd.DataFrame:
    """1 kV within a hundredth of the line's time, which is then left to charge."""
    stage = {
        "duration": f"{3 * TAU} s",
        "steps": 30,
        "terminal": {"voltage": {"to": "1 kV", "rise": f"{TAU / 100} s"}},
    }
    return pd.DataFrame(rows(line(stage, solver={"time_tolerance": tolerance})))


def test_a_step_charges_it_and_loses_half_of_the_energy():
    errors = []
    for tolerance in (1e-3, 1e-4):
        h = step(tolerance)
        t = np.maximum(
            h["time_s"].to_numpy() - TAU / 200, 0
        )  # the rise is symmetric about its middle
        odd = np.pi / 2 * np.arange(1, 400, 2)
        series = (2 / odd**2 * np.exp(-np.outer(t, odd**2) / TAU)).sum(axis=1)
        late = t > TAU / 20
        missed = h["charge_uC"].to_numpy() - CAPACITANCE * (1 - series)
        errors.append(np.abs(missed[late]).max() / CAPACITANCE)
        assert np.abs(h["energy_residual_mJ"]).max() < 2e-2 * CAPACITANCE
    assert errors[1] < 2e-3
    assert errors[1] < errors[0]
    # in the electrodes as much as in the film, but for what the slow start and the end leave
    stored = CAPACITANCE / 2
    assert h["electrode_loss_mJ"].iloc[-1] == pytest.approx(stored, rel=5e-2)


@pytest.mark.once
def test_layers_conduct_as_faces_do():
    """A conducting layer has the sheet's resistance, whatever its thickness."""
    faces = step(1e-3)
    stage = {
        "duration": f"{3 * TAU} s",
        "steps": 30,
        "terminal": {"voltage": {"to": "1 kV", "rise": f"{TAU / 100} s"}},
    }
    given = config(
        "strip",
        layer("low", "0.02 mm", material="electrode"),
        layer(thickness="0.1 mm"),
        layer("high", "0.02 mm", material="electrode"),
        materials={"film": STIFF, "electrode": {"law": "neo_hookean", "youngs_modulus": "1 GPa"}},
        mesh={"columns": 24},
        sensing={"sheet_resistance": "1 Mohm", "charging": True},
        solver={"time_tolerance": 1e-3},
    )
    charge = Stage.model_validate({"stage": "charge", **stage})
    h = pd.DataFrame(rows(given.model_copy(update={"program": (charge,)})))
    at = np.linspace(0.1, 3, 20) * TAU
    one, other = (np.interp(at, x["time_s"], x["charge_uC"]) for x in (faces, h))
    assert other == pytest.approx(one, rel=5e-3)


@pytest.mark.once
def test_three_dimensions_and_two_terminals_charge_alike():
    """A strip solved in its plane; the same with its width; and two of them on one ground."""
    stage = {"stage": "charge", "duration": f"{TAU} s", "steps": 6}
    rise = {"voltage": {"to": "1 kV", "rise": f"{TAU / 4} s"}}
    films = [layer(name, "0.1 mm", material="film") for name in ("film", "second")]
    ends = {"low": {"on": "film.bottom"}, "high": {"on": "second.top"}}
    ground = {"ground": {"on": "film.top", "ground": True}}
    found = []
    for geometry, terminals, inputs in (
        ({"layers": films[:1]}, None, {"terminal": rise}),
        ({"layers": films[:1], "space": "3d"}, None, {"terminal": rise}),
        ({"layers": films}, ends | ground, {"terminals": {"low": rise, "high": rise}}),
    ):
        given = config(
            "strip",
            geometry=geometry,
            terminals=terminals,
            materials={"film": STIFF},
            mesh={"columns": 16, "sectors": 2},
            sensing={"sheet_resistance": "1 Mohm", "charging": True},
            solver={"time_tolerance": 0},
        )
        charge = Stage.model_validate(stage | inputs)
        found.append(pd.DataFrame(rows(given.model_copy(update={"program": (charge,)}))))
    plane, space, stack = found
    for name in ("charge_uC", "electrode_loss_mJ"):
        most = plane[name].max()
        assert space[name].to_numpy() == pytest.approx(plane[name], abs=1e-3 * most), name
    apart = stack[["charge_uC.low", "charge_uC.high"]]
    assert apart["charge_uC.low"].to_numpy() == pytest.approx(apart["charge_uC.high"], rel=1e-6)
    # the ground carries the charge of both, over as much resistance again: slower
    later = apart.sum(axis=1).to_numpy()[1:4] / 2 / plane["charge_uC"].to_numpy()[1:4]
    assert (later < 0.99).all()
    residual = np.abs(stack["energy_residual_mJ"]).max()
    assert residual < 2e-2 * 2 * CAPACITANCE


def test_a_resumed_run_goes_on_charging(tmp_path):
    stage = {
        "duration": f"{TAU} s",
        "steps": 8,
        "terminal": {"voltage": {"to": "1 kV", "rise": f"{TAU / 4} s"}},
    }
    given = line(stage, solver={"time_tolerance": 1e-2})
    case = dealib.Case(given, resolved(given), tmp_path)
    whole = dealib.simulate(case, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        dealib.simulate(case, tmp_path / "run", observers=[After(5)])
    resumed = dealib.simulate(case, tmp_path / "run", resume=True)
    for name in ("charge_uC", "electrode_loss_mJ", "energy_residual_mJ"):
        expected = whole.history[name].to_numpy()
        within = 1e-9 * (CAPACITANCE if name.endswith("mJ") else np.abs(expected).max())
        assert resumed.history[name].to_numpy() == pytest.approx(expected, abs=within), name


def test_what_does_not_go_with_it():
    with pytest.raises(ValueError, match=r"needs sensing\.sheet_resistance"):
        config("strip", sensing={"charging": True})
    both = {"sheet_resistance": "1 kohm", "charging": True, "differential": True}
    with pytest.raises(ValueError, match=r"cannot be combined with sensing\.differential"):
        config("strip", sensing=both)


@pytest.mark.once
@pytest.mark.mpi
def test_two_ranks_charge_alike(tmp_path):
    stage = {
        "duration": f"{TAU} s",
        "steps": 8,
        "terminal": {"voltage": {"to": "1 kV", "rise": f"{TAU / 4} s"}},
    }
    given = line(stage, solver={"time_tolerance": 0})
    one = dealib.simulate(dealib.Case(given, resolved(given), tmp_path), tmp_path / "one")
    path = tmp_path / "two.yaml"
    path.write_text(resolved(given))
    code, errors = finish(start(2, "-m", "mpi4py", SCRIPT, tmp_path, path))
    assert code == 0, errors
    other = dealib.open(tmp_path / "two")
    for name in ("charge_uC", "electrode_loss_mJ"):
        expected = one.history[name].to_numpy()
        within = 1e-8 * np.abs(expected).max()
        assert other.history[name].to_numpy() == pytest.approx(expected, abs=within), name
