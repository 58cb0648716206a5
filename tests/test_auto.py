"""`steps: auto`: fewer states are solved, and no row of the history is off by more than 1e-5."""

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case

import dealib
from dealib.design.slopes import known
from dealib.errors import ConfigError
from dealib.program.knots import TOLERANCE, Knots

pytestmark = pytest.mark.once  # which states are solved, not how
SMALL = CONFIGS.parent / "tests" / "small.yaml"
STRIP = {"mesh__columns": 8, "mesh__film_rows": 1, "output__fields": "none"}
FORCE = "[{{stage: preload, mount: {{force: -0.4 N}}, {0}}}, {{stage: hold, {0}}}," + (
    " {{stage: actuate, terminal: {{voltage: [0 V, 2.5 kV, 0 V]}}, {0}}}]"
)
PUSH = (
    "[{{stage: push, mount: {{displacement: {1}}}, {0}}}, {{stage: actuate, terminal: {2}, {0}}}]"
)
RAMP, SMOOTH = "{voltage: 2.5 kV}", "{voltage: {to: 2 kV, rise: 0.8 s}}"
KINKS = ("step", "time_s", "stage", "newton_iterations", "energy_residual_mJ", "solved")


def rows(name, program, steps, *given, **changes):
    """The history of a shipped config with another program, and how many systems were solved."""
    found = case(name, program=program.format(steps, *given), **changes)
    simulation = dealib.Simulation(found)
    history = pd.DataFrame([state.row for state in simulation])
    return history, simulation.engine.newton.total


def assert_equal(auto, tight):
    """All columns to 1e-5 of their range, with 1e-9 of the values for rounding."""
    assert list(auto.drop(columns="solved")) == list(tight)
    assert auto["stage"].tolist() == tight["stage"].tolist()
    assert np.array_equal(auto["time_s"], tight["time_s"])
    for name in tight.columns.drop([k for k in KINKS if k in tight]):
        off = np.abs(auto[name] - tight[name]).max()
        size = np.abs(tight[name]).max()
        assert off <= TOLERANCE * np.ptp(tight[name]) + 1e-9 * size + 1e-12, name
    # what the balance lacks is compared with the energies, of which it is the difference
    off = np.abs(auto["energy_residual_mJ"] - tight["energy_residual_mJ"]).max()
    assert off <= TOLERANCE * tight["elastic_energy_mJ"].max()


@pytest.mark.parametrize(
    ("name", "program", "count", "given", "share", "changes"),
    [
        ("benchmark_strip", PUSH, 100, ("-3 mm", RAMP), 0.5, STRIP),
        ("benchmark_strip", PUSH, 60, ("-3 mm", SMOOTH), 0.7, STRIP),
        ("deap100", FORCE, 100, (), 0.35, STRIP),
        ("membrane", PUSH, 100, ("-10 mm", "{voltage: 5.8207 kV}"), 0.5, STRIP),
    ],
)
def test_smooth_curves_need_few_states(name, program, count, given, share, changes):
    tight, iterations = rows(name, program, f"steps: {count}", *given, **changes)
    auto, fewer = rows(name, program, f"steps: auto, rows: {count}", *given, **changes)
    assert_equal(auto, tight)
    assert auto["solved"].sum() <= share * len(tight)
    assert fewer < iterations
    assert (auto.loc[auto["solved"] == 0, "newton_iterations"] == 0).all()
    assert set(auto["solved"]) == {0, 1}


def test_turns_that_no_corner_tells_are_refined(tmp_path):
    file = tmp_path / "triangle.csv"
    file.write_text("time [s], voltage [kV]\n0, 0\n0.37, 2\n0.52, 0.5\n0.8, 0.5\n0.84, 1.5\n1, 1\n")
    given = "-1 mm", f"{{voltage: {{file: {file}}}}}"
    tight, _ = rows("benchmark_strip", PUSH, "steps: 50", *given, **STRIP)
    auto, _ = rows("benchmark_strip", PUSH, "steps: auto, rows: 50", *given, **STRIP)
    assert_equal(auto, tight)
    solved = auto[auto["stage"] == "actuate"].set_index("time_s")["solved"]
    for turn in (0.37, 0.52, 0.8, 0.84):  # the row there, or both around it
        around = solved[np.abs(solved.index - 1 - turn) < 0.02 - 1e-9]
        assert len(around) == 1 + (turn == 0.37)
        assert around.all(), turn


def test_corners_between_rows_are_reached():
    """Corners at fifths of a stage that has rows at its quarters."""
    program = "[{{stage: actuate, terminal: {{voltage: [0 V, 1 kV, 0 V, 2 kV, 1 kV, 0 V]}}, {0}}}]"
    tight, _ = rows("benchmark_strip", program, "steps: 4", **STRIP)
    auto, _ = rows("benchmark_strip", program, "steps: auto, rows: 4", **STRIP)
    shared = auto[auto["time_s"].isin(tight["time_s"])].reset_index(drop=True)
    for name in ("voltage_kV", "charge_uC", "capacitance_pF", "elastic_energy_mJ"):
        off = np.abs(shared[name] - tight[name]).max()  # works are sums over all rows of a run
        assert off <= TOLERANCE * np.ptp(tight[name]), name
    assert set(auto["solved"]) == {1}


