"""The predictor: exact on parabolas, a memory on the way back, blind across jumps."""

from petsc4py import PETSc

import numpy as np
import pytest

from dealib.program.predictor import Predictor, remembered


def vector(*values):
    v = PETSc.Vec().createSeq(len(values))
    v.array[:] = values
    return v


def walk(predictor, path, times):
    for t in times:
        predictor.add(t, ("voltage", float(t)), path(t))


def parabola(t):
    return vector(1 + 2 * t + 3 * t**2, -t)


def test_parabolas_are_continued_exactly():
    predictor = Predictor()
    walk(predictor, parabola, [0.0, 0.1, 0.25, 0.4])
    guess = predictor.predict(0.6, ("voltage", 0.6))
    assert guess.array == pytest.approx(parabola(0.6).array)


def cubic(t):
    return vector(t**3 - t, 2 * t**3)


def slope(t):
    return vector(3 * t**2 - 1, 6 * t**2)


def rated(predictor, times):
    for t in times:
        predictor.add(t, ("voltage", float(t)), cubic(t), slope(t))


def test_cubics_are_continued_exactly_from_two_states_and_their_rates():
    predictor = Predictor()
    rated(predictor, [0.0])
    first = predictor.predict(0.25, ("voltage", 0.25))
    assert first.array == pytest.approx(0.25 * slope(0.0).array)
    rated(predictor, [0.25])
    second = predictor.predict(0.4, ("voltage", 0.4))
    assert second.array == pytest.approx(cubic(0.4).array, abs=1e-12)


def test_rates_are_forgotten_where_they_are_of_no_use():
    """Behind a corner they are others, and no polynomial needs more than four."""
    predictor = Predictor()
    rated(predictor, np.linspace(0, 1, 9))
    assert [k.rate is not None for k in predictor.path] == [False] * 5 + [True] * 4
    predictor.corner()
    assert predictor.rates == []


def test_what_is_restored_predicts_the_same():
    whole, again = Predictor(), Predictor()
    rated(whole, np.linspace(0, 0.5, 5))
    states = [known.q.copy() for known in whole.path]
    again.restore(whole.plain(), states, [rate.copy() for rate in whole.rates])
    guesses = [p.predict(0.6, ("voltage", 0.6)).array for p in (whole, again)]
    assert guesses[0].tolist() == guesses[1].tolist()


def test_a_restored_state_is_known_if_all_of_it_was_kept():
    whole = Predictor()
    walk(whole, parabola, [0.0, 0.1, 0.2, 0.3])
    whole.corner()
    for exact in (True, False):
        again = Predictor()
        again.restore(whole.plain(), [known.q for known in whole.path], exact=exact)
        assert again.predict(0.4, ("voltage", 0.2)) is not None
        assert again.known == exact
        again.predict(0.4, ("voltage", 0.7))
        assert not again.known


def test_the_secant_is_continued_from_two_states():
    predictor = Predictor()
    walk(predictor, lambda t: vector(2 * t), [0.0, 0.5])
    assert predictor.predict(1.0, ("voltage", 1.0)).array == pytest.approx([2])


def test_nothing_is_guessed_from_one_state_or_far_away():
    predictor = Predictor()
    walk(predictor, parabola, [0.0])
    assert predictor.predict(0.1, ("voltage", 0.1)) is None
    walk(predictor, parabola, [0.1])
    assert predictor.predict(0.5, ("voltage", 0.5)) is None


def test_the_way_back_is_remembered_twice():
    predictor = Predictor()
    up = np.linspace(0, 1, 6)
    walk(predictor, parabola, up)
    clock = 1.0
    for ramp in (up[-2::-1], up[1:]):
        predictor.corner()
        recalled = 0
        for k, t in enumerate(ramp, start=1):
            guess = predictor.predict(clock + k, ("voltage", float(t)))
            if guess is not None and guess.array == pytest.approx(parabola(t).array, abs=1e-14):
                recalled += 1
            predictor.add(clock + k, ("voltage", float(t)), parabola(t))
        clock += k
        assert recalled >= 3


