"""A law's own response, its stability limit, the command that draws it and the run's warning."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import dealib
from dealib.materials import LAWS
from dealib.materials.response import MODES, response, stability_limit, stiffness

CONFIGS = Path(__file__).parent.parent / "configs"


def law(name, **parameters):
    return LAWS[name].model_validate({"law": name, **parameters})


NH = law("neo_hookean", shear_modulus="1 MPa", bulk_modulus="1e6 MPa")
MR = law("mooney_rivlin", c10="0.3 MPa", c01="0.1 MPa", bulk_modulus="1e6 MPa")
THESIS = law("mooney_rivlin", youngs_modulus="1.25 MPa")  # c01 = -c10 / 3


@pytest.mark.parametrize("stretch", [0.7, 1.0, 1.5, 2.5])
def test_nominal_stress_of_incompressible_laws(stretch):
    # W = C1 (I1 - 3) + C2 (I2 - 3): P = 2 (l - 1 / l^2) (C1 + C2 / l) in a bar,
    # 2 (l - 1 / l^5) (C1 + C2 l^2) equal-biaxial, 2 (l - 1 / l^3) (C1 + C2) in pure shear
    for material, c1, c2 in ((NH, 0.5, 0.0), (MR, 0.3, 0.1)):
        l = stretch
        expected = {
            "uniaxial": 2 * (l - l**-2) * (c1 + c2 / l),
            "equal-biaxial": 2 * (l - l**-5) * (c1 + c2 * l**2),
            "pure shear": 2 * (l - l**-3) * (c1 + c2),
        }
        for mode, value in expected.items():
            nominal, true, J = response(material, mode, [l])
            assert nominal[0] == pytest.approx(value, rel=2e-4, abs=1e-9)
            assert true[0] == pytest.approx(value * l, rel=2e-4, abs=1e-9)
            assert J[0] == pytest.approx(1, abs=1e-5)


def test_small_strain_modulus_follows_from_shear_and_bulk_modulus():
    soft = law("neo_hookean", shear_modulus="1 MPa", bulk_modulus="2 MPa")
    d = 1e-6
    nominal, _, J = response(soft, "uniaxial", [1 + d])
    assert nominal[0] / d == pytest.approx(9 * 2 / (3 * 2 + 1), rel=1e-5)  # 9 K G / (3 K + G)
    assert (J[0] - 1) / d == pytest.approx(1 - 2 * (3 * 2 - 2) / (2 * (3 * 2 + 1)), rel=1e-4)


def test_limits_of_the_thesis_law():
    # at c01 = -c10 / 3: a bar loses its sideways stiffness C10 / l + C01 l at sqrt(3)
    assert stability_limit(THESIS, "uniaxial") == pytest.approx(math.sqrt(3), abs=1e-6)
    # equal-biaxial at the peak of the true stress, here of s = (l^2 - l^-4) (1 - l^2 / 3)
    l = np.linspace(1.3, 1.4, 100001)
    peak = l[np.argmax((l**2 - l**-4) * (1 - l**2 / 3))]
    assert stability_limit(THESIS, "equal-biaxial") == pytest.approx(peak, abs=2e-6)
    shear = stability_limit(THESIS, "pure shear")
    assert 1.63 < shear < 1.66
    assert stiffness(THESIS, [shear - 1e-3, shear + 1e-3], [1, 1]) == pytest.approx(0, abs=2e-3)


def test_laws_without_a_limit():
    for mode in MODES:
        assert math.isinf(stability_limit(NH, mode))
        assert math.isinf(stability_limit(MR, mode))
    # at rest the smallest stiffness is twice the shear modulus
    assert stiffness(MR, 1.0, 1.0) == pytest.approx(2 * 2 * (0.3 + 0.1), rel=1e-6)


def test_command_lists_laws_and_draws_one(program, tmp_path):
    listed = program("materials", cwd=tmp_path)
    assert listed.returncode == 0
    for name in LAWS:
        assert f"{name}: " in listed.stdout
    first = ("mooney_rivlin", "--set", "youngs_modulus=1.25 MPa", "--out", "mr.svg")
    drawn = program("materials", *first, cwd=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    assert "stable to 1.3551" in drawn.stdout
    picture = (tmp_path / "mr.svg").read_text(encoding="utf-8")
    assert picture.startswith("<?xml")
    again = program("materials", *first, cwd=tmp_path)
    assert again.returncode == 2
    assert "mr.svg exists" in again.stderr
    assert (tmp_path / "mr.svg").read_text(encoding="utf-8") == picture


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("mooney",), "unknown law or material 'mooney'"),
        (("neo_hookean", "--set", "c10=1 MPa"), "unknown parameter"),
        (("mooney_rivlin", "--set", "youngs_modulus=1"), "has no unit"),
        (("neo_hookean", "--out", "a.bmp"), "must end in .png, .svg, .pdf"),
        (("--config", str(CONFIGS / "membrane.yaml"), "--region", "electrode"), "no such material"),
    ],
)
def test_command_explains_mistakes(program, tmp_path, arguments, message):
    result = program("materials", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not list(tmp_path.iterdir())


def test_a_run_warns_near_the_limit_of_its_film(tmp_path):
    changes = {
        "mesh.columns": 20,
        "mesh.film_rows": 2,
        "program.1.steps": 4,
        "program.1.mount.displacement": "-1 mm",
        "program.2.terminal.voltage": "0.1 kV",
        "program.2.steps": 1,
        "materials.film": "{law: mooney_rivlin, youngs_modulus: 1.25 MPa, "
        "relative_permittivity: 3.0, prestretch: 1.25}",
    }
    case = dealib.load(CONFIGS / "benchmark_strip.yaml", set=changes)
    run = dealib.simulate(case, tmp_path / "near")
    warnings = json.loads((tmp_path / "near" / "run.json").read_text())["warnings"]
    assert run.info["warnings"] == warnings
    assert len(warnings) == 1  # said once, though the state lasts
    assert "within 5 % of the stability limit" in warnings[0]
    # equal-biaxial 1.25 alone is 8 % off 1.355; neo-Hookean film has no limit
    assert warnings[0].startswith("step ")
    assert not warnings[0].startswith("step 0")
    del changes["materials.film"]
    case = dealib.load(CONFIGS / "benchmark_strip.yaml", set=changes)
    assert dealib.simulate(case, tmp_path / "far").info["warnings"] == []
