"""The minimum-energy structure of the gallery: a frame that its film folds, and voltage unfolds."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from runpy import run_path
from typing import Any

import numpy as np
import pytest
from conftest import CONFIGS, history

pytestmark = pytest.mark.once  # their equations are solved with each by other tests
TURN = "rotation_deg.tip.about_Y"
MOMENT = "moment_Nmm.tip.about_Y"
NAME = "devices/minimum_energy_structure"


def ends(h: Any) -> Any:
    """The last row of each stage."""
    return h.groupby("stage", sort=False).last()


def check(h: Any) -> None:
    """What holds on any mesh."""
    at = ends(h)
    rest, released, driven = (at.loc[name] for name in ("prestrain", "release", "actuate"))
    # flat, it pulls at the tip with sigma_X = G (l1^2 - 1 / (l1 l2)^2) of all of the film's width
    film = 0.3 * (1.3**2 - (1.3 * 1.1) ** -2) * 0.05 * 10
    assert rest["force_N.tip.X"] == pytest.approx(film, rel=0.1)
    # led up, it soon wants to go further by itself: its moment changes its sign on the way
    fold = h[h["stage"] == "fold"]
    assert (fold[TURN].diff()[1:] < 0).all()
    assert fold[MOMENT].iloc[-1] > fold[MOMENT].min()
    # let go, nothing holds it, and its energy is the least of all that it went through
    for name in (MOMENT, "force_N.tip.X", "force_N.tip.Z"):
        assert released[name] == pytest.approx(0, abs=1e-7)
    assert released["elastic_energy_mJ"] == h["elastic_energy_mJ"].min()
    assert released["displacement_mm.tip.Z"] > 0  # towards the film
    # voltage unfolds it, more and more
    drive = h[h["stage"] == "actuate"]
    assert (np.diff([released[TURN], *drive[TURN]]) > 0).all()
    assert (np.diff(drive[TURN], 2)[np.diff(drive["voltage_kV"], 2) == 0] > 0).all()
    # and does the work that is stored: the mount moves freely
    stored = driven["elastic_energy_mJ"] - released["elastic_energy_mJ"]
    work = driven["terminal_work_mJ"] - released["terminal_work_mJ"]
    assert stored > 1e-3
    assert driven["electric_energy_mJ"] + stored == pytest.approx(work, rel=2e-3)
    assert driven["field_max_MV_per_m"] == pytest.approx(60, rel=0.15)


def test_on_a_coarse_mesh(tmp_path: Path) -> None:
    """Four cells along the window fold half as much, but all is there."""
    make = run_path(str(CONFIGS.parent / "meshes" / "make.py"))
    file = make["write"](tmp_path / "fold.msh", partial(make["fold"], (1, 4, 2, 1)))
    h = history(
        NAME, geometry__file=str(file), program__1__turns="{tip.about_Y: {rotation: -30 deg}}"
    )
    check(h)


@pytest.mark.slow
def test_folded_and_unfolded() -> None:
    """53.0 and 36.0 degrees; 8 cells along the window give 46.0 and 32.7, 18 give 55.3 and 37.0."""
    h = history(NAME)
    check(h)
    at = ends(h)
    assert at.loc["release", TURN] == pytest.approx(-53.0, abs=0.3)
    assert at.loc["actuate", TURN] == pytest.approx(-36.0, abs=0.3)
