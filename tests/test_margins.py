"""Margins: closed forms of each, where the worst is, what ends a stage or a run."""

import json
import shutil
from itertools import pairwise

import numpy as np
import pytest
from conftest import CONFIGS, case, film_of, history, thinned
from laminates import config
from laminates import rows as laminate_rows
from scipy.optimize import minimize_scalar
from typer.testing import CliRunner
from watch import At

import dealib
from dealib.cli.app import app
from dealib.errors import ConfigError
from dealib.materials.response import stability_limit
from dealib.observe.columns import columns
from dealib.results import stress
from dealib.results.elements import Cell
from dealib.results.margins import fields
from dealib.results.summary import alarms, margins
from dealib.results.thickness import Columns, edges
from dealib.units import EPSILON_0

pytestmark = pytest.mark.once  # of stresses in numpy, and conditions of a program
SMALL = CONFIGS.parent / "tests" / "small.yaml"


def small(**changes):
    return dealib.load(SMALL, set={k.replace("__", "."): v for k, v in changes.items()})


def rows(given):
    return [state.row for state in dealib.Simulation(given)]


def film(**changes):
    return film_of(small(**changes).config)


def deformation(F, e):
    return stress.Deformation(F, np.linalg.det(F), np.linalg.inv(F), e)


def homogeneous(l1, l2, field):
    """A film that is stretched incompressibly, and a true field across it."""
    F = np.diag([l1, 1 / (l1 * l2), l2])
    return deformation(F, np.array([0.0, field, 0.0]))


MOONEY = {
    "materials__film": "{law: mooney_rivlin, c10: 0.4 MPa, c01: 0.1 MPa, bulk_modulus: 50 MPa, "
    "relative_permittivity: 3.0}"
}
NEO = {
    "materials__film": "{law: neo_hookean, shear_modulus: 1 MPa, bulk_modulus: 50 MPa, "
    "relative_permittivity: 3.0}"
}


@pytest.mark.parametrize(
    ("given", "second", "peak"), [(NEO, 0, 2 ** (1 / 3)), (MOONEY, 0.2, 1.32077)]
)
def test_pull_in_of_a_free_block(given, second, peak):
    """Equal-biaxial: it is lost at the peak of the voltage, phi~ = 0.687365 and 0.731118."""
    found = film(**given)

    def phi(l):  # (V/H) sqrt(eps/mu) in equilibrium
        return np.sqrt((l**-2 - l**-8) * (1 - second + second * l**2))

    def use(l):
        true = phi(l) / np.sqrt(3 * EPSILON_0) * l**2  # mu = 1 MPa
        return float(found.pull_in(homogeneous(l, l, true)))

    top = minimize_scalar(lambda l: -phi(l), bounds=(1.1, 1.5), options={"xatol": 1e-10}).x
    assert top == pytest.approx(peak, abs=5e-6)
    assert use(top) == pytest.approx(1, abs=1e-6)
    assert use(top - 0.01) < 1 < use(top + 0.01)
    if second == 0:  # A - q [[1, 2], [2, 1]] along (1, 1): 3 q = l^2 + 5 l^-4
        for l in (1.05, 1.15, 1.4):
            assert use(l) ** 2 == pytest.approx(3 * (l**2 - l**-4) / (l**2 + 5 * l**-4), rel=1e-6)
    assert use(1.0) == 0


@pytest.mark.parametrize("slope", [0.0, -0.8, 0.5])
def test_pull_in_of_unequal_stretches_is_where_the_hessian_is_singular(slope):
    """W(l1, l2, D) of Zhao and Suo: its Hessian by finite differences, D at the critical field."""
    given = MOONEY["materials__film"].replace("3.0}", f"{{intercept: 3, slope: {slope}}}}}")
    found, (l1, l2) = film(materials__film=given), (1.5, 1.1)
    use = float(found.pull_in(homogeneous(l1, l2, 50.0)))
    true, h = 50.0 / use, 1e-4

    def eps(a, b):
        return (3 + slope * np.sqrt(a * b)) * EPSILON_0

    def W(x):
        a, b, D = x[0], x[1], x[2]  # D is nominal
        i1, i2 = a**2 + b**2 + (a * b) ** -2, a**-2 + b**-2 + (a * b) ** 2
        return 0.4 * (i1 - 3) + 0.1 * (i2 - 3) + D**2 / (2 * eps(a, b) * (a * b) ** 2)

    x0 = np.array([l1, l2, eps(l1, l2) * true * l1 * l2])
    steps = h * np.diag([1, 1, x0[2]])
    hessian = np.array(
        [
            [W(x0 + a + b) - W(x0 + a - b) - W(x0 - a + b) + W(x0 - a - b) for a in steps]
            for b in steps
        ]
    ) / (4 * h**2)
    eigenvalues = np.linalg.eigvalsh(hessian)  # the third coordinate in units of itself
    assert abs(eigenvalues[0]) < 1e-5 * eigenvalues[-1]
    assert eigenvalues[1] > 0


