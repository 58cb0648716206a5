"""The linear reference solutions: frequencies, circuits, sound and flow.

Each is checked against an independent fact and against known numbers.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import eigh, expm
from scipy.special import j1, jn_zeros

from verification.printed import all_printed, printed
from verification.references import (
    capacitor,
    chamber,
    frequencies,
    line,
    oscillator,
    sound,
    unimorph,
)
from verification.references.laws import Film, neo_hooke

pytestmark = pytest.mark.once  # without finite elements
NEO = neo_hooke(1.0)


# frequencies


def test_membrane_frequencies():
    all_printed(frequencies.annulus(1, 3, 0.25, 1.0), "4.447506 8.536922 12.678959")
    lp, v = 1.2, 0.4
    film = Film(NEO, 1.0, lp)
    assert printed(film.tension(v), "0.797747")
    wbar = [frequencies.disc(n, 1, 1.0)[0] * film.tension(v) ** 0.5 for n in range(3)]
    all_printed(wbar, "2.147910 3.422353 4.586967")
    mass = 10 * np.pi * 0.25
    all_printed(frequencies.plunging_plate(2, 0.5, 1.0, mass), "1.038962 6.374652")
    inertia = 10 * np.pi / 64
    all_printed(frequencies.rocking_plate(2, 0.5, 1.0, inertia), "1.939350 6.635749")
    # a vanishing core
    assert frequencies.annulus(1, 1, 1e-4, 1.0)[0] == pytest.approx(jn_zeros(1, 1)[0], rel=1e-6)
    tiny = frequencies.plunging_plate(1, 1e-4, 1.0, np.pi * 1e-8)[0]
    assert tiny == pytest.approx(jn_zeros(0, 1)[0], rel=1e-6)


@pytest.mark.parametrize(("n", "a", "plate"), [(0, 0.4, 2.0), (1, 0.4, 0.3), (2, 0.4, None)])
def test_membrane_frequencies_from_an_eigenvalue_problem(n, a, plate):
    """Linear elements along the radius: int r w'^2 + n^2 w^2/r = k^2 int r w^2, extrapolated."""

    def lowest(cells):
        r = np.linspace(a, 1.0, cells + 1)
        mid, h = (r[1:] + r[:-1]) / 2, (1 - a) / cells
        K, M = np.zeros((2, cells + 1, cells + 1))
        i = np.arange(cells)
        for p, q, stiff, mass in (
            (0, 0, 1, 1 / 3),
            (1, 1, 1, 1 / 3),
            (0, 1, -1, 1 / 6),
            (1, 0, -1, 1 / 6),
        ):
            np.add.at(K, (i + p, i + q), mid / h * stiff + n * n * h / mid * mass)
            np.add.at(M, (i + p, i + q), mid * h * mass)
        if n == 0:  # the plate's mass on its edge: w(a) is its displacement
            M[0, 0] += plate / (2 * np.pi)
        elif plate:  # the tension on the tilted edge, and the inertia
            K[0, 0] += 1.0
            M[0, 0] += plate / (np.pi * a * a)
        first = 0 if plate else 1
        keep = slice(first, cells)
        return (
            eigh(K[keep, keep], M[keep, keep], eigvals_only=True, subset_by_index=[0, 0])[0] ** 0.5
        )

    coarse, fine = lowest(60), lowest(120)
    solve = {0: frequencies.plunging_plate, 1: frequencies.rocking_plate}.get(n)
    exact = solve(1, a, 1.0, plate)[0] if solve else frequencies.annulus(n, 1, a, 1.0)[0]
    assert fine + (fine - coarse) / 3 == pytest.approx(exact, rel=1e-6)


