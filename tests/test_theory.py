"""Equations of the theory page against the code: laws and the stress of the field."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

import dealib
from dealib.materials.laws import LAWS, invariants_of_stretches
from dealib.results import stress

PAGE = Path(__file__).parents[1] / "notebooks" / "guide" / "theory.md"
L = np.array([1.3, 1.1, 0.75])  # principal stretches
J = L.prod()
BAR = L * J ** (-1 / 3)
I1, I2 = (BAR**2).sum(), (BAR**-2).sum()


def langevin(y):
    return y * (2 / (1 - y**2) + 1 - y**2 / 5 - 2 * y**4 / 5)


EQUATIONS = {  # as they stand on the page
    "neo_hookean": ({"shear_modulus": 0.4}, lambda: 0.2 * (I1 - 3)),
    "mooney_rivlin": ({"c10": 0.3, "c01": -0.05}, lambda: 0.3 * (I1 - 3) - 0.05 * (I2 - 3)),
    "yeoh": (
        {"c10": 0.2, "c20": -0.01, "c30": 0.002},
        lambda: 0.2 * (I1 - 3) - 0.01 * (I1 - 3) ** 2 + 0.002 * (I1 - 3) ** 3,
    ),
    "gent": (
        {"shear_modulus": 0.4, "j_lim": 20},
        lambda: -0.4 * 20 / 2 * np.log(1 - (I1 - 3) / 20),
    ),
    "arruda_boyce": (
        {"shear_modulus": 0.4, "locking_stretch": 3},
        lambda: 0.4 * 9 * quad(langevin, 1 / 3, np.sqrt(I1 / 3) / 3)[0],
    ),
    "ogden": (
        {"mu": [0.2, 0.01], "alpha": [1.3, 5.0]},
        lambda: sum(m / a * ((BAR**a).sum() - 3) for m, a in ((0.2, 1.3), (0.01, 5.0))),
    ),
}


@pytest.mark.parametrize("name", EQUATIONS)
def test_laws_are_those_of_the_page(name):
    given, expected = EQUATIONS[name]
    units = {
        k: v if k in ("j_lim", "locking_stretch", "alpha") else _MPa(v) for k, v in given.items()
    }
    law = dealib.law(name, bulk_modulus="7 MPa", **units)
    found = law.energy(invariants_of_stretches(*L), law.values)
    assert found == pytest.approx(expected() + 7 / 2 * (J - 1) ** 2, rel=1e-8)


def _MPa(value):
    return [f"{v} MPa" for v in value] if isinstance(value, list) else f"{value} MPa"


def test_the_page_has_every_law_and_every_margin():
    text = PAGE.read_text(encoding="utf-8")
    assert set(EQUATIONS) == set(LAWS)
    for name in LAWS:
        row = re.search(rf"^\| `{name}` \|(.*)$", text, re.MULTILINE)
        assert row, name
        assert all(f"`{p}`" in row[1] for p in LAWS[name].names() if p != "bulk_modulus"), name
    from dealib.results.summary import MARGINS

    assert all(f"| `{column}` |" in text for column in MARGINS)


def test_the_stress_of_the_field_is_the_derivative_of_its_energy():
    """Of -(eps/2) J e.e by F, with a permittivity that depends on the area's stretch."""
    rng = np.random.default_rng(1)
    F, E = np.eye(3) + 0.2 * rng.standard_normal((3, 3)), rng.standard_normal(3)
    normal = np.array([0.0, 0.0, 1.0])
    a, b = 3.0, -0.4

    def energy(F):
        e = np.linalg.solve(F.T, E)
        area = np.sqrt(np.linalg.det(F) * np.linalg.norm(np.linalg.solve(F.T, normal)))
        return -(a + b * area) / 2 * np.linalg.det(F) * (e @ e)

    step, P = 1e-6, np.empty((3, 3))
    for i, j in np.ndindex(3, 3):
        d = np.zeros((3, 3))
        d[i, j] = step
        P[i, j] = (energy(F + d) - energy(F - d)) / (2 * step)
    sigma = P @ F.T / np.linalg.det(F)
    e, n = np.linalg.solve(F.T, E), np.linalg.solve(F.T, normal)
    area = np.sqrt(np.linalg.det(F) * np.linalg.norm(n))
    n /= np.linalg.norm(n)
    plane = np.eye(3) - np.outer(n, n)
    page = stress.maxwell(a + b * area, e) - b * area / 4 * (e @ e) * plane
    assert sigma == pytest.approx(page, rel=1e-6, abs=1e-7)
    expected = (a + b * area) * (np.outer(e, e) - e @ e / 2 * np.eye(3))
    assert stress.maxwell(a + b * area, e) == pytest.approx(expected)
