"""Bias elements on the mount: their forces, the states they lead to, and the chart of them."""

import csv
import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import case, history
from typer.testing import CliRunner

import dealib
from dealib.cli.app import app
from dealib.config.bias import Bistable, Sampled, SecondFilm, Spring, Table, second_device
from dealib.config.inputs import MountInput
from dealib.device.records import MOUNT, Port
from dealib.errors import ConfigError
from dealib.program.bias_chart import chart
from dealib.program.inputs import Drive, drives, law
from dealib.program.progress import ProgramState
from dealib.units import GRAVITY

pytestmark = pytest.mark.once  # laws of ports, beside which the equations are the same
NEGATIVE, CONE = "bias_negative_rate", "bias_double_cone"
POINTS = {
    "displacement": ("-2 mm", "-1 mm", "1 mm", "2 mm"),
    "force": ("0.05 N", "-0.1 N", "0.1 N", "-0.15 N"),
    "anchor": "0 mm",
}
GRID = np.linspace(-3, 3, 21)
ELEMENTS = [
    Spring(stiffness="0.3 N/mm", anchor="0 mm"),
    Bistable(rate="-0.3 N/mm", well="1.5 mm", anchor="0 mm"),
    Table(**POINTS),
    Sampled(displacement=tuple(GRID), force=tuple(np.sin(GRID))),
]


# --- elements ------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: type(e).__name__)
def test_slope_is_the_derivative_of_the_force_and_continuous(element):
    for x in (-4.0, -2.7, -0.9, 0.0, 0.4, 1.3, 3.5):
        h = 1e-5
        numeric = (element.load(x + h)[0] - element.load(x - h)[0]) / (2 * h)
        assert element.load(x)[1] == pytest.approx(numeric, rel=1e-6, abs=1e-8)
    for x in (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0):  # also where pieces meet
        assert element.load(x - 1e-9)[1] == pytest.approx(element.load(x + 1e-9)[1], abs=1e-6)


def test_the_cubic_rests_at_its_wells_and_pushes_most_between():
    spring = Bistable(rate="-0.3 N/mm", well="1.5 mm", anchor="0 mm")
    assert [spring.load(x)[0] for x in (-1.5, 0.0, 1.5)] == [0, 0, 0]
    assert spring.load(0.0)[1] == 0.3  # pushed away from the anchor
    assert spring.load(1.5)[1] == -0.6  # held at the well, twice as stiff
    peak = spring.load(1.5 / np.sqrt(3))
    assert peak[0] == pytest.approx(0.3 * 1.5 * 2 / (3 * np.sqrt(3)), rel=1e-12)
    assert peak[1] == pytest.approx(0, abs=1e-15)


def test_a_table_meets_its_points_and_stays_between_them():
    table = Table(**POINTS)
    points = list(zip(table.displacement, table.force, strict=True))
    assert [table.load(x)[0] for x, _ in points] == pytest.approx([f for _, f in points])
    for (a, fa), (b, fb) in pairwise(points):
        inside = [table.load(x)[0] for x in np.linspace(a, b, 50)]
        assert min(fa, fb) - 1e-15 <= min(inside)
        assert max(inside) <= max(fa, fb) + 1e-15
    slope = table.load(2.0)[1]
    assert table.load(2.5) == (pytest.approx(-0.15 + 0.5 * slope), slope)


def test_sampled_forces_are_fifth_order():
    errors = []
    for n in (20, 40):
        x = np.linspace(-2, 2, n + 1)
        smooth = Sampled(displacement=tuple(x), force=tuple(x**3 * np.exp(x / 2)))
        at = np.linspace(-1, 1, 37)
        errors.append(max(abs(smooth.load(v)[0] - v**3 * np.exp(v / 2)) for v in at))
    assert np.log2(errors[0] / errors[1]) > 5.5
    assert errors[1] < 1e-8


# --- drives --------------------------------------------------------------------------------------


PLATE = Port(MOUNT, "mount", ("inner",))


def bias(*elements):
    return MountInput.model_validate({"bias": list(elements)})


