"""Schema, reference page and templates: current, and in agreement with what `check` accepts."""

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from conftest import CONFIGS
from ruamel.yaml import YAML
from typer.testing import CliRunner

import dealib
from dealib.calibration.coupon_schema import Coupon
from dealib.calibration.schema import Fit
from dealib.cli.app import app
from dealib.config.reference import MODELINE, json_text, reference
from dealib.config.templates import TEMPLATES
from dealib.design.schema import Design
from dealib.observe.columns import columns
from dealib.observe.quantities import QUANTITIES
from dealib.observe.reference import MEANINGS
from dealib.observe.reference import page as page_of_columns
from dealib.study.expressions import COMMON, KINDS, OF_A_CASE, OF_ALL_CASES
from dealib.study.schema import MaterialTest, Study
from dealib.validation.schema import Benchmark

pytestmark = pytest.mark.once  # texts
VALIDATOR = jsonschema.Draft202012Validator(json.loads(json_text()))


def read(text):
    return YAML(typ="safe", pure=True).load(text)


def call(*arguments):
    done = CliRunner().invoke(app, list(map(str, arguments)))
    assert done.exit_code == 0, done.output
    return done.output


def call_fails(*arguments):
    done = CliRunner().invoke(app, list(arguments))
    assert isinstance(done.exception, dealib.ConfigError)
    return str(done.exception)


def test_committed_files_are_current():
    again = "run: dealib schema [--reference] --overwrite --out FILE"
    assert (CONFIGS / "dealib.schema.json").read_text() == json_text(), again
    assert (CONFIGS / "REFERENCE.md").read_text() == reference(), again
    assert call("schema") == json_text()
    assert call("schema", "--reference") == reference()


PAGES = {
    "study": ("studies/REFERENCE.md", Study),
    "fit": ("fits/REFERENCE.md", Fit),
    "coupon": ("fits/COUPONS.md", Coupon),
    "design": ("designs/REFERENCE.md", Design),
    "benchmark": ("validation/REFERENCE.md", Benchmark),
}


@pytest.mark.parametrize("of", PAGES)
def test_reference_of_studies_and_fits_is_current_and_whole(of):
    file, model = PAGES[of]
    page = call("schema", "--of", of, "--reference")
    again = f"run: dealib schema --of {of} --reference --overwrite --out FILE"
    assert (CONFIGS / file).read_text() == page, again
    schema = json.loads(call("schema", "--of", of))
    jsonschema.Draft202012Validator.check_schema(schema)
    parts = [schema, *schema["$defs"].values()]
    if of == "study":
        parts.append(MaterialTest.model_json_schema())
        for name in (*COMMON, *OF_A_CASE, *OF_ALL_CASES):
            assert f"| `{name}(" in page, name
        for signature in (*OF_A_CASE.values(), *OF_ALL_CASES.values()):
            assert set(signature.arguments) <= set(KINDS)
        for quantity in QUANTITIES:
            assert f"| `{quantity.name}` |" in page, quantity.name
    assert list(schema["properties"]) == list(model.model_fields)
    for part in parts:
        for key in part.get("properties", {}):
            assert f"| `{key}` |" in page, key


@pytest.mark.parametrize(
    "path",
    [
        p
        for of in ("thesis", "studies", "fits", "designs", "validation")
        for p in sorted(CONFIGS.glob(f"{of}/*.yaml"))
    ],
    ids=lambda p: f"{p.parent.name}/{p.stem}",
)
def test_shipped_studies_and_fits_meet_their_schema(path):
    tree = read(path.read_text())
    fit = Coupon if "tests" in tree else Fit
    models = {"fits": fit, "designs": Design, "validation": Benchmark}
    model = models.get(path.parent.name, Study)
    schema = json.loads(json_text(model))
    assert list(jsonschema.Draft202012Validator(schema).iter_errors(tree)) == []


