"""Motion in time against closed forms, conservation laws and independent solutions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import case, history
from laminates import FILM, config, layer, rows
from pydantic import ValidationError
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit
from test_parallel import finish, start
from verification.references import balloon
from verification.references.laws import gent

import dealib
from dealib.config import resolved
from dealib.config.program import Stage
from dealib.config.wave import Wave
from dealib.errors import ConfigError
from dealib.units import EPSILON_0

FIXED = {"time_tolerance": 0}
SCRIPT = Path(__file__).parent / "parallel_run.py"

# --- rigid motion --------------------------------------------------------------------------------


def flight(stage: dict[str, object], **sections: object) -> pd.DataFrame:
    """A body of 10 x 5 x 0.4 mm^3 and 20 mg that one mount carries whole, in motion."""
    given = config(
        "strip",
        layer(thickness="0.4 mm"),
        materials={"film": FILM | {"density": "1000 kg/m^3"}},
        holds=[],
        solver=FIXED,
        **sections,
    )
    move = Stage.model_validate({"stage": "fly", "dynamic": True, "duration": "0.2 s"} | stage)
    return pd.DataFrame(rows(given.model_copy(update={"program": (move,)})))


def test_free_flight():
    """Newton's law: nothing else holds the body, and the mount's own mass moves with it."""
    mass, omega, F = 2e-8 + 3e-8, 2 * np.pi * 10, 1e-3
    errors = []
    for steps in (50, 100):
        h = flight(
            {"steps": steps, "mount": {"force": {"amplitude": "1 mN", "frequency": "10 Hz"}}},
            mounts={"plate": {"on": "film", "along": "X", "mass": "0.03 g"}},
        )
        t = h["time_s"].to_numpy()
        v = F / (mass * omega) * (1 - np.cos(omega * t))
        x = F / (mass * omega) * (t - np.sin(omega * t) / omega)
        found = h["velocity_mm_per_s"].to_numpy(), h["displacement_mm"].to_numpy()
        errors.append([np.abs(a - b).max() / b.max() for a, b in zip(found, (v, x), strict=True)])
        kinetic = mass / 2 * h["velocity_mm_per_s"].to_numpy() ** 2
        assert h["kinetic_energy_mJ"].to_numpy() == pytest.approx(kinetic, rel=1e-9)
        assert np.abs(h["energy_residual_mJ"]).max() < 1e-9 * kinetic.max()
    assert max(errors[1]) < 1e-2
    assert np.log2(np.array(errors[0]) / errors[1]) == pytest.approx([2, 2], abs=0.1)


@pytest.mark.once
def test_a_rigid_body_spins():
    """Several turns: the moment of inertia is that of the body, whatever way it has turned."""
    inertia, omega = 2e-8 * (10**2 + 0.4**2) / 12, 2 * np.pi * 5
    errors = []
    for steps in (100, 200):
        h = flight(
            {
                "steps": steps,
                "turn": {"moment": {"amplitude": "2.5e-4 N mm", "frequency": "5 Hz"}},
                "mounts": {axis: {"force": "0 N"} for axis in ("plate.X", "plate.Z")},
            },
            mounts={"plate": {"on": "film", "rigid": True}},
        )
        t = h["time_s"].to_numpy()
        turned = 2.5e-4 / (inertia * omega) * (t - np.sin(omega * t) / omega)
        assert turned.max() > 2 * np.pi
        errors.append(np.abs(np.radians(h["rotation_deg"]) - turned).max() / turned.max())
        stays = h[["displacement_mm.plate.X", "displacement_mm.plate.Z"]].to_numpy()
        assert np.abs(stays).max() < 1e-6  # its centre of mass
    assert errors[1] < 3e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


# --- a mass on the film --------------------------------------------------------------------------

MASS = 3e-6  # t
DENSE = {
    "materials__film__density": "960 kg/m^3",
    "materials__electrode__density": "1000 kg/m^3",
    "mounts": "{mount: {on: inner, along: Z, mass: 3 g}}",
    "mesh__columns": 16,
    "mesh__film_rows": 1,
    "solver__time_tolerance": 0,
}
REST = (
    "{stage: push, mount: {displacement: -2 mm}, terminal: {voltage: 2.5 kV}, steps: 4},"
    " {stage: let, mount: {force: -0.3 N}, steps: 2}"
)


def swing(steps: int, duration: str = "40 ms", **changes: object) -> pd.DataFrame:
    """The benchmark with a mass, let go by a lower voltage; the rows of its motion."""
    move = (
        f"{{stage: move, dynamic: true, duration: {duration}, steps: {steps},"
        " terminal: {voltage: {to: 2.4 kV, rise: 4 ms}}}"
    )
    h = history("benchmark_strip", **DENSE | changes, program=f"[{REST}, {move}]")
    return h[h["stage"] == "move"].reset_index(drop=True)


@pytest.mark.once
def test_the_order_in_time_is_two():
    coarse, middle, fine = (swing(n)["displacement_mm"].to_numpy() for n in (50, 100, 200))
    errors = np.abs(coarse - middle[1::2]).max(), np.abs(middle - fine[1::2]).max()
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def sine(t, mean, amplitude, frequency, phase, decay):
    """A damped vibration."""
    return mean + amplitude * np.exp(-decay * t) * np.sin(2 * np.pi * frequency * t + phase)


def vibration(h: pd.DataFrame, column: str = "displacement_mm") -> np.ndarray:
    """Parameters of `sine` after the first 5 ms."""
    t, x = h["time_s"] - h["time_s"].iloc[0], h[column]
    after = t > 5e-3
    guess = (x[after].mean(), np.ptp(x[after]) / 2, 57.0, 0.0, 0.0)
    return curve_fit(sine, t[after], x[after], guess)[0]


def small(**changes: object) -> pd.DataFrame:
    """Small vibrations about 2.5 kV."""
    move = (
        "{stage: move, dynamic: true, duration: 60 ms, steps: 240,"
        " mount: {force: {to: -0.2995 N, rise: 2 ms}}}"
    )
    h = history("benchmark_strip", **DENSE | changes, program=f"[{REST}, {move}]")
    return h[h["stage"] == "move"].reset_index(drop=True)


def test_a_mass_on_the_film_vibrates_at_the_root_of_stiffness_over_mass():
    h = small(sensing__differential=True)
    stiffness = h["mount_stiffness_N_per_mm"].mean()
    frequency = vibration(h)[2]
    assert frequency == pytest.approx(np.sqrt(stiffness / MASS) / (2 * np.pi), rel=2e-3)


@pytest.mark.once
def test_a_step_of_the_voltage_overshoots():
    """To where the same voltage would hold the plate, by what linear vibrations overshoot."""
    h = history("dynamics/step_response")
    before, moving = h[h["stage"] == "hang"].iloc[-1], h[h["stage"] == "switch on"]
    held = history(
        "dynamics/step_response",
        program="[{stage: pull, mount: {force: -0.25 N}, steps: 5},"
        " {stage: hang, mount: {mass: 3 g}},"
        " {stage: switch on, terminal: {voltage: 2.5 kV}, steps: 5}]",
    ).iloc[-1]
    start_, end = before["displacement_mm"], held["displacement_mm"]
    x, t = moving["displacement_mm"].to_numpy(), moving["time_s"].to_numpy() - before["time_s"]
    assert x[-1] == pytest.approx(end, abs=0.2 * abs(end - start_))
    turns = t[1:-1][np.diff(np.sign(np.diff(x))) != 0]
    half = np.diff(turns).mean()
    overshoot = (x.min() - end) / (end - start_)
    assert overshoot == pytest.approx(np.exp(-40 / 2 * half), rel=0.2)
    assert moving["damped_energy_mJ"].iloc[-1] > 5 * np.ptp(moving["energy_residual_mJ"])


@pytest.mark.once
@pytest.mark.parametrize("damping", ["mass", "stiffness"])
def test_rayleigh_damping(damping):
    """Decay a/2 by the mass, b omega^2 / 2 by the stiffness (its share that bends the film)."""
    free = vibration(small(solver__rho=1))
    omega = 2 * np.pi * free[2]
    assert abs(free[4]) < 0.05  # 1/s
    given = {"mass": "20 1/s", "stiffness": f"{20 / omega**2:.9f} s"}[damping]
    h = small(solver__rho=1, **{f"damping__{damping}": given})
    decay = vibration(h)[4]
    assert decay == pytest.approx(10, rel=1e-2 if damping == "mass" else 5e-2)
    assert h["damped_energy_mJ"].is_monotonic_increasing
    left = np.ptp(h["energy_residual_mJ"])
    assert left < 1e-2 * h["damped_energy_mJ"].iloc[-1]


@pytest.mark.once
def test_steps_follow_the_error():
    """Cut where the motion is fast, and grown again; the tolerance is what the error follows."""
    exact = swing(400)
    errors, counts = [], []
    for tolerance in (4e-3, 1e-3):
        h = swing(20, solver__time_tolerance=tolerance)
        there = np.interp(h["time_s"], exact["time_s"], exact["displacement_mm"])
        errors.append(np.abs(h["displacement_mm"] - there).max())
        counts.append(len(h))
    assert 20 < counts[0] < counts[1] < 300
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.slow
def test_energy_over_2000_steps():
    h = swing(2000, "400 ms")
    stored = h["elastic_energy_mJ"] + h["kinetic_energy_mJ"] + h["electric_energy_mJ"]
    after = h["time_s"] - h["time_s"].iloc[0] > 5e-3
    assert np.ptp(h["energy_residual_mJ"][after]) < 1e-6 * stored.abs().max()
    assert 0 < h["numerical_dissipation_mJ"].iloc[-1] < 2e-2 * h["kinetic_energy_mJ"].max()


@pytest.mark.once
def test_branches_and_motion_together():
    """What the branches dissipate is lost to the motion, and the balance closes."""
    branches = "[{shear_modulus: 0.1 MPa, relaxation_time: 5 ms}]"
    changes = {"materials__film__branches": branches, "solver__rho": 1}
    h = small(**changes)
    assert vibration(h)[4] > 5
    lost = h["dissipated_energy_mJ"].iloc[-1] - h["dissipated_energy_mJ"].iloc[0]
    assert np.ptp(h["energy_residual_mJ"]) < 0.05 * lost


# --- chambers and the mixed form -----------------------------------------------------------------


def balloon_motion(steps: int) -> tuple[pd.DataFrame, np.ndarray]:
    """A thick incompressible balloon after a sudden pressure, and its equation of motion."""
    h = history(
        "devices/balloon",
        materials__film__density="1000 kg/m^3",
        solver__time_tolerance=0,
        program=f"[{{stage: swell, dynamic: true, duration: 10 ms, steps: {steps},"
        " chamber: {pressure: {to: 3 kPa, rise: 2 ms}}}]",
    )
    h = h[h["stage"] == "swell"]
    given = balloon.Balloon(gent(0.02, 30.0), 10.0, 2.0, 4.7 * EPSILON_0, thick=True)
    A, B, rho = 10.0, 12.0, 1e-9

    def slope(t: float, y: np.ndarray) -> list[float]:
        a, v = y
        b = (B**3 - A**3 + a**3) ** (1 / 3)
        wave = Wave(to=3e-3, rise="2 ms")
        mass = 4 * np.pi * rho * a**4 * (1 / a - 1 / b)
        d_mass = 4 * np.pi * rho * (3 * a**2 - 4 * a**3 / b + a**6 / b**4)
        net = wave.at(t, 0.0) - balloon.pressure(given, a / A, 0.0)
        return [v, (4 * np.pi * a**2 * net - d_mass * v**2 / 2) / mass]

    found = solve_ivp(slope, (0, 0.01), [A, 0.0], rtol=1e-9, atol=1e-12, t_eval=h["time_s"])
    return h, 2 / 3 * np.pi * (found.y[0] ** 3 - A**3)


@pytest.mark.once
def test_a_balloon_swells_and_swings_back():
    """Finite motion of an incompressible body under a follower pressure; no step jitters."""
    (coarse, _), (fine, exact) = balloon_motion(50), balloon_motion(100)
    assert np.ptp(exact) > 0.9 * exact.max()
    raw, finer = (h["volume_mm3"].to_numpy() for h in (coarse, fine))
    errors = np.abs(raw - exact[1::2]).max(), np.abs(finer - exact).max()
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    limit = (4 * finer[1::2] - raw) / 3
    assert limit == pytest.approx(exact[1::2], abs=2e-3 * exact.max())
    turns = np.diff(np.sign(np.diff(finer))).astype(bool).sum()
    assert turns == np.diff(np.sign(np.diff(exact))).astype(bool).sum()


@pytest.mark.once
def test_a_driven_volume_has_a_smooth_pressure():
    """Constraints hold at the end of a step: the pressure that they take does not alternate."""
    h = history(
        "devices/balloon",
        materials__film__density="1000 kg/m^3",
        solver__time_tolerance=0,
        program="[{stage: pump, dynamic: true, duration: 20 ms, steps: 100,"
        " chamber: {volume: {amplitude: 200 mm^3, frequency: 50 Hz, rise: 10 ms}}}]",
    )
    p = h.loc[h["stage"] == "pump", "pressure_kPa"].to_numpy()[4:]
    second = np.abs(np.diff(p, 2)).max()
    assert second < 3 * (2 * np.pi / 100) ** 2 * np.abs(p).max()


def test_enclosed_gas_has_a_smooth_pressure():
    """Boyle's law holds at the end of every step, and what it gives does not alternate."""
    h = history(
        "devices/balloon",
        materials__film__density="1000 kg/m^3",
        solver__time_tolerance=0,
        program="[{stage: close, chamber: {gas: {volume: 4 ml, pressure: 101.325 kPa}}},"
        " {stage: drive, dynamic: true, duration: 20 ms, steps: 100,"
        " terminal: {voltage: {amplitude: 1 kV, frequency: 50 Hz, rise: 5 ms}}}]",
    )
    p, V = h["pressure_kPa"].to_numpy(), h["volume_mm3"].to_numpy()
    assert (101.325 + p) * (4000 + V) == pytest.approx(101.325 * 4000, rel=1e-12)
    assert np.ptp(p) > 1e-3
    assert np.abs(np.diff(p, 2)).max() < 0.05 * np.ptp(p)