def test_cantilever_frequencies():
    D = frequencies.bilayer_stiffness(3.0, 1.0, 1.0, 1.0)
    assert printed(D, "4.333333")
    omega = frequencies.cantilever(3, 40.0, D, 2.0)
    all_printed(omega, "3.234646e-03 2.027118e-02 5.675990e-02")
    # a moment bends it as the unimorph's small-strain section does: D k = eps E^2 h1 (lever)
    given = unimorph.Unimorph(neo_hooke(3.0), NEO, 1.0, 1.0)
    layers = 3 * 1.5 + 0.5
    lever = 1.5 - layers / 4
    V = 0.1
    assert unimorph.curvature(given, V) == pytest.approx(V**2 * lever / D, rel=1e-12)


# capacitor


def test_capacitor():
    all_printed(
        [capacitor.homogeneous(w, 1.0) for w in (1, 10, 50)], "2.115779 11.681330 52.161054"
    )
    sheets = [capacitor.infinite_sheet(w, 1.0, 4.7) for w in (1, 10, 50)]
    all_printed(sheets, "7.510579 50.431286 238.927426")
    slabs = [capacitor.finite_slab(w, 1.0, 4.7) for w in (1, 10, 50)]
    all_printed(slabs, "5.8658 48.7249 237.2037")
    for w in (0.3, 4.0):  # three ways to the same number, in mm as well
        exact = capacitor.homogeneous(w, 1.0)
        assert capacitor.infinite_sheet(0.05 * w, 0.05, 1.0) == pytest.approx(exact, rel=1e-11)
        assert capacitor.finite_slab(0.05 * w, 0.05, 1.0) == pytest.approx(exact, rel=1e-9)
        assert (
            w < exact < capacitor.finite_slab(w, 1.0, 3.0) < capacitor.infinite_sheet(w, 1.0, 3.0)
        )
    assert printed(capacitor.love_asymptote(50.0, 1.0), "52.148560")


def test_slab_gains_capacitance_by_the_energy_in_it():
    """dC/der at er = 1 is int |grad phi|^2 over the slab at 1 V, from the potential of the strips.

    That is int phi dphi/dn over its edge, the field of a density T_k/sqrt(1 - t^2) on a strip of
    half length 1 being pi (z - sqrt(z^2 - 1))^k/sqrt(z^2 - 1).
    """
    w, h = 1.0, 1.0
    rise = (capacitor.finite_slab(w, h, 1 + 1e-4) - capacitor.finite_slab(w, h, 1 - 1e-4)) / 2e-4
    coefficients = capacitor.sheet_coefficients(w, h, 1.0)

    def field(x, y):  # Ex - i Ey
        def single(z):
            root = np.sqrt(z - 1) * np.sqrt(z + 1)
            powers = (z - root) ** (2 * np.arange(len(coefficients)))
            return (coefficients @ powers) * np.pi / root / (2 * np.pi)

        z = (x + 1j * y) / (w / 2)
        return single(z - 1j * h / w) - single(z + 1j * h / w)

    def potential(y):  # on the side, from the middle plane
        return -quad(lambda s: -field(w / 2, s).imag, 0, y, epsrel=1e-9)[0]

    def side(t):  # y = h/2 - t^2 takes the edge's singularity away
        y = h / 2 - t * t
        return 2 * t * potential(y) * -field(w / 2, y).real

    flux = 2 * quad(lambda x: field(x, 0.0).imag, 0, w / 2, epsrel=1e-9)[0]
    out = (
        2
        * quad(lambda t: 2 * t * field(w / 2, h / 2 - t * t).real, 0, (h / 2) ** 0.5, epsrel=1e-9)[
            0
        ]
    )
    energy = 2 * (flux + out) / 2 + 4 * quad(side, 0, (h / 2) ** 0.5, epsrel=1e-7)[0]
    assert energy == pytest.approx(rise, rel=1e-5)


# RC line


