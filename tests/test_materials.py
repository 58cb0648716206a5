"""Laws at homogeneous deformations against values worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import case

from dealib.materials import invariants_of_stretches, thickness_stretch
from dealib.materials.laws import MooneyRivlin, NeoHookean
from dealib.results.stress import cauchy, second_pk

NH = NeoHookean(law="neo_hookean", shear_modulus="0.4 MPa", bulk_modulus="20 MPa")
MR = MooneyRivlin(law="mooney_rivlin", c10="0.25 MPa", c01="-0.05 MPa", bulk_modulus="20 MPa")


def energy(law, *stretches):
    return law.energy(invariants_of_stretches(*stretches), SimpleNamespace(**law.parameters))


def test_neo_hookean_energy_by_hand():
    # isochoric stretches 2, 1, 1/2: I1 = 4 + 1 + 1/4; W = 0.2 (5.25 - 3) = 0.45 MPa
    assert energy(NH, 2.0, 1.0, 0.5) == pytest.approx(0.45)
    # pure dilation J = 1.1^3: no isochoric part; W = 10 (0.331)^2
    assert energy(NH, 1.1, 1.1, 1.1) == pytest.approx(10 * 0.331**2)


def test_mooney_rivlin_energy_by_hand():
    # I2 = 4 * 1 + 1 * 1/4 + 4 * 1/4 = 5.25 too
    assert energy(MR, 2.0, 1.0, 0.5) == pytest.approx((0.25 - 0.05) * 2.25)


def test_neo_hookean_stress_by_hand():
    # sigma_1 - sigma_3 = G (l1^2 - l3^2) at J = 1
    F = np.diag([2.0, 1.0, 0.5])
    sigma = cauchy(F, second_pk(NH, F))
    assert sigma[0, 0] - sigma[2, 2] == pytest.approx(0.4 * (4 - 0.25))
    assert sigma[1, 1] - sigma[2, 2] == pytest.approx(0.4 * (1 - 0.25))
    assert np.trace(sigma) == pytest.approx(0, abs=1e-12)


def test_mooney_rivlin_stress_by_hand():
    # sigma_i - sigma_j = 2 (C10 + C01 l_k^2)(l_i^2 - l_j^2), the third stretch k (thesis, eq. 16)
    F = np.diag([2.0, 1.0, 0.5])
    sigma = cauchy(F, second_pk(MR, F))
    assert sigma[0, 0] - sigma[2, 2] == pytest.approx(2 * (0.25 - 0.05 * 1) * (4 - 0.25))
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(2 * (0.25 - 0.05 * 0.25) * (4 - 1))


@pytest.mark.parametrize("law", [NH, MR])
@pytest.mark.parametrize("prestretch", [None, np.array([1.2, 0.71, 1.15])])
def test_stress_is_the_derivative_of_the_energy(law, prestretch):
    """P = F S against central differences of W(F F_p) / det F_p."""
    rng = np.random.default_rng(1)
    F = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
    F[2, :2] = F[:2, 2] = 0  # axisymmetric
    P = np.eye(3) if prestretch is None else np.diag(prestretch)

    def W(A):
        stretches = np.linalg.svd(A @ P, compute_uv=False)
        return energy(law, *stretches) / np.linalg.det(P)

    h = 1e-6
    one = np.eye(3)
    numeric = [
        [(W(F + h * np.outer(a, b)) - W(F - h * np.outer(a, b))) / (2 * h) for b in one]
        for a in one
    ]
    assert F @ second_pk(law, F, prestretch) == pytest.approx(np.array(numeric), abs=1e-7)


@pytest.mark.parametrize("law", [NH, MR])
def test_thickness_stretch_leaves_no_thickness_stress(law):
    lz = thickness_stretch(law, 1.2, 1.1)
    F = np.diag([1.2, lz, 1.1])
    assert second_pk(law, F)[1, 1] == pytest.approx(0, abs=1e-12)
    assert lz == pytest.approx(1 / (1.2 * 1.1), rel=0.02)


def test_rules_of_the_thesis():
    """Tables 1 and 2: parameters from Young's modulus."""
    film = case("deap100").config.materials["film"]
    assert film.parameters == pytest.approx({"shear_modulus": 1 / 3, "bulk_modulus": 50 / 3})
    assert film.shear_modulus == pytest.approx(3.34e5 / 1e6, rel=3e-3)
    electrode = case("own_mesh").config.materials["electrode"]
    assert electrode.parameters == pytest.approx(
        {"c10": 0.5, "c01": -1 / 6, "bulk_modulus": 100 / 3}
    )
