"""The library of published materials: complete, overridable, explained."""

import numpy as np
import pytest
from conftest import case, history
from pydantic import TypeAdapter
from scipy.optimize import brentq

import dealib
from dealib.config import resolved
from dealib.config.materials import Material, Materials
from dealib.materials.published import library
from dealib.materials.response import response
from dealib.units import EPSILON_0


def film(**given):
    return TypeAdapter(Material).validate_python(given)


@pytest.mark.parametrize("name", library())
def test_every_material_is_a_film_with_its_source(name):
    entry = library()[name]
    assert len(entry.source) > 30
    given = film(library=name, **{"relative_permittivity": 3.0} | dict(entry.values))
    assert given == film(library=name, relative_permittivity=given.relative_permittivity)
    assert given.library == name
    nominal = response(given, "uniaxial", [1.5])[0][0]
    assert 0.01 < nominal < 1.1  # MPa: an elastomer


def test_published_values():
    elastosil = film(library="elastosil_2030")
    assert elastosil.parameters == pytest.approx(
        {"c10": 0.1807, "c20": -0.0167, "c30": 0.0066, "bulk_modulus": 361.4}
    )
    assert elastosil.permittivity.at(1.5) == pytest.approx(2.76 - 0.28 * 1.5)
    acrylic = film(library="vhb_4910")
    assert acrylic.parameters["shear_modulus"] == pytest.approx(15.36e-3)
    assert acrylic.parameters["locking_stretch"] == 5.99
    assert acrylic.relative_permittivity * 8.854 == pytest.approx(39.8, rel=1e-3)  # pF/m
    rubber = film(library="natural_rubber", relative_permittivity=2.4)
    # Treloar's bar carries 0.4 MPa at 1.5 and 1.6 MPa near 5
    assert response(rubber, "uniaxial", [1.5, 5.0])[0] == pytest.approx([0.4, 1.65], rel=0.08)


def test_values_can_be_overridden():
    given = film(library="elastosil_2030", c30="0 kPa", relative_permittivity=2.8, prestretch=1.2)
    assert given.parameters["c30"] == 0
    assert given.parameters["c10"] == pytest.approx(0.1807)
    assert (given.relative_permittivity, given.prestretch) == (2.8, (1.2, 1.2))
    stiffer = film(library="elastosil_2030", youngs_modulus="1.2 MPa")
    assert stiffer.parameters == pytest.approx(
        {"c10": 0.2, "c20": -0.0167, "c30": 0.0066, "bulk_modulus": 20.0}
    )
    both = TypeAdapter(Materials).validate_python(
        {
            "film": {"library": "deap_film", "relative_permittivity": 3.0},
            "electrode": {"library": "deap_electrode"},
        }
    )
    assert both["electrode"].shear_modulus == 1.0
    assert both["electrode"] == TypeAdapter(Material).validate_python(
        {"library": "deap_electrode", **library()["deap_electrode"].values}
    )


def test_resolved_config_is_the_same(tmp_path):
    config = case("elastosil", materials__film__c20="-20 kPa").config
    path = tmp_path / "resolved.yaml"
    path.write_text(resolved(config))
    assert dealib.load(path).config == config


def test_command_shows_and_draws_materials(program, tmp_path):
    def run(*arguments):
        return program("materials", *arguments, cwd=tmp_path)

    listed = run().stdout
    for name, entry in library().items():
        assert f"{name}: {entry.description}" in listed
        assert entry.source.split(",")[0] in listed
    drawn = run("vhb_4910", "--set", "locking_stretch=5", "--stretch", "6")
    assert drawn.returncode == 0, drawn.stderr
    # equal-biaxial locking: 2 l^2 + l^-4 = 3 * 25
    assert "locks at 6.1237" in drawn.stdout
    assert (tmp_path / "vhb_4910.png").stat().st_size > 10_000
    wrong = run("vhb_491")
    assert wrong.returncode == 2
    assert "unknown law or material 'vhb_491'; did you mean 'vhb_4910'?" in wrong.stderr


@pytest.mark.once
def test_elastosil_membrane():
    """The shipped config: capacitance by hand, weight, stroke and field at 3 kV."""
    h = history("elastosil")
    flat = EPSILON_0 * (2.76 - 0.28 * 1.2) * np.pi * (25**2 - 12.5**2) / 0.05 * 1e3
    assert h.loc[0, "capacitance_pF"] == pytest.approx(flat, rel=1e-6)
    before = h[h["stage"] == "weight"].index[-1]
    assert h["force_N"].iloc[before:].to_numpy() == pytest.approx(-0.2 * 9.80665, abs=1e-8)
    peak = h["voltage_kV"].idxmax()
    assert h.loc[peak, "voltage_kV"] == pytest.approx(3)
    constant = history("elastosil", materials__film__relative_permittivity=2.76 - 0.28 * 1.2)

    def stroke(run):
        weight = run[run["stage"] == "weight"]["displacement_mm"].iloc[-1]
        return run["displacement_mm"].min() - weight

    assert -3 < stroke(h) < -0.3
    assert 0.8 < stroke(h) / stroke(constant) < 0.95
    rest = h.loc[before, "displacement_mm"]
    assert h["displacement_mm"].iloc[-1] == pytest.approx(rest, rel=1e-7)
    assert 60 < h.loc[peak, "field_max_MV_per_m"] < 130  # 3 kV over 50 um that thins to 26


def test_acrylic_membrane():
    """The shipped config, pre-stretched to 3: tension by hand, stroke without locking."""
    h = history("acrylic")
    assert h.loc[0, "thickness_stretch_min"] == pytest.approx(1 / 9, rel=0.01)
    # sigma = G L/(3 c) beta(c/L) (l^2 - l^-4) with c = sqrt(I1/3); F/u = 2 pi sigma h/ln 2
    c = np.sqrt((2 * 9 + 3.0**-4) / 3)
    b = brentq(lambda b: 1 / np.tanh(b) - 1 / b - c / 5.99, 0.1, 10)
    sigma = 15.36e-3 * 5.99 / (3 * c) * b * (9 - 3.0**-4)
    stiffness = 2 * np.pi * sigma * 0.111 / np.log(2)
    assert h.loc[1, "force_N"] / h.loc[1, "displacement_mm"] == pytest.approx(stiffness, rel=0.03)
    on = h[h["stage"] == "actuate"]
    assert on["voltage_kV"].iloc[-1] == pytest.approx(4)
    assert -2 < on["displacement_mm"].iloc[-1] - h.loc[10, "displacement_mm"] < -1
    assert 3 < h["stretch_max"].max() < 4
    assert h["newton_iterations"].max() <= 7


def test_materials_of_studies_may_come_from_the_library():
    given = TypeAdapter(Material).validate_python({"library": "vhb_4910"})
    assert (given.law, given.locking_stretch) == ("arruda_boyce", 5.99)