def test_line():
    given = line.Sheets(1e4, 1e4, 1e-7)
    L, W, a, b = 0.1, 0.02, 0.01, 0.04
    omega = 1.5e6
    for Z, real, imaginary in (
        (line.strip(given, omega, L, W), "1.290004e+04", "-1.292225e+04"),
        (line.opposite_ends(given, omega, L, W), "3.142969e+04", "-6.081965e+03"),
        (line.annulus_from_outside(given, omega, a, b), "6.861211e+02", "-1.517899e+03"),
        (line.annulus_from_inside(given, omega, a, b), "2.449782e+03", "-1.763351e+03"),
        (line.annulus_from_outside(given, omega, 0.0, b), "7.525154e+02", "-1.471632e+03"),
    ):
        all_printed((Z.real, Z.imag), f"{real} {imaginary}")
    # far below the corner: a capacitor with a third of the line's resistance, Rs/(8 pi) of a disc
    Z = line.strip(given, 1.0, L, W)
    assert Z.real == pytest.approx(2e4 * L / (3 * W), rel=1e-9)
    assert -1 / Z.imag == pytest.approx(1e-7 * L * W, rel=1e-9)
    assert line.annulus_from_outside(given, 10.0, 0.0, b).real == pytest.approx(2e4 / (8 * np.pi))
    # scaled Bessel functions: far above it Z = Rs/(2 pi r q)
    q = given.q(1e12)
    assert line.annulus_from_outside(given, 1e12, a, b) == pytest.approx(
        2e4 / (2 * np.pi * b * q), rel=1e-3
    )


@pytest.mark.parametrize("feed", ["outside", "inside", "opposite"])
def test_line_against_a_ladder(feed):
    """Finite volumes of both electrodes' potentials."""
    given = line.Sheets(3e4, 1e4, 1e-7)
    omega, a, b, W = 2e5, 0.01, 0.04, 0.02

    def ladder(n):
        edges = np.linspace(a, b, n + 1)
        mid = (edges[1:] + edges[:-1]) / 2
        breadth = np.full(n + 1, W) if feed == "opposite" else 2 * np.pi * edges
        widths = np.full(n, W) if feed == "opposite" else 2 * np.pi * mid
        h = (b - a) / n
        Y = np.zeros((2 * n, 2 * n), dtype=complex)
        for k, R in enumerate((given.first, given.second)):
            i = k * n + np.arange(n - 1)
            g = breadth[1:-1] / (R * h)
            for p, q, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
                np.add.at(Y, (i + p, i + q), sign * g)
        c = 1j * omega * given.capacitance * widths * h
        i = np.arange(n)
        for p, q, sign in ((0, 0, 1), (n, n, 1), (0, n, -1), (n, 0, -1)):
            np.add.at(Y, (i + p, i + q), sign * c)
        first, second = {"outside": (n - 1, n - 1), "inside": (0, 0), "opposite": (0, n - 1)}[feed]
        current = np.zeros(2 * n)
        current[first], current[n + second] = 1.0, -1.0
        phi = np.linalg.lstsq(Y, current, rcond=None)[0]
        # half a cell more to each terminal
        ends = [
            h / 2 * R / breadth[e + (e > 0)]
            for R, e in ((given.first, first), (given.second, second))
        ]
        return phi[first] - phi[n + second] + sum(ends)

    exact = {
        "outside": lambda: line.annulus_from_outside(given, omega, a, b),
        "inside": lambda: line.annulus_from_inside(given, omega, a, b),
        "opposite": lambda: line.opposite_ends(given, omega, b - a, W),
    }[feed]()
    coarse, fine = ladder(60), ladder(120)
    assert abs(fine + (fine - coarse) / 3 - exact) < 2e-6 * abs(exact)


