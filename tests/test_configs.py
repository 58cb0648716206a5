"""Every config in configs/ is run and asserts physical numbers."""

import itertools

import numpy as np
import pytest
from conftest import CONFIGS, case, history
from synthetic_coupons import FILLED

from dealib.materials import coupon
from dealib.units import EPSILON_0, GRAVITY

WAY = (1, 1.5, 1, 2, 1, 2)  # stretches of softening.yaml
CONFIG_NAMES = {
    "acrylic",
    "bias_double_cone",
    "bias_negative_rate",
    "benchmark_strip",
    "benchmark_strip_air",
    "creep",
    "deap100",
    "deap100_displacement",
    "deap200",
    "deap75",
    "elastosil",
    "harvesting",  # in test_sensing.py
    "hysteresis",
    "margins",  # in test_margins.py
    "membrane",
    "own_mesh",
    "pull_in",
    "sensing",  # in test_sensing.py
    "snap_through",
    "softening",
    "tables",
}


def test_every_shipped_config_is_run_here():
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == CONFIG_NAMES


@pytest.mark.parametrize(
    ("name", "tolerance", "expected"),
    [
        # forces and capacitances on which two independent codes agree to six digits
        ("benchmark_strip", 1e-4, (-1.07523, 355.476, -0.81331, 359.114)),
        ("benchmark_strip_air", 2e-4, (-1.07528, 355.478, -0.81336, 359.117)),
    ],
)
def test_benchmark_strips(name, tolerance, expected):
    h = history(name)
    pushed, actuated = h.loc[12], h.iloc[-1]
    assert pushed["displacement_mm"] == pytest.approx(-3, abs=1e-12)
    assert actuated["voltage_kV"] == pytest.approx(2.5, abs=1e-12)
    got = [s[k] for s in (pushed, actuated) for k in ("force_N", "capacitance_pF")]
    assert got == pytest.approx(list(expected), rel=tolerance)
    assert h.loc[0, "capacitance_pF"] == pytest.approx(230.31, rel=1e-4)


@pytest.mark.once
def test_softening_is_that_of_the_homogeneous_test():
    """The material of the synthetic coupon tests, in pure shear."""
    way = np.concatenate([[1], *(np.linspace(a, b, 401)[1:] for a, b in itertools.pairwise(WAY))])
    path = coupon.Path("pure shear", np.arange(len(way)), way)
    (stress,) = coupon.stresses(path, [FILLED])
    h = history("softening")
    force = h.groupby("stage", sort=False)["force_N"].last().to_numpy()[1:]
    assert force / (40 * 0.5) == pytest.approx(stress[400::400], abs=2e-3 * stress.max())
    first, *_, third = h["force_N"][np.isclose(h["displacement_mm"], 10)]
    assert third < 0.6 * first


def test_deap100_force_control():
    h = history("deap100")
    assert len(h) == 32
    assert h["time_s"].iloc[[0, 10, 11, 21, 31]].tolist() == pytest.approx([0, 10, 15, 25, 35])
    force = case("deap100").config.program[1].mount.force[0]  # the identified pre-load
    assert -0.45 < force < -0.35
    assert h["force_N"].iloc[10:].to_numpy() == pytest.approx(force, abs=1e-8)
    assert h["voltage_kV"].iloc[21] == pytest.approx(2.5)
    stroke = h["displacement_mm"].iloc[21] - h["displacement_mm"].iloc[11]
    assert -0.6 < stroke < -0.2  # mm; the axis of the thesis's Fig. 31 ends at 0.6 mm
    assert h["field_max_MV_per_m"].iloc[21] == pytest.approx(1e2, rel=0.3)  # Fig. 28: order 1e8 V/m
    # the elastic cycle returns to where it began
    columns = ["displacement_mm", "capacitance_pF", "elastic_energy_mJ"]
    assert h.loc[31, columns].to_numpy(float) == pytest.approx(
        h.loc[11, columns].to_numpy(float), rel=1e-7
    )


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("deap75", marks=pytest.mark.once),
        "deap100_displacement",
        pytest.param("deap200", marks=pytest.mark.once),
    ],
)
def test_displacement_control_blocks_the_stroke(name):
    h = history(name)
    held, full = h.loc[11], h.loc[21]
    assert held["displacement_mm"] == full["displacement_mm"]
    assert held["force_N"] < full["force_N"] < 0  # the voltage relieves the mount
    g, film = case(name).config.geometry, case(name).config.materials["film"]
    area = np.pi * (g.outer_radius**2 - g.inner_radius**2)
    flat = EPSILON_0 * film.relative_permittivity * area / g.film_thickness * 1e3
    assert h.loc[0, "capacitance_pF"] == pytest.approx(flat, rel=1e-6)
    assert h["capacitance_pF"].is_monotonic_increasing or held["capacitance_pF"] > flat


def test_membrane_tends_to_its_thin_limit():
    """Annular membrane under an out-of-plane push: F / (mu H a) at u/a = 1 (neo-Hooke)."""
    h = history("membrane")
    pushed = h[(h["voltage_kV"] == 0)].iloc[-1]
    assert pushed["displacement_mm"] == pytest.approx(-10)
    force = [-pushed["force_N"], -h["force_N"].iloc[-1]]  # mu H a = 1 N
    limit = np.array([8.307286, 7.119352])  # at phi~ = 0 and 0.3
    assert force == pytest.approx(limit, rel=7e-3)
    assert (force < limit).all()  # from below
    C = np.array([pushed["capacitance_pF"], h["capacitance_pF"].iloc[-1]])
    thin = np.array([26.584370, 26.734910]) * EPSILON_0 * 3 * 10**2 / 0.1 * 1e3
    assert pytest.approx(thin, rel=7e-3) == C
    assert (thin > C).all()


def test_own_mesh_with_a_mass():
    h = history("own_mesh")
    assert h["force_N"].iloc[4:].to_numpy() == pytest.approx(-0.020 * GRAVITY, abs=1e-8)
    peaks, rest = h.loc[[6, 10], "displacement_mm"], h.loc[[4, 8, 12], "displacement_mm"]
    assert peaks.iloc[0] == pytest.approx(peaks.iloc[1], rel=1e-7)  # both cycles alike
    assert rest.to_numpy() == pytest.approx(rest.iloc[0], rel=1e-7)
    assert peaks.iloc[0] < rest.iloc[0] < -0.5


@pytest.mark.parametrize(
    ("name", "rest", "full"),
    [("bias_negative_rate", -1.18920, -2.00035), ("bias_double_cone", -2.0, -2.25348)],
)
def test_biased_films(name, rest, full):
    """More about them in test_bias.py."""
    h = history(name)
    released = h.index[h["voltage_kV"] == 0].max()
    assert h["displacement_mm"].iloc[released] == pytest.approx(rest, abs=1e-4)
    assert h.loc[h["voltage_kV"].idxmax(), "displacement_mm"] == pytest.approx(full, abs=1e-4)


@pytest.mark.once
@pytest.mark.parametrize(
    ("name", "volts"), [("pull_in", [4.39758]), ("snap_through", [2.53746, 1.48746])]
)
def test_branches_past_limit_points(name, volts):
    """More about them in test_follow.py."""
    h = history(name)
    assert h.loc[h["limit_point"] == 1, "voltage_kV"].tolist() == pytest.approx(volts, abs=1e-4)
    assert h["unstable_modes"].max() == 1
