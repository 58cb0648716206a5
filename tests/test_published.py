"""Devices that others have published and solved, in configs/published, against what they found.

Published numbers are those of E. M. Stewart, S. A. Chester, L. Anand, Example codes for coupled
theories in solid mechanics (2025), doi 10.5281/zenodo.14680876, read off pictures: they are good to
3 % of the range that the picture shows. Where ours differ by more, a reference that needs no finite
elements tells which side is wrong.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import CONFIGS, history
from scipy.optimize import brentq, minimize
from verification.references.circle import Circle, at_stretch
from verification.references.laws import Film, gent

from dealib.units import EPSILON_0

pytestmark = pytest.mark.once  # their equations are solved with each by other tests
PUBLISHED = CONFIGS / "published"
READ = 0.03  # of the range: how well a picture is read
MODULUS = 0.015  # MPa
VHB = (0.01536, (0.02606, 0.6074), (0.02653, 6.56), (0.01083, 61.25))  # MPa, s: spring, branches
VHB_PERMITTIVITY = 4.8 * EPSILON_0


def relaxed(time: float, model: Any = VHB) -> float:
    """Shear modulus, MPa, some seconds after a strain that was put on at once."""
    spring, *branches = model
    return spring + sum(G * np.exp(-time / tau) for G, tau in branches)


def test_all_of_them_are_here():
    names = {path.stem for path in PUBLISHED.glob("*.yaml")}
    assert names == {
        "beam", "beam_in_motion", "blister", "cylinder", "disc",
        "gripper", "gripper_six", "helix", "helix_in_motion",
    }  # fmt: skip
    for path in PUBLISHED.glob("*.yaml"):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 40, path.name


def when(h: Any, *volts: float) -> list[float]:
    """Displacements of the tip where the voltage first is what it is said to be."""
    return [float(h["tip_mm"][np.isclose(h["voltage_kV"], v)].iloc[0]) for v in volts]


# --- the pre-stretched disc ----------------------------------------------------------------------

AREAS = {0.1: 1.09, 0.2: 1.46, 0.3: 2.22, 0.4: 2.69, 0.5: 2.95, 0.6: 3.14}
ELECTRODE, PRESTRETCH, LIMIT = 10 / 3, 4.0, 90.0
UNIT = 2.25494 / 0.6  # kV: T0 sqrt(G / eps)


def areas(volts: Any, **changes: object) -> Any:
    """Area of the electrodes over that at rest, at voltages that the disc passes through."""
    return (1 + np.array(when(history("published/disc", **changes), *volts)) / ELECTRODE) ** 2


def test_the_disc_grows_as_published_before_its_law_locks():
    volts = UNIT * np.array(list(AREAS))
    found, wanted = areas(volts), np.array(list(AREAS.values()))
    assert found[:2] == pytest.approx(wanted[:2], abs=READ * (wanted[-1] - 1))
    # the curve is so steep there that the voltage is read no better than the area
    low, high = np.interp([0.3 - READ * 0.6, 0.3 + READ * 0.6], list(AREAS), found)
    assert low < wanted[2] < high
    # the mesh is fine enough: with half as many cells it is the same
    assert areas(volts, mesh__columns=20) == pytest.approx(found, rel=5e-4)


def test_the_disc_is_that_of_ordinary_differential_equations():
    """Incompressible, up to three quarters of the largest area that its law allows."""
    film = Film(gent(MODULUS, LIMIT), 0.2 / PRESTRETCH**2, PRESTRETCH, 4.8 * EPSILON_0)
    device = Circle(film, 10.0, ELECTRODE)
    wanted = [at_stretch(device, PRESTRETCH * a**0.5) for a in (1.09, 1.46, 2.22)]
    volts = [state.voltage for state in wanted]
    drive = ", ".join(f"{v!r} kV" for v in map(float, volts))
    found = areas(
        volts,
        materials__film__bulk_modulus="1500 MPa",
        program__1__terminal__voltage=f"[0 kV, {drive}]",
        program__1__steps=9,
    )
    assert found == pytest.approx([1.09, 1.46, 2.22], rel=1e-3)


def tension(stretch: float, field: float, kappa: float = 1000.0) -> float:
    """Nominal tension of Gent's film that is stretched equally, over G; field: V/T0 sqrt(eps/G)."""

    def slope(thickness: float, own: float, sign: int) -> float:
        volume = stretch**2 * thickness
        squares = 2 * stretch**2 + thickness**2
        g = 1 / (1 - (squares * volume ** (-2 / 3) - 3) / LIMIT)
        shape = g * volume ** (-2 / 3) * (own**2 - squares / 3)
        electric = sign * field**2 / 2 * stretch**2 / thickness
        return float(shape + kappa * (volume - 1) * volume + electric) / own

    locked = (2 * stretch**2 / (LIMIT + 3)) ** 1.5  # least volume, relative
    low, high = max(1.0001 * locked, 0.9) / stretch**2, 2 / stretch**2
    thickness = brentq(lambda t: slope(t, t, 1), low, high)
    return slope(thickness, stretch, -1)


