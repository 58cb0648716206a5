"""Adaptive increments: with a solver that fails where it is told to, and with a real one."""

import copy
import re
from types import SimpleNamespace

import pytest
from conftest import case

import dealib
from dealib.config.schema import Solver
from dealib.errors import NotConverged
from dealib.program.increments import Increments, StageClock
from dealib.program.predictor import Predictor

pytestmark = pytest.mark.once  # how a program goes on


class Vector:
    """A number with the methods of a PETSc vector that increments use."""

    def __init__(self, value=0.0):
        self.value = value

    def copy(self, target=None):
        target = Vector() if target is None else target
        target.value = self.value
        return target

    def duplicate(self):
        return Vector()

    def set(self, value):
        self.value = value

    def axpy(self, alpha, x):
        self.value += alpha * x.value

    def maxpy(self, alphas, xs):
        self.value += sum(a * x.value for a, x in zip(alphas, xs, strict=True))

    def scale(self, alpha):
        self.value *= alpha

    def norm(self):
        return abs(self.value)


class FakeNewton:
    """Follows the input; fails if it is further away than `reach` from where Newton starts."""

    def __init__(self, reach=float("inf"), iterations=3, answers=False):
        self.system = SimpleNamespace(q=Vector())
        self.reach, self.iterations, self.answers = reach, iterations, answers
        self.input = 0.0
        self.starts, self.known = [], []

    def solve(self, known=False):
        q = self.system.q
        self.known.append(known)
        self.starts.append(q.value)
        if abs(self.input - q.value) > self.reach * (1 + 1e-12):
            q.value = float("nan")
            raise NotConverged("too far")
        q.value = self.input

    def answer(self):
        return Vector(self.input - self.system.q.value) if self.answers else None


def drive(newton, targets, corners=(), path=lambda t: t, clock=None, order=1, **settings):
    """Times of the converged states."""

    def apply(at):
        newton.input = path(at)
        return (path(at),)

    predictor = Predictor(order)
    predictor.add(0.0, (path(0.0),), newton.system.q)
    increments = Increments(newton, Solver(**settings), predictor, clock)
    run = increments.run(targets, set(corners), apply, lambda at: f"stopped on the way to {at:g}")
    times = []
    for time in run:
        assert newton.system.q.value == pytest.approx(path(time), abs=1e-14)
        assert increments.clock.now == time
        times.append(time)
    return times


def test_without_trouble_only_the_targets():
    newton = FakeNewton()
    assert drive(newton, [0.25, 0.5, 0.75, 1.0]) == [0.25, 0.5, 0.75, 1.0]
    # first from rest, then from the extrapolation, which is exact for a straight path
    assert newton.starts == pytest.approx([0.0, 0.5, 0.75, 1.0])


def test_cut_back_until_it_converges_and_targets_hit_exactly():
    newton = FakeNewton(reach=0.1)
    times = drive(newton, [0.3, 1.0], order=0)
    assert {0.3, 1.0} <= set(times)
    steps = [b - a for a, b in zip([0.0, *times], times, strict=False)]
    assert max(steps) <= 0.1 + 1e-12
    assert times == sorted(set(times))


def test_no_sliver_before_a_target():
    """What is left before a target is never a small rest of an increment."""
    times = drive(FakeNewton(reach=0.3), [1.0], order=0)
    steps = [b - a for a, b in zip([0.0, *times], times, strict=False)]
    assert min(steps) >= 0.125


def test_growth_while_steps_are_easy_and_none_while_they_are_hard():
    newton = FakeNewton(reach=0.1, iterations=3)
    clock = StageClock(size=1 / 64)
    easy = drive(newton, [1.0], clock=clock, order=0, target_iterations=4)
    assert easy[:3] == pytest.approx([1 / 64, 3 / 64, 7 / 64])
    newton = FakeNewton(reach=0.1, iterations=5)
    hard = drive(newton, [1.0], clock=StageClock(size=1 / 64), order=0, target_iterations=4)
    assert len(hard) >= 60


def test_corners_are_not_extrapolated_across():
    newton = FakeNewton()

    def path(t):
        return t if t <= 0.5 else 0.5 + 3 * (t - 0.5)

    drive(newton, [0.25, 0.5, 0.75, 1.0], corners=[0.5, 1.0], path=path)
    assert newton.starts == pytest.approx([0.0, 0.5, 0.5, 2.0])


def test_with_rates_a_parabola_is_predicted_from_the_second_state_behind_a_corner():
    newton = FakeNewton(answers=True)

    def path(t):
        return t**2 if t <= 0.5 else 0.25 + 3 * (t - 0.5) ** 2

    drive(newton, [0.25, 0.5, 0.75, 1.0], corners=[0.5, 1.0], path=path, order=3)
    assert newton.starts == pytest.approx([0.0, 0.25, 0.25, 1.0], abs=1e-5)


def test_no_rate_is_asked_for_where_something_goes_on_in_time():
    newton = FakeNewton(answers=True)
    still = SimpleNamespace(error=lambda: 0.0)
    run = Increments(newton, Solver(time_tolerance=0), Predictor(), clocks=[still])
    run.predictor.add(0.0, (0.0,), newton.system.q)
    list(run.run([0.5, 1.0], set(), lambda at: setattr(newton, "input", at) or (at,), str))
    assert newton.starts == pytest.approx([0.0, 1.0])