def test_line_behind_a_drivers_resistance():
    given = line.Sheets(0.02, 0.03, 1e-3)  # Gohm, nF/mm^2, mm, s
    L, W, driver = 30.0, 10.0, 0.1
    omega = 700.0
    V0 = line.strip_voltage(given, omega, L, W, 0.0, driver)
    Z = line.strip(given, omega, L, W)
    assert pytest.approx(Z / (Z + driver), rel=1e-12) == V0
    # the step's series, transformed, is the harmonic answer
    tau = 0.05 * 1e-3 * L**2
    rates = line._rates(0.05 * L / W, driver, 1000)
    A = 4 * np.sin(rates) / (2 * rates + np.sin(2 * rates))
    for x in (0.0, 0.7 * L):
        parts = A * np.cos(rates * (1 - x / L)) * rates**2 / (rates**2 + 1j * omega * tau)
        harmonic = line.strip_voltage(given, omega, L, W, x, driver)
        assert abs(parts.sum() - harmonic) < 2e-3 * abs(harmonic)
    # against a ladder in time
    n, t = 200, 0.3 * tau
    h = L / n
    g = W / (0.05 * h)
    Y = np.diag(np.full(n, 2 * g)) - np.diag(np.full(n - 1, g), 1) - np.diag(np.full(n - 1, g), -1)
    Y[0, 0], Y[-1, -1] = g + 1 / (driver + 1 / (2 * g)), g
    V = 1 - expm(-Y * t / (1e-3 * W * h)) @ np.ones(n)
    assert line.strip_step(given, t, L, W, None, driver) == pytest.approx(V.mean(), rel=1e-5)
    assert line.strip_step(given, t, L, W, L, driver) == pytest.approx(V[-1], rel=1e-4)
    # no line: one resistance and one capacitance
    good = line.Sheets(1e-7, 1e-7, 1e-3)
    times = np.array([0.01, 0.03])
    exact = 1 - np.exp(-times / (driver * 1e-3 * L * W))
    assert line.strip_step(good, times, L, W, None, driver, 5) == pytest.approx(exact, rel=1e-4)
    assert line.strip_step(given, 1e-3 * tau, L, W) == pytest.approx(
        2 * (1e-3 / np.pi) ** 0.5, rel=1e-6
    )


# one degree of freedom


def test_oscillator():
    o = oscillator.Oscillator(branch=0.5, tau=2.0)
    for omega, texts in (
        (0.1, "0.981940 -0.093554 0.986387 -5.4424"),
        (1.0, "2.000000 -1.000000 2.236068 -26.5651"),
        (2.0, "-0.394495 -0.018349 0.394922 -177.3370"),
    ):
        u = oscillator.harmonic(o, omega)
        all_printed((u.real, u.imag, abs(u), np.degrees(np.angle(u))), texts)
    t = np.array([0.5, 10.0])
    all_printed(oscillator.creep(o, t), "0.717839 0.988109")
    all_printed(oscillator.step(oscillator.Oscillator(damper=0.2), t), "0.118454 1.336852")
    all_printed(oscillator.step(o, t), "0.121204 0.747520")


def test_oscillator_against_its_differential_equation():
    o = oscillator.Oscillator(2e-6, 0.3, 1e-4, 0.2, 3e-3)
    omega, F = 250.0, 0.7

    def rate(t, y, force):
        u, v, inner = y
        pull = o.branch * (u - inner)
        return [v, (force(t) - o.damper * v - o.stiffness * u - pull) / o.mass, (u - inner) / o.tau]

    end = 0.02
    tight = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
    done = solve_ivp(rate, (0, end), [0, 0, 0], args=(lambda t: F,), **tight)
    assert oscillator.step(o, end) * F == pytest.approx(done.y[0, -1], rel=1e-7)

    # a mean voltage with a small wave: harmonics 0, 1, 2 once the transients have gone
    def force(t):
        return 0.1 * (1.5 + 0.4 * np.cos(omega * t)) ** 2

    period = 2 * np.pi / omega
    start = 40 * period
    t = start + np.arange(32) / 32 * period
    done = solve_ivp(rate, (0, t[-1]), [0, 0, 0], t_eval=t, args=(force,), **tight)
    series = np.fft.fft(done.y[0])[:3] / 32 * [1, 2, 2]
    harmonics = oscillator.voltage_driven(o, 0.1, 1.5, 0.4, omega)
    assert np.abs(series - harmonics).max() < 1e-6 * abs(harmonics[0])


