"""The reference solutions of films: each against an independent fact and against known numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from verification.printed import all_printed, printed
from verification.references import (
    EPS0,
    annulus,
    balloon,
    block,
    circle,
    continuation,
    diaphragm,
    strip,
    tube,
    unimorph,
    wrinkling,
)
from verification.references.laws import (
    Film,
    derivative,
    gent,
    mooney_rivlin,
    neo_hooke,
    ogden,
    shear_modulus,
    slopes,
)

pytestmark = pytest.mark.once  # without finite elements
NEO = neo_hooke(1.0)
OGDEN = ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0))


# laws and continuation


def test_laws_reduce_to_neo_hooke_and_have_their_moduli():
    at = (1.3, 0.9)
    exact = (1.3 - 1.3**-3 * 0.9**-2, 0.9 - 0.9**-3 * 1.3**-2)
    for law in (NEO, mooney_rivlin(0.5, 0.0), ogden([1.0], [2.0]), gent(1.0, 1e6)):
        assert slopes(law, *at) == pytest.approx(exact, rel=1e-5)
        assert law(*at) == pytest.approx(NEO(*at), rel=1e-5)
    assert slopes(ogden([-1.0], [-2.0]), *at) == pytest.approx(
        slopes(mooney_rivlin(0.0, 0.5), *at), rel=1e-14
    )
    for law, modulus in (
        (gent(0.4, 6.0), 0.4),
        (mooney_rivlin(0.3, 0.1), 0.8),
        (OGDEN, (0.63 * 1.3 + 0.0012 * 5 + 0.01 * 2) / 2),
    ):
        assert shear_modulus(law) == pytest.approx(modulus, rel=1e-9)
    assert np.isnan(gent(1.0, 1.0)(3.0, 3.0))


def test_continuation_finds_all_limit_points_of_a_cubic():
    def residual(x):
        return x[0] ** 3 - x[0] - x[1]

    found = list(continuation.limit_points(residual, [-1.4, -1.344], 0.1, 40))
    assert [x[0] for x in found] == pytest.approx([-(3**-0.5), 3**-0.5], abs=1e-5)
    assert [x[1] for x in found] == pytest.approx([2 * 3**-1.5, -2 * 3**-1.5], abs=1e-9)


# free block


@pytest.mark.parametrize("mode", ["biaxial", "uniaxial", "plane_strain"])
@pytest.mark.parametrize("law", [NEO, gent(0.7, 20.0), mooney_rivlin(0.4, 0.1), OGDEN])
@pytest.mark.parametrize("load", [0.0, 0.3])
def test_a_block_carries_its_load_by_the_maxwell_tensor_and_a_pressure(law, mode, load):
    """With W(l1, l2, l3), a pressure from the free faces and sigma = eps (e e - e^2 I/2)."""
    eps, H = 0.5, 0.2
    given = block.Block(law, mode, load, H, eps, width=1.1)
    V = 0.45 * H * (shear_modulus(law) / eps) ** 0.5
    state = block.at_voltage(given, V)
    l1, l2 = state.l1, state.l2
    l3 = 1 / (l1 * l2)
    e = V / (H * l3)
    stretches = np.array([l1, l2, l3])
    elastic = stretches * _by_three(law, stretches)
    maxwell = eps * e**2 * np.array([-0.5, -0.5, 0.5])
    true = elastic + maxwell - (elastic[2] + maxwell[2])
    nominal = true / stretches
    assert nominal[0] == pytest.approx(load, abs=1e-12)
    assert state.charge == pytest.approx(eps * e / l3, rel=1e-12)
    if mode == "plane_strain":
        assert l2 == 1.1
    else:
        assert nominal[1] == pytest.approx(load if mode == "biaxial" else 0.0, abs=1e-12)


def _by_three(law, l):
    """dW/dl of laws in three stretches, written out."""
    I1 = float((l**2).sum())
    minors = np.array([l[1] ** 2 + l[2] ** 2, l[0] ** 2 + l[2] ** 2, l[0] ** 2 + l[1] ** 2])
    if law is NEO:
        return l
    if law is OGDEN:
        terms = ((0.63, 1.3), (0.0012, 5.0), (-0.01, -2.0))
        return sum(mu * l ** (alpha - 1) for mu, alpha in terms)
    if law(1.1, 1.0) == pytest.approx(gent(0.7, 20.0)(1.1, 1.0), rel=1e-12):
        return 0.7 * 20 / (23 - I1) * l
    return 0.8 * l + 0.2 * l * minors


def test_pull_in_of_a_block():
    for law, voltage, stretch in (
        (NEO, "0.687365", "1.259921"),
        (gent(1.0, 90.0), "0.689590", "1.26425"),
        (mooney_rivlin(0.4, 0.1), "0.731118", "1.32077"),
    ):
        found = block.limit_point(block.Block(law))
        all_printed((found.voltage, found.l1), f"{voltage} {stretch}")
        below, above = (
            block.at_voltage(block.Block(law), f * found.voltage) for f in (0.9999, 1.0001)
        )
        assert below.l1 == pytest.approx(found.l1, rel=0.02)
        assert above is None
    # with a load the fold is the maximum of the explicit path
    for law in (NEO, gent(0.7, 20.0), mooney_rivlin(0.4, 0.1), OGDEN):
        for mode in ("biaxial", "uniaxial"):
            given = block.Block(law, mode, 0.3, 0.2, 0.5)
            found = block.limit_point(given, step=0.05)
            near = [block.at_stretch(given, found.l1 * (1 + d)).voltage for d in (-1e-3, 0.0, 1e-3)]
            assert near[1] > max(near[0], near[2]), (mode, law)
    assert block.limit_point(block.Block(NEO, "plane_strain", 0.5)) is None
    # Gent snaps to a second branch, which the voltage reaches after a minimum
    assert block.at_voltage(block.Block(gent(1.0, 20.0)), 0.8) is None


# expanding circle


@pytest.mark.parametrize(
    ("law", "lp", "ratio", "v", "texts"),
    [
        (
            NEO, 1.5, 0.25, 0.3,
            "1.015659 1.523489 0.969402 1.338782 1.473462 1.496863 1.367760 1.064123",
        ),
        (
            NEO, 3.0, 0.5, 0.9,
            "1.037547 3.112642 0.928933 2.807650 2.812290 2.924899 2.995671 1.158861",
        ),
        (
            gent(1.0, 30.0), 1.5, 0.25, 0.7,
            "1.090321 1.635481 0.841185 1.266860 1.347862 1.481857 1.444430 1.413244",
        ),
    ],
)  # fmt: skip
def test_expanding_circle(law, lp, ratio, v, texts):
    # scaled: b = 50 mm, H = 0.5 mm, G = 0.02 MPa, er = 4.7
    G, eps, b, H = 0.02, 4.7 * EPS0, 50.0, 0.5
    film = Film(lambda l1, l2: G * law(l1, l2), H, lp, eps)
    device = circle.Circle(film, b, ratio * b)
    state = circle.at_voltage(device, v * H * (G / eps) ** 0.5)
    ring = state.ring
    rest = eps * np.pi * (ratio * b) ** 2 / H
    all_printed(
        (
            state.edge / (ratio * b), state.stretch, state.thickness / H, state.stress / G,
            ring.l1[0], ring.l1[-1], ring.s2.min() / G, state.capacitance / rest,
        ),
        texts,
    )  # fmt: skip
    same = circle.at_stretch(device, state.stretch)
    assert same.voltage == pytest.approx(state.voltage, rel=1e-8)


def test_expanding_circle_of_any_law_obeys_its_potential():
    """-dPi/dV = C V, with elastic energy less C V^2/2."""

    def own(l1, l2):  # Yeoh, given as a function of the user's
        I = l1**2 + l2**2 + 1 / (l1 * l2) ** 2 - 3
        return 0.5 * I - 0.02 * I**2 + 0.003 * I**3

    device = circle.Circle(Film(own, 0.8, 1.4, 0.7), 3.0, 1.0)

    def potential(V):
        state = circle.at_voltage(device, V)
        return state.energy - state.capacitance * V * V / 2

    V = 0.4
    assert -derivative(potential, V, 0.02) == pytest.approx(
        circle.at_voltage(device, V).capacitance * V, rel=1e-7
    )
    small = circle.at_voltage(device, 0.01)
    assert small.edge - 1 == pytest.approx(circle.small_signal(device, 0.01), rel=3e-4)


def test_expanding_circle_loses_its_tension_or_pulls_in():
    def device(lp, ratio):
        return circle.Circle(Film(NEO, 1.0, lp), 1.0, ratio)

    slack = circle.tension_loss(device(1.2, 0.5))
    all_printed((slack.stretch, slack.edge / 0.5, slack.voltage), "1.445232 1.204360 0.940119")
    assert circle.limit_point(device(1.2, 0.5), step=0.2) is None
    fold = circle.limit_point(device(2.0, 0.25), step=0.3)
    near = [circle.at_stretch(device(2.0, 0.25), fold.stretch + d).voltage for d in (-0.05, 0.05)]
    assert fold.stress > 0.5
    assert fold.voltage > max(near)
    assert fold.voltage == pytest.approx(max(near), rel=1e-3)


# annulus with a rigid disc


def test_annulus_with_a_rigid_disc():
    device = annulus.Annulus(Film(NEO, 1 / 1.44, 1.2), 1.0, 2.0)  # unstretched thickness 1
    states = [annulus.push(device, 1.0, phi) for phi in (0.0, 0.1, 0.2, 0.3)]
    all_printed((s.force for s in states), "8.307286 8.176674 7.782929 7.119352")
    all_printed((states[0].capacitance, states[-1].capacitance), "26.584370 26.734910")


def test_annulus_obeys_its_potential_and_its_linear_limit():
    device = annulus.Annulus(Film(OGDEN, 0.05, 1.3, 3 * EPS0), 5.0, 9.0)
    V = 1.5

    def potential(u):
        state = annulus.push(device, u, V)
        return state.energy - state.capacitance * V * V / 2

    assert derivative(potential, 1.5, 0.1) == pytest.approx(
        annulus.push(device, 1.5, V).force, rel=1e-6
    )
    u = 0.02
    small, flat = annulus.push(device, u), annulus.push(device, 0.0)
    for volts in (0.0, V):
        force = annulus.push(device, u, volts).force
        assert force / u == pytest.approx(annulus.stiffness(device, volts), rel=3e-5)
    z = np.interp(6.0, small.meridian.r, small.meridian.z)
    assert annulus.shape(device, 6.0, u) == pytest.approx(u - z, rel=2e-3)
    change = small.capacitance - flat.capacitance
    assert change == pytest.approx(annulus.capacitance_change(device, u), rel=1e-3)
    # the least voltage at which it wrinkles: at a small force that of the flat film
    flat = device.film.unstretched * wrinkling.onset_equal(OGDEN, 1.3, 3 * EPS0)
    assert annulus.tension_loss(device, 1e-4).voltage == pytest.approx(flat, rel=2e-3)
    slack = annulus.tension_loss(device, 0.2)
    assert slack.meridian.s2[0] == pytest.approx(0, abs=1e-12)
    assert (slack.meridian.s2[1:] > 0).all()
    again = annulus.push(device, slack.displacement, slack.voltage)
    assert again.force == pytest.approx(0.2, rel=1e-7)
    # T, the mounted tension, of neo-Hooke
    neo = annulus.Annulus(Film(NEO, 1 / 1.44, 1.2), 1.0, 2.0)
    exact = 2 * np.pi * (1.2**2 - 1.2**-4 - (0.2 * 1.44) ** 2) / (1.44 * np.log(2))
    assert annulus.stiffness(neo, 0.2) == pytest.approx(exact, rel=1e-12)


# thick tube


@pytest.mark.parametrize(
    ("B", "ends", "P", "v", "lz", "texts"),
    [
        (1.1, "open", 0.0, 0.6, 1.0, "1.100015 1.113794 1.196429 0.000000 96.571885"),
        (1.1, "open", 0.02, 0.4, 1.0, "1.001771 1.133354 1.222342 0.000000 83.272081"),
        (2.0, "held", 0.0, 0.6, 1.5, "1.500000 1.557891 2.104050 4.737593 31.360435"),
    ],
)
def test_tube(B, ends, P, v, lz, texts):
    given = tube.Tube(NEO, 1.0, B)
    state = tube.at_voltage(given, v * given.unit_voltage, P, ends, lz)
    values = (state.stretch, state.inner, state.outer, state.force, state.capacitance)
    all_printed(values, texts)
    same = tube.at_radius(given, state.inner, P, ends, lz)
    assert same.voltage == pytest.approx(state.voltage, rel=1e-9)


def test_capped_tube_is_a_stationary_point_of_its_potential():
    given = tube.Tube(OGDEN, 3.0, 4.0, 0.5)
    V, P = 0.5 * given.unit_voltage, 0.01
    at = tube.at_voltage(given, V, P, "capped")
    assert at.force == pytest.approx(np.pi * at.inner**2 * P, rel=1e-9)

    def potential(a, lz):
        state = tube._state(given, a, lz, V, P)
        return state.energy - state.capacitance * V**2 / 2 - P * np.pi * a * a * lz

    assert derivative(lambda a: potential(a, at.stretch), at.inner) == pytest.approx(0, abs=1e-9)
    assert derivative(lambda s: potential(at.inner, s), at.stretch) == pytest.approx(0, abs=1e-9)


def test_thin_tube_is_a_free_block_and_pulls_in():
    thin = tube.Tube(NEO, 1.0, 1.0001)
    free = block.at_voltage(block.Block(NEO), 0.3)
    state = tube.at_voltage(thin, 0.3 * thin.unit_voltage)
    assert state.stretch == pytest.approx(free.l1, rel=1e-5)
    assert state.inner == pytest.approx(free.l1, rel=1e-5)
    given = tube.Tube(NEO, 1.0, 1.1)
    for P, v in ((0.0, "0.687408"), (0.02, "0.622878")):
        fold = tube.limit_point(given, P)
        assert printed(fold.voltage / given.unit_voltage, v)
        near = [tube.at_radius(given, fold.inner * f, P).voltage for f in (0.999, 1.001)]
        assert fold.voltage > max(near)
    fold = tube.limit_point(tube.Tube(NEO, 1.0, 2.0))
    all_printed((fold.voltage, fold.inner, fold.stretch), "0.689947 1.5875 1.2669")
    assert tube.limit_point(given, ends="held", step=0.1) is None


# balloon


def test_balloon():
    thick = balloon.Balloon(gent(1.0, 30.0), 1.0, 0.2, thick=True)
    pressures = [balloon.pressure(thick, l, 0.02) / 0.2 for l in (1.2, 1.5, 2.0, 3.0)]
    all_printed(pressures, "0.906086 1.147743 1.072833 1.071036")
    limits = balloon.limit_pressures(thick, 0.02)
    all_printed(limits, "1.536294 2.543378")
    all_printed((balloon.pressure(thick, l, 0.02) / 0.2 for l in limits), "1.149039 1.016457")
    thin = balloon.Balloon(NEO, 1.0, 1.0)
    assert balloon.limit_pressures(thin)[0] == pytest.approx(7 ** (1 / 6), rel=1e-9)
    nearly = balloon.Balloon(NEO, 1.0, 1e-4, thick=True)
    assert balloon.pressure(nearly, 2.0, 0.2e-4) * 1e4 == pytest.approx(
        balloon.pressure(thin, 2.0, 0.2), rel=1e-4
    )
    assert balloon.voltage(thick, 1.5, balloon.pressure(thick, 1.5, 0.02)) == pytest.approx(0.02)


@pytest.mark.parametrize("is_thick", [False, True])
def test_the_pressure_is_the_derivative_of_the_potential_by_volume(is_thick):
    given = balloon.Balloon(OGDEN, 10.0, 2.0, 4 * EPS0, thick=is_thick)
    V, l = 30.0, 1.4

    def potential(l):
        return balloon.energy(given, l) - balloon.capacitance(given, l) * V * V / 2

    by_volume = derivative(potential, l) / derivative(lambda x: balloon.volume(given, x), l)
    assert balloon.pressure(given, l, V) == pytest.approx(by_volume, rel=1e-8)


def test_pull_in_of_a_balloon():
    """Without pressure it is that of a free block; Gent's balloon comes back at a minimum."""
    found = balloon.limit_voltages(balloon.Balloon(NEO, 1.0, 1.0))
    assert found == [pytest.approx((2 ** (1 / 3), 0.6873648185), rel=1e-6)]
    given = balloon.Balloon(gent(1.0, 97.2), 1.0, 1.0)
    inflated = balloon.Balloon(gent(1.0, 30.0), 1.0, 1.0)
    for device, p in ((given, 0.5), (inflated, 0.5)):
        folds = balloon.limit_voltages(device, p)
        for l, V in folds:  # the pressure is stationary there as well
            assert pytest.approx(balloon.voltage(device, l, p), rel=1e-9) == V
            slope = derivative(lambda x, d=device, p=p: balloon.voltage(d, x, p), l)
            assert slope == pytest.approx(0, abs=1e-5)
    assert len(folds) == 2


