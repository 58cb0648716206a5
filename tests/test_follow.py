"""Branches past limit points: against closed forms, the bias chart, and other ways there."""

import json
import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case, history
from scipy.optimize import minimize_scalar
from typer.testing import CliRunner
from verification import free_block as block
from verification.branches import follow_block
from watch import At

import dealib
from dealib.cli.app import app
from dealib.config.bias import Bistable, Spring
from dealib.errors import ConfigError, NotConverged
from dealib.materials import thickness_stretch
from dealib.program.follow import LIMIT_POINT
from dealib.report import facts
from dealib.results.critical import critical_points
from dealib.units import EPSILON_0

NEO, MOONEY, GENT = block.mooney_rivlin_of(0.0), block.mooney_rivlin_of(0.2), block.gent_of(20.0)


# --- a homogeneous block, whose whole branch is known --------------------------------------------


@pytest.mark.parametrize(
    ("rubber", "peak", "at"),
    [(NEO, 0.687365, 1.259921), (MOONEY, 0.731118, 1.32077)],
    ids=["neo-Hooke", "Mooney-Rivlin"],
)
def test_the_whole_branch_of_a_block(rubber, peak, at):
    """Voltage and stretch at each charge, and the peak, nearly incompressible."""
    kappa, limits = 1e5, []
    for volts, charge, stretch, found in follow_block(rubber, kappa, 1.8, 10):
        exact = block.closed_form(rubber, kappa, charge, stretch)
        assert (volts, stretch) == pytest.approx(exact[:2], rel=1e-6)
        past = stretch > at * (1 + 1e-4)
        assert found.modes == (1 if past else 0)
        if found.kind:
            limits.append((found.kind, block.normalised(volts), stretch))
    ((kind, phi, stretch),) = limits
    assert kind == LIMIT_POINT
    assert phi == pytest.approx(peak, abs=1.5e-6)
    assert stretch == pytest.approx(at, abs=1e-5)


@pytest.mark.once
def test_both_limit_points_of_a_rubber_that_locks():
    """Gent: unstable between a largest and a smallest voltage, each solved to 1e-9."""
    kappa, rows = 1e3, list(follow_block(GENT, 1e3, 2.9, 40))
    limits = [(volts, charge, stretch) for volts, charge, stretch, f in rows if f.kind]
    assert len(limits) == 2
    for sign, (volts, charge, stretch) in zip((1, -1), limits, strict=True):

        def fold(at, sign=sign, stretch=stretch):
            return -sign * block.closed_form(GENT, kappa, at, stretch)[0]

        exact = minimize_scalar(fold, bounds=(0.98 * charge, 1.02 * charge), method="bounded")
        assert volts == pytest.approx(-sign * exact.fun, rel=1e-9)
    upper, lower = (stretch for _, _, stretch in limits)
    for _, _, stretch, found in rows:
        if abs(stretch - upper) > 1e-4 and abs(stretch - lower) > 1e-4:
            assert found.modes == int(upper < stretch < lower)


# --- snap-through on a bistable bias -------------------------------------------------------------


def limits(h):
    return h[h["limit_point"] == 1]


