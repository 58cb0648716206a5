"""Beyond a limit point: snapping through is found, what no motion leads to is refused."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import case
from verification.references import balloon
from verification.references.laws import gent

import dealib
from dealib.errors import NotConverged

INFLATED = "[{stage: inflate, chamber: {pressure: PRESSURE kPa}, steps: 7}]"


def test_a_balloon_snaps_through_under_pressure_and_never_through_its_axis(caplog):
    """From 4.2 to 4.9 kPa Newton's method goes to the balloon inside out, at negative radii."""
    caplog.set_level("INFO", "dealib.program.increments")
    grown = case("devices/balloon", program=INFLATED.replace("PRESSURE", "4.9"))
    rows = [state.row for state in dealib.Simulation(grown)]
    assert "the body went through its axis" in caplog.text
    given = balloon.Balloon(gent(0.02, 30.0), 10.0, 2.0, 0.0, thick=True)
    for row, wanted, within in ((rows[6], 4.2, 1e-4), (rows[-1], 4.9, 3e-4)):  # of this mesh
        stretch = (1 + 2 * row["volume_mm3"] / balloon.volume(given, 1.0)) ** (1 / 3)
        assert row["pressure_kPa"] == pytest.approx(wanted)
        assert 1e3 * balloon.pressure(given, stretch) == pytest.approx(wanted, rel=within)
    assert rows[-1]["volume_mm3"] > 20 * rows[6]["volume_mm3"]


def test_a_balloon_that_bursts_stops_with_what_to_do():
    """Of a neo-Hookean balloon there is no state above its largest pressure."""
    film = "{law: neo_hookean, shear_modulus: 20 kPa, bulk_modulus: 2 GPa,"
    grown = case(
        "devices/balloon",
        program=INFLATED.replace("PRESSURE", "8"),
        materials__film=f"{film} relative_permittivity: 4.7}}",
        solver__max_cuts=2,
    )
    with pytest.raises(NotConverged, match="the largest pressure, prescribe the volume instead"):
        list(dealib.Simulation(grown))


@pytest.mark.parametrize("modes", [0, 1])
def test_what_turns_over_must_be_stable(modes, monkeypatch):
    """A strip that has turned by 100 degrees in one increment, or by 80."""
    strip = case("devices/pure_shear_strip", mesh__columns=4)
    engine = next(iter(dealib.Simulation(strip))).engine
    leaps = engine.leaps
    monkeypatch.setattr(engine.newton, "unstable_modes", lambda: modes)
    leaps.check()
    before = leaps._before
    for degrees in (80, 100):
        c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
        monkeypatch.setattr(leaps, "_deformation", lambda c=c, s=s: before @ turn(c, s))
        if degrees > 90 and modes:
            with pytest.raises(NotConverged, match="turned over"):
                leaps.check()
        else:
            leaps.check()


def turn(c, s):
    """A rotation about the third axis."""
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