def test_schema_of_something_else(tmp_path):
    done = CliRunner().invoke(app, ["schema", "--of", "studdy"])
    assert isinstance(done.exception, dealib.ConfigError)
    assert str(done.exception) == "--of studdy: unknown; did you mean 'study'?"


def test_schema_is_valid_and_describes_every_key():
    jsonschema.Draft202012Validator.check_schema(VALIDATOR.schema)
    for name, section in VALIDATOR.schema["$defs"].items():
        for key, value in section.get("properties", {}).items():
            assert "description" in value or "$ref" in value or "const" in value, (name, key)
    clamps = VALIDATOR.schema["$defs"]["Clamps"]["properties"]
    assert clamps["width"]["description"] == "radial width of each block (length, such as '30 um')"
    assert VALIDATOR.schema["$defs"]["Stage"]["properties"]["duration"]["default"] == "1 s"


@pytest.mark.parametrize(
    "path",
    [*sorted(CONFIGS.glob("*.yaml")), *sorted(CONFIGS.glob("devices/*.yaml"))],
    ids=lambda p: p.stem,
)
def test_shipped_configs_meet_the_schema(path):
    up = "../" * (len(path.relative_to(CONFIGS).parts) - 1)
    assert path.read_text().splitlines()[0] == MODELINE.replace("=", f"={up}")
    assert list(VALIDATOR.iter_errors(read(path.read_text()))) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("electrode_thickness: 10 um", "electrode_thickness: 10"),
        ("inner_radius", "inner_radios"),
        ("columns: 60", "columns: 61"),
        ("grading: ends", "grading: end"),
        ("law: neo_hookean", "law: neohookean"),
        ("youngs_modulus: 1 MPa", "shear_modulus: 1 MPa"),
        ("youngs_modulus: 1 MPa", "youngs_modulus: 1 MPa\n    shear_modulus: 1 MPa"),
        ("prestretch:", "prestretch: [1.1, 1.2, 1.3]  #"),
        ("- {stage: prestrain, steps: 2}", "- {steps: 2}"),
    ],
)
def test_schema_refuses_what_check_refuses(tmp_path, old, new):
    text = (CONFIGS / "deap100.yaml").read_text()
    assert old in text
    text = text.replace(old, new, 1)
    assert not VALIDATOR.is_valid(read(text))
    (tmp_path / "case.yaml").write_text(text)
    with pytest.raises(dealib.ConfigError):
        dealib.load(tmp_path / "case.yaml")


def test_schema_takes_a_laws_own_parameters():
    law = "shear_modulus: 1 MPa\n    bulk_modulus: 50 MPa"
    text = (CONFIGS / "deap100.yaml").read_text().replace("youngs_modulus: 1 MPa", law)
    assert VALIDATOR.is_valid(read(text))


def test_reference_lists_every_key():
    text = reference()

    def keys(node):
        if isinstance(node, dict):
            yield from node.get("properties", {})
            for value in node.values():
                yield from keys(value)

    for key in set(keys(VALIDATOR.schema)):
        assert f"| `{key}` |" in text, key