@pytest.mark.parametrize("r", [0.0, 0.5, 0.8, 1.0])
def test_generalised_alpha(r):
    o = oscillator.Oscillator(2.0, 3.0, 0.3)
    T = 2 * np.pi * (2 / 3) ** 0.5
    errors = []
    for steps in (200, 400):
        t = np.linspace(0, T, steps + 1)
        u = oscillator.generalised_alpha(o, T / steps, steps, r, start=1.0)[:, 0]
        s = oscillator.generalised_alpha(o, T / steps, steps, r, force=1.0)[:, 0]
        differences = (u - oscillator.free(o, t), s - oscillator.step(o, t))
        errors.append([np.abs(d).max() for d in differences])
    assert np.log2(np.divide(*errors)) == pytest.approx([2, 2], abs=0.03)
    # the spectral radius: r at high frequency, 1 without damping for r = 1
    stiff = oscillator.amplification(oscillator.Oscillator(1.0, 1.0), 1e6, r)[0]
    assert np.abs(np.linalg.eigvals(stiff)).max() == pytest.approx(r, abs=2e-3)
    free = oscillator.Oscillator(1.0, 1.0)
    omega, decay = oscillator.numerical_motion(free, 0.1, r)
    if r == 1.0:  # the trapezoidal rule's Cayley map: tan(omega h/2) = h/2
        assert omega == pytest.approx(2 / 0.1 * np.arctan(0.05), rel=1e-9)
        assert decay == pytest.approx(0, abs=1e-7)
    else:
        assert 0 < decay < 1e-3
    # free vibration marches by the principal pair of eigenvalues
    x = oscillator.generalised_alpha(free, 0.1, 200, r, start=1.0)[100:, 0]
    expected = 2 * np.cos(omega * 0.1) * np.exp(-decay * 0.1) * x[1:-1]
    assert x[2:] + np.exp(-2 * decay * 0.1) * x[:-2] == pytest.approx(expected, abs=1e-7)


# sound


def test_piston():
    air = sound.Air()
    a, w = 10.0, 5.0
    z = air.density * air.speed

    def rigid(r):
        return np.full_like(r, w)

    for omega in (2e3, 2e5):
        k = omega / air.speed
        for height in (0.0, 7.0, 500.0):
            far = np.hypot(a, height)
            exact = z * w * (np.exp(-1j * k * height) - np.exp(-1j * k * far))
            assert sound.on_axis(rigid, a, omega, height) == pytest.approx(exact, rel=1e-9)
        exact = z * np.pi * a**2 * w**2 / 2 * (1 - j1(2 * k * a) / (k * a))
        assert sound.power(rigid, a, omega) == pytest.approx(exact, rel=1e-9)
    Q = sound.volume_velocity(rigid, a)
    assert pytest.approx(np.pi * a**2 * w) == Q
    low = sound.power(rigid, a, 100.0)
    assert low == pytest.approx(sound.compact_power(Q, 100.0), rel=1e-5)


def test_piston_of_any_profile():
    """The power is half of int Re(p) w, with Re of the kernel (i omega rho/2 pi) exp(-ikR)/R."""
    air, a, omega = sound.Air(), 10.0, 1e5
    k = omega / air.speed

    def dome(r):
        return 3.0 * (1 - (r / a) ** 2)

    assert sound.volume_velocity(dome, a) == pytest.approx(3 * np.pi * a**2 / 2)
    r, weight = sound._rule(0.0, a, 30)
    angle = (np.arange(40) + 0.5) / 40 * 2 * np.pi
    R = np.sqrt(
        (r[:, None, None] - r[:, None] * np.cos(angle)) ** 2 + (r[:, None] * np.sin(angle)) ** 2
    )
    kernel = omega * air.density / (2 * np.pi) * np.sin(k * R) / R
    source = weight * r * dome(r) * 2 * np.pi
    exact = source @ kernel.mean(-1) @ source / 2
    assert sound.power(dome, a, omega) == pytest.approx(exact, rel=1e-9)
    # far away, on the axis and beside it, the directivity
    height = 1e5
    far = 1j * omega * air.density * np.exp(-1j * k * height) / height
    assert sound.on_axis(dome, a, omega, height) == pytest.approx(
        far * sound.directivity(dome, a, omega, 0.0), rel=1e-3
    )