@pytest.mark.once
def test_snap_through_has_both_folds_of_the_chart():
    """At a fold the curve of the film at that voltage touches that of the bias."""
    h = history("snap_through")
    down, up = (row for _, row in limits(h).iterrows())
    assert down["voltage_kV"] == pytest.approx(2.537459, abs=1e-5)
    assert up["voltage_kV"] == pytest.approx(1.487460, abs=1e-5)
    bistable = Bistable(rate="-0.45 N/mm", well="1.5 mm", anchor="0 mm")
    spring = Spring(stiffness="0.1 N/mm", anchor="0 mm")
    for fold in (down, up):
        u = fold["displacement_mm"]
        bias = np.add(bistable.load(u + 1.8), spring.load(u + 4))
        assert fold["force_N"] == pytest.approx(bias[0], abs=1e-9)
        d = 0.01
        program = (
            f"[{{stage: push, mount: {{displacement: {u - d!r} mm}}, steps: 4}},"
            f" {{stage: on, terminal: {{voltage: {fold['voltage_kV']!r} kV}}, steps: 4}},"
            f" {{stage: pull, mount: {{displacement: {u + d!r} mm}}, steps: 2}}]"
        )
        film = history("snap_through", program=program)["force_N"].to_numpy()[-3:]
        assert film[1] == pytest.approx(bias[0], abs=1e-8)
        assert (film[2] - film[0]) / (2 * d) == pytest.approx(bias[1], abs=2e-5)
    between = h["displacement_mm"].between(
        up["displacement_mm"], down["displacement_mm"], "neither"
    )
    assert (h.loc[between, "unstable_modes"] == 1).all()
    others = ~between & (h["limit_point"] == 0)
    assert (h.loc[others, "unstable_modes"] == 0).all()
    assert h["bifurcation"].sum() == 0


@pytest.mark.once
def test_the_program_goes_on_from_the_end_of_a_branch():
    """The free variable stays where it is, then changes as told; back over the fold's voltage."""
    stages = [stage.model_dump(exclude_none=True) for stage in case("snap_through").config.program]
    stages += [{"stage": "less", "terminal": {"voltage": "2 kV"}, "steps": 4}]
    h = history("snap_through", program=json.dumps(stages))
    last = h.iloc[-1]
    assert last["voltage_kV"] == pytest.approx(2)
    assert last["unstable_modes"] == 0
    branch = h[h["stage"] == "branch"]
    # not on the grid of the branch, but on the lower stable part of it
    lower = branch[branch["displacement_mm"] < limits(h)["displacement_mm"].iloc[1]]
    order = np.argsort(lower["voltage_kV"])
    u = np.interp(2, lower["voltage_kV"].iloc[order], lower["displacement_mm"].iloc[order])
    assert last["displacement_mm"] == pytest.approx(u, abs=2e-3)


SMALL = {"mesh__columns": 12, "mesh__film_rows": 1}


@pytest.mark.once
def test_resume_anywhere_on_a_branch(tmp_path):
    """Rounding moves the direction by 5e-9 (state by 1e-15), and so all that follows the fold."""
    whole = dealib.simulate(case("snap_through", **SMALL), tmp_path / "whole")
    folds = limits(whole.history)["step"].tolist()
    assert len(folds) == 2

    begin = int(whole.history.query("stage == 'branch'")["step"].iloc[0])
    for step in (begin - 1, begin, begin + 1, folds[0] - 1, folds[0], folds[0] + 1, folds[1]):
        directory = tmp_path / f"at{step}"
        with pytest.raises(KeyboardInterrupt):
            dealib.simulate(
                case("snap_through", **SMALL), directory, observers=[At(step, KeyboardInterrupt())]
            )
        again = dealib.simulate(case("snap_through", **SMALL), directory, resume=True)
        for column in whole.history.columns.drop(["stage", "newton_iterations"]):
            expected, found = whole.history[column].to_numpy(), again.history[column].to_numpy()
            error = np.abs(found - expected) / max(np.abs(expected).max(), 1e-30)
            assert error[: folds[0]].max() <= 1e-9, (step, column)
            assert error[folds[0] :].max() <= 1e-8, (step, column)


# --- pull-in -------------------------------------------------------------------------------------