def test_failed_extrapolation_falls_back_to_the_last_state():
    newton = FakeNewton(reach=0.3)
    drive(newton, [0.25, 0.5], path=lambda t: min(t, 0.25) - 0.2 * (t > 0.25))
    assert newton.starts == pytest.approx([0.0, 0.5, 0.25])


def test_gives_up_after_max_cuts_and_rolls_back():
    newton = FakeNewton()

    def apply(at):
        newton.input, newton.reach = at, 1.0 if at <= 0.5 else 0.0
        return (at,)

    run = Increments(newton, Solver(max_cuts=3), Predictor(0))
    steps = run.run([0.5, 1.0], set(), apply, lambda at: f"on the way to {at:g}")
    assert next(steps) == 0.5
    with pytest.raises(NotConverged, match=r"on the way to 0\.5625 \(too far\)"):
        next(steps)
    assert newton.system.q.value == 0.5  # the last converged state
    assert newton.input == 0.5  # and its inputs
    assert newton.starts == [0.0, 0.5, 0.5, 0.5, 0.5]  # 0.5, then 3 halvings


def test_goes_on_from_a_place_as_if_never_stopped():
    """Also along the way back, which the predictor remembers."""
    settings, targets = Solver(target_iterations=4), [0.4, 1.0, 1.6, 2.0]

    def begin(newton, predictor, clock=None):
        increments = Increments(newton, settings, predictor, clock)

        def apply(at):
            newton.input = min(at, 2 - at) ** 2
            return (newton.input,)

        return increments, increments.run(targets, {1.0, 2.0}, apply, str)

    whole = FakeNewton(reach=0.03)
    _, run = begin(whole, Predictor())
    expected = list(run)
    for stop in range(1, len(expected)):
        first, predictor = FakeNewton(reach=0.03), Predictor()
        increments, run = begin(first, predictor)
        for _ in range(stop):
            next(run)
        second, again = FakeNewton(reach=0.03), Predictor()
        first.system.q.copy(second.system.q)
        again.restore(predictor.plain(), [known.q.copy() for known in predictor.path])
        _, rest = begin(second, again, copy.copy(increments.clock))
        assert list(rest) == expected[stop:]
        assert first.starts + second.starts == whole.starts


def test_what_is_known_is_said_on_the_way_back():
    newton = FakeNewton()
    drive(newton, [0.25, 0.5, 0.75, 1.0], corners=[0.5], path=lambda t: min(t, 1 - t))
    assert newton.known == [False, False, True, True]


# --- real runs -----------------------------------------------------------------------------------


def test_known_states_need_no_iteration_where_the_tolerance_is_below_rounding(tmp_path):
    """Rounding errors differ with the number of ranks, and must not decide."""
    cycle = case(
        "deap100",
        mesh__columns=6,
        program="[{stage: preload, mount: {force: -0.1 N}, steps: 3}, {stage: actuate, terminal:"
        " {voltage: [0 V, 2 kV, 0 V]}, steps: 8}]",
        solver__tolerance=1e-12,
    )
    rows = dealib.simulate(cycle, tmp_path / "run").history.query("stage == 'actuate'")
    there, back = rows[rows["time_s"] <= 1.5], rows[rows["time_s"] > 1.5]
    there, back = there.set_index("voltage_kV"), back[:-1].set_index("voltage_kV")
    assert (there["newton_iterations"] > 0).all()
    assert len(back) >= 3
    assert (back["newton_iterations"] == 0).all()
    column = "displacement_mm"
    assert back[column].to_numpy() == pytest.approx(there.loc[back.index, column].to_numpy())


def test_beyond_pull_in_the_converged_steps_are_kept(tmp_path):
    """A free film under a voltage that no equilibrium bears."""
    film = case(
        "membrane",
        mesh__columns=8,
        program="[{stage: prestrain}, {stage: push, mount: {displacement: -2 mm}, steps: 2},"
        " {stage: actuate, duration: 10 s, terminal: {voltage: 100 kV}, steps: 20}]",
        solver__max_cuts=3,
    )
    with pytest.raises(NotConverged) as caught:
        dealib.simulate(film, tmp_path / "run")
    message = str(caught.value)
    assert caught.value.exit_code == 3
    volts = float(re.search(r"terminal\.voltage = ([\d.]+) kV", message)[1])
    assert "stage 'actuate' stopped after t = " in message
    assert "mount.displacement = -2 mm" in message
    assert "Try: give the stage more steps; if this is pull-in, prescribe the charge" in message
    run = dealib.open(tmp_path / "run")
    assert run.status == "not converged"
    assert run.info["error"] == message
    last = run.history.iloc[-1]
    assert 0 < last["voltage_kV"] < volts < 100
    assert float(re.search(r"t = ([\d.]+) s", message)[1]) == pytest.approx(last["time_s"], 1e-5)
    assert run.stored_steps  # and the fields
    assert run.fields(-1).n_points == len(run.mesh.points)
    log = (run.directory / "run.log").read_text()
    assert "cut to" in log
    assert "stopped: stage 'actuate'" in log
