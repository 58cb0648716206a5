"""Laws beyond the thesis's two: stresses by hand, limits, locking; in numpy and in a run."""

import math

import numpy as np
import pytest
from conftest import case
from scipy.optimize import brentq

import dealib
from dealib.fem.problem import shear_modulus
from dealib.materials import LAWS, invariants_of_stretches, thickness_stretch
from dealib.materials.response import (
    MODES,
    locking_stretch,
    response,
    stability_limit,
    stiffness,
)
from dealib.results.local import cauchy, second_pk


def law(name, **parameters):
    return LAWS[name].model_validate({"law": name, **parameters})


KAPPA = "1e6 MPa"
YEOH = law("yeoh", c10="180.7 kPa", c20="-16.7 kPa", c30="6.6 kPa", bulk_modulus=KAPPA)
GENT = law("gent", shear_modulus="0.4 MPa", j_lim=20, bulk_modulus=KAPPA)
CHAINS = law("arruda_boyce", shear_modulus="15.36 kPa", locking_stretch=5.99, bulk_modulus=KAPPA)


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
        moved = type(invariants_of_stretches(1, 1, 1))(I1 + 1j * h, 3.0, 1.0)
        ours = float(CHAINS.energy(moved, CHAINS.values).imag / h)
        exact = 0.01536 * L / (6 * y * L) * inverse_langevin(y)
        worst = max(worst, abs(ours / exact - 1))
    assert 1e-3 < worst < 2.8e-3
    assert ours == pytest.approx(exact, rel=1e-4)  # the last one, nearest to locking


@pytest.mark.parametrize("name", ["yeoh", "gent", "arruda_boyce"])
def test_youngs_modulus_rule(name):
    """A third of it is the shear modulus at rest, whatever else is given."""
    given = law(name, **LAWS[name].example() | {"youngs_modulus": "1.5 MPa"})
    assert shear_modulus(given) == pytest.approx(0.5, rel=2e-3)
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
        assert nominal[0] > 10 * shear_modulus(given)
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
    assert "less load, for a law is stretched to over 90 % of its limit" in str(stopped.value)
    assert "a law locks" in str(stopped.value)
    # at most the flat cone's stretch l: l^2 + l^-2 - 2 = 1, sqrt((l^2 + 1 + l^-2) / 3) = 1.25
    longest = {"gent": 1.618, "arruda_boyce": 1.786}[name]
    assert 11 < -rows[-1]["displacement_mm"] < 10 * math.sqrt(longest**2 - 1)
    assert not simulation.problem.locked()
    assert simulation.problem.locked(0.95)