@pytest.mark.once
def test_a_pump_with_valves():
    """What flows is what the chamber takes; through an orifice as Bernoulli and Torricelli say."""
    h = history("dynamics/pump_cycle")
    h = h[h["stage"].isin(["fill", "pump"])]
    inlet, outlet = h["inflow_mm3.inlet"], h["inflow_mm3.outlet"]
    filled = (h["volume_mm3"] - inlet - outlet).to_numpy()
    assert np.ptp(filled) < 1e-6 * filled.max()
    assert inlet.iloc[-1] > 40  # pumped in three strokes
    assert outlet.iloc[-1] < -4
    p, dt = h["pressure_kPa"].to_numpy()[1:], np.diff(h["time_s"])
    driven, rate = 0.205 - p, np.diff(inlet) / dt
    opened = driven > 5e-3
    expected = 0.6 * np.pi / 4 * 1**2 * np.sqrt(2e-3 * driven[opened] / 1e-9)
    assert opened.sum() > 10
    assert rate[opened] == pytest.approx(expected, rel=5e-2)
    assert np.abs(rate[driven < -5e-3]).max() < 1e-2 * expected.max()
    assert np.abs(np.diff(outlet) / dt)[p < 0.217].max() < 1e-2 * expected.max()


def test_gas_flows_until_pressures_are_equal():
    """A balloon that a vessel blows up through a channel: isothermal, p V follows the flow."""
    stages = (
        "[{stage: close, chamber: {gas: {volume: 4 ml, pressure: 101.325 kPa}}},"
        " {stage: fill, duration: 20 s, steps: 200}]"
    )
    openings = "{feed: {conductance: 100 mm^3/s/kPa, pressure: 1 kPa}}"
    h = history(
        "devices/balloon",
        chambers=f"{{air: {{on: inside, openings: {openings}}}}}",
        program=stages,
        solver__time_tolerance=0,
    )
    p, V = h["pressure_kPa"].to_numpy(), h["volume_mm3"].to_numpy()
    assert p[-1] == pytest.approx(1.0, rel=1e-3)
    # what is in it has come through the opening, at the pressure there
    amount = (101.325 + p) * (4000 + V)
    come = amount[1] + (h["inflow_mm3.feed"] - h["inflow_mm3.feed"].iloc[1]) * 102.325
    assert amount[2:] == pytest.approx(come.to_numpy()[2:], rel=1e-8)
    rate = np.diff(h["inflow_mm3.feed"]) / np.diff(h["time_s"])
    assert rate[1:] == pytest.approx(100 * (1 - p[2:]), rel=1e-6, abs=1e-6)


