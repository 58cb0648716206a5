"""Laws beyond the thesis's two: stresses by hand, limits, locking; in numpy and in a run."""

import math

import numpy as np
import pytest
import ufl
from conftest import case
from scipy.optimize import brentq
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

import dealib
from dealib.materials import LAWS, Invariants, invariants_of_stretches, thickness_stretch
from dealib.materials.response import (
    MODES,
    locking_stretch,
    response,
    stability_limit,
    stiffness,
)
from dealib.results.stress import cauchy, second_pk


def law(name, **parameters):
    return LAWS[name].model_validate({"law": name, **parameters})


KAPPA = "1e6 MPa"
YEOH = law("yeoh", c10="180.7 kPa", c20="-16.7 kPa", c30="6.6 kPa", bulk_modulus=KAPPA)
GENT = law("gent", shear_modulus="0.4 MPa", j_lim=20, bulk_modulus=KAPPA)
CHAINS = law("arruda_boyce", shear_modulus="15.36 kPa", locking_stretch=5.99, bulk_modulus=KAPPA)


class _Numbers(MultiFunction):
    """Value of a scalar UFL expression of numbers, each part computed once."""

    def scalar_value(self, o):
        return float(o)

    def zero(self, o):
        return 0.0

    def label(self, o):
        return None

    def variable(self, o, value, label):
        return value

    def sum(self, o, a, b):
        return a + b

    def product(self, o, a, b):
        return a * b

    def division(self, o, a, b):
        return a / b

    def power(self, o, a, b):
        return a**b

    def ln(self, o, a):
        return math.log(a)

    def condition(self, o, a, b):
        assert o._name == "<"
        return a < b

    def conditional(self, o, condition, a, b):
        return a if condition else b


def number(expression):
    return map_expr_dag(_Numbers(), apply_derivatives(apply_algebra_lowering(expression)))


def inverse_langevin(y):
    """The function itself, not an approximation: coth(b) - 1/b = y."""
    return brentq(lambda b: 1 / math.tanh(b) - 1 / b - y, 3 * y * 0.9, 2 / (1 - y), xtol=1e-14)


def slope(name, I1):
    """2 dW/dI1, by hand."""
    if name == "yeoh":
        return 2 * (0.1807 - 2 * 0.0167 * (I1 - 3) + 3 * 0.0066 * (I1 - 3) ** 2)
    if name == "gent":
        return 0.4 * 20 / (20 - (I1 - 3))
    stretch = math.sqrt(I1 / 3)
    return 0.01536 * 5.99 / (3 * stretch) * inverse_langevin(stretch / 5.99)


@pytest.mark.parametrize(("given", "exact"), [(YEOH, 1e-12), (GENT, 1e-12), (CHAINS, 2.8e-3)],
                         ids=["yeoh", "gent", "arruda_boyce"])  # fmt: skip
@pytest.mark.parametrize("l", [0.6, 1.2, 2.0])
def test_stress_by_hand(given, exact, l):
    """sigma_i - sigma_j = 2 dW/dI1 (l_i^2 - l_j^2); in three modes at constant volume."""
    for first, second in ((l, l**-0.5), (l, l), (l, 1.0)):
        F = np.diag([first, 1 / (first * second), second])
        sigma = cauchy(F, second_pk(given, F))
        factor = slope(given.law, np.trace(F @ F))
        for i, j in ((0, 1), (2, 1)):
            by_hand = factor * (F[i, i] ** 2 - F[j, j] ** 2)
            assert sigma[i, i] - sigma[j, j] == pytest.approx(by_hand, rel=exact, abs=1e-12)


def test_energies_by_hand():
    # isochoric stretches 2, 1, 1/2: I1 - 3 = 2.25
    i = invariants_of_stretches(2.0, 1.0, 0.5)
    assert YEOH.energy(i, YEOH.values) == pytest.approx(
        0.1807 * 2.25 - 0.0167 * 2.25**2 + 0.0066 * 2.25**3
    )
    assert GENT.energy(i, GENT.values) == pytest.approx(-0.2 * 20 * math.log(1 - 2.25 / 20))
    # Arruda and Boyce: G L^2 (y b + ln(b / sinh b)), less its value at rest
    L, w = 5.99, []
    for I1 in (5.25, 3.0):
        y = math.sqrt(I1 / 3) / L
        b = inverse_langevin(y)
        w.append(0.01536 * L**2 * (y * b + math.log(b / math.sinh(b))))
    assert CHAINS.energy(i, CHAINS.values) == pytest.approx(w[0] - w[1], rel=2e-3)
    dilated = invariants_of_stretches(1.1, 1.1, 1.1)  # 1e6/2 (1.331 - 1)^2
    for given in (YEOH, GENT, CHAINS):
        assert given.energy(dilated, given.values) == pytest.approx(5e5 * 0.331**2)