def test_onset_of_wrinkles_is_refined():
    onset = {"physics__wrinkling": "tension_field", "mesh__columns": 8, "output__fields": "none"}
    onset["physics__model"] = "membrane"
    onset["materials__film__prestretch"] = 1.02
    given = "-0.2 mm", "{voltage: 8 kV}"
    tight, _ = rows("membrane", PUSH, "steps: 40", *given, **onset)
    auto, _ = rows("membrane", PUSH, "steps: auto, rows: 40", *given, **onset)
    assert tight["wrinkled_area_mm2"].min() == 0 < tight["wrinkled_area_mm2"].max()
    assert_equal(auto, tight)
    assert auto["solved"].sum() < len(auto)


def test_knots_bound_a_kink_by_its_error():
    """|x| beyond a kink anywhere between two states: what the rows are off is below the share."""
    every = np.array([True])
    for kink in np.linspace(0.01, 0.99, 25):

        def curve(x, kink=kink):
            return np.array([np.sin(x) + 1e-3 * max(0.0, x - 7 - kink)])

        knots = Knots()
        for x in range(8):
            knots.add(float(x), curve(x))
        times = np.linspace(7, 8, 22)[1:-1].tolist()
        fit = knots.fit(8.0, curve(8.0), times, lambda x: [x], every)
        off = np.abs(fit.rows - [curve(x) for x in times]).max() / fit.allowed[0]
        assert off <= fit.share


def test_a_condition_ends_the_stage_where_solving_each_row_does():
    program = "[{{stage: push, mount: {{displacement: -3 mm}}, {0}, stop_when: [{1}]}}]"
    for condition in ("force_N < -0.1 N", "{when: force_N < -0.1 N, bisect: 3}"):
        tight, _ = rows("benchmark_strip", program, "steps: 60", condition, **STRIP)
        auto, _ = rows("benchmark_strip", program, "steps: auto, rows: 60", condition, **STRIP)
        assert auto["solved"].iloc[-1] == 1
        assert auto["force_N"].iloc[-1] < -0.1 <= auto["force_N"].iloc[-2]
        assert auto["time_s"].iloc[-1] == pytest.approx(tight["time_s"].iloc[-1], abs=1e-12)
        assert auto["solved"].sum() < len(auto)


class Enough(Exception):
    """Ends a run as a kill would."""


class Stop:
    """Ends a run after so many solved states, or at an interpolated row that follows them."""

    def __init__(self, count, solved):
        self.count, self.solved = count, solved

    def start(self, simulation):
        pass

    def see(self, state):
        self.count -= state.solved
        if self.count <= 0 and state.solved == self.solved:
            raise Enough

    def stop(self, error):
        pass


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("auto") / "whole"
    return dealib.simulate(auto_small(), path)


def auto_small():
    return dealib.load(SMALL, set={f"program.{k}.steps": "auto" for k in (0, 1)})


@pytest.mark.parametrize("solved", [True, False])
def test_a_run_goes_on_as_if_nothing_had_happened(whole, tmp_path, solved):
    with pytest.raises(Enough):
        dealib.simulate(auto_small(), tmp_path / "run", observers=[Stop(15, solved)])
    kept = dealib.open(tmp_path / "run").history
    assert kept["solved"].iloc[-1] == 1
    assert len(kept) < len(whole.history)
    again = dealib.simulate(auto_small(), tmp_path / "run", resume=True)
    pd.testing.assert_frame_equal(again.history, whole.history)
    assert again.stored_steps == whole.stored_steps
    np.testing.assert_array_equal(again.state(-1), whole.state(-1))


def test_solved_states_alone_have_fields(whole):
    history = whole.history
    solved = history.loc[history["solved"] == 1, "step"].tolist()
    assert whole.stored_steps == solved
    assert len(history) == 81
    assert len(solved) < 70
    assert history["step"].tolist() == list(range(81))
    worst = whole.info["margins"]["pull_in_use"]
    assert worst["use"] == pytest.approx(history["pull_in_use"].max(), rel=1e-12)
    for state in dealib.Simulation(auto_small()):
        if not state.solved:
            with pytest.raises(ConfigError, match=r"step \d+ is interpolated \(steps: auto\)"):
                state.nodal()
            break


@pytest.mark.parametrize(
    ("changes", "where", "why"),
    [
        ({"program.0.dynamic": True}, "program.0.steps", "solver.time_tolerance"),
        (
            {"materials.film.branches": "[{shear_modulus: 0.1 MPa, relaxation_time: 1 s}]"},
            "program.0.steps",
            "materials.film.branches gives states a memory",
        ),
        ({"program.0.stage": "prestrain", "program.0.mount": None}, "program.0.steps", "one row"),
        ({"program.1.rows": 10, "program.1.steps": 4}, "program.1.rows", "only with steps: auto"),
        ({"program.0.steps": "automatic"}, "program.0.steps", "a number of steps, or auto"),
        ({"program.0.steps": 0}, "program.0.steps", "must be at least 1, not 0"),
        ({"program.0.rows": 0}, "program.0.rows", "must be at least 1, not 0"),
    ],
)
def test_what_cannot_be_is_told_at_its_key(changes, where, why):
    with pytest.raises(ConfigError) as caught:
        dealib.load(SMALL, set={"program.0.steps": "auto"} | changes)
    assert where in str(caught.value)
    assert why in str(caught.value)


def test_a_fit_takes_differences_where_rows_are_interpolated():
    """A row between solved states has no states beside it that would give its derivatives."""
    given = case("benchmark_strip")
    assert known(given.config)
    assert not known(case("benchmark_strip", program__1__steps="auto").config)


def test_a_branch_chooses_its_own_steps():
    path = CONFIGS / "pull_in.yaml"
    last = len(dealib.load(path).config.program) - 1
    with pytest.raises(ConfigError, match="along the branch"):
        dealib.load(path, set={f"program.{last}.steps": "auto"})