def test_without_stiffness_there_is_no_margin():
    soft = film(
        materials__film="{law: mooney_rivlin, youngs_modulus: 1 MPa, relative_permittivity: 3}"
    )
    # equal-biaxial dead loads: the peak of l - l^-5 - l^3/3 + l^-3/3 is near 1.3
    assert np.isfinite(soft.pull_in(homogeneous(1.25, 1.25, 1.0)))
    assert np.isinf(soft.pull_in(homogeneous(1.31, 1.31, 0.0)))


def test_softening_is_whole_at_the_stability_limit():
    soft = film(
        materials__film="{law: mooney_rivlin, youngs_modulus: 1 MPa, relative_permittivity: 3}"
    )
    assert soft.softens
    assert not film().softens
    limit = stability_limit(soft.law, "equal-biaxial")
    assert float(soft.softening(homogeneous(limit, limit, 0).F)) == pytest.approx(1, abs=1e-6)
    assert float(soft.softening(np.eye(3))) == pytest.approx(0, abs=1e-6)


def test_a_law_that_locks():
    gent = "law: gent, youngs_modulus: 1 MPa, j_lim: 8, relative_permittivity: 3, prestretch: 1.5"
    found = film(materials__film=f"{{{gent}}}")
    l = 2.0
    assert float(found.extension(homogeneous(l / 1.5, l / 1.5, 0).F)) == (
        pytest.approx((2 * l**2 + l**-4 - 3) / 8)
    )
    row = rows(small(materials__film=f"{{{gent}}}", program="[{stage: rest}]"))[0]
    assert row["locking_use"] == pytest.approx((2 * 1.5**2 + 1.5**-4 - 3) / 8)
    assert "locking_use" not in history("margins")


def test_tension_of_a_flat_film_under_voltage():
    """Clamped and flat it cannot move: tension G (l^2 - l^-4) - eps e^2, lost at use 1."""
    G, l, H = 1.0, 1.1, 0.05
    given = small(
        mesh__columns=4,
        physics__formulation="mixed",
        materials__film="{law: neo_hookean, shear_modulus: 1 MPa, bulk_modulus: 1e5 MPa, "
        "relative_permittivity: 3.0, prestretch: 1.1}",
        program="[{stage: up, terminal: {voltage: 8 kV}, steps: 4}]",
    )
    mounted = G * (l**2 - l**-4)
    for row in rows(given):
        taken = 3 * EPSILON_0 * (row["voltage_kV"] / H) ** 2
        assert row["tension_min_MPa"] == pytest.approx(mounted - taken, abs=2e-5)
        assert row["wrinkling_use"] == pytest.approx(taken / mounted, abs=5e-5)
    assert row["wrinkling_use"] > 1 > row["pull_in_use"]


def test_wrinkling_counts_from_the_smaller_tension_of_the_pre_stretch():
    stiff = NEO["materials__film"].replace("50 MPa", "1e6 MPa")
    stiff = stiff.replace("}", ", prestretch: [1.2, 1.1]}")
    lz = 1 / (1.2 * 1.1)  # neo-Hooke: s_i = G (l_i^2 - l_z^2)
    assert film(materials__film=stiff).tension == pytest.approx(1.1**2 - lz**2, rel=1e-5)
    bare = rows(small(materials__film__prestretch=1, program="[{stage: rest}]"))[0]
    assert bare["wrinkling_use"] == pytest.approx(0, abs=1e-9)  # no tension to lose