def test_no_film_bears_the_largest_of_the_published_areas():
    """The ring slackens while the electrodes grow: their tension is at most that at rest.

    At 0.4, 0.5 and 0.6 the published areas 2.69, 2.95 and 3.14 would take tensions of 8.7, 16.8 and
    25.7 G; at rest it is 5.8 G. Ours, 2.57, 2.79 and 2.94, take 2.0, 1.7 and 1.5 G.
    """
    rest = tension(PRESTRETCH, 0.0)
    assert rest == pytest.approx(5.81, abs=0.01)
    excess = [tension(PRESTRETCH * AREAS[v] ** 0.5, v) / rest for v in (0.4, 0.5, 0.6)]
    assert excess == pytest.approx([1.49, 2.89, 4.42], abs=0.02)
    ours = areas(UNIT * np.array(list(AREAS)))
    assert ours[3:] == pytest.approx([2.575, 2.791, 2.939], abs=0.003)
    borne = [tension(PRESTRETCH * a**0.5, v) for v, a in zip(AREAS, ours, strict=True)]
    assert np.all(np.diff([rest, *borne]) < 0)


# --- the beam ------------------------------------------------------------------------------------


def test_the_beam_bends_as_published_whatever_the_sign_of_the_voltage():
    h = history("published/beam")
    peaks = when(h, 5.0, -5.0)
    assert peaks == pytest.approx([-12.2, -12.2], abs=READ * 12.2)
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-6)
    assert h["tip_mm"].iloc[[6, 12]].to_numpy() == pytest.approx(0, abs=1e-6)
    # it is elastic, and its energy even in the field: one quarter of a cycle gives all others
    assert h["newton_iterations"].iloc[4:].sum() == 0
    assert h["tip_mm"].iloc[12:].to_numpy() == pytest.approx(h["tip_mm"].iloc[:13], abs=1e-6)


@pytest.mark.slow
def test_the_beam_s_mesh_is_fine_enough():
    drive = {"program__0__terminal__voltage": "[0 kV, 5 kV]", "program__0__steps": 3}
    fine = history("published/beam", mesh__columns=20, mesh__sectors=4, **drive)
    assert when(history("published/beam"), 5.0) == pytest.approx(when(fine, 5.0), rel=0.01)


@pytest.mark.slow
def test_the_beam_swings_while_it_creeps():
    """Published are -2.0 mm at 0.55 s, -3.2 at 2 s, -4.1 at 5 s, with ripples of about 0.53 s.

    Times are read no better than 3 % of the 5 s that the picture shows. With 14 cells along the
    beam instead of 8 all is 0.9 % more.
    """
    h = history("published/beam_in_motion")
    t, tip = h["time_s"].to_numpy(), h["tip_mm"].to_numpy()
    for time, wanted in ((0.55, -2.0), (2.0, -3.2), (5.0, -4.1)):
        near = tip[np.abs(t - time) <= READ * 5]
        assert near.min() - READ * 4.1 <= wanted <= near.max() + READ * 4.1
    low = t[1:-1][(tip[1:-1] < tip[:-2]) & (tip[1:-1] <= tip[2:])]
    assert np.diff(low).mean() == pytest.approx(0.53, rel=0.08)
    # it creeps on, and swings less and less
    assert (np.diff(tip[np.isin(t, low)]) < 0).all()
    assert h["dissipated_energy_mJ"].iloc[-1] > 10 * h["kinetic_energy_mJ"].max()
    work = h["terminal_work_mJ"].iloc[-1]
    assert h["energy_residual_mJ"].abs().max() < 1e-3 * work


# --- the gripper ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_gripper_curls_in_as_published():
    """Published are -32 mm at 3.8 kV and, beyond the turn, -21 mm at 4.4 kV.

    On cells of 4 mm it is -31.3 and -23.6 mm, on those of 2.5 mm -31.3 and -22.9 mm. The published
    model holds only those facets of its irregular mesh that lie in the square of 10 mm with all
    their corners, three quarters of it; a mesh like that, held alike, gives -31.7 and -21.3 mm.
    """
    h = history("published/gripper")
    low, high = when(h, 3.8, 4.4)
    assert low == pytest.approx(-32, abs=READ * 32)
    assert high == pytest.approx(-22.9, abs=READ * 32)
    assert h["tip_mm"].iloc[-1] > h["tip_mm"].min() + 5  # it has turned


# --- the helix -----------------------------------------------------------------------------------