def test_motion_of_a_balloon():
    given = balloon.Balloon(NEO, 1.0, 1.0)
    all_printed([balloon.angular_frequency(given, 1.0)], "3.464102")
    for p, E, texts in (
        (0.0, 0.3, "1.016397 3.242281 1.033274 1.938227"),
        (0.5, 0.2, "1.064139 2.747869 1.136544 2.295730"),
        (1.0, 0.0, "1.154244 1.979974 1.380933 3.387061"),
    ):
        l = balloon.at(given, p, E)
        all_printed(
            (l, balloon.angular_frequency(given, l, E), *balloon.release(given, p, E)), texts
        )
    assert balloon.at(given, 1.0, 0.3) is None
    assert balloon.release(given, 1.2, 0.0) is None
    # by the differential equation, of a balloon of 10 mm in mm, MPa, kV, s
    real = balloon.Balloon(gent(0.02, 30.0), 10.0, 0.2, 4.7 * EPS0, density=960e-12)
    top, period = balloon.release(real, 3e-4, 1.0)

    def rate(t, y):
        return [y[1], balloon.motion(real, y[0], 3e-4, 1.0)]

    half = solve_ivp(rate, (0, period / 2), [1.0, 0.0], "DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    assert half[0] == pytest.approx(top, rel=1e-8)
    assert half[1] / (top / period) == pytest.approx(0, abs=1e-6)


# diaphragm


@pytest.mark.parametrize(
    ("lp", "p", "v", "texts"),
    [
        (1.2, 1.0, 0.4, "0.297539 0.485533 1.285218 1.243927 -34.0102"),
        (1.2, 2.0, 0.4, "0.729582 1.349285 1.834987 1.317822 -73.7613"),
        (2.0, 1.5, 0.6, "0.106093 0.167259 2.023068 1.998944 -12.1084"),
    ],
)
def test_diaphragm(lp, p, v, texts):
    G, eps, b, H = 0.02, 4.7 * EPS0, 20.0, 0.25
    device = diaphragm.Diaphragm(Film(neo_hooke(G), H, lp, eps), b)
    state = diaphragm.at_pressure(device, p * G * H / b, v * H * (G / eps) ** 0.5, step=0.1)
    values = (state.height / b, state.volume / b**3, state.apex, state.edge, state.slope)
    all_printed(values, texts)


def test_diaphragm_of_any_law_obeys_its_potential():
    """dPi = -volume dp - C V dV along a line, Pi the elastic energy less C V^2/2 and p volume."""
    device = diaphragm.Diaphragm(Film(gent(1.0, 30.0), 1.0, 1.2), 1.0)
    dp, dV = 0.3, -0.2

    def at(x):
        return diaphragm.at_pressure(device, 0.8 + dp * x, 0.5 + dV * x)

    ends = [
        end.energy - end.capacitance * end.voltage**2 / 2 - end.pressure * end.volume
        for end in (at(0.0), at(1.0))
    ]
    x, w = np.polynomial.legendre.leggauss(4)
    states = [at((1 + node) / 2) for node in x]
    duals = [-s.volume * dp - s.capacitance * s.voltage * dV for s in states]
    assert ends[1] - ends[0] == pytest.approx(w @ duals / 2, rel=1e-7)
    tall = states[0]
    same = diaphragm.at_height(device, tall.height, tall.voltage)
    assert (same.pressure, same.volume) == pytest.approx((tall.pressure, tall.volume), rel=1e-7)
    small = diaphragm.at_pressure(device, 1e-3, 0.4)
    tension = device.film.tension(0.4)
    assert small.height == pytest.approx(1e-3 / (4 * tension), rel=1e-5)
    assert small.volume == pytest.approx(np.pi * 1e-3 / (8 * tension), rel=1e-5)


def test_limit_points_of_a_diaphragm():
    device = diaphragm.Diaphragm(Film(NEO, 1.0, 1.2), 1.0)
    fold = diaphragm.limit_pressure(device, 0.4)
    all_printed((fold.pressure, fold.apex), "2.015640 1.9799")
    # the same fold, met by raising the voltage
    same = diaphragm.limit_voltage(device, fold.pressure)
    assert same.voltage == pytest.approx(0.4, rel=1e-6)
    assert same.apex == pytest.approx(fold.apex, rel=1e-3)
    assert diaphragm.at_pressure(device, 1.5, 0.6, step=0.3) is None


# pure-shear strip


@pytest.mark.parametrize(
    ("lp", "lw", "E", "texts"),
    [
        (1.0, 1.0, 0.25, "1.016265 -0.032796 -0.062500 -0.062500 0.000000 0.000000"),
        (2.0, 1.0, 0.4, "2.326662 -0.050865 1.555000 0.110000 0.968246 0.433013"),
        (1.5, 1.5, 0.4, "2.202946 0.274233 0.828313 0.828313 0.636731 0.636731"),
    ],
)
def test_strip(lp, lw, E, texts):
    G, eps, H = 0.02, 4.7 * EPS0, 0.5
    given = strip.Strip(neo_hooke(G), H, 100.0, lw, eps)
    unit = H * (G / eps) ** 0.5
    load = strip.load_of(given, lp)
    free, held = strip.at_load(given, load, E * unit), strip.at_length(given, lp, E * unit)
    slack = strip.slack(given, lp)
    all_printed(
        (free.stretch, free.across / G, held.along / G, held.across / G, *np.array(slack) / unit),
        texts,
    )
    assert free.force == pytest.approx(load * H * 100)
    assert strip.limit_point(given, load) is None


def test_strip_of_any_law_obeys_its_potential():
    given = strip.Strip(OGDEN, 0.5, 10.0, 1.2, 0.7)
    V, l = 0.3, 1.6
    volume = 0.5 * 10

    def potential(l):
        at = strip.at_length(given, l, V)
        return OGDEN(l, 1.2) * volume - at.capacitance * V * V / 2

    assert strip.at_length(given, l, V).force == pytest.approx(derivative(potential, l), rel=1e-9)
    small = strip.at_load(strip.Strip(NEO), 0.0, 0.01)
    assert small.stretch == pytest.approx((1 - 1e-4) ** -0.25, rel=1e-12)


# unimorph


@pytest.mark.parametrize(
    ("m", "n", "v", "texts"),
    [
        (1.0, 1.0, 0.3, "1.687500e-02 1.788317e-02 1.011887 1.767308e-02 1.020686"),
        (1.0, 3.0, 0.6, "6.230769e-02 8.436605e-02 1.067302 7.904608e-02 1.106119"),
        (0.5, 1.0, 0.6, "4.000000e-02 4.808572e-02 1.060116 4.535891e-02 1.082558"),
    ],
)
def test_unimorph(m, n, v, texts):
    h1, G1, eps = 0.5, 0.02, 4.7 * EPS0
    given = unimorph.Unimorph(neo_hooke(G1), neo_hooke(G1 / n), h1, h1 / m, eps)
    V = v * h1 * (G1 / eps) ** 0.5
    state = unimorph.bend(given, V)
    small = unimorph.curvature(given, V)
    all_printed(
        (small * h1, state.k * h1, state.stretch, state.curvature * h1, state.middle), texts
    )
    assert unimorph.laminate(given, V) == pytest.approx(small, rel=1e-12)
    weak = unimorph.bend(given, 1e-3 * V)
    assert weak.k == pytest.approx(unimorph.curvature(given, 1e-3 * V), rel=1e-5)


def test_unimorph_is_a_stationary_point_of_its_potential():
    given = unimorph.Unimorph(gent(1.0, 10.0), OGDEN, 1.0, 0.7)
    V = 0.5
    at = unimorph.bend(given, V)

    def potential(k, li):
        return unimorph.energy(given, k, li) - unimorph.capacitance(given, k, li) * V * V / 2

    assert derivative(lambda k: potential(k, at.stretch), at.k) == pytest.approx(0, abs=1e-10)
    assert derivative(lambda s: potential(at.k, s), at.stretch) == pytest.approx(0, abs=1e-10)
    assert unimorph.limit_point(given) is None


# wrinkling


def test_wrinkling_onset_and_natural_width():
    for l1, l2, text in (
        (1.2, 1.2, "0.679615"),
        (3.0, 3.0, "0.333105"),
        (2.0, 1.0, "0.433013"),
        (4.0, 2.0, "0.249511"),
    ):
        E = wrinkling.onset(NEO, l1, l2)
        assert printed(E, text)
        # at the onset the film has just its natural width
        assert wrinkling.natural_width(NEO, l1, E**2) == pytest.approx(l2, rel=1e-12)
    law = gent(1.0, 30.0)
    E = wrinkling.onset_equal(law, 2.0)
    assert pytest.approx(wrinkling.onset(law, 2.0, 2.0), rel=1e-12) == E
    factor = 30 / (33 - 2 * 4 - 1 / 16)
    assert pytest.approx(factor * (2**-2 - 2**-8), rel=1e-12) == E**2
    for l1, e2 in ((1.5, 0.0), (1.5, 0.2), (2.0, 0.2)):
        exact = (l1**2 * (1 - e2 * l1**2)) ** -0.25
        assert wrinkling.natural_width(NEO, l1, e2) == pytest.approx(exact, rel=1e-12)
    assert np.isnan(wrinkling.natural_width(NEO, 2.0, 0.26))  # E l1 > 1
    # Gent's law has one at any field, short of its limit
    width = wrinkling.natural_width(law, 2.0, 0.5)
    assert slopes(law, 2.0, width)[1] == pytest.approx(0.5 * width * 4, rel=1e-9)


@pytest.mark.parametrize("pull", [0.0, 0.1])
@pytest.mark.parametrize(("shear", "across"), [(0.5, 1.0), (0.8, 0.9), (0.1, 1.3)])
def test_tension_field_of_a_sheared_strip(shear, across, pull):
    """Its stress is the gradient of the relaxed energy; one principal tension has vanished."""
    law = gent(1.0, 30.0)
    state = wrinkling.sheared_strip(law, shear, 1.0, across, pull)

    def energy(i, j):
        def at(x):
            F = np.array([[1.0, shear], [0.0, across]])
            F[i, j] += x
            return wrinkling.sheared_strip(law, F[0, 1], F[0, 0], F[1, 1], pull).energy

        return derivative(at, 0.0)

    for i, j in ((0, 0), (0, 1), (1, 1)):
        assert state.nominal[i, j] == pytest.approx(energy(i, j), rel=1e-8, abs=1e-9)
    assert state.taut == (across == 1.3)
    true = state.nominal @ np.array([[1.0, shear], [0.0, across]]).T
    assert true == pytest.approx(true.T, abs=1e-12)
    tensions, directions = np.linalg.eigh(true)
    assert (tensions[0] > 0) if state.taut else (abs(tensions[0]) < 1e-12)
    angle = np.degrees(np.arctan(directions[1, 1] / directions[0, 1]))
    assert angle == pytest.approx(state.angle, abs=1e-9)


def test_wagners_web():
    """Near no strain a quarter of Young's modulus at 45 degrees; neo-Hooke in closed form."""
    small = wrinkling.sheared_strip(NEO, 1e-5)
    assert small.nominal[0, 1] / 1e-5 == pytest.approx(3 / 4, rel=1e-4)
    assert small.angle == pytest.approx(45, abs=1e-3)
    assert not small.taut
    large = wrinkling.sheared_strip(NEO, 0.7)
    l1 = (0.7 + (0.7**2 + 4) ** 0.5) / 2  # simple shear: l1 - 1/l1 = gamma
    rate = l1 / (l1 + 1 / l1)
    assert large.nominal[0, 1] == pytest.approx((l1 - l1**-2) * rate, rel=1e-12)