def test_elements_add_up_and_the_hand_lets_go():
    given = bias({"mass": "10 g"}, {"spring": {"stiffness": "0.2 N/mm", "anchor": "-3 mm"}})
    found = drives(PLATE, given, -1.0, -0.5)
    weight, spring = -0.010 * GRAVITY, -0.2 * (-1 + 3)
    assert law(found, 0.0).balance(-1.0) == (pytest.approx(-0.5), pytest.approx(-0.2))
    assert law(found, 0.5).balance(-1.0)[0] == pytest.approx((-0.5 + weight + spring) / 2)
    assert law(found, 1.0).balance(-1.0)[0] == pytest.approx(weight + spring)
    settled = drives(PLATE, given, -1.0, weight + spring)
    assert len(settled) == 2  # there is nothing to let go of


def test_anchors_move_on_from_where_they_were():
    first = drives(PLATE, bias({"spring": {"stiffness": "0.2 N/mm", "anchor": "-3 mm"}}), 0.0, -0.6)
    moved = bias({"spring": {"stiffness": "0.2 N/mm", "anchor": "-4 mm"}})
    assert drives(PLATE, moved, 0.0, -0.6, first)[0].knots == (-3.0, -4.0)
    other = bias({"spring": {"stiffness": "0.3 N/mm", "anchor": "-4 mm"}})
    assert drives(PLATE, other, 0.0, -0.6, first)[0].knots == (-4.0, -4.0)


def test_progress_survives_json():
    given = bias({"mass": "10 g"}, {"bistable": {"rate": "-0.1 N/mm", "well": "1 mm",
                                                 "anchor": ["0 mm", "-1 mm"]}})  # fmt: skip
    sampled = Drive("a", "mm", "device", (0.0, 1.0), element=ELEMENTS[3])
    progress = ProgramState(drives={"mount": (*drives(PLATE, given, 0.1, 0.3), sampled)})
    again = ProgramState.of(json.loads(json.dumps(progress.plain())))
    assert again == progress
    assert law(again.drives["mount"], 0.3).balance(0.2) == law(
        progress.drives["mount"], 0.3
    ).balance(0.2)


# --- runs ----------------------------------------------------------------------------------------


def test_a_run_on_springs_balances_them():
    h = history(NEGATIVE)
    held = h["stage"] == "actuate"
    u = h.loc[held, "displacement_mm"].to_numpy()
    x = u + 2
    force = 0.25 * x * (1 - (x / 1.5) ** 2) - 0.1 * (u + 4)
    assert h.loc[held, "force_N"].to_numpy() == pytest.approx(force, abs=1e-9)
    assert h.loc[held, "newton_iterations"].max() <= 4  # the springs' slopes are in the tangent
    rest, full = h.iloc[6], h.iloc[16]
    assert (rest["voltage_kV"], full["voltage_kV"]) == (0, 2.5)
    assert full["displacement_mm"] - rest["displacement_mm"] == pytest.approx(-0.8111574, abs=1e-6)
    assert h.iloc[26]["displacement_mm"] == pytest.approx(rest["displacement_mm"], rel=1e-8)


def test_a_spring_of_negative_rate_moves_further_than_a_weight_or_a_spring():
    """All with the same state at rest, so that only the slope of the bias differs."""
    h = history(NEGATIVE)
    rest = h.iloc[6]
    force, u = float(rest["force_N"]), float(rest["displacement_mm"])
    strokes = [abs(h["displacement_mm"].iloc[16] - u)]
    for mount in (
        f"{{mass: {-force / GRAVITY!r} kg}}",
        f"{{bias: [{{spring: {{stiffness: 0.05 N/mm, anchor: {u + force / 0.05!r} mm}}}}]}}",
    ):
        other = history(NEGATIVE, program__2__mount=mount)
        assert other["displacement_mm"].iloc[6] == pytest.approx(u, abs=1e-8)
        strokes.append(abs(other["displacement_mm"].iloc[16] - u))
    negative, weight, spring = strokes
    assert negative == pytest.approx(0.81116, abs=1e-5)
    assert weight == pytest.approx(0.52796, abs=1e-5)
    assert spring < weight < negative / 1.5