def wound(voltage: float, modulus: float = MODULUS, permittivity: float = 5.0) -> float:
    """How far a cylinder's wall winds up, of what it had, where no edge hinders it.

    An incompressible wall (R, t, Z) that becomes (r, k t, l Z), r' = R / (k l r), with the field of
    a coaxial capacitor: k, l and the inner radius make its potential smallest.
    """
    places, weights = np.polynomial.legendre.leggauss(12)
    radii = (4.9, 5.1)
    half = (radii[1] - radii[0]) / 2
    R, weights = radii[0] + half * (1 + places), half * weights

    def potential(x: Any) -> float:
        inner, k, l = 4.9 + x[0], 1 + x[1], 1 + x[2]
        r = np.sqrt(inner**2 + (R**2 - radii[0] ** 2) / (k * l))
        outer = np.sqrt(inner**2 + (radii[1] ** 2 - radii[0] ** 2) / (k * l))
        squares = (R / (k * l * r)) ** 2 + (k * r / R) ** 2 + l**2
        elastic = -modulus * 175 / 2 * np.log(1 - (squares - 3) / 175) @ (R * weights)
        capacitance = permittivity * EPSILON_0 * k * l / np.log(outer / inner)
        return float(elastic - capacitance * voltage**2 / 2)

    x = np.zeros(3)
    for _ in range(3):
        options = {"xatol": 1e-12, "fatol": 1e-20, "maxiter": 5000}
        x = minimize(potential, x + 1e-6, method="Nelder-Mead", options=options).x
    return float(x[1])


def test_a_wall_hardly_winds_up():
    """To the first order it does not: it would by its growth, but the field is larger inside."""
    degrees = [np.degrees(6 * np.pi * wound(v)) for v in (0.85, 1.37, 2.0)]
    assert degrees == pytest.approx([0.4, 3.5, 23.3], abs=0.2)


@pytest.mark.slow
def test_the_helix_hardly_winds_up():
    """Published is Y = +4.6 mm at 0.85 kV, 0 at 1.18, -4.6 at 1.37, +2.8 at 1.63, -4.8 at 1.82 kV.

    Flat-faced tetrahedra do move so: 2,892 of them, as published, with displacements of second and
    potential and pressure of first order, give +4.6 mm at 0.85 kV and 0 at 1.15 kV, outside dealib.
    At 0.4 kV such ones wind up by 16 degrees, and by 6.1 if the same cells are curved; growth
    without the larger field at the inner face would do so by 6.4. With a potential of second order
    flat ones go to +5.1 mm at 1.2 kV and -3.4 mm at 1.8 kV.

    Curved hexahedra stay between 0 and 3.1 mm: at 2 kV it is 2.0, 2.4 and 2.5 mm
    with 30, 45 and 60 in a turn and 2 across, 2.4 and 3.1 mm with 24 and 45 and 4 across. The wall
    without edges and base is at 2.1 mm.
    """
    h = history("published/helix")
    assert h["tip_mm"].is_monotonic_increasing
    small, middle, large = when(h, 0.85, 1.37, 2.0)
    assert 0 < small < 0.3  # 0.04 mm without edges
    assert 0.3 < middle < 1.0  # 0.32 mm
    turn = 6 * np.pi * wound(2.0)
    assert large == pytest.approx(5.33 * np.sin(turn), rel=0.3)


@pytest.mark.slow
def test_the_helix_in_motion_hardly_moves():
    """Published is Y = +3.4 mm at 0.52 s, -4.5 at 1.26, +6.0 at 2.07 and 4.1 mm at 2.5 s.

    As for the helix at rest, a curved wall hardly winds up: in closed form, without edges and base,
    it moves by 0.14 mm with the modulus after 2.5 s, and by 1.8 mm once all branches have relaxed.
    The published elements on a mesh like theirs of 2,892 flat tetrahedra go to +3.4 mm at 0.52 s,
    -4.7 at 1.26 and +5.8 at 2.07, and are at 3.7 mm after 2.5 s, outside dealib; with dealib's
    potential of second order this mesh goes to +5.7 mm at 1.9 s.
    """
    h = history("published/helix_in_motion")
    t, tip = h["time_s"].to_numpy(), h["tip_mm"].to_numpy()
    slow = (VHB[0], *VHB[2:])  # its first branch relaxes within 1 ms, as published
    rest = 5.33 * np.sin(6 * np.pi * wound(2.0, relaxed(2.5, slow), 4.8))
    assert rest == pytest.approx(0.14, abs=0.02)
    assert np.abs(tip).max() < 0.6  # it swings about there
    assert tip[t > 1.5].mean() == pytest.approx(rest, abs=0.1)
    work = h["terminal_work_mJ"].iloc[-1]
    assert h["energy_residual_mJ"].abs().max() < 1e-3 * work


# --- the gripper with six arms -------------------------------------------------------------------

ARM, LAYER = 50.0, 0.5  # mm