@pytest.mark.once
def test_pull_in_with_electrodes_and_air():
    h = history("pull_in")
    (peak,) = (row for _, row in limits(h).iterrows())
    assert peak["voltage_kV"] == pytest.approx(4.39758, abs=2e-5)
    assert peak["displacement_mm"] == pytest.approx(-5.25074, abs=2e-4)
    assert h["voltage_kV"].idxmax() == peak.name
    beyond = h.loc[peak.name + 1 :]
    assert len(beyond) >= 2
    assert (beyond["unstable_modes"] == 1).all()
    assert (h.loc[: peak.name, "unstable_modes"] == 0).all()
    assert h["force_N"].iloc[10:].to_numpy() == pytest.approx(-0.4, abs=1e-8)
    # charge and capacitance go on growing while the voltage falls
    assert beyond["charge_uC"].is_monotonic_increasing
    assert beyond["charge_uC"].iloc[0] > peak["charge_uC"]
    ratio = 1e3 * h["charge_uC"] / h["voltage_kV"]
    assert h["capacitance_pF"].iloc[11:].to_numpy() == pytest.approx(ratio.iloc[11:], rel=1e-9)


@pytest.mark.parametrize("steps", [pytest.param(6, marks=pytest.mark.once), 7])
def test_large_steps_find_the_limit_point_too(steps):
    """Before it Newton needs all its iterations, and states beyond lie far from those before."""
    program = (
        "[{stage: load, mount: {force: -0.4 N}, steps: 8}, {stage: branch, follow:"
        f" {{vary: voltage, along: displacement, until: {{displacement: -5.35 mm}}}},"
        f" steps: {steps}}}]"
    )
    h = history("pull_in", program=program, **SMALL)
    (peak,) = (row for _, row in limits(h).iterrows())
    assert peak["voltage_kV"] == pytest.approx(4.39914, abs=2e-5)
    assert peak["displacement_mm"] == pytest.approx(-5.24785, abs=2e-4)
    assert h["bifurcation"].sum() == 0
    past = h.index > peak.name
    assert past.sum() >= 1
    assert (h["unstable_modes"] == past).all()
    assert h["displacement_mm"].is_monotonic_decreasing
    assert h["displacement_mm"].iloc[-1] == pytest.approx(-5.35, abs=1e-12)


WEIGHT = "{stage: load, mount: {force: -0.4 N}, steps: 10}"
NO_AIR = {"geometry__air_height": "0 mm", "mesh__columns": 16}


def branch(text, steps=10):
    return f"[{WEIGHT}, {{stage: branch, follow: {text}, steps: {steps}}}]"


@pytest.mark.once
def test_pull_in_does_not_depend_on_the_way_there():
    """Along the displacement or the charge; the voltage alone stops short of it."""
    found = []
    for text in (
        "{vary: voltage, along: displacement, until: {displacement: -5.4 mm}}",
        "{vary: voltage, until: {charge: 3.3 uC}}",
    ):
        (peak,) = (
            r for _, r in limits(history("pull_in", program=branch(text), **NO_AIR)).iterrows()
        )
        found.append(peak)
    for column in ("voltage_kV", "displacement_mm", "charge_uC"):
        assert found[0][column] == pytest.approx(found[1][column], rel=1e-6)
    volts = float(found[0]["voltage_kV"])
    program = f"[{WEIGHT}, {{stage: on, terminal: {{voltage: {1.001 * volts!r} kV}}, steps: 8}}]"
    states, simulation = [], dealib.Simulation(
        case("pull_in", program=program, solver__max_cuts=5, **NO_AIR)
    )  # fmt: skip
    with pytest.raises(NotConverged):
        states.extend(state.row for state in simulation)
    reached = simulation.progress.row["voltage_kV"]
    assert 0.97 * volts < reached < volts


@pytest.mark.once
def test_stops_where_it_is_told():
    voltage = "{vary: voltage, along: displacement, until: {displacement: -5.4 mm, voltage: 2 kV}}"
    h = history("pull_in", program=branch(voltage), **NO_AIR)
    last, before = h["voltage_kV"].iloc[-1], h["voltage_kV"].iloc[-2]
    assert before < 2 <= last
    few = "{vary: voltage, along: displacement, until: {displacement: -5.4 mm}, states: 3}"
    h = history("pull_in", program=branch(few), **NO_AIR)
    assert (h["stage"] == "branch").sum() == 3


