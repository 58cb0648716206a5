"""The best design within limits: against closed forms, on the command line, with its files."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import dealib
from dealib.design.designs import Designs, Evaluated
from dealib.design.evaluate import Evaluation, evaluate
from dealib.design.goals import Aim, Limit, goals
from dealib.design.optimise import optimise, pareto
from dealib.design.plan import DesignPlan
from dealib.design.schema import Search
from dealib.design.search import descend
from dealib.design.sensitivity import find

# isort: split
import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS
from scipy.optimize import brentq
from typer.testing import CliRunner

from dealib.cli.app import app
from dealib.errors import ConfigError

SMALL = Path(__file__).with_name("small.yaml")
DESIGNS = CONFIGS / "designs"
THICKNESS, FORCE = "geometry.layers.0.thickness", "program.1.mount.force"
STRETCH, RADIUS = "materials.film.prestretch", "geometry.inner_radius"

# configs/devices/pure_shear_strip.yaml: MPa, mm, N, kV; 8.8541878128e-6 N/kV^2 is vacuum's
SHEAR, PERMITTIVITY, VOLTAGE = 0.02, 4.7 * 8.8541878128e-6, 4.38452
LENGTH, WIDTH, STRENGTH = 30.0, 100.0, 30.0


def strip(thickness: float, force: float = 0.912209, pre: float = 1.5, G: float = SHEAR):
    """Stroke, largest stretch and field of a thin incompressible neo-Hookean strip.

    Its width is held at the pre-stretch l2. With l3 = 1 / (l1 l2), the thickness H and the section
    W H of the unstretched film, G (l1^2 - l3^2) - eps E^2 = F l1 / (W H) and E = V / (l3 H).
    """
    W, L, H = WIDTH / pre, LENGTH / pre, thickness * pre**2

    def stretch(voltage: float) -> float:
        def excess(l1: float) -> float:
            l3 = 1 / (l1 * pre)
            field = PERMITTIVITY * (voltage / (l3 * H)) ** 2
            return G * (l1**2 - l3**2) - field - force * l1 / (W * H)

        tried = np.linspace(0.5, 6, 600)
        size = np.array([excess(l1) for l1 in tried])
        first = np.flatnonzero((size[:-1] < 0) & (size[1:] >= 0))
        if not len(first):
            return np.nan  # beyond pull-in
        return brentq(excess, tried[first[0]], tried[first[0] + 1])

    before, under = stretch(0.0), stretch(VOLTAGE)
    return L * (under - before), under, VOLTAGE * under * pre / H


def written(path: Path, **changes: str) -> Path:
    """A design of the strip with keys in place of those of `thickness.yaml`."""
    keys = {
        "base": str(CONFIGS / "devices" / "pure_shear_strip.yaml"),
        "set": "{limits: {breakdown_strength: 30 MV/m}, program.2.steps: 4}",
        "variables": f"{{{THICKNESS}: {{min: 0.12 mm, max: 0.4 mm}}}}",
        "quantities": "{stroke: 'stroke(\"actuate\")'}",
        "maximise": "stroke",
        "subject_to": "['max(breakdown_use) <= 1']",
        "search": "{starts: 1}",
    }
    text = "".join(f"{k}: {v}\n" for k, v in (keys | changes).items() if v)
    path.write_text(text)
    return path


def command(*arguments: object) -> tuple[int, str, str]:
    """Exit code, output and error of the command line."""
    done = CliRunner().invoke(app, ["optimise", *map(str, arguments)])
    error = done.exception
    if isinstance(error, dealib.DealibError):
        return error.exit_code, done.output, str(error)
    assert error is None or isinstance(error, SystemExit), error
    return done.exit_code, done.output, ""


@pytest.fixture(scope="module")
def thinnest(tmp_path_factory):
    """The shipped design of the best film thickness, with its output."""
    out = tmp_path_factory.mktemp("thickness") / "out"
    code, said, _ = command(DESIGNS / "thickness.yaml", "--out", out)
    assert code == 0
    return out, said


@pytest.mark.once
def test_best_thickness_is_that_of_the_thin_film(thinnest):
    out, said = thinnest
    table = pd.read_csv(out / "designs.csv")
    known = brentq(lambda h: strip(h)[2] - STRENGTH, 0.19, 0.3)
    best = table[table["allowed"]].sort_values("stroke").iloc[-1]
    assert best[f"{THICKNESS} [mm]"] == pytest.approx(known, rel=2e-3)
    assert best["stroke"] == pytest.approx(strip(known)[0], rel=2e-3)
    assert known * 0.99 < 0.2196 < known * 1.01
    assert "largest" in said
    assert "active" in said
    assert "4 of them solved now" in said
    assert (out / "designs.png").stat().st_size > 10_000


@pytest.mark.once
def test_it_never_ends_beyond_a_limit(thinnest):
    out, _ = thinnest
    table = pd.read_csv(out / "designs.csv")
    allowed = table[table["allowed"]]
    assert (allowed["max(breakdown_use)"] <= 1).all()
    assert (table[~table["allowed"]]["max(breakdown_use)"] > 1).all()
    assert not table["allowed"].all()  # it has been there
    found = evaluate(
        dealib.load(out / "best.yaml"), {"used": "max(breakdown_use)", "s": "stroke('actuate')"}
    )
    assert 0.999 < found.values["used"] <= 1
    assert found.values["s"] == pytest.approx(allowed["stroke"].max(), rel=1e-9)


@pytest.mark.once
def test_best_config_is_the_base_with_its_comments(thinnest):
    out, _ = thinnest
    text = (out / "best.yaml").read_text()
    assert "# holds the pre-stretch" in text
    config = dealib.load(out / "best.yaml").config
    assert config.name == "thickness-best"
    assert config.directory == "runs/thickness-best"
    assert config.limits.breakdown_strength == 30.0


@pytest.mark.once
def test_the_same_command_solves_nothing_twice(thinnest):
    out, said = thinnest
    before = pd.read_csv(out / "designs.csv")
    lost = sorted((out / "evaluations").glob("*.json"))[0]
    lost.write_text(lost.read_text()[:20])  # as if the machine had gone down
    code, again, _ = command(DESIGNS / "thickness.yaml", "--out", out)
    assert code == 0
    assert "4 designs, 1 of them solved now" in again
    pd.testing.assert_frame_equal(pd.read_csv(out / "designs.csv"), before)
    assert again.replace("1 of them", "4 of them") == said


@pytest.mark.once
def test_python_has_the_same(thinnest):
    out, _ = thinnest
    found = dealib.optimise(DESIGNS / "thickness.yaml", out)
    assert found.solved == 0
    assert found.best is not None
    assert found.config.geometry.layers[0].thickness == found.best.point[THICKNESS]
    assert list(found.table["number"]) == [1, 2, 3, 4]


@pytest.mark.once
def test_interrupted_it_goes_on(tmp_path):
    design = written(tmp_path / "d.yaml")
    command_ = [sys.executable, "-m", "dealib", "optimise", str(design), "--out", "out", "-j", "1"]
    job = subprocess.Popen(
        command_, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert job.stdout is not None
    first = job.stdout.readline()
    time.sleep(0.1)
    job.send_signal(signal.SIGINT)
    _, said = job.communicate(timeout=300)
    assert first.startswith("   1  solid     stroke = ")
    assert job.returncode == 130
    assert "which are kept in out/evaluations; the same command goes on" in said
    assert "Traceback" not in said
    found = optimise(design, tmp_path / "out", jobs=1)
    assert 0 < found.solved < len(found.designs)
    assert found.best is not None


@pytest.mark.once
def test_choices_are_all_tried(tmp_path):
    film = {"soft": ("20 kPa", 0.02), "middle": ("30 kPa", 0.03), "stiff": ("60 kPa", 0.06)}
    laws = ", ".join(f"{k}: {{materials.film.shear_modulus: {v}}}" for k, (v, _) in film.items())
    design = written(
        tmp_path / "d.yaml",
        variables=f"{{film: {{choices: {{{laws}}}}}, {THICKNESS}: {{choices: [0.2 mm, 0.25 mm]}}}}",
    )
    found = optimise(design, tmp_path / "out")
    sizes = {(name, h): strip(h, G=G) for name, (_, G) in film.items() for h in (0.2, 0.25)}
    allowed = {k: s for k, (s, _, E) in sizes.items() if E <= STRENGTH}
    best = max(allowed, key=allowed.__getitem__)
    assert len(found.designs) == 6
    assert found.best is not None
    assert found.best.point == {"film": best[0], THICKNESS: f"{best[1]} mm"}
    assert found.best.found.values["stroke"] == pytest.approx(allowed[best], rel=5e-3)
    for row in found.designs:
        known = sizes[row["film"], float(row[THICKNESS].split()[0])]
        assert row["allowed"] == (known[2] <= STRENGTH)


@pytest.mark.once
def test_a_choice_beside_a_number(tmp_path):
    design = written(
        tmp_path / "d.yaml",
        variables=f"{{materials.film.shear_modulus: {{choices: [20 kPa, 40 kPa]}}, "
        f"{THICKNESS}: {{min: 0.12 mm, max: 0.4 mm, start: 0.25 mm}}}}",
    )
    found = optimise(design, tmp_path / "out")
    known = {
        f"{G * 1e3:g} kPa": brentq(
            lambda h, G=G: strip(h, G=G)[2] - STRENGTH, {0.02: 0.19, 0.04: 0.14}[G], 0.3
        )
        for G in (0.02, 0.04)
    }
    strokes = {name: strip(h, G=float(name.split()[0]) / 1e3)[0] for name, h in known.items()}
    best = max(strokes, key=strokes.__getitem__)
    assert found.best is not None
    assert found.best.point["materials.film.shear_modulus"] == best
    assert found.best.point[THICKNESS] == pytest.approx(known[best], rel=2e-3)


@pytest.mark.once
def test_where_nothing_is_allowed_it_says_what_misses_least(tmp_path):
    design = written(
        tmp_path / "d.yaml",
        subject_to="['max(breakdown_use) <= 1', 'stroke >= 30 + 0']",
        search="{starts: 1, evaluations: 12}",
    )
    code, said, error = command(design, "--out", tmp_path / "out")
    assert code == 3
    assert error.startswith(
        f"{design}: no design is within all limits; in the nearest one, 'max(breakdown_use) <= 1' "
        "is missed by "
    )
    assert "the nearest design, which is beyond a limit" in said
    assert not (tmp_path / "out" / "best.yaml").exists()
    thick = pd.read_csv(tmp_path / "out" / "designs.csv")[f"{THICKNESS} [mm]"]
    worst = [
        max(strip(h)[2] / STRENGTH - 1, 1 - strip(h)[0] / 30) for h in np.linspace(0.17, 0.25, 400)
    ]
    missed = float(error.split("is missed by ")[1].split("%")[0]) / 100
    assert missed == pytest.approx(np.nanmin(worst), abs=0.02)
    assert len(thick) <= 12


@pytest.mark.once
def test_beyond_collapse_nothing_is_allowed_and_nothing_crashes(tmp_path):
    # the stress of the film and that of the field both grow with the stretch squared
    collapse = VOLTAGE / 1.5 * np.sqrt(PERMITTIVITY / SHEAR)
    assert collapse == pytest.approx(0.13333, rel=1e-3)
    keys = {"set": "{program.2.steps: 4, solver.max_cuts: 2}", "subject_to": ""}
    all_beyond = f"{{{THICKNESS}: {{min: 0.1 mm, max: 0.13 mm}}}}"
    design = written(tmp_path / "d.yaml", variables=all_beyond, **keys)
    code, said, error = command(design, "--out", tmp_path / "out")
    assert code == 3
    assert error.startswith(f"{design}: no design converges: stage 'actuate' stopped after t = ")
    assert said.splitlines()[0].startswith("   1  solid     stage 'actuate' stopped after t = ")
    some = f"{{{THICKNESS}: {{min: 0.12 mm, max: 0.16 mm}}}}"
    written(design, variables=some, search="{starts: 1, evaluations: 5}", **keys)
    found = optimise(design, tmp_path / "some", jobs=1)
    failed = [row[f"{THICKNESS} [mm]"] for row in found.designs if row["error"]]
    assert failed
    assert max(failed) < 0.137
    assert found.best is not None
    assert found.best.point[THICKNESS] > collapse
    assert found.best.found.values["stroke"] > 90


@pytest.fixture(scope="module")
def front(tmp_path_factory):
    """The shipped design of two objectives."""
    out = tmp_path_factory.mktemp("front") / "out"
    code, said, _ = command(DESIGNS / "stroke_or_stretch.yaml", "--out", out)
    assert code == 0
    return out, said


def random_designs(count: int) -> np.ndarray:
    """Stroke and stretch of random designs within the limits."""
    plan = DesignPlan(DESIGNS / "stroke_or_stretch.yaml")
    bounds = np.array([v.range for v in plan.design.variables.values()])
    assert list(plan.design.variables) == [THICKNESS, STRETCH, FORCE]
    rng, found = np.random.default_rng(7), []
    while len(found) < count:
        h, pre, force = rng.uniform(*bounds.T)
        stroke, stretch, field = strip(h, force, pre)
        if field <= STRENGTH and stroke >= 1:
            found.append((stroke, max(stretch, pre)))
    return np.array(found)


@pytest.mark.once
@pytest.mark.slow
def test_front_dominates_random_designs(front):
    out, said = front
    table = pd.read_csv(out / "front.csv", float_precision="round_trip")
    others = random_designs(200)
    assert "the knee of a front of" in said
    assert table["allowed"].all()
    assert (table["max(breakdown_use)"] <= 1).all()
    assert (np.diff(table["stroke"]) < 0).all()
    assert (np.diff(table["stretch"]) < 0).all()
    for h, pre, force, stroke, stretch in table[
        [f"{THICKNESS} [mm]", STRETCH, f"{FORCE} [N]", "stroke", "stretch"]
    ].to_numpy():
        known = strip(h, force, pre)
        assert stroke == pytest.approx(known[0], rel=5e-3)
        assert stretch == pytest.approx(max(known[1], pre), rel=5e-3)
    stroke, stretch = table["stroke"].to_numpy(), table["stretch"].to_numpy()
    dominated = [((stroke >= s) & (stretch <= l1)).any() for s, l1 in others]
    assert sum(dominated) == 200
    assert (out / "front.png").stat().st_size > 10_000
    knee = dealib.load(out / "best.yaml").config
    assert knee.geometry.layers[0].thickness in table[f"{THICKNESS} [mm]"].to_numpy()


@pytest.mark.once
def test_membrane_is_corrected_by_the_solid(tmp_path):
    design = tmp_path / "d.yaml"
    design.write_text(
        f"base: {SMALL}\nset: {{program.1.steps: 4, program.0.steps: 2}}\n"
        "variables: {geometry.film_thickness: {min: 20 um, max: 60 um}}\n"
        "minimise: 'abs(end(force_N, \"push\"))'\n"
        "subject_to: 'max(field_max_MV_per_m) <= 60'\nsearch: {starts: 1}\n"
    )
    said: list[str] = []
    found = optimise(design, tmp_path / "out", jobs=1, tell=said.append)
    assert found.best is not None
    assert found.best.model == "solid"
    (told,) = [line for line in said if "the membrane deviates from the solid by" in line]
    assert "searching with the membrane, corrected by the solid" in told
    models = found.table["model"].value_counts()
    assert models["solid"] <= 5
    field = found.best.found.values["max(field_max_MV_per_m)"]
    assert 59.9 < field <= 60
    alone = optimise(design, tmp_path / "solid", model="solid", jobs=1)
    assert alone.best is not None
    same = found.best.point["geometry.film_thickness"]
    assert same == pytest.approx(alone.best.point["geometry.film_thickness"], rel=1e-3)
    assert set(alone.table["model"]) == {"solid"}


@pytest.mark.once
def test_slopes_of_a_design_are_those_of_sensitivities():
    case = dealib.load(SMALL, {"physics": "{model: membrane}", "program.1.steps": 4})
    names = ["geometry.film_thickness", "materials.film.prestretch"]
    found = evaluate(case, {"a": "max(field_max_MV_per_m)", "b": "end(force_N, 'push')"}, names)
    exact = find(case, ["max(field_max_MV_per_m)", "end(force_N, 'push')"], names).rows
    rough = [found.slopes[q][k] for q in "ab" for k in names]
    assert rough == pytest.approx([row["derivative"] for row in exact], rel=1e-3)


def test_differences_where_a_run_gives_no_slopes(tmp_path):
    design = tmp_path / "d.yaml"
    design.write_text(  # a number at 0 has no relative change
        f"base: {SMALL}\nset: {{physics.model: membrane, program.0.steps: 1, program.1.steps: 2}}\n"
        "variables: {program.0.mount.displacement: {min: -1 mm, max: 1 mm, start: 0 mm}}\n"
        "minimise: '(end(displacement_mm, \"push\") - 0.5) ** 2 + 1'\nsearch: {starts: 1}\n"
    )
    found = optimise(design, tmp_path / "out", jobs=1)
    assert found.best is not None
    tried = [row["program.0.mount.displacement [mm]"] for row in found.designs]
    assert tried[:2] == pytest.approx([0, -0.002], abs=1e-12)
    assert found.best.point["program.0.mount.displacement"] == pytest.approx(0.5, abs=0.02)


def valley(x):
    """A bent valley with a hole, and two more quantities."""
    a, b = x
    if a > 0.9 and b > 0.5:
        return None
    f = 100 * (b - a * a) ** 2 + (1 - a) ** 2
    df = np.array([-400 * a * (b - a * a) - 2 * (1 - a), 200 * (b - a * a)])
    return {"f": (f, df), "sum": (a + b, np.ones(2)), "far": (a * a + b * b, 2 * x)}


@pytest.mark.parametrize(
    ("limits", "known"),
    [
        ([], None),
        ([Limit("", "sum", 1, 0.8)], (0.5256, 0.2744)),
        ([Limit("", "sum", 1, 1.2), Limit("", "far", -1, 0.9)], (0.9, 0.3)),
        ([Limit("", "sum", 1, 0.2), Limit("", "far", -1, 0.9)], "none"),
    ],
)
def test_search_ends_within_limits_and_beside_holes(limits, known):
    best = descend(valley, Aim("f", 1), limits, np.array([0.8, 0.1]), Search(tolerance=1e-7))
    assert best is not None
    if known == "none":
        assert best.beyond > 0.8
        return
    assert best.beyond == 0
    assert all(limit.slack({k: v[0] for k, v in valley(best.x).items()}) >= 0 for limit in limits)
    if known is None:
        assert best.objective < 0.03
    else:
        assert best.x == pytest.approx(known, abs=1e-3)


def test_a_search_from_a_hole_has_no_end():
    assert descend(valley, Aim("f", 1), [], np.array([0.95, 0.9]), Search()) is None


def test_front_keeps_what_nothing_is_better_than():
    sizes = [(1, 1), (2, 0.5), (2, 0.7), (3, 0.5), (0.5, 3), (0.5, 2.5), (1, 1)]
    found = [Evaluated("solid", {}, Evaluation({"a": a, "b": -b}, {})) for a, b in sizes]
    front = pareto(found, (Aim("a", 1), Aim("b", -1)))
    assert [(e.found.values["a"], -e.found.values["b"]) for e in front] == [
        (0.5, 2.5), (1, 1), (2, 0.5)
    ]  # fmt: skip


MISTAKES = {  # changed lines -> what is said, from the line on
    "unknown key": ({"maximize": "stroke"}, "8:1: maximize: unknown key; did you mean 'maximise'?"),
    "order": (
        {"variables": f"{{{THICKNESS}: {{min: 0.5 mm, max: 0.4 mm}}}}"},
        f"3:48: variables.{THICKNESS}.min: min must be below max",
    ),
    "kind": (
        {"variables": f"{{{THICKNESS}: {{min: 0.1 mm, max: 0.4 N}}}}"},
        f"3:61: variables.{THICKNESS}.max: expected a unit such as 'mm'; 'N' is not a unit of that "
        "kind",
    ),
    "unit": (
        {"variables": f"{{{THICKNESS}: {{min: 0.1 N, max: 0.4 N}}}}"},
        f"3:48: variables.{THICKNESS}.min: expected a unit such as 'mm'; 'N' is not a unit of that "
        "kind",
    ),
    "no number": (
        {"variables": "{materials.film.law: {min: 1, max: 2}}"},
        "3:13: variables.materials.film.law: in ",
    ),
    "section": (
        {"variables": "{materials.film.thicknes: {min: 1 mm, max: 2 mm}}"},
        "3:13: variables.materials.film.thicknes: in ",
    ),
    "quantity": (
        {"maximise": "strokes"},
        "5:11: maximise: unknown name 'strokes'; did you mean 'stroke'?",
    ),
    "stage": (
        {"quantities": "{stroke: 'stroke(\"actuat\")'}"},
        "4:22: quantities.stroke: there is no stage 'actuat'; did you mean 'actuate'?",
    ),
    "no comparison": (
        {"subject_to": "[stroke]"},
        "6:14: subject_to.0: 'stroke' is not an inequality such as 'used <= 0.8' or "
        "'0 <= max(force_N) <= 2'",
    ),
    "equality": (
        {"subject_to": "['stroke == 2']"},
        "6:14: subject_to.0: 'stroke == 2' is not an inequality",
    ),
    "numbers": (
        {"subject_to": "['1 <= 2']"},
        "6:14: subject_to.0: '1 <= 2' compares constants; name a quantity",
    ),
    "no variables": ({"variables": "{}"}, "3:12: variables: must not be empty"),
    "no objective": (
        {"maximise": ""},
        "1:1: one or two objectives are needed, in maximise and minimise",
    ),
    "both": (
        {"variables": f"{{{THICKNESS}: {{min: 0.1 mm, choices: [0.2 mm]}}}}"},
        "min: choices and min exclude each other",
    ),
    "half": (
        {"variables": f"{{{THICKNESS}: {{min: 0.1 mm}}}}"},
        f"variables.{THICKNESS}: max is missing; give min and max, or choices",
    ),
    "start": (
        {"variables": f"{{{THICKNESS}: {{min: 0.1 mm, max: 0.2 mm, start: 1 mm}}}}"},
        "start: the start must lie between min and max",
    ),
    "base": ({"base": "nothing.yaml"}, "1:7: base: there is no file "),
}


@pytest.mark.once
@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_told_with_their_place(name, tmp_path):
    changes, said = MISTAKES[name]
    design = written(tmp_path / "d.yaml", **changes)
    both = [["check", str(design)], ["optimise", str(design), "--out", str(tmp_path / "o")]]
    for arguments in both[name == "no objective" :]:  # which `dealib uncertainty` needs not
        done = CliRunner().invoke(app, arguments)
        assert isinstance(done.exception, ConfigError), done.exception
        assert str(done.exception).startswith(f"{design}:"), done.exception
        assert said in str(done.exception)
    assert not (tmp_path / "o").exists()


@pytest.mark.once
def test_check_of_a_good_design_imports_no_solver():
    code = (
        "import sys; from dealib.cli.app import app; "
        f"app(['check', {str(DESIGNS / 'thickness.yaml')!r}], standalone_mode=False); "
        "print(sorted({'dolfinx', 'pandas', 'matplotlib', 'pyvista'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        f"{DESIGNS / 'thickness.yaml'}: valid; thickness: {THICKNESS}",
        "[]",
    ]


def test_files_of_another_kind_and_other_folders_are_left_alone(tmp_path):
    code, _, error = command(SMALL)
    assert (code, error) == (2, f"{SMALL}: a config, not a design; 'dealib run {SMALL}' takes it")
    (tmp_path / "mine").write_text("kept")
    code, _, error = command(DESIGNS / "thickness.yaml", "--out", tmp_path)
    assert (code, error) == (
        2,
        f"{tmp_path} is not the directory of an optimum; choose another --out",
    )
    code, _, error = command(DESIGNS / "thickness.yaml", "--model", "solids")
    assert (code, error) == (2, "--model solids: unknown; did you mean 'solid'?")
    assert sorted(os.listdir(tmp_path)) == ["mine"]


def test_limits_read_as_they_are_written(tmp_path):
    design = written(
        tmp_path / "d.yaml",
        subject_to="['0.1 <= stroke < 30', 'max(breakdown_use) * 2 >= stroke / 100', "
        "'10 > 2 * stroke']",
    )
    found = goals(DesignPlan(design))
    values = {name: 0.0 for name in found.asked} | {
        "stroke": 3.0, "max(breakdown_use) * 2 - (stroke / 100)": 0.5, "2 * stroke": 6.0
    }  # fmt: skip
    assert [round(limit.slack(values), 9) for limit in found.limits] == [2.9, 27.0, 0.5, 4.0]
    assert found.asked["2 * stroke"] == "2 * stroke('actuate')"


@pytest.mark.slow
def test_deap100_in_four_variables(tmp_path):
    shutil.copy(CONFIGS / "deap100.yaml", tmp_path)
    (tmp_path / "d.yaml").write_text(
        "base: deap100.yaml\nquantities: {stroke: 'stroke(\"actuate\")'}\nmaximise: stroke\n"
        "variables:\n  geometry.film_thickness: {min: 20 um, max: 60 um}\n"
        "  geometry.inner_radius: {min: 4 mm, max: 7 mm}\n"
        "  materials.film.prestretch: {min: 1.05, max: 1.3}\n"
        "  program.1.mount.force: {min: -0.8 N, max: -0.2 N}\n"
        "subject_to: ['max(pull_in_use) <= 1', 'max(wrinkling_use) <= 1', "
        "'max(field_max_MV_per_m) <= 110']\n"
    )
    begin = os.times()
    found = optimise(tmp_path / "d.yaml", tmp_path / "out")
    end = os.times()
    assert found.best is not None
    assert found.best.model == "solid"
    values = found.best.found.values
    assert values["stroke"] > 0.73
    assert values["max(field_max_MV_per_m)"] <= 110
    assert values["max(wrinkling_use)"] <= 1
    used = end.user + end.system + end.children_user + end.children_system
    used -= begin.user + begin.system + begin.children_user + begin.children_system
    assert used < 2 * 180  # of two cores in three minutes


@pytest.mark.once
def test_a_design_that_cannot_be_is_not_allowed(tmp_path):
    design = tmp_path / "d.yaml"
    design.write_text(
        f"base: {SMALL}\nset: {{physics.model: membrane, program.0.steps: 1, program.1.steps: 2}}\n"
        "variables: {geometry.inner_radius: {choices: [8 mm, 13 mm]}}\n"  # beyond the outer one
        "minimise: 'max(field_max_MV_per_m)'\n"
    )
    with pytest.raises(ConfigError, match=r"d\.yaml:3:37: variables\.geometry\.inner_radius"):
        DesignPlan(design)
    text = design.read_text().replace("choices: [8 mm, 13 mm]", "min: 10 mm, max: 14 mm")
    design.write_text(text.replace("minimise: 'max", "maximise: 'charge_uC * 0 + max"))
    plan = DesignPlan(design)
    with Designs(plan, goals(plan), tmp_path / "out", 1, print) as designs:
        assert "must exceed inner_radius" in designs.see("membrane", {RADIUS: 13.0}).error
        assert not designs.allowed(designs.seen[0])
        see = designs.oracle("membrane", {})
        assert see(np.array([0.9])) is None
        assert see(np.array([0.1])) is not None