def test_error_of_the_inverse_langevin_function():
    """Of the nominal stress over that of the exact function: 0.28 % at most."""
    L, worst = 5.99, 0.0
    for y in np.linspace(1 / L, 0.9999, 400):
        I1 = 3 * (y * L) ** 2
        h = 1e-30
        moved = Invariants(I1 + 1j * h, 3.0, 1.0, 1.0)
        ours = float(CHAINS.energy(moved, CHAINS.values).imag / h)
        exact = 0.01536 * L / (6 * y * L) * inverse_langevin(y)
        worst = max(worst, abs(ours / exact - 1))
    assert 1e-3 < worst < 2.8e-3
    assert ours == pytest.approx(exact, rel=1e-4)  # the last one, nearest to locking


@pytest.mark.parametrize("name", ["yeoh", "gent", "arruda_boyce"])
def test_youngs_modulus_rule(name):
    """A third of it is the shear modulus at rest, whatever else is given."""
    given = law(name, **LAWS[name].example() | {"youngs_modulus": "1.5 MPa"})
    assert given.shear_modulus_at_rest == pytest.approx(0.5, rel=2e-3)
    assert given.bulk_modulus == pytest.approx(25)
    F = np.eye(3)
    assert np.abs(second_pk(given, F)).max() < 1e-14


def test_limits():
    # a Yeoh law whose slope 2 dW/dI1 has its minimum above zero stiffens again: no limit in a bar
    assert math.isinf(stability_limit(YEOH, "uniaxial"))
    softer = law("yeoh", c10="0.2 MPa", c20="-0.05 MPa", bulk_modulus="1e4 MPa")
    # equal-biaxial: the peak of the true stress 2 (l^2 - l^-4) (c10 + 2 c20 (I1 - 3))
    l = np.linspace(1.1, 2, 200001)
    stress = (l**2 - l**-4) * (0.2 - 0.1 * (2 * l**2 + l**-4 - 3))
    assert stability_limit(softer, "equal-biaxial") == pytest.approx(l[stress.argmax()], abs=1e-5)
    # the laws that lock are stable up to there: I1 - 3 = J_lim, sqrt(I1 / 3) = L
    for given, I1 in ((GENT, 23.0), (CHAINS, 3 * 5.99**2)):
        for mode in MODES:
            assert math.isinf(stability_limit(given, mode))
        locked = locking_stretch(given, "equal-biaxial")
        assert 2 * locked**2 + locked**-4 == pytest.approx(I1, rel=1e-9)
        assert (stiffness(given, [1.0, 0.999 * locked], [1.0, 0.999 * locked]) > 0).all()
        nominal, _, J = response(given, "equal-biaxial", [0.99 * locked, 1.01 * locked])
        assert nominal[0] > 10 * given.shear_modulus_at_rest
        assert np.isnan(nominal[1])
        assert J[0] == pytest.approx(1, abs=1e-3)
    assert math.isinf(locking_stretch(YEOH, "uniaxial"))


@pytest.mark.parametrize("stretch", [3.2, 3.3])
def test_prestretch_near_locking(stretch):
    """Beyond half or twice the thickness the law has no energy: the search stays inside."""
    given = law("gent", shear_modulus="0.4 MPa", j_lim=20, bulk_modulus="4000 MPa")
    lz = thickness_stretch(given, stretch, stretch)
    F = np.diag([stretch, lz, stretch])
    assert second_pk(given, F)[1, 1] == pytest.approx(0, abs=1e-7)
    assert lz * stretch**2 == pytest.approx(1, rel=2e-2)


SMALL = {"mesh__columns": 8, "mesh__film_rows": 1}


@pytest.mark.parametrize("name", ["gent", "arruda_boyce"])
@pytest.mark.parametrize("formulation", ["displacement", "mixed"])
def test_a_run_past_locking_says_so(name, formulation):
    """The mount asks for more than the film can stretch: what converged is below the limit."""
    limit = {"gent": "j_lim: 1.0", "arruda_boyce": "locking_stretch: 1.25"}[name]
    film = f"{{law: {name}, shear_modulus: 1 MPa, "
    film += f"bulk_modulus: 2000 MPa, {limit}, relative_permittivity: 3.0}}"
    program = [{"stage": "push", "mount": {"displacement": "-16 mm"}, "steps": 8}]
    given = case(
        "membrane",
        **SMALL,
        materials__film=film,
        program=program,
        physics__formulation=formulation,
        solver__max_cuts=5,
    )
    simulation = dealib.Simulation(given)
    rows = []
    with pytest.raises(dealib.NotConverged) as stopped:
        rows.extend(state.row for state in simulation)
    assert "reduce the load, for a law is stretched to over 90 % of its limit" in str(stopped.value)
    assert "a law locks" in str(stopped.value)
    # at most the flat cone's stretch l: l^2 + l^-2 - 2 = 1, sqrt((l^2 + 1 + l^-2) / 3) = 1.25
    longest = {"gent": 1.618, "arruda_boyce": 1.786}[name]
    assert 11 < -rows[-1]["displacement_mm"] < 10 * math.sqrt(longest**2 - 1)
    assert not simulation.engine.problem.locked()
    assert simulation.engine.problem.locked(0.95)