def test_no_recall_across_a_jump():
    """A path that snapped must not be led back to its other branch."""

    def snapping(t):
        return vector(t if t < 0.5 else 10 + t)

    predictor = Predictor()
    times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0]
    walk(predictor, snapping, times)
    predictor.corner()
    for t in (0.8, 0.6, 0.4):
        guess = predictor.predict(2 - t, ("voltage", t))
        assert guess is None or guess.array[0] > 5
        predictor.add(2 - t, ("voltage", t), vector(10 + t))


@pytest.mark.parametrize("jump", [0.0, 10.0])
def test_the_first_step_is_recalled_if_the_second_shows_that_it_did_not_jump(jump):
    def path(t):
        return vector(t**2 + jump * (t > 0))

    predictor = Predictor()
    predictor.add(0.0, ("voltage", 0.0), path(0.0))
    predictor.start(("voltage", 0.0))
    for t in (0.25, 0.5, 0.75):
        predictor.add(t, ("voltage", t), path(t), vector(2 * t))
    predictor.corner()
    for t in (0.5, 0.25):
        predictor.predict(1.5 - t, ("voltage", t))
        assert predictor.known
        predictor.add(1.5 - t, ("voltage", t), path(t))
    predictor.predict(1.5, ("voltage", 0.0))
    assert predictor.known == (jump == 0)


def test_other_inputs_are_not_recalled():
    predictor = Predictor()
    walk(predictor, parabola, np.linspace(0, 1, 6))
    predictor.corner()
    assert predictor.predict(1.2, ("charge", 0.8)) is None


def test_memory_bounds_how_many_states_are_remembered():
    """At most 256 MB of numbers, but always enough to go on."""
    assert [remembered(n) for n in (1000, 500_000, 1_000_000, 2_000_000, 10**8)] == [
        64,
        64,
        32,
        16,
        8,
    ]
    predictor = Predictor(memory=8)
    walk(predictor, parabola, np.linspace(0, 1, 20))
    assert len(predictor.path) == len(predictor.plain()["known"]) == 8
    predictor.corner()
    back = predictor.predict(1.5, ("voltage", 18 / 19))
    assert back.array == pytest.approx(parabola(18 / 19).array)


def swing(predictor, count, path=lambda V: vector(V**2, V), steps=6):
    """Go along a sine of voltage; returns by step whether the state was known, and the guesses."""
    predictor.add(0.0, ("prestretch", 1.0), path(0.0))
    predictor.start(("terminal.voltage", 0.0))
    known, guesses = [], []
    for k in range(1, count + 1):
        V = np.sin(np.pi / 2 * k / steps)
        guess = predictor.predict(k / steps, ("terminal.voltage", V))
        known.append(predictor.known)
        guesses.append(guess)
        predictor.add(k / steps, ("terminal.voltage", V), path(V))
    return known, guesses


def test_a_wave_turns_at_its_peak_and_beyond_zero_it_comes_to_images():
    """The first quarter of a sine is solved; all others are known, the second one reversed."""
    known, guesses = swing(Predictor(signs=vector(1.0, -1.0)), 48)
    assert known == [False] * 6 + [True] * 42
    for k, guess in enumerate(guesses[6:], start=7):
        V = np.sin(np.pi / 12 * k)
        assert guess.array == pytest.approx([V**2, V], abs=1e-12)


def test_a_wave_of_what_is_not_even_has_no_images():
    known, _ = swing(Predictor(), 24)
    assert known[6:12] == [True] * 6  # back to zero
    assert known[12:18] == [False] * 6


def test_a_wave_is_not_led_back_across_a_jump():
    def snapping(V):
        return vector(V**2 + 10 * (V > 0.7), V)

    known, _ = swing(Predictor(signs=vector(1.0, -1.0)), 24, snapping, 12)
    assert not any(known[:12])
    assert any(known[12:18])  # from the peak down to the jump
    assert not any(known[18:])


def test_a_restored_path_goes_on_through_images():
    whole, again = Predictor(signs=vector(1.0, -1.0)), Predictor(signs=vector(1.0, -1.0))
    swing(whole, 14)
    again.restore(whole.plain(), [k.q.copy() for k in whole.path])
    for p in (whole, again):
        V = np.sin(np.pi / 12 * 15)
        assert p.predict(15 / 6, ("terminal.voltage", V)).array == pytest.approx([V**2, V])
        assert p.known