@pytest.mark.once
def test_a_branch_that_never_comes_to_its_end_is_told(caplog):
    """At a constant charge the voltage falls as the film is stretched: it cannot rise to 3 kV."""
    program = (
        "[{stage: charge, mount: {force: -0.1 N}, terminal: {charge: 0.1 uC}, steps: 2}, {stage:"
        " b, follow: {vary: force, along: voltage, until: {voltage: 3 kV}%s}, steps: 1}]"
    )
    states = [s.row for s in dealib.Simulation(case("pull_in", program=program % "", **NO_AIR))]
    last = states[-1]
    assert sum(row["stage"] == "b" for row in states) == 10
    (told,) = (r.getMessage() for r in caplog.records if r.levelname == "WARNING")
    assert told == (
        "stage 'b' ends after 10 states, ten times its steps, at force = "
        f"{last['force_N']:.6g} N, voltage = {last['voltage_kV']:.6g} kV, not at the end of its "
        "branch; give it more steps, or `states`"
    )
    caplog.clear()
    list(dealib.Simulation(case("pull_in", program=program % ", states: 3", **NO_AIR)))
    assert not [r for r in caplog.records if r.levelname == "WARNING"]


def test_force_along_displacement_is_the_curve_of_displacement_control():
    """A film without limit points: the same curve, all stable, to its end exactly."""
    text = "{vary: force, until: {displacement: -2 mm}}"
    h = history("pull_in", program=f"[{{stage: f, follow: {text}, steps: 6}}]", **NO_AIR)
    assert h["displacement_mm"].iloc[-1] == pytest.approx(-2, abs=1e-12)
    assert h["unstable_modes"].sum() == h["limit_point"].sum() == 0
    push = "[{stage: push, mount: {displacement: -2 mm}, steps: 4}]"
    pushed = history("pull_in", program=push, **NO_AIR)
    assert h["force_N"].iloc[-1] == pytest.approx(pushed["force_N"].iloc[-1], rel=1e-8)


@pytest.mark.once
def test_a_flat_film_buckles_where_its_tension_is_gone():
    """A bifurcation, not a limit point: the flat state goes on, unstable in more and more ways."""
    text = "{vary: voltage, until: {charge: 0.7 uC}}"
    free = "{stage: free, mount: {force: 0 N}}"
    program = f"[{free}, {{stage: branch, follow: {text}, steps: 8}}]"
    bare = {**NO_AIR, "geometry__electrode_thickness": "0 um"}
    h = history("pull_in", program=program, **bare)
    assert h["displacement_mm"].abs().max() < 1e-9
    assert h["limit_point"].sum() == 0
    first = h[h["bifurcation"] == 1].iloc[0]
    assert (h.loc[: first.name - 1, "unstable_modes"] == 0).all()
    assert h["unstable_modes"].is_monotonic_increasing
    assert h["unstable_modes"].iloc[-1] > 5
    # tension at rest, by hand: mu (lp^2 - lz^2) J^(-5/3), balanced by the field's eps E^2
    g, film = case("pull_in").config.geometry, case("pull_in").config.materials["film"]
    lp = film.prestretch[0]
    lz = thickness_stretch(film, lp, lp)
    stress = film.shear_modulus * (lp**2 - lz**2) * (lp**2 * lz) ** (-5 / 3)
    gone = g.film_thickness * np.sqrt(stress / (EPSILON_0 * film.relative_permittivity))
    assert first["voltage_kV"] == pytest.approx(gone, rel=0.01)