# --- Ogden: principal stretches ------------------------------------------------------------------

TERMS = {"mu": ["0.63 MPa", "1.2 kPa", "-10 kPa"], "alpha": [1.3, 5.0, -2.0]}  # Ogden (1972)
OGDEN = law("ogden", **TERMS, bulk_modulus=KAPPA)


@pytest.mark.parametrize("l", [0.6, 1.0, 1.2, 3.0])
def test_ogden_stress_by_hand(l):
    """sigma_i - sigma_j = sum of mu_k (l_i^alpha_k - l_j^alpha_k), equal stretches included."""
    for first, second in ((l, l**-0.5), (l, l), (l, 1.0), (l, l**-2)):
        stretches = (first, 1 / (first * second), second)
        F = np.diag(stretches)
        sigma = cauchy(F, second_pk(OGDEN, F))
        for i, j in ((0, 1), (2, 1)):
            by_hand = sum(
                m * (stretches[i] ** a - stretches[j] ** a)
                for m, a in zip((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), strict=True)
            )
            assert sigma[i, i] - sigma[j, j] == pytest.approx(by_hand, rel=1e-12, abs=1e-12)
    bar = response(OGDEN, "uniaxial", [l])[0][0]
    by_hand = sum(
        m * (l ** (a - 1) - l ** (-a / 2 - 1))
        for m, a in zip((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), strict=True)
    )
    assert bar == pytest.approx(by_hand, rel=1e-4, abs=1e-12)


@pytest.mark.once
@pytest.mark.parametrize("alpha", [2, 4, -2, -4])
@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-9, 1e-4, 0.1, 0.22, 0.24, 1.0, 5.0])
def test_ogden_where_stretches_coincide(alpha, apart):
    """Energy, stress and stiffness are those of a polynomial of the invariants, near and far.

    l1^4 + l2^4 + l3^4 = I1^2 - 2 I2, with -alpha the same in I2 and I1, all isochoric.
    """
    F = np.array([[1.1 + apart, 0.02 * apart, 0], [0, 1.1, 0], [0, 0, 0.9]])
    one = law("ogden", mu=f"{2 / alpha} MPa", alpha=alpha, bulk_modulus="3 MPa")

    class Polynomial:
        @staticmethod
        def energy(i, p):
            a, b = (i.I1, i.I2) if alpha > 0 else (i.I2, i.I1)
            powers = a if abs(alpha) == 2 else a**2 - 2 * b
            return 2 / alpha**2 * (powers - 3) + 1.5 * (i.J - 1) ** 2

    def derivatives(given):
        places = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2)]
        x = [ufl.variable(ufl.as_ufl(float(F[place]))) for place in places]
        a, b, c, d = (
            x[0] ** 2 + x[2] ** 2, x[1] ** 2 + x[3] ** 2, x[0] * x[1] + x[2] * x[3], x[4] ** 2
        )  # fmt: skip
        J = (x[0] * x[3] - x[1] * x[2]) * x[4]
        q = J ** (-2 / 3)
        second = q**2 * (a * b - c * c + (a + b) * d)
        density = given.energy(Invariants(q * (a + b + d), second, J, q * d), one.values)
        P = [ufl.diff(density, a) for a in x]
        A = [ufl.diff(p, a) for p in P for a in x]
        return [np.array(list(map(number, part))) for part in ([density], P, A)]

    for ours, theirs in zip(derivatives(one), derivatives(Polynomial), strict=True):
        assert np.allclose(ours, theirs, rtol=0, atol=3e-13 * np.abs(theirs).max())
    # numpy with complex steps
    P = derivatives(Polynomial)[1]
    ours = (F @ second_pk(one, F))[(0, 0, 1, 1, 2), (0, 1, 0, 1, 2)]
    assert np.allclose(ours, P, rtol=0, atol=3e-14 * np.abs(P).max())