def test_double_cone_balances_two_films():
    """Half-way by symmetry; under voltage the forces of two runs are equal and opposite."""
    h = history(CONE)
    assert h["displacement_mm"].iloc[5] == pytest.approx(-2, abs=1e-9)
    u, force = float(h["displacement_mm"].iloc[15]), h["force_N"].iloc[15]
    assert u == pytest.approx(-2.2534838, abs=1e-6)
    program = "[{stage: prestrain}, {stage: push, mount: {displacement: %r mm}, steps: 4}]"
    second = history(CONE, program=program % -(u + 4))
    assert force == pytest.approx(second["force_N"].iloc[-1], rel=1e-7)


def test_a_second_film_of_its_own():
    """A stiffer antagonist, by keys that differ, pulls further at rest and yields less."""
    stiff = "{distance: 4 mm, set: {geometry.film_thickness: 50 um}}"
    program = (
        "[{stage: push, mount: {displacement: -2 mm}, steps: 4},"
        f" {{stage: couple, mount: {{bias: [{{film: {stiff}}}]}}}},"
        " {stage: actuate, terminal: {voltage: 2.5 kV}, steps: 5}]"
    )
    h = history(CONE, program=program)
    u, force = float(h["displacement_mm"].iloc[5]), h["force_N"].iloc[5]
    assert u < -2.05
    alone = history(
        CONE,
        geometry__film_thickness="50 um",
        program="[{stage: push, mount: {displacement: %r mm}, steps: 4}]" % -(u + 4),
    )
    assert force == pytest.approx(alone["force_N"].iloc[-1], rel=1e-7)
    stroke = u - h["displacement_mm"].iloc[-1]
    assert 0 < stroke < 0.2534838


NEO = {"law": "neo_hookean", "youngs_modulus": "1 MPa"}
VHB = {"library": "vhb_4910"}
STIFF, GENT = {"youngs_modulus": "2 MPa"}, {"law": "gent", "j_lim": 50}
MODULI = {"shear_modulus": "1 MPa", "bulk_modulus": "40 MPa"}


@pytest.mark.parametrize(
    ("given", "changes", "wanted"),
    [
        (NEO, STIFF, NEO | STIFF),
        (NEO, STIFF | GENT, STIFF | GENT),
        (NEO, MODULI | GENT, MODULI | GENT),
        (NEO, VHB, VHB),
        (VHB, STIFF, VHB | STIFF),
        (VHB, NEO, NEO),
    ],
)
def test_a_second_film_of_other_stiffness_law_or_library(given, changes, wanted):
    """What is set takes the place of what it rules, as if the film had been written so."""
    same = {"relative_permittivity": 4.03, "prestretch": 1.108}
    film = SecondFilm(distance="4 mm", set={f"materials.film.{k}": v for k, v in changes.items()})
    config = case(CONE, materials__film=given | same).config
    found = second_device(config, film).materials["film"]
    assert found == case(CONE, materials__film=wanted | same).config.materials["film"]


def test_leaving_a_table_is_a_warning(tmp_path):
    table = "{displacement: [-0.5 mm, 0.5 mm], force: [0.05 N, -0.05 N], anchor: -1 mm}"
    program = (
        "[{stage: push, mount: {displacement: -1 mm}, steps: 2},"
        f" {{stage: hang, mount: {{bias: [{{table: {table}}}, {{mass: 30 g}}]}}, steps: 4}}]"
    )
    run = dealib.simulate(case(NEGATIVE, program=program), tmp_path / "run")
    (warning,) = run.info["warnings"]
    assert "is outside the range of a bias element (-1.5 to -0.5 mm)" in warning
    u, force = run.history.iloc[-1][["displacement_mm", "force_N"]]
    assert u < -1.5
    assert force == pytest.approx(-0.1 * (u + 1) - 0.030 * GRAVITY, abs=1e-9)