# chamber


def test_a_rigid_chamber_empties():
    V = 5000.0
    for law, start, times in (
        ("nozzle", 0.5, [0, 0.01, 0.02]),
        ("incompressible", 0.11, [0, 0.01, 0.02]),
    ):
        orifice = chamber.Orifice(0.2, law=law)
        p, mass = chamber.transient(orifice, lambda t, p: V, start, np.array(times))
        t = np.array(times)
        if law == "nozzle":  # choked: exponential
            g = orifice.ratio
            rate = (
                orifice.area
                / V
                * np.sqrt(g * orifice.specific * (2 / (g + 1)) ** ((g + 1) / (g - 1)))
            )
            exact = start * np.exp(-rate * t)
            assert exact[-1] > orifice.outside / (2 / (g + 1)) ** (g / (g - 1))
        else:  # p = po cosh^2 y with a constant rate of y
            y = np.arccosh((start / orifice.outside) ** 0.5)
            y = y - orifice.area / V * (orifice.specific / 2) ** 0.5 * t
            assert y[-1] > 0
            exact = orifice.outside * np.cosh(y) ** 2
        assert p == pytest.approx(exact, rel=1e-7)
        assert mass * orifice.specific == pytest.approx(p * V, rel=1e-12)


def test_flow_through_an_orifice():
    nozzle, plain = chamber.Orifice(0.2), chamber.Orifice(0.2, law="incompressible")
    po = nozzle.outside
    for sign in (1, -1):
        p = po * (1 + sign * 1e-4)
        assert chamber.flow(nozzle, p) == pytest.approx(chamber.flow(plain, p), rel=2e-4)
        assert sign * chamber.flow(nozzle, p) > 0
    assert chamber.flow(nozzle, 2 * po) == pytest.approx(2 * chamber.flow(nozzle, 4 * po) / 4)
    # isentropic: density and speed in the throat, from the energy balance
    pu, g, RT = 1.5 * po, nozzle.ratio, nozzle.specific
    T = (po / pu) ** ((g - 1) / g)
    speed = (2 * g / (g - 1) * RT * (1 - T)) ** 0.5
    density = po / (RT * T)
    assert chamber.flow(nozzle, pu) == pytest.approx(0.2 * density * speed, rel=1e-12)


def test_a_chamber_keeps_its_mass_and_comes_to_rest():
    times = np.linspace(0, 0.5, 6)

    def volume(t, p):  # a membrane that gives way, and a piston
        return 5000 * (1 + 0.3 * np.sin(9 * t)) + 2e4 * (p - 0.101325)

    closed = chamber.Orifice(0.0)
    p, mass = chamber.transient(closed, volume, 0.15, times)
    assert mass == pytest.approx(mass[0], rel=1e-14)
    products = [float(x * volume(t, x)) for t, x in zip(times, p, strict=True)]
    assert products == pytest.approx([products[0]] * 6, rel=1e-12)
    leaky = chamber.Orifice(1.0)
    p, _ = chamber.transient(leaky, lambda t, p: 5000 + 2e4 * (p - 0.101325), 0.15, times)
    assert p[-1] == pytest.approx(leaky.outside, rel=1e-7)
    assert (np.diff(p) <= 1e-9).all()
