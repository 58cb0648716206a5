"""Statistics of fits: errors in x, correlated noise, what the data do not see."""

import warnings

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import t as student

from dealib.calibration.search import blind, search
from dealib.calibration.statistics import directions, distances, uncertainty
from dealib.calibration.task import Free, Task
from dealib.data.measured import Measured


def test_orthogonal_distances_by_hand():
    line = np.array([[0.0, 1.0], [0.0, 1.0]])
    # 45 degrees: a point off by 1 across is 1 / sqrt(2) away; below it the sign is positive
    found = distances(line, np.array([0.5, 0.5, 3.0]), np.array([-0.5, 1.5, 2.0]), 1.0, 1.0)
    assert found == pytest.approx(np.array([1, -1, 1]) / np.sqrt(2))
    # an exact x leaves the distance along y
    found = distances(line, np.array([0.5]), np.array([0.7]), 1e-9, 0.1)
    assert found == pytest.approx([-2.0])


def test_orthogonal_fit_is_that_of_odrpack():
    odr = pytest.importorskip("scipy.odr")
    random = np.random.default_rng(1)
    sigma_x, sigma_y = 0.03, 0.05

    def f(b, x):
        return b[0] * np.expm1(b[1] * x)

    x = np.linspace(0, 2, 40)
    y = f([1.0, 1.2], x) + random.normal(0, sigma_y, 40)
    x = x + random.normal(0, sigma_x, 40)
    grid = np.linspace(-0.2, 2.3, 4000)

    def residual(b):
        return distances(np.stack([grid, f(b, grid)]), x, y, sigma_x, sigma_y)

    own = least_squares(residual, [0.8, 1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # newer scipy announces its end
        other = odr.ODR(odr.RealData(x, y, sx=sigma_x, sy=sigma_y), odr.Model(f), [0.8, 1.0]).run()
    assert own.x == pytest.approx(other.beta, rel=1e-5)
    assert 2 * own.cost == pytest.approx(other.sum_square, rel=1e-5)
    found = uncertainty(own.jac, own.fun, [slice(0, 40)])
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(other.sd_beta, rel=1e-3)


@pytest.mark.parametrize(("points", "rho"), [(20, 0.0), (60, 0.5), (200, 0.9)])
def test_intervals_hold_with_correlated_noise(points, rho):
    """500 linear fits: 95 % intervals contain the truth in 93 % to 97 % of them."""
    random = np.random.default_rng(points)
    x = np.linspace(0.05, 1, points)
    J = np.column_stack([x, x**2])
    hits, plain = [], []
    for _ in range(500):
        noise = random.normal(size=points)
        for i in range(1, points):
            noise[i] = rho * noise[i - 1] + np.sqrt(1 - rho**2) * noise[i]
        off = np.linalg.lstsq(J, noise, rcond=None)[0]
        r = noise - J @ off
        found = uncertainty(J, r, [slice(0, points)])
        reach = student.ppf(0.975, found.freedom) * np.sqrt(np.diag(found.covariance))
        hits.append(np.abs(off) < reach)
        white = np.sqrt(np.diag(np.linalg.inv(J.T @ J)) * (r @ r) / (points - 2))
        plain.append(np.abs(off) < student.ppf(0.975, points - 2) * white)
    assert 0.925 <= np.mean(hits) <= 0.975
    if rho == 0.9:
        assert np.mean(plain) < 0.5  # what counting each point would have given


def test_noise_of_each_curve_is_its_own():
    random = np.random.default_rng(3)
    x = np.linspace(0.1, 1, 400)
    J = np.concatenate([x, x])[:, None]
    r = np.concatenate([random.normal(0, 0.5, 400), random.normal(0, 3.0, 400)])
    r -= J[:, 0] * (J[:, 0] @ r) / (J[:, 0] @ J[:, 0])
    found = uncertainty(J, r, [slice(0, 400), slice(400, 800)])
    assert [n.scale for n in found.noise] == pytest.approx([0.5, 3.0], rel=0.1)
    expected = np.sqrt((0.25 + 9) * (x @ x)) / (2 * x @ x)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(expected, rel=0.05)


def test_what_the_data_do_not_see():
    x = np.linspace(0, 1, 50)
    J = np.column_stack([x, x, x**2])  # only the sum of the first two
    (error, change), *rest = directions(J, np.ones(3))
    assert error == np.inf
    assert change / change[0] == pytest.approx([1, -1, 0], abs=1e-9)
    assert all(np.isfinite(e) for e, _ in rest)
    found = uncertainty(J, np.sin(50 * x), [slice(0, 50)])
    assert np.isinf(np.diag(found.covariance)).tolist() == [True, True, False]


# --- the search, on models in closed form --------------------------------------------------------


class Curve:
    """y(t) as one series."""

    title, weight = "curve", 1.0

    def __init__(self, t, y, sigma):
        self.measured = Measured("curve", "t", {"t": t, "y": y})
        self.sigma = {"y": sigma}

    def residual(self, history):
        return (history["y"] - self.measured.columns["y"]) / self.sigma["y"]

    def against(self, history):
        return []


def task(model, free, t, y, sigma, intervals="linear"):
    def solve(sets):
        return [[{"y": model(t, **values)}] for values in sets]

    return Task(free, [Curve(t, y, sigma)], solve, 1e-5, 1e-9, 200, 0.95, intervals)


def decay(t, a, tau):
    return a * np.exp(-t / tau)


def test_profile_where_linear_intervals_mislead():
    """A time constant beyond the measured time: profile intervals hold, linear ones less."""
    t = np.linspace(0.0, 1.0, 25)
    free = {"a": Free("", 1.0, 0.0, 10.0), "tau": Free("s", 1.5, 0.05, 1e3)}
    hits = {"auto": [], "linear": []}
    bent = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0, 0.1, len(t))
        for intervals, held in hits.items():
            tau = search(task(decay, free, t, decay(t, 1, 2) + noise, 0.1, intervals)).estimates[1]
            held.append(tau.low < 2 < tau.high)
            bent += tau.bent
    assert bent > 30  # the linear ones are told to mislead
    assert np.mean(hits["auto"]) >= 0.9
    assert np.mean(hits["auto"]) > np.mean(hits["linear"])


def test_identifiability_is_told_before_and_after():
    def model(t, a, b, c):
        return a * b * t + c

    t = np.linspace(0, 1, 30)
    free = {key: Free("MPa", 1.0, 0.1, 10.0) for key in "abc"}
    given = task(model, free, t, model(t, 2, 2, 3), 0.01)
    (told,) = blind(given)
    assert told == (
        "a +10 %, b -10 % together move the curves by 0 standard deviations in all: the data "
        "hardly see it."
    )
    found = search(given)
    assert [e.open for e in found.estimates] == [True, True, False]
    assert len(found.unseen) == 1
    assert found.values["a"] * found.values["b"] == pytest.approx(4)