@pytest.mark.parametrize("name", list(TEMPLATES))
def test_templates_check_and_run(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert call("init", "--template", name) == f"{name}.yaml: next, dealib run {name}.yaml\n"
    text = Path(f"{name}.yaml").read_text()
    assert text.splitlines()[0] == MODELINE
    assert Path("dealib.schema.json").read_text() == json_text()
    assert list(VALIDATOR.iter_errors(read(text))) == []
    assert call("check", f"{name}.yaml").startswith(f"{name}.yaml: valid; {name}: prestrain, ")
    last = len(dealib.load(f"{name}.yaml").config.program) - 1
    small = {"mesh.columns": 12, "mesh.film_rows": 1, f"program.{last}.steps": 2}
    history = dealib.simulate(dealib.load(f"{name}.yaml", set=small)).history
    assert history["stage"].iloc[-1] == "actuate"
    last = history.iloc[-1]
    if name in ("disc", "rectangle"):  # the driven part grows, and the film's thickness falls
        moved = {"disc": "edge_mm", "rectangle": "centre_mm"}[name]
        volts, nominal = {"disc": (8, 16), "rectangle": (1.6, 16)}[name]
        assert last.filter(regex=r"^voltage_kV(\.left)?$").item() == volts
        assert abs(last[moved]) > 0.1
        assert nominal < last["field_max_MV_per_m"] < 2 * nominal
        return
    assert history["voltage_kV"].max() == {"deap": 2.5, "benchmark": 2.5, "membrane": 5}[name]
    assert history["field_max_MV_per_m"].max() > 60


@pytest.mark.parametrize("name", list(TEMPLATES))
def test_templates_offer_keys_that_exist(tmp_path, name):
    """Each commented key with a default can be taken in as it stands."""
    from dealib.config.templates import template

    text = template(name)
    for section in ("physics", "solver"):
        block = re.search(rf"^(# )?{section}:.*?(?=\n\n)", text, re.M | re.S)[0]
        taken = re.sub(r"^# ", "", block, flags=re.M)  # the section
        text = text.replace(block, re.sub(r"^  # ", "  ", taken, flags=re.M))  # its keys
    path = tmp_path / "case.yaml"
    path.write_text(text)
    (tmp_path / "plain.yaml").write_text(template(name))
    assert dealib.load(path).config == dealib.load(tmp_path / "plain.yaml").config


def test_overrides_are_values_of_python():
    """None and tuples too, and numpy's numbers."""
    small = Path(__file__).with_name("small.yaml")
    clamped = ["geometry.clamps={width: 1 mm, height: 1 mm}", "limits.stretch_max=2"]
    assert dealib.load(small, set=clamped).config.geometry.clamps is not None
    given = {
        "geometry.clamps": None,
        "limits.stretch_max": None,
        "mesh.columns": np.int64(6),
        "materials.film.prestretch": (1.1, np.float64(1.2)),
        "program": [{"stage": "a", "mount": None, "terminal": {"voltage": ["0 V", "1 kV"]}}],
        "output.directory": Path("runs/a: b"),
    }
    config = dealib.load(small, set=given).config
    assert config.geometry.clamps is None
    assert config.limits.stretch_max is None
    assert config.mesh.columns == 6
    assert config.materials["film"].prestretch == (1.1, 1.2)
    assert config.program[0].terminal.voltage == (0, 1)
    assert config.directory == "runs/a: b"


def test_page_of_columns_is_current_and_whole():
    page = call("schema", "--of", "history", "--reference")
    file = CONFIGS.parent / "notebooks" / "guide" / "columns.md"
    again = f"run: dealib schema --of history --reference --overwrite --out {file}"
    assert file.read_text() == page, again
    assert set(MEANINGS) == {quantity.name for quantity in QUANTITIES}
    assert call_fails("schema", "--of", "history").startswith("--of history: it has no schema")


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("benchmark_strip", {"limits.breakdown_strength": "90 MV/m", "output.modes": 1}),
        ("devices/segmented_annulus", {}),
        ("devices/diaphragm_pump", {}),
        ("dynamics/pump_cycle", {}),
        ("devices/positioning_stage", {}),
    ],
)
def test_every_column_of_a_history_is_on_the_page(name, changes):
    """Of all columns that these devices can write, without solving them."""
    config = dealib.load(CONFIGS / f"{name}.yaml", set=changes).config
    told = set(re.findall(r"^\| `(\w+)", page_of_columns(), re.MULTILINE))
    own = {*(config.probes or ())}
    for column in columns(config):
        stem = column.partition(".")[0]
        assert stem in told or any(stem.startswith(probe) for probe in own), column


def test_a_solved_history_has_the_columns_of_the_page():
    case = dealib.load(CONFIGS.parent / "tests" / "small.yaml", set={"output.modes": 1})
    told = set(re.findall(r"^\| `(\w+)", page_of_columns(), re.MULTILINE))
    first = next(iter(dealib.Simulation(case)))
    assert len(first.row) > 20
    assert set(first.row) <= told