# --- waves ---------------------------------------------------------------------------------------


def test_waves():
    sine_wave = Wave(mean=2.0, amplitude=0.5, frequency="10 Hz", phase="90 deg")
    assert [sine_wave.at(t, 9.0) for t in (0, 0.025, 0.05)] == pytest.approx([2.5, 2.0, 1.5])
    step = Wave(to=3.0, rise="2 ms")
    assert [step.at(t, 1.0) for t in (0, 1e-3, 2e-3, 1)] == pytest.approx([1, 2, 3, 3])
    decay = Wave(to=3.0, time_constant="2 ms")
    assert decay.at(2e-3, 1.0) == pytest.approx(3 - 2 * np.exp(-1))


@pytest.mark.once
def test_a_measured_drive(tmp_path):
    """From a file, and from where the port is in the first step."""
    (tmp_path / "drive.csv").write_text("time [ms];voltage [V]\n0;500\n10;1500\n20;0\n")
    path = tmp_path / "case.yaml"
    text = resolved(case("benchmark_strip", mesh__columns=8, mesh__film_rows=1).config)
    path.write_text(text)
    stage = "{stage: drive, duration: 40 ms, steps: 8, terminal: {voltage: {file: drive.csv}}}"
    given = dealib.load(path, set={"program": f"[{stage}]"})
    h = pd.DataFrame([state.row for state in dealib.Simulation(given)])
    assert h["voltage_kV"].to_numpy() == pytest.approx([0, 1, 1.5, 0.75, 0, 0, 0, 0, 0])
    (tmp_path / "drive.csv").write_text("time [ms];voltage [V]\n0;500\n0;1500\n")
    with pytest.raises(ConfigError, match="times must increase"):
        list(dealib.Simulation(given))
    (tmp_path / "drive.csv").unlink()
    with pytest.raises(ConfigError, match=r"there is no file 'drive.csv'"):
        dealib.load(path, set={"program": f"[{stage}]"})