def test_ogden_is_its_special_cases():
    nh = law("neo_hookean", shear_modulus="0.4 MPa", bulk_modulus="20 MPa")
    same = law("ogden", mu="0.4 MPa", alpha=2, bulk_modulus="20 MPa")
    mr = law("mooney_rivlin", c10="0.2 MPa", c01="0.05 MPa", bulk_modulus="20 MPa")
    both = law("ogden", mu=["0.4 MPa", "-0.1 MPa"], alpha=[2, -2], bulk_modulus="20 MPa")
    rng = np.random.default_rng(3)
    F = np.zeros((500, 3, 3))
    F[:, :2, :2] = np.eye(2) + 0.4 * rng.standard_normal((500, 2, 2))
    F[:, 2, 2] = rng.uniform(0.5, 2, 500)
    F = F[np.linalg.det(F) > 0.2]
    for ogden, other in ((same, nh), (both, mr)):
        assert np.allclose(second_pk(ogden, F), second_pk(other, F), rtol=1e-10, atol=1e-10)
        assert thickness_stretch(ogden, 1.3, 1.2) == pytest.approx(
            thickness_stretch(other, 1.3, 1.2), rel=1e-13
        )
    modulus = law("ogden", youngs_modulus="1.5 MPa", alpha=[1.3, 5.0, -2.0])
    assert modulus.shear_modulus_at_rest == pytest.approx(0.5, rel=2e-3)


def test_ogden_limit():
    """Where the equal-biaxial true stress, sum of mu_i (l^alpha_i - l^(-2 alpha_i)), peaks."""
    assert math.isinf(stability_limit(law("ogden", mu="1 MPa", alpha=1.0, bulk_modulus=KAPPA),
                                      "equal-biaxial"))  # fmt: skip
    given = law("ogden", mu=["0.6 MPa", "0.1 MPa"], alpha=[2.0, -1.0], bulk_modulus=KAPPA)
    # equal-biaxial true stress 0.6 (l^2 - l^-4) + 0.1 (l^-1 - l^2): grows, its slope is positive
    assert math.isinf(stability_limit(given, "equal-biaxial"))
    weak = law("ogden", mu=["0.3 MPa", "0.3 MPa"], alpha=[2.0, -1.0], bulk_modulus=KAPPA)
    l = np.linspace(1.05, 4, 400001)
    stress = 0.3 * (l**2 - l**-4) + 0.3 * (l**-1 - l**2)
    assert stability_limit(weak, "equal-biaxial") == pytest.approx(l[stress.argmax()], abs=2e-5)


@pytest.mark.once
@pytest.mark.parametrize(
    "formulation", ["displacement", pytest.param("mixed", marks=pytest.mark.slow)]
)
def test_ogden_device_is_the_neo_hookean_one(formulation):
    """Film and electrodes with the law's special case: the same curves, in as many iterations."""
    program = [
        {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
        {"stage": "on", "terminal": {"voltage": "2 kV"}, "steps": 2},
    ]
    found = []
    for film, electrode in (
        ("law: neo_hookean, shear_modulus: 0.334 MPa", "law: neo_hookean, shear_modulus: 1 MPa"),
        (
            "law: ogden, mu: [0.167 MPa, 0.167 MPa], alpha: [2, 2]",
            "law: ogden, mu: 1 MPa, alpha: 2",
        ),
    ):
        simulation = dealib.Simulation(
            case(
                "benchmark_strip",
                mesh__columns=16,
                materials__film=f"{{{film}, bulk_modulus: 16.7 MPa, prestretch: 1.15, "
                "relative_permittivity: 3.0}",
                materials__electrode=f"{{{electrode}, bulk_modulus: 50 MPa}}",
                physics__formulation=formulation,
                program=program,
            )
        )
        found.append([state.row for state in simulation])
    for theirs, ours in zip(*found, strict=True):
        for column in ("force_N", "charge_uC", "elastic_energy_mJ", "thickness_stretch_min"):
            assert ours[column] == pytest.approx(theirs[column], rel=1e-9, abs=1e-12)
        assert abs(ours["newton_iterations"] - theirs["newton_iterations"]) <= 1


@pytest.mark.parametrize("hoop", [True, False])
@pytest.mark.parametrize("name", LAWS)
def test_an_energy_changes_with_the_invariants_that_it_reads_alone(name, hoop):
    given = law(name, **LAWS[name].example())
    values = {"I1": 3.4, "I2": 3.3, "J": 1.02, "hoop": 0.8 if hoop else None}
    energy = given.energy(Invariants(**values), given.values)
    for which in (n for n, value in values.items() if value is not None):
        moved = given.energy(Invariants(**values | {which: 1.01 * values[which]}), given.values)
        assert bool(moved != energy) is (which in given.reads(hoop)), which
