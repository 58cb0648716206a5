"""Warnings about what is probably not meant: `check` and `run` tell them, of no shipped file."""

import pytest
from conftest import CONFIGS
from laminates import ELECTRODE, FILM, config, layer
from test_bad_input import dealib  # noqa: F401 - a fixture

import dealib as program
from dealib.config import load
from dealib.config.doubts import doubts
from dealib.config.templates import TEMPLATES, template
from dealib.errors import ConfigError

pytestmark = pytest.mark.once  # nothing is solved
ON = [{"stage": "on", "terminals": {"hot": {"voltage": "1 kV"}}}]
GROUND = {"on": "film.bottom", "ground": True}
BOTH = {"film": FILM}  # without the material of electrodes, which a film alone does not use


def told(base="strip", *layers, **sections):
    """Doubts about a device, without those about the materials that `config` adds."""
    found = doubts(config(base, *layers, **sections))
    return [text for text in found if not text.startswith("materials.electrode")]


def shipped():
    """All configs, those within studies' and benchmarks' files too."""
    for path in sorted(CONFIGS.rglob("*.yaml")):
        for within in ("", "device"):
            try:
                yield path, within, load(path, within=within).config
            except ConfigError:
                continue


def test_shipped_configs_raise_none(tmp_path):
    found = {f"{path}:{within}": doubts(given) for path, within, given in shipped()}
    assert len(found) > 60
    assert {name: said for name, said in found.items() if said} == {}
    for name in TEMPLATES:
        (tmp_path / "case.yaml").write_text(template(name))
        assert doubts(load(tmp_path / "case.yaml").config) == []


@pytest.mark.parametrize("space", [{}, {"geometry": {"space": "3d"}}])
@pytest.mark.parametrize("model", ["solid", "membrane"])
def test_electrodes_that_face_each_other(space, model):
    physics = {"physics": {"model": model}} | space
    apart = {"hot": {"on": "film.top", "within": ["0 mm", "4 mm"]},
             "cold": {"on": "film.bottom", "within": ["5 mm", "9 mm"], "ground": True}}  # fmt: skip
    said = "terminals.hot: no film lies between it and another electrode, so that its voltage does "
    assert told(terminals=apart, program=ON, **physics) == [said + "nothing"]
    facing = apart | {"cold": GROUND}
    assert told(terminals=facing, program=ON, **physics) == []
    beside = facing | {"sense": {"on": "film.top", "within": ["5 mm", "9 mm"]}}
    assert told(terminals=beside, program=ON, **physics) == []  # each faces the ground
    same = beside | {"cold": GROUND | {"within": ["0 mm", "4 mm"]}}
    assert [text.partition(":")[0] for text in told(terminals=same, program=ON, **physics)] == [
        "terminals.sense"
    ]


def test_layers_that_conduct_are_electrodes():
    layers = (layer("film"), layer("upper", "0.1 mm", material="electrode"), layer("film2",
              material="film"), layer("lower", "0.1 mm", material="electrode"))  # fmt: skip
    good = {"hot": {"on": "upper"}, "ground": {"on": "lower", "ground": True}}
    assert told("strip", *layers, terminals=good, program=ON) == []
    touching = {"hot": {"on": "upper"}, "ground": {"on": "film2.top", "ground": True}}
    assert told("strip", *layers[:3], terminals=touching, program=ON) == []


def test_materials_that_nothing_is_made_of():
    given = config("strip", materials={"glue": ELECTRODE})
    assert doubts(given) == [
        f"materials.{name}: no part of the device is made of it" for name in ("electrode", "glue")
    ]


def test_a_film_thicker_than_its_span():
    said = "geometry: 'film' is thicker (10.5 mm) than its span (10 mm); check the units"
    assert told("strip", layer(thickness="10.5 mm")) == [said]
    assert told("disc", layer(thickness="20 mm")) == []  # of 20 mm in diameter
    assert len(told("disc", layer(thickness="20.5 mm"))) == 1


@pytest.mark.parametrize(
    ("strength", "volts", "said"),
    [
        (None, "400 kV", []),
        (None, "600 kV", ["600 kV over the film of 0.5 mm are 1,200 MV/m, which no film bears"]),
        ("50 MV/m", "240 kV", []),
        ("50 MV/m", "300 kV", ["300 kV over the film of 0.5 mm are 600 MV/m, 12 times its "
                               "breakdown strength"]),
    ],
)  # fmt: skip
def test_voltages_that_no_film_bears(strength, volts, said):
    limits = {} if strength is None else {"limits": {"breakdown_strength": strength}}
    found = told(program=[{"stage": "on", "terminal": {"voltage": ["0 V", volts]}}], **limits)
    assert found == [f"program.0.terminal.voltage: {text}; check the unit" for text in said]


def test_loads_beyond_the_modulus():
    """A film of 1 kPa at 200 MV/m, and a chamber at 15 times the modulus of 1/3 MPa."""
    soft = {"film": FILM | {"youngs_modulus": "3 kPa"}}
    volts = [{"stage": "on", "terminal": {"voltage": "100 kV"}}]
    said = "program.0.terminal.voltage: 100 kV over the film of 0.5 mm are 200 MV/m, whose stress "
    assert told(materials=soft, program=volts) == [
        said + "is 1,060 times the film's shear modulus; check the unit"
    ]
    chamber = {"chambers": {"pump": {"on": "film.bottom"}}}
    for pressure, count in (("3 MPa", 0), ("5 MPa", 1)):
        blown = [{"stage": "on", "chamber": {"pressure": pressure}}]
        found = told("annulus", program=blown, **chamber)
        assert len(found) == count
    said = "program.0.chamber.pressure: 5,000 kPa are 15 times the largest shear modulus of the "
    assert found == [said + "device; check the unit"]


def test_check_and_run_tell_them(dealib, tmp_path):  # noqa: F811
    text = (CONFIGS.parent / "tests" / "small.yaml").read_text()
    glue = "materials:\n  glue: {law: neo_hookean, youngs_modulus: 1 MPa}\n"
    (tmp_path / "case.yaml").write_text(text.replace("materials:\n", glue, 1))
    said = "dealib: materials.glue: no part of the device is made of it\n"
    code, out, err = dealib("check", "case.yaml")
    assert (code, err) == (0, said)
    assert "valid" in out
    code, out, err = dealib("run", "case.yaml", "--out", "run", "--set", "program=[{stage: rest}]")
    assert code == 0
    assert said in err
    assert program.open(tmp_path / "run").info["warnings"] == [
        said.strip().removeprefix("dealib: ")
    ]