# --- what it refuses, remembers and shares -------------------------------------------------------


@pytest.mark.once
def test_what_moves_needs_a_density():
    moving = "[{stage: move, dynamic: true}]"
    with pytest.raises(ConfigError, match=r"materials.electrode.density: this key is missing"):
        case("benchmark_strip", program=moving)
    with pytest.raises(ValidationError, match="of equilibria cannot be dynamic"):
        Stage.model_validate(
            {
                "stage": "x",
                "dynamic": True,
                "follow": {"vary": "voltage", "until": {"charge": "1 uC"}},
            }
        )


class After:
    """Stops a run after a step."""

    def __init__(self, step: int) -> None:
        self.step = step

    def start(self, simulation): ...

    def see(self, state):
        if state.row["step"] == self.step:
            raise KeyboardInterrupt

    def stop(self, error): ...


MOVE = (
    "[{stage: push, mount: {displacement: -1 mm}, steps: 1}, {stage: move, dynamic: true,"
    " duration: 10 ms, steps: 8, mount: {force: {to: -0.1 N, rise: 2 ms}}},"
    " {stage: on, dynamic: true, duration: 5 ms, steps: 4}, {stage: rest, mount: {force: 0 N}}]"
)


def moving(**changes: object) -> dealib.Case:
    """A short motion between two states of rest."""
    return case("benchmark_strip", **DENSE | {"mesh__columns": 8} | changes, program=MOVE)


