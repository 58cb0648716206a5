"""The three strips on which two independent codes agree (COMSOL-like model without and with air)."""

from pathlib import Path

import pytest

import dealib

CONFIGS = Path(__file__).parent.parent / "configs"


def rows(name, **changes):
    case = dealib.load(CONFIGS / f"{name}.yaml", set=changes)
    return [state.row for state in dealib.Simulation(case)]


@pytest.mark.parametrize(
    ("name", "tolerance", "expected"),
    [
        ("benchmark_strip", 1e-4, (-1.07523, 355.476, -0.81331, 359.114)),
        ("benchmark_strip_air", 2e-4, (-1.07528, 355.478, -0.81336, 359.117)),
    ],
)
def test_forces_and_capacitances(name, tolerance, expected):
    history = rows(name)
    pushed, actuated = history[12], history[-1]
    assert pushed["displacement_mm"] == pytest.approx(-3, abs=1e-12)
    assert actuated["voltage_kV"] == pytest.approx(2.5, abs=1e-12)
    got = [s[k] for s in (pushed, actuated) for k in ("force_N", "capacitance_pF")]
    assert got == pytest.approx(list(expected), rel=tolerance)
    assert history[0]["capacitance_pF"] == pytest.approx(230.31, rel=1e-4)