@pytest.mark.parametrize(
    ("start", "follow"),
    [
        ("displacement: -0.5 mm", "{vary: force, until: {displacement: -0.7 mm}}"),
        ("force: -0.1 N", "{vary: displacement, until: {force: -0.13 N}}"),
    ],
)
def test_small_signals_on_a_path_are_those_of_what_it_varies(start, follow):
    """As after it, where that is held: at constant force, or at constant displacement."""
    push = f"{{stage: push, mount: {{{start}}}, terminal: {{voltage: 0.5 kV}}}}"
    small = CONFIGS.parent / "tests" / "small.yaml"
    program = f"[{push}, {{stage: path, follow: {follow}, steps: 2}}, {{stage: hold}}]"
    given = dealib.load(small, set={"program": program, "sensing.differential": True})
    *_, before, last, held = (state.row for state in dealib.Simulation(given))
    free, blocked = "differential_capacitance_pF", "blocked_capacitance_pF"
    assert last[free] == pytest.approx(held[free], rel=1e-7)
    for row in (before, last):
        assert (row[free] == row[blocked]) == ("vary: displacement" in follow)


# --- what the user sees --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    directory = tmp_path_factory.mktemp("follow") / "run"
    return dealib.simulate(case("snap_through", **SMALL), directory)


@pytest.mark.once
def test_limit_points_are_told(run):
    first, second = critical_points(run)
    assert first.name == "limit voltage (pull-in)"
    assert second.name == "limit point of voltage"
    assert (first.modes, second.modes) == ((0, 1), (1, 0))
    assert first.value == limits(run.history)["voltage_kV"].iloc[0]
    done = CliRunner().invoke(app, ["info", str(run.directory)])
    assert f"limit voltage (pull-in) in 'branch'  {first.value:.7g} kV" in done.output
    log = (run.directory / "run.log").read_text()
    assert log.count("is a limit point") == 2
    from dealib.report.page import render

    page = render(run)
    assert "limit voltage (pull-in) in “branch”" in page
    assert "limit point of voltage in “branch”" in page


@pytest.mark.once
def test_the_report_tells_what_is_followed(run):
    """In the table of the load program."""
    *_, row = facts.program(run.config)
    assert row["inputs"] == "voltage followed until displacement −2.9 mm"
    count = dict(facts.solution(run))["Steps"]
    assert count == f"{len(run.history) - 1}; the number of steps along a branch is not planned"


@pytest.mark.once
def test_limit_points_of_stages_of_one_name(run):
    """Conditions have ended those before the branch, long before their time."""
    first, *others = run.config.program
    alike = [s.model_copy(update={"stage": "s", "duration": 99.0}) for s in others]
    h = run.history.assign(stage=["prestrain"] + ["s"] * (len(run.history) - 1))
    ends = [run.history.query("stage == @s.stage")["step"].iloc[-1] for s in others[:-1]]
    like = SimpleNamespace(
        history=h,
        config=run.config.model_copy(update={"program": (first, *alike)}),
        info={"stops": [{"step": int(step)} for step in ends]},
    )
    assert critical_points(like) == [replace(p, stage="s (3)") for p in critical_points(run)]


@pytest.mark.once
def test_a_branch_that_ends_in_its_limit_point_has_nothing_behind_it(run):
    """As with `stop_when: [limit_point > 0]`; what comes next is under another control."""
    end = int(run.history["limit_point"].to_numpy().argmax())
    h = pd.concat([run.history.iloc[: end + 1], run.history.iloc[:1].assign(stage="hold")])
    h["time_s"] = h["step"] = np.arange(len(h))
    program = (*run.config.program, run.config.program[1].model_copy(update={"stage": "hold"}))
    config = run.config.model_copy(update={"program": program})
    like = SimpleNamespace(history=h.reset_index(drop=True), config=config, info={})
    (point,) = critical_points(like)
    assert (point.stage, point.modes) == ("branch", (0, None))


@pytest.mark.once
def test_unstable_parts_are_dashed(run):
    from dealib.plots import style
    from dealib.plots.curves import curves
    from dealib.plots.limits import BEYOND

    with style.theme():
        (axis,) = curves([run], "voltage_kV", ["displacement_mm"]).axes
        branch = [line for line in axis.lines if line.get_color() not in BEYOND.values()]
        lines = [line for line in branch if len(line.get_xdata()) > 2]
        solid = [line.get_linestyle() == "-" for line in lines]
        assert solid == [True, False, True]
        for before, after in pairwise(lines):  # they meet in the limit points
            assert before.get_xydata()[-1].tolist() == after.get_xydata()[0].tolist()
        folds = limits(run.history)["voltage_kV"].tolist()
        assert [line.get_xdata()[-1] for line in lines[:2]] == folds
        marks = next(line for line in axis.lines if line.get_marker() == "o")
        assert marks.get_xdata().tolist() == folds