@pytest.mark.parametrize("prestretch", [1, 1 + 1e-5])
def test_a_film_without_tension_wrinkles_where_it_is_compressed(prestretch):
    """By a thousandth of its shear modulus; rounding is no compression."""
    G = 1.0
    found = film(
        materials__film=NEO["materials__film"].replace("}", f", prestretch: {prestretch}}}")
    )
    assert found.tension == pytest.approx(6 * G * (prestretch - 1), rel=0.1, abs=1e-12)

    def use(tension):
        return float(found.wrinkling(np.array([found.tension + 0.2, found.tension + tension, 0])))

    assert use(0) == pytest.approx(0, abs=1e-12)
    assert use(-1e-9 * G) == pytest.approx(0, abs=1e-5)
    assert use(-1e-3 * G) == pytest.approx(1)
    assert use(-0.01 * G) == pytest.approx(10)
    assert use(0.1 * G) == pytest.approx(-0.1)


def test_a_free_disc_does_not_wrinkle():
    """It grows without stress under voltage, to rounding."""
    given = config(
        "disc",
        mounts={},
        holds=[{"on": ["film.bottom"], "fix": ["Z"]}],
        program=[{"stage": "actuate", "terminal": {"voltage": "25 kV"}, "steps": 2}],
    )
    row = laminate_rows(given)[-1]
    assert row["stretch_max"] > 1.02
    assert row["wrinkling_use"] == pytest.approx(0, abs=1e-3)


def test_tension_of_maxwell_branches():
    """Pushed at once, a branch is a spring beside the law; after long it bears nothing."""
    law = "law: neo_hookean, bulk_modulus: 20 MPa, relative_permittivity: 3, shear_modulus:"
    push = "mount: {displacement: -1 mm}, steps: 2"
    found = {}
    for name, film_, duration in (
        (
            "fast",
            f"{law} 0.3 MPa, branches: [{{shear_modulus: 0.2 MPa, relaxation_time: 1 s}}]",
            1e-6,
        ),
        (
            "slow",
            f"{law} 0.3 MPa, branches: [{{shear_modulus: 0.2 MPa, relaxation_time: 1 s}}]",
            1e8,
        ),
        ("stiff", f"{law} 0.5 MPa", 1),
        ("soft", f"{law} 0.3 MPa", 1),
    ):
        given = small(
            materials__film=f"{{{film_}}}",
            program=f"[{{stage: push, duration: {duration} s, {push}}}]",
        )
        found[name] = rows(given)[-1]["tension_min_MPa"]
    assert found["fast"] == pytest.approx(found["stiff"], rel=1e-6)
    # C_i is kept at the quadrature points: interpolated to the Gauss points it is C nearly
    assert found["slow"] == pytest.approx(found["soft"], rel=1e-3)
    assert found["stiff"] > 1.5 * found["soft"]


def test_average_through_the_thickness():
    """Over two columns of unequal cells: by deformed area, whatever the order of the cells."""
    boxes = [(0, 0, 1, 1), (0, 1, 1, 3), (1, 0, 3, 2), (1, 2, 3, 3)]  # R0, Z0, R1, Z1
    corners = np.array([[(a, b), (c, b), (c, d), (a, d)] for a, b, c, d in boxes], float)
    corners[..., 0] += 5
    along = corners[..., 0].mean(axis=1, keepdims=True)
    radii = edges(Cell("quadrilateral", 1), corners, along, 1)
    assert radii.tolist() == [5, 6, 8]
    layer = Columns.of(radii, along, corners, 4)
    F = np.tile(np.eye(3), (4, 1, 1, 1))
    F[1, 0, 1, 1] = 2.0  # the second cell is twice as thick now
    k = deformation(F, np.zeros((4, 1, 3)))
    values = np.array([1.0, 2.0, 3.0, 6.0])[:, None, None]
    assert layer.average(values, k)[:, 0] == pytest.approx([(1 + 4 * 2) / 5, (2 * 3 + 6) / 3])
    assert layer.middles.tolist() == [5.5, 7]