@pytest.mark.parametrize(
    ("element", "message"),
    [
        ("{mass: 1 g, spring: {stiffness: 1 N/mm, anchor: 0 mm}}", "exclude each other"),
        ("{}", "give one of mass, spring, bistable, table, film"),
        ("{bistable: {rate: 1 N/mm, well: 1 mm, anchor: 0 mm}}", "must be below 0"),
        ("{table: {displacement: [0 mm, 1 mm], force: [0 N], anchor: 0 mm}}", "force: "),
        ("{table: {displacement: [1 mm, 0 mm], force: [0 N, 1 N], anchor: 0 mm}}",
         "must increase, but 0 mm follows 1 mm"),
        ("{film: {distance: 0 mm}}", "must be above 0 mm somewhere"),
        ("{film: {distance: 4 mm, set: {mesh.columns: 2}}}", "mesh.columns: only keys such as"),
        ("{film: {distance: 4 mm, set: {geometry.outer_radius: 2 mm}}}",
         "set: geometry.outer_radius: 2 mm must exceed inner_radius (6.11 mm)"),
        ("{film: {distance: 4 mm, set: {materials.film.law: gent}}}",
         "set: materials.film.law: gent needs shear_modulus and j_lim and bulk_modulus, or "
         "youngs_modulus and j_lim"),
        ("{film: {distance: 4 mm, set: {materials.film.law: gent, "
         "materials.film.youngs_modulus: 1 MPa}}}",
         "set: materials.film.law: gent needs j_lim besides youngs_modulus"),
        ("{film: {distance: 4 mm, set: {materials.film.law: gnet}}}",
         "set: materials.film.law: unknown law 'gnet'; did you mean 'gent'?"),
        ("{film: {distance: 4 mm, set: {materials.film.youngs_modulus: 1 MPa, "
         "materials.film.shear_modulus: 1 MPa}}}",
         "set: materials.film.shear_modulus: give either youngs_modulus or the law's own "
         "parameters"),
        ("{film: {distance: 4 mm, set: {materials.film.youngs_modulus: 1}}}",
         "set: materials.film.youngs_modulus: expected a stress with its unit"),
    ],
)  # fmt: skip
def test_wrong_elements_are_told(element, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        case(NEGATIVE, program__2__mount=f"{{bias: [{element}]}}")


# --- the chart -----------------------------------------------------------------------------------


def test_equilibria_of_the_chart_are_those_of_runs():
    found = chart(case(NEGATIVE))
    h = history(NEGATIVE)
    for volts, row in ((0.0, h.iloc[6]), (2.5, h.iloc[16])):
        (e,) = found.equilibria[volts]
        assert e.displacement == pytest.approx(row["displacement_mm"], abs=1e-8)
        assert e.force == pytest.approx(row["force_N"], abs=1e-8)
        assert e.stable
    (stroke,) = found.strokes()
    assert stroke.length == pytest.approx(0.8111574, abs=1e-6)
    assert stroke.returns
    # the curves themselves, between their solved points
    pushed = history(NEGATIVE, program="[{stage: push, mount: {displacement: -1.2345 mm}}]")
    film = np.interp(-1.2345, found.displacement, found.film[0.0])
    assert film == pytest.approx(pushed["force_N"].iloc[-1], abs=1e-6)


def test_maxwell_branches_relax_in_the_chart():
    slow = "[{shear_modulus: 0.2 MPa, relaxation_time: 5 s}]"
    (e,) = chart(case(NEGATIVE, materials__film__branches=slow)).equilibria[2.5]
    assert e.displacement == pytest.approx(history(NEGATIVE)["displacement_mm"].iloc[16], abs=1e-8)


def on_a_strong_spring(grams):
    spring = "{rate: -0.5 N/mm, well: 1.5 mm, anchor: -1.6 mm}"
    mount = f"{{bias: [{{bistable: {spring}}}, {{mass: {grams} g}}]}}"
    return chart(case(NEGATIVE, program__2__mount=mount))


def test_a_strong_bistable_spring_has_an_unstable_state_between_two():
    found = on_a_strong_spring(20)
    for equilibria in found.equilibria.values():
        assert [e.stable for e in equilibria] == [True, False, True]
        for e in equilibria:  # also the unstable one balances
            x = e.displacement + 1.6
            force = 0.5 * x * (1 - (x / 1.5) ** 2) - 0.020 * GRAVITY
            assert e.force == pytest.approx(force, abs=1e-9)
    assert all(s.returns for s in found.strokes())


def test_a_film_that_snaps_through_and_stays():
    """The upper state vanishes under voltage, and the lower one is there without it too."""
    found = on_a_strong_spring(33)
    assert [e.stable for e in found.equilibria[0.0]] == [True, False, True]
    assert [e.stable for e in found.equilibria[2.5]] == [True]
    lower, upper = found.strokes()
    assert lower.returns
    assert not upper.returns
    assert upper.back == lower.start
    assert upper.end == lower.end
    assert upper.length > 3 * lower.length > 0


def test_command_writes_picture_and_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = case(NEGATIVE).path
    mass = ["--set", "program.2.mount={mass: 14 g}"]
    done = CliRunner().invoke(app, ["bias", str(config), *mass])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "bias_negative_rate-bias.png").stat().st_size > 10_000
    with (tmp_path / "bias_negative_rate-bias-equilibria.csv").open() as file:
        rest, full = csv.DictReader(file)
    assert rest["stable"] == full["stable"] == "1"
    assert float(rest["force_N"]) == pytest.approx(-0.014 * GRAVITY, abs=1e-9)
    stroke = float(rest["displacement_mm"]) - float(full["displacement_mm"])
    assert stroke > 0  # it goes down, and is a length
    assert f"stroke {stroke:.6f} mm" in done.output
    with (tmp_path / "bias_negative_rate-bias.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["displacement_mm", "film_at_0_kV_N", "film_at_2.5_kV_N", "bias_N"]
    assert all(float(r["bias_N"]) == pytest.approx(-0.014 * GRAVITY) for r in rows)
    again = CliRunner().invoke(app, ["bias", str(config), *mass])
    assert isinstance(again.exception, ConfigError)
    assert "exists" in str(again.exception)


def test_what_lies_outside_the_chart_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = [str(case(NEGATIVE).path), "--set", "mesh.columns=12"]

    def call(reach, *options):
        done = CliRunner().invoke(app, ["bias", *config, "--reach", reach, *options])
        assert done.exit_code == 0, done.exception
        return done.stdout.splitlines()

    assert call("-0.2 mm, 0 mm", "--out", "q.png")[:2] == [
        "0 kV: film and bias do not meet within -0.2 .. 0 mm; see --reach",
        "2.5 kV: film and bias do not meet within -0.2 .. 0 mm; see --reach",
    ]
    assert (tmp_path / "q.png").stat().st_size > 10_000
    rest, note, *files = call("-1.5 mm, 0 mm")
    assert rest.split()[:3] == ["0", "kV", "-1.189111"]
    assert note == "2.5 kV: film and bias do not meet within -1.5 .. 0 mm; see --reach"
    assert len(files) == 3


def test_a_stroke_that_ends_outside_the_chart_is_told():
    full = on_a_strong_spring(20)
    rest, up = full.film
    cut = [e for e in full.equilibria[up] if e.displacement > full.equilibria[up][0].displacement]
    found = replace(full, equilibria={rest: full.equilibria[rest], up: cut})
    lower, _, upper = full.equilibria[rest]
    assert [s.start for s in found.strokes()] == [upper]
    (note,) = found.notes()
    assert note.startswith(f"the stroke from {lower.displacement:.6f} mm at 2.5 kV does not end")
    assert full.notes() == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--voltage", "2.5"], "--voltage: expected a voltage with its unit"),
        (["--reach", "-4 mm"], "--reach: expected two displacements"),
        (["--voltage", "0 kV"], "give one with --voltage"),
        (["--set", "program.2.mount={displacement: -2 mm}"], "no stage loads the mount by bias"),
        (["--set", "program.2.mount={force: 0 N}"], "the bias leaves the mount at 0 mm; give the "),
    ],
)
def test_command_explains(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["bias", str(case(NEGATIVE).path), *options])
    assert isinstance(done.exception, ConfigError)
    assert message in str(done.exception)
    assert list(tmp_path.iterdir()) == []