@pytest.mark.once
def test_what_is_unstable_and_what_is_beyond_a_limit_can_be_told_apart(run):
    from dealib.plots import style
    from dealib.plots.curves import overview
    from dealib.plots.limits import BEYOND

    with style.theme():
        figure = overview([run])
        above, below = figure.legends
        told = [text.get_text() for text in below.get_texts()]
        assert told == ["unstable", "limit point"]
        (told,) = [text.get_text() for text in above.get_texts()]
        assert re.fullmatch(r"beyond: wrinkling [\d.]+, pull-in [\d.]+ \(1 is the limit\)", told)
        # along a branch time is the length of a path
        assert figure.axes[4].get_xlabel() == "Step"
        last = max(line.get_xdata()[-1] for line in figure.axes[1].lines if len(line.get_xdata()))
        assert last == run.history["step"].iloc[-1]
        axis = figure.axes[2]
        (band,) = [line for line in axis.lines if line.get_color() == BEYOND["beyond"]]
        curve, unstable = axis.lines[:2]
        assert (band.get_linestyle(), unstable.get_linestyle()) == ("-", "--")
        assert band.get_linewidth() > 4 * curve.get_linewidth()  # behind the dashes, not on them
        assert band.get_zorder() < unstable.get_zorder()


HELD = "{stage: hold, mount: {displacement: -1 mm}}"


@pytest.mark.once
@pytest.mark.parametrize(
    ("program", "message"),
    [
        (f"[{HELD}, {{stage: b, follow: {{vary: voltage, along: displacement, until:"
         " {displacement: -2 mm}}}]", "displacement is prescribed here"),
        ("[{stage: b, follow: {vary: voltage, until: {displacement: -2 mm}}}]",
         "give the last value of charge"),
        ("[{stage: b, follow: {vary: voltage, along: force, until: {force: -2 N}}}]",
         "beside voltage only charge or the displacement of the mount measures the path, not"),
        ("[{stage: b, mount: {force: 0 N}, follow: {vary: voltage, until: {charge: 1 uC}}}]",
         "a stage that follows a branch takes no input"),
        ("[{stage: b, cycles: 2, follow: {vary: voltage, until: {charge: 1 uC}}}]",
         "has one cycle"),
        ("[{stage: a, mount: {spring: {stiffness: 1 N/mm, anchor: 0 mm}}},"
         " {stage: b, follow: {vary: force, until: {displacement: -1 mm}}}]",
         "varying force would remove the spring from the mount"),
    ],
)  # fmt: skip
def test_wrong_branches_are_told(program, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        case("pull_in", program=program)


def test_only_a_potential_can_be_followed():
    with pytest.raises(ConfigError, match="a stage with follow needs coupling: energy"):
        case("pull_in", physics__coupling="pelrine")


def test_a_branch_out_of_time_takes_no_viscosity():
    viscous = "[{shear_modulus: 1 kPa, relaxation_time: 1 s}]"
    with pytest.raises(ConfigError, match="computes equilibria, independent of time"):
        case("pull_in", materials__film__branches=viscous)


def test_a_branch_that_begins_at_its_end_is_told():
    text = "{vary: voltage, along: displacement, until: {displacement: -0 mm}}"
    program = f"[{{stage: load, mount: {{force: 0 N}}}}, {{stage: b, follow: {text}}}]"
    with pytest.raises(ConfigError, match="stage 'b' begins at the value of displacement at whi"):
        list(dealib.Simulation(case("pull_in", program=program, **NO_AIR)))