def test_columns_end_at_the_corners_of_the_upper_face():
    """Wherever that is: here it rises to a ridge at R = 7, over a free triangulation."""
    upper, lower = [(5, 1), (6.2, 1.6), (6.3, 1.65), (7, 2), (9.3, 1)], [(5, 0), (9.3, 0)]
    fan = [(lower[0], b, a) for a, b in pairwise(upper)]
    corners = np.array([*fan, (lower[0], lower[1], upper[-1])], float)
    centres = corners[..., 0].mean(axis=1, keepdims=True)  # none lies between 6.2 and 7 mm
    triangle = Cell("triangle", 1)
    assert edges(triangle, corners, centres, 1).tolist() == [5, 7, 9.3]
    everywhere = np.append(centres, [[6.25], [6.5]], axis=0)
    assert edges(triangle, corners, everywhere, 1).tolist() == [5, 6.2, 6.3, 7, 9.3]


def test_margins_and_sheets_of_a_film_that_is_not_flat(tmp_path):
    """A mesh of the user, 1 % thinner at one end or in the middle: nearly the same numbers."""
    changes = {"mesh__columns": 20, "sensing__sheet_resistance": "10 kohm"}
    flat = rows(small(**changes))[-1]
    for thickness in (lambda s: 1 - 0.01 * s, lambda s: 1 - 0.01 * (1 - (2 * s - 1) ** 2)):
        path = thinned(small(**changes), tmp_path / "own.msh", thickness)
        found = rows(small(**changes, mesh__file=str(path)))[-1]
        for key in ("tension_min_MPa", "electrode_resistance_kohm", "rc_time_us"):
            assert found[key] == pytest.approx(flat[key], rel=0.02), key


def test_bending_compresses_one_face_but_not_the_average():
    program = "[{stage: push, mount: {displacement: -1.5 mm}, terminal: {voltage: 2 kV}, steps: 8}]"
    run_case = case("margins", program=program)
    simulation = dealib.Simulation(run_case)
    for state in simulation:
        nodal = state.nodal()
    found = fields(run_case.config, simulation.engine.layout.mesh, nodal)
    assert found["tension"].min() < 0 < state.row["tension_min_MPa"]
    assert found["wrinkling_use"].max() == pytest.approx(state.row["wrinkling_use"], abs=0.1)
    # what the history says at the Gauss points lies between the nodal values
    assert found["stretch_use"].max() == pytest.approx(state.row["stretch_use"], rel=0.05)


def test_limits_are_columns_only_where_they_are_set():
    h = history("margins")
    strength = 150 * 0.8
    assert h["breakdown_use"].to_numpy() == pytest.approx(h["field_max_MV_per_m"] / strength)
    assert h["stretch_use"].to_numpy() == pytest.approx(h["stretch_max"] / 2)
    assert not {"breakdown_use", "stretch_use", "stability_use"} & set(history("benchmark_strip"))
    work = {"mount_work_mJ", "terminal_work_mJ", "energy_residual_mJ"}
    branch = {"unstable_modes", "limit_point", "bifurcation"}
    known = columns(case("margins").config)  # what conditions can watch
    kept = {name for name, column in known.items() if column.quantity.measure is None}
    program = {"step", "time_s", "solved"}
    assert kept == {*program, *work, *branch}  # the others are measured
    assert set(h.columns) - {"stage"} <= set(known)


GENT = "{law: gent, youngs_modulus: 1 MPa, j_lim: 8, relative_permittivity: 3, "
GENT += "branches: [{shear_modulus: 0.1 MPa, relaxation_time: 1 s}]}"
MOONEY_SOFT = "{law: mooney_rivlin, youngs_modulus: 1 MPa, relative_permittivity: 3}"
FOLLOW = "{stage: on, follow: {vary: force, until: {displacement: -2 mm}}}"
EVERYTHING = {
    "limits": "{breakdown_strength: 100 MV/m, stretch_max: 2}",
    "sensing": "{differential: true, sheet_resistance: 10 kohm}",
}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        EVERYTHING | {"materials__film": GENT},
        {
            "materials__film": MOONEY_SOFT,
            "program": f"[{{stage: push, mount: {{force: 0 N}}}}, {FOLLOW}]",
        },
    ],
    ids=["plain", "everything", "follow"],
)
def test_a_condition_may_watch_what_the_run_measures_and_nothing_else(changes):
    given = small(**changes)
    row, known = next(iter(dealib.Simulation(given))).row, columns(given.config)

    def may_be_watched(column):
        try:
            small(stop_when=f"[{column} > 1e9 {known[column].unit}]", **changes)
        except ConfigError:
            return False
        return True

    assert set(filter(may_be_watched, known)) == set(row) - {"stage"}