def test_a_resumed_run_goes_on_moving(tmp_path):
    given = moving(solver__time_tolerance=1e-2, damping__stiffness="10 us")
    whole = dealib.simulate(given, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        dealib.simulate(given, tmp_path / "run", observers=[After(7)])
    resumed = dealib.simulate(given, tmp_path / "run", resume=True)
    assert len(resumed.history) == len(whole.history)
    for name in whole.history.columns.drop(["stage", "newton_iterations"]):
        expected = whole.history[name].to_numpy()
        within = 1e-9 * max(np.abs(expected).max(), 1e-9)
        assert resumed.history[name].to_numpy() == pytest.approx(expected, abs=within), name
    assert resumed.velocity(-2) == pytest.approx(whole.velocity(-2), abs=1e-6)
    assert np.abs(whole.velocity(-2)).max() > 1
    assert whole.velocity(-1) is None
    assert whole.history["kinetic_energy_mJ"].iloc[-1] == 0


@pytest.mark.once
@pytest.mark.mpi
def test_two_ranks_move_alike(tmp_path):
    given = moving(damping__stiffness="10 us")
    one = dealib.simulate(given, tmp_path / "one")
    path = tmp_path / "two.yaml"
    path.write_text(resolved(given.config))
    code, errors = finish(start(2, "-m", "mpi4py", SCRIPT, tmp_path, path))
    assert code == 0, errors
    other = dealib.open(tmp_path / "two")
    for name in one.history.columns.drop(["stage", "newton_iterations"]):
        expected = one.history[name].to_numpy()
        within = 1e-8 * max(np.abs(expected).max(), 1e-9)
        assert other.history[name].to_numpy() == pytest.approx(expected, abs=within), name