def growth(voltage: float, modulus: float) -> float:
    """Strain in its plane of a layer that is free, for small strains: eps E^2 / (2 Young's)."""
    return VHB_PERMITTIVITY * (voltage / LAYER) ** 2 / (6 * modulus)


def test_the_six_arms_bend_as_two_layers_do():
    """Small and at once: a plate of any outline takes the curvature 3/2 strain over thickness."""
    h = history(
        "published/gripper_six",
        program__0__terminal__voltage="0.3 kV",
        program__0__duration="1 us",
        program__0__dynamic=False,
        program__0__steps=1,
    )
    strain = growth(0.3, relaxed(0.0))
    curvature = 1.5 * strain / (2 * LAYER)
    assert h["height_mm"].iloc[-1] == pytest.approx(-curvature * ARM**2 / 2, rel=0.01)
    along = strain / 2 * ARM - curvature**2 * ARM**3 / 6  # its middle grows, and it bends away
    assert h["tip_mm"].iloc[-1] == pytest.approx(along, rel=0.02)


@pytest.mark.slow
def test_the_six_arms_swing_as_published():
    """Published are +0.3 and -4.9 mm along the arm in five cycles; here in the first two of them.

    Over all five it is between +0.24 and -4.86 mm, on cells of 5 mm instead of 8 between +0.25 and
    -4.83 mm.
    """
    h = history("published/gripper_six", program__0__duration="0.5 s", program__0__steps=100)
    tip = h["tip_mm"]
    assert [tip.max(), tip.min()] == pytest.approx([0.3, -4.9], abs=READ * 5.2)
    assert h["height_mm"].min() < -15  # most of the motion is across
    assert h["energy_residual_mJ"].abs().max() < 1e-3 * h["electric_energy_mJ"].max()


# --- the blister ---------------------------------------------------------------------------------

FILM = 0.612  # mm
UNIT_OF_IT = FILM * (VHB[0] / VHB_PERMITTIVITY) ** 0.5  # kV


def risen(rate: float, **changes: Any) -> tuple[Any, Any]:
    """Voltages over the unit and rises over the film's thickness, at a rate in kV/s."""
    h = history("published/blister", program__0__duration=f"{2.3275 / rate!r} s", **changes)
    return h["voltage_kV"].to_numpy() / UNIT_OF_IT, np.abs(h["tip_mm"].to_numpy()) / FILM


def test_the_blister_rises_as_published():
    """Published is 6.1 times the film's thickness, from an onset near 0.055, at 0.1 kV/s."""
    volts, rise = risen(0.1, program__0__steps=25)
    assert volts[-1] == pytest.approx(0.2, rel=1e-3)
    assert rise[-1] == pytest.approx(6.1, abs=READ * 10)
    assert rise[volts < 0.05].max() < 0.05  # flat before it buckles


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "published", "onset"), [(0.1, 6.1, 0.055), (0.01, 7.9, 0.04), (0.001, 9.0, 0.03)]
)
def test_the_blister_rises_at_three_rates(rate, published, onset):
    """The slower, the more of the branches relax. Cells of 7.5 mm instead of 12 give 0.4 % less.

    It begins to rise about a quarter later than published: nothing but the fringes of the
    electrode's field bends the flat film at first.
    """
    volts, rise = risen(rate)
    assert rise[-1] == pytest.approx(published, abs=READ * 10)
    assert onset < np.interp(0.5, rise, volts) < 1.3 * onset


# --- the cylinder --------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_cylinder_buckles_and_comes_to_rest():
    """Published is its shape alone. Relaxed, the wall grows by 3 % where nothing hinders it.

    A half ring between fixed feet that grew so into half an ellipse would rise by twice that share
    of its radius, 1.2 mm; this one rises by 3.7 mm. Its folds have the same places and depths on
    12 x 24 and 16 x 32 cells. A point between two of them feels each shift: with 50 steps it is at
    4.2 mm, and at 3.73, 4.34, 4.15 and 3.84 mm on 8 x 16, 10 x 20, 12 x 24 and 16 x 32 cells. The
    end moves by 1.849, 1.851, 1.853 and 1.879 mm. A half wave of a thin cylinder's buckling,
    pi sqrt(R h) / (12 (1 - nu^2))^(1/4) = 5.7 mm, is shorter than a shipped cell of 6.25 mm.
    """
    h = history("published/cylinder")
    strain = growth(4.0, VHB[0])
    assert strain == pytest.approx(0.0295, abs=0.0005)
    last = h.iloc[-1]
    assert last["tip_mm"] > 2 * (2 * strain * 20)
    assert 0.4 * 100 * strain < last["end_mm"] < 100 * strain
    assert last["kinetic_energy_mJ"] < 1e-4 * h["kinetic_energy_mJ"].max()
    assert h["energy_residual_mJ"].abs().max() < 2e-3 * last["terminal_work_mJ"]