def test_a_stage_ends_at_the_crossing_and_the_next_begins_there():
    h = history("margins")
    raised = h[h["stage"] == "raise"]
    before, last = raised.iloc[-2], raised.iloc[-1]
    assert before["wrinkling_use"] <= 1 < last["wrinkling_use"]
    assert last["time_s"] - before["time_s"] == pytest.approx(2**-10)  # of a step of 1 s
    assert last["wrinkling_use"] == pytest.approx(1, abs=1e-3)
    grid = raised["time_s"][raised["time_s"] % 1 == 0]
    assert grid.tolist() == [9, 10, 11, 12, 13, 14]  # the steps asked for are there
    lowered = h[h["stage"] == "lower"]
    assert lowered["time_s"].to_numpy() == pytest.approx(last["time_s"] + np.arange(1, 6))
    assert lowered["voltage_kV"].to_numpy() == pytest.approx(
        last["voltage_kV"] * np.array([0.8, 0.6, 0.4, 0.2, 0.0]), abs=1e-12
    )
    assert lowered["force_N"].iloc[-1] == pytest.approx(h["force_N"][8], rel=1e-7)  # elastic


def test_the_finest_condition_that_is_met_rules_the_step():
    """Of two that a whole step would meet, the one without halvings does not hide the other."""
    fine = "{when: displacement_mm < -0.2 mm, bisect: 6}"
    push = f"mount: {{displacement: -1 mm}}, stop_when: [{fine}]"
    simulation = dealib.Simulation(
        small(program=f"[{{stage: push, {push}}}]", stop_when="[displacement_mm < -0.5 mm]")
    )
    *_, before, last = [state.row["displacement_mm"] for state in simulation]
    assert (before, last) == pytest.approx((-12 / 64, -13 / 64), abs=1e-12)
    (stop,) = simulation.progress.stops
    assert (stop["when"], stop["ends"]) == ("displacement_mm < -0.2 mm", "stage")


FIELD = "[field_max_MV_per_m > 30 V/um]"


def test_a_condition_of_the_whole_run_ends_it(tmp_path):
    run = dealib.simulate(small(stop_when=FIELD), tmp_path / "run")
    assert run.status == "done"
    assert run.info["steps"] == len(run.history) - 1 == 14
    assert (
        run.history["field_max_MV_per_m"].iloc[-2]
        <= 30
        < run.history["field_max_MV_per_m"].iloc[-1]
    )
    (stop,) = run.info["stops"]
    assert stop == {
        "step": 14,
        "time_s": 5.5,
        "stage": "actuate",
        "when": "field_max_MV_per_m > 30 V/um",
        "ends": "run",
    }
    assert "ends the run at step 14" in (run.directory / "run.log").read_text()
    shown = CliRunner().invoke(app, ["info", str(run.directory)]).stdout
    assert "run ended by               field_max_MV_per_m > 30 V/um at step 14" in shown
    # killed right after that state: going on adds nothing
    info = run.info | {"status": "interrupted"}
    (run.directory / "run.json").write_text(json.dumps(info))
    again = dealib.simulate(small(stop_when=FIELD), run.directory, resume=True)
    assert again.status == "done"
    assert len(again.history) == 15


def test_resume_after_a_stage_that_was_ended(tmp_path):
    conditions = {"program__1__stop_when": FIELD, "program__1__steps": 32}
    tail = "[{stage: back, terminal: {voltage: 0 V}, steps: 3}]"
    given = small(**conditions)
    text = (SMALL.read_text()).replace(
        "steps: 16}", f"steps: 16, stop_when: {FIELD}}}\n  - {tail[1:-1]}"
    )
    (tmp_path / "case.yaml").write_text(text)
    given = dealib.load(tmp_path / "case.yaml")
    whole = dealib.simulate(given, tmp_path / "whole")
    assert whole.history["stage"].tolist()[-4:] == ["actuate", "back", "back", "back"]

    with pytest.raises(dealib.DealibError, match="enough"):
        dealib.simulate(given, tmp_path / "part", observers=[At(14, dealib.DealibError("enough"))])
    part = dealib.simulate(given, tmp_path / "part", resume=True)
    for column in ("time_s", "voltage_kV", "force_N", "wrinkling_use"):
        assert part.history[column].to_numpy() == pytest.approx(whole.history[column], rel=1e-10)
    assert part.info["stops"] == whole.info["stops"]
    assert part.info["margins"] == whole.info["margins"]


def test_the_table_says_how_much_where_and_when(tmp_path):
    run = dealib.simulate(case("margins", limits__breakdown_strength="95 MV/m"), tmp_path / "run")
    h, found = run.history, run.info["margins"]
    assert list(found) == ["breakdown_use", "wrinkling_use", "pull_in_use", "stretch_use"]
    for name, worst in found.items():
        at = h.loc[worst["step"]]
        assert worst["use"] == pytest.approx(at[name], rel=1e-12)
        assert worst["use"] == pytest.approx(h[name].max(), rel=1e-8)
        assert (worst["time_s"], worst["stage"]) == (at["time_s"], at["stage"])
        assert worst["ok"] == (worst["use"] <= 1)
        assert 6 <= worst["R_mm"] <= 10
        assert abs(worst["Z_mm"]) <= 0.0175
    assert [m["ok"] for m in found.values()] == [False, True, True, True]
    assert run.info["stops"][0]["ends"] == "run"  # breakdown comes before the loss of tension
    # the log has the first crossing, the summary the largest value
    assert run.info["warnings"] == []
    assert "step 14 (raise): breakdown_use = 1.0" in (run.directory / "run.log").read_text()
    largest = f"breakdown {found['breakdown_use']['use']:.3f}"
    shown = CliRunner().invoke(app, ["info", str(run.directory)]).stdout
    assert shown.startswith(f"run (margins): done; LIMIT EXCEEDED: {largest}\n")
    where = "(1 is the limit), step 14, t = 14 s, raise: the film breaks down"
    assert f"LIMIT EXCEEDED: {largest} {where}" in shown
    assert "margins (1 is the limit)" in shown
    assert "exceeded" in next(x for x in shown.splitlines() if x.startswith("  breakdown"))
    from dealib.report.page import render

    page = render(run)
    assert f'<span class="badge limit exceeded">limit exceeded: {largest}</span>' in page
    assert '<div class="tile limit exceeded">' in page
    assert '<span class="badge plain">done</span>' in page  # no green beside it
    # of a run that was killed, from its history
    killed = dict(run.info)
    del killed["margins"]
    (run.directory / "run.json").write_text(json.dumps(killed))
    assert alarms(run) == {"limit exceeded": largest}
    assert margins(run)[0].when.startswith("step 14, t = 14 s, raise")
    # contours: the field of the margin, and what is not there
    for name in ("wrinkling_use", "tension"):
        done = CliRunner().invoke(app, ["plot", str(run.directory), "--field", name])
        assert done.exit_code == 0, done.output
    shutil.rmtree(run.directory / "plots")
    plain = dealib.simulate(small(), tmp_path / "plain")
    done = CliRunner().invoke(app, ["plot", str(plain.directory), "--field", "breakdown_use"])
    assert done.exit_code == 2 or "sets no limit" in str(done.exception)


def test_curves_are_red_beyond_a_limit(tmp_path):
    from dealib.plots import limits, style
    from dealib.plots.curves import curves

    run = dealib.simulate(case("margins", limits__breakdown_strength="95 MV/m"), tmp_path / "run")
    with style.theme():
        figure = curves([run], "voltage_kV", ["force_N", "breakdown_use", "pull_in_use"])
        force, uses = figure.axes[:2]
        red = [line for line in force.lines if line.get_color() == limits.BEYOND["limit exceeded"]]
        there = limits.beyond(run.history, "limit exceeded")
        assert np.isfinite(red[0].get_ydata()).tolist() == there.tolist()
        assert np.isfinite(red[0].get_ydata()).sum() == 1  # the last state alone
        assert uses.get_ylim()[1] >= 1.15
