"""The study engine on a tiny device; the thesis's studies validate."""

import multiprocessing
import os
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pandas as pd
import pytest

import dealib
from dealib import versions
from dealib.cases.cache import DONE, FAILED, Cache
from dealib.cases.workers import Pool, Watcher
from dealib.errors import ConfigError, PlatformError
from dealib.study import sample, sweep
from dealib.study.evaluate import Results
from dealib.study.expressions import OF_A_CASE, Expression
from dealib.study.plan import find, read
from dealib.tasks import studies

pytestmark = pytest.mark.once  # of histories and fields as they are stored
ROOT = Path(__file__).parent.parent
THESIS = ROOT / "configs" / "thesis"

BASE = """\
name: tiny
geometry:
  inner_radius: 8 mm
  outer_radius: 12 mm
  film_thickness: 30 um
  electrode_thickness: 0 um
mesh: {columns: 8, film_rows: 1}
materials:
  film: {law: neo_hookean, youngs_modulus: 1 MPa, relative_permittivity: 3.0, prestretch: 1.15}
solver: {max_cuts: 2}
program:
  - {stage: prestrain, steps: 1}
"""
STUDY = """\
name: tiny_study
title: a tiny study
base: tiny.yaml
program:
  - {stage: prestrain, steps: 1}
  - {stage: raise, mount: {force: 0 N}, terminal: {voltage: 1 V}, steps: 1}
  - {stage: push, mount: {force: -0.05 N}, steps: 2}
vary:
  thickness: {geometry.film_thickness: [30 um, 60 um], geometry.electrode_thickness: [0 um, 0 um]}
  law:
    neo-Hookean: {}
    Mooney-Rivlin: {materials.film.law: mooney_rivlin}
quantities:
  depth: -end(displacement_mm, "push")
  charge: field("D_n", "film", 0.5, 1, "raise")
  thickness: setting("geometry.film_thickness")
panels:
  - kind: curves
    title: pushed
    x: {value: displacement_mm, label: Displacement (mm), limits: [0, -1]}
    y: {value: force_N, label: Force (N), limits: [-0.06, 0]}
    references: [{label: none, x: [0.0], y: [0.0]}]
  - kind: points
    group: law
    x: {value: 1000 * thickness, label: Thickness (µm)}
    y: {value: depth, label: Depth (mm)}
  - kind: contour
    where: &one {thickness: 30 um, law: neo-Hookean}
    field: E
    label: E (MV/m)
    stage: push
  - {kind: shapes, where: *one, times: [0 s, 2 s]}
windows:
  - {name: charge times thickness, value: charge * thickness, low: 2.6e-8, high: 2.7e-8}
  - {name: too deep, value: depth, low: 100, unit: mm}
comparison: 'thin: {of(depth, "30 um, neo-Hookean"):.4f} mm'
"""
SWEEP = """\
name: voltages
title: voltages, two of them far beyond pull-in
base: tiny.yaml
program:
  - {stage: prestrain, steps: 1}
  - {stage: raise, mount: {force: -0.01 N}, terminal: {voltage: 1 kV}, steps: 1}
label: "{volts}"
vary:
  volts: {program.1.terminal.voltage: [0.1 kV, 0.2 kV, 0.3 kV, 30 kV, 0.4 kV, 0.5 kV, 0.6 kV,
          40 kV, 0.7 kV, 0.8 kV, 0.9 kV, 1.0 kV]}
quantities:
  charge: end(charge_uC, "raise")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("study")
    for name, text in {"tiny": BASE, "study": STUDY, "sweep": SWEEP}.items():
        (path / f"{name}.yaml").write_text(text)
    return path


@pytest.fixture
def run_cli(program):
    """Runs the program in a folder."""
    return lambda folder, *arguments: program(*arguments, cwd=folder)


# --- expressions ---------------------------------------------------------------------------------


def test_expression_values():
    x = np.array([1.0, 4.0, 9.0])
    value = Expression("-2 * max(sqrt(x)) ** 2 / (1 + first(x)) + mean(diff(x))", {})
    assert value({"x": x}, {}) == pytest.approx(-9 + 4)
    assert Expression('end(x, "a") * 2', OF_A_CASE)({"x": x}, {"end": lambda x, s: x[-1]}) == 18


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(x + x).real", "'(x + x).real': only numbers, names"),
        ("x.real()", "'x.real()': only numbers, names"),
        ("__import__('os')", "unknown function '__import__'"),
        ("[1 for i in x]", "only numbers, names"),
        ("x[0]", "only numbers, names"),
        ("(lambda: 1)()", "only numbers, names"),
        ("maxx(x)", "unknown function 'maxx'; did you mean 'max'?"),
        ("max(x, x)", "max() takes 1 argument, not 2"),
        ("1 +", "'1 +' is not an arithmetic expression"),
        ("1" * 501, "at most 500 characters"),
    ],
)
def test_expressions_are_arithmetic_only(text, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Expression(text, {})


def test_expression_names_unknown_things_and_bounds_powers():
    with pytest.raises(ValueError, match="unknown name 'forse_N'; did you mean 'force_N'"):
        Expression("forse_N", {})({"force_N": np.ones(1)}, {})
    forces = {"force_N.left": np.array([2.0, 3.0]), "force_N.right": np.ones(2)}
    assert list(Expression("force_N.left - force_N.right", {})(forces, {})) == [1.0, 2.0]
    with pytest.raises(ValueError, match=r"unknown name 'force_N\.left\.real'"):  # no attributes
        Expression("force_N.left.real", {})(forces, {})
    with pytest.raises(ValueError, match=r"'9 \*\* 9 \*\* 9 \*\* 9': an exponent is beyond 64"):
        Expression("9 ** 9 ** 9 ** 9", {})({}, {})
    assert Expression("2 ** 64", {})({}, {}) == 2.0**64


# --- cases ---------------------------------------------------------------------------------------


def test_axes_multiply_and_lists_go_in_step(folder):
    cases = read(folder / "study.yaml").cases
    assert [c.label for c in cases] == [
        f"{t} um, {law}" for t in (30, 60) for law in ("neo-Hookean", "Mooney-Rivlin")
    ]
    assert [c.work.geometry.film_thickness for c in cases] == pytest.approx(
        [0.03, 0.03, 0.06, 0.06]
    )
    assert cases[1].work.materials["film"].parameters["c01"] == pytest.approx(-1 / 12)


def test_key_is_that_of_the_physics(folder, tmp_path, monkeypatch):
    def key(base=BASE, study=STUDY):
        (tmp_path / "tiny.yaml").write_text(base)
        (tmp_path / "study.yaml").write_text(study)
        return read(tmp_path / "study.yaml").cases[0].key

    first = read(folder / "study.yaml").cases[0].key
    assert key() == first
    assert key(BASE.replace("name: tiny", "name: other\ndescription: new")) == first
    assert key(study=STUDY.replace("tiny_study", "other_study")) == first
    assert key(BASE.replace("1.15", "1.16")) != first
    assert key(study=STUDY.replace("-0.05 N", "-0.06 N")) != first
    with monkeypatch.context() as patch:
        patch.setattr(versions, "installed", lambda: {"petsc4py": "99"})
        assert key() != first
    with monkeypatch.context() as patch:
        patch.setattr(versions, "source", lambda: "of another solver")
        assert key() != first
    assert key() == first


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("title:", "titel:", "study.yaml:2:1: titel: unknown key; did you mean 'title'?"),
        (
            "thickness: setting(",
            "thickness: settin(",
            "study.yaml:16:14: quantities.thickness: unknown function 'settin'; did you mean "
            "'setting'?",
        ),
        (
            "value: depth, low",
            "value: dept, low",
            "windows.1.value: 'dept': no quantity named dept; did you mean 'depth'?",
        ),
        ("name: tiny_study", "name: tiny study", "study.yaml:1:7: name: use letters, digits, '_'"),
        ("low: 100, unit: mm", "unit: mm", "give low, high or both"),
        ("30 um, 60 um]", "30 um]", "the lists must have the same length"),
        ("geometry.film_thickness: [30 um", "geometry.film_thicknes: [30 um", "film_thickness"),
        ("[30 um, 60 um]", "[30 um, 60 kg]", "case '60 kg, neo-Hookean'"),
        ("base: tiny.yaml", "base: none.yaml", "none.yaml: cannot read the config"),
        (
            "group: law",
            "group: laws",
            "panels.1.group: 'laws' is not an axis of vary; did you mean 'law'?",
        ),
        # what no case will have is told before any is solved
        (
            "-end(displacement_mm,",
            "-end(displacment_mm,",
            "study.yaml:14:10: quantities.depth: unknown name 'displacment_mm'; did you mean "
            "'displacement_mm'?",
        ),
        (
            '(displacement_mm, "push")',
            '(displacement_mm, "pusch")',
            "quantities.depth: there is no stage 'pusch'; did you mean 'push'?",
        ),
        (
            '(displacement_mm, "push")',
            "(displacement_mm, push)",
            "quantities.depth: 'push' is a stage; put it in double quotes",
        ),
        (
            "{stage: raise,",
            "{stage: push,",
            "quantities.depth: several stages are named 'push'; give each a name of its own",
        ),
        (
            '"D_n", "film", 0.5, 1,',
            '"D_m", "film", 0.5, 1,',
            "quantities.charge: there is no field 'D_m'; did you mean 'D_n'?",
        ),
        (
            '"D_n", "film", 0.5, 1,',
            '"D_n", "flim", 0.5, 1,',
            "quantities.charge: there is no region 'flim'; did you mean 'film'?",
        ),
        (
            '"D_n", "film", 0.5, 1,',
            '"D_n", "film", 1.5, 1,',
            "quantities.charge: along is a fraction from 0 to 1, not 1.5",
        ),
        (
            '"D_n", "film", 0.5, 1,',
            '"D_n", "film", 0.5, -1 / 4,',
            "quantities.charge: across is a fraction from 0 to 1, not -0.25",
        ),
        (
            'geometry.film_thickness")',
            'geometry.film_thicknes")',
            "quantities.thickness: the config has no 'geometry.film_thicknes'",
        ),
        (
            "x: {value: displacement_mm,",
            "x: {value: -displacement,",
            "panels.0.x.value: unknown name 'displacement'; did you mean 'displacement_mm'?",
        ),
        (
            "field: E\n",
            "field: F\n",
            "panels.2.field: there is no field 'F'; known: phi, J, wrinkling, tension,",
        ),
        (
            "&one {thickness: 30 um,",
            "&one {thickness: 31 um,",
            "panels.2.where.thickness: there is no '31 um' on this axis; did you mean '30 um'?",
        ),
        (
            "&one {thickness: 30 um, law: neo-Hookean}",
            "&one {thickness: 30 um}",
            "panels.2: 'where' must choose one case, not 2",
        ),
        (
            "label: E (MV/m)",
            "limits: [2, 1]\n    label: E (MV/m)",
            "panels.2.limits: the first limit must be below the second",
        ),
        (
            "value: depth, low: 100",
            "value: depth, where: {law: Ogden}, low: 100",
            "windows.1.where.law: there is no 'Ogden' on this axis; known: neo-Hookean, "
            "Mooney-Rivlin",
        ),
        (
            "stage: push\n  - {kind",
            "stage: puch\n  - {kind",
            "panels.2.stage: there is no stage 'puch'; did you mean 'push'?",
        ),
        (
            'of(depth, "30 um, neo-Hookean")',
            'of(depth, "30 um, neo-Hooke")',
            "comparison: there is no case '30 um, neo-Hooke'; did you mean '30 um, neo-Hookean'?",
        ),
    ],
)
def test_mistakes_in_a_study(tmp_path, old, new, message):
    (tmp_path / "tiny.yaml").write_text(BASE)
    (tmp_path / "study.yaml").write_text(STUDY.replace(old, new, 1))
    with pytest.raises(ConfigError) as error:
        read(tmp_path / "study.yaml")
    assert message in str(error.value)


def test_a_material_is_not_stretched_to_nothing(tmp_path):
    path = tmp_path / "laws.yaml"
    material = "{law: neo_hookean, youngs_modulus: 1 MPa}"
    path.write_text(
        f"name: laws\ntitle: laws\nmaterial_test: {{material: {material}, stretch: [0, 2]}}\n"
    )
    with pytest.raises(ConfigError) as error:
        read(path)
    assert str(error.value) == (
        f"{path}: case 'laws': material_test.stretch.0: must be above 0, not 0"
    )


def test_configs_beside_studies_are_left_out(run_cli, folder, tmp_path):
    for name in ("tiny", "study", "sweep"):
        (tmp_path / f"{name}.yaml").write_text((folder / f"{name}.yaml").read_text())
    (tmp_path / "fit.yaml").write_text("name: fit\nbase: tiny.yaml\nparameters: {}\ndata: []\n")
    assert [p.name for p in find(tmp_path)] == ["study.yaml", "sweep.yaml"]
    (tmp_path / "study.yaml").write_text(STUDY.replace("base: tiny.yaml", "base: none.yaml"))
    done = run_cli(tmp_path, "study", ".")
    assert (done.returncode, done.stdout) == (
        2,
        "left out, since they are no studies: fit.yaml, tiny.yaml\n",
    )
    assert "none.yaml: cannot read the config" in done.stderr
    for name in ("study", "sweep"):
        (tmp_path / f"{name}.yaml").unlink()
    with pytest.raises(ConfigError, match=r"the folder has no study \(a \*\.yaml file with "):
        find(tmp_path)


# --- running -------------------------------------------------------------------------------------


def test_study_solves_draws_and_compares(run_cli, folder):
    done = run_cli(folder, "study", "study.yaml", "-j", 2, "--cache", "cases")
    assert done.returncode == 0, done.stderr
    assert "4 cases in 1 study; 4 to solve" in done.stdout
    assert "tiny_study: 2 of 3 windows hold" in done.stdout
    out = folder / "runs" / "studies" / "tiny_study"
    table = pd.read_csv(out / "tiny_study.csv")
    assert list(table["status"]) == ["done"] * 4
    # a flat capacitor at 1 V: charge density eps0 eps_r V / H
    assert table["charge"][0] == pytest.approx(8.8541878128e-12 * 3 / 30e-6, rel=1e-4)
    # the same number as by the Python interface
    case = dealib.load(folder / "tiny.yaml", set=read(folder / "study.yaml").cases[3].overrides)
    last = list(dealib.Simulation(case))[-1].row
    assert table["depth"][3] == pytest.approx(-last["displacement_mm"], rel=1e-12)
    windows = pd.read_csv(out / "windows.csv").set_index("window")["verdict"]
    assert windows.to_dict() == {
        "charge times thickness": "holds",
        "too deep": "does not hold",
        "pushed: Force within the axis": "holds",
    }
    assert (out / "tiny_study.png").read_bytes()[:4] == b"\x89PNG"
    page = (out / "gallery.html").read_text()
    assert page.count("<h1>a tiny study</h1>") == page.count(">a tiny study<") - 1 == 1  # <title>
    assert "Shaded in the pictures" in page
    assert f"thin: {table['depth'][0]:.4f} mm" in page
    assert "<svg" in page
    assert "currentColor" in page
    assert not re.search(r"(src|href)=\"(?!#|data:)", page)  # self-contained
    again = run_cli(folder, "study", "study.yaml", "--cache", "cases")
    assert again.returncode == 0
    assert "0 to solve" in again.stdout


def test_what_ended_a_case_early_is_told(folder):
    text = STUDY.replace(
        "force: -0.05 N}, steps: 2", "force: -0.05 N}, steps: 2, stop_when: [WHEN]"
    )
    text = text.replace("WHEN", "force_N < -0.02 N").replace("charge: field", "# charge: field")
    (folder / "early.yaml").write_text(text[: text.index("panels:")])
    told = []
    (found,) = dealib.run_study(
        folder / "early.yaml", folder / "out", 1, cache=folder / "cases", tell=told.append
    )
    assert set(found.table["ended_by"]) == {"force_N < -0.02 N at 1.5 s in push"}
    head, *rows = told[1].splitlines()
    assert head.split() == ["case", "depth", "thickness", "ended_by"]
    assert [float(row.split()[-10]) for row in rows] == [0.03, 0.03, 0.06, 0.06]
    assert told[2:] == [
        str(folder / "out" / "tiny_study.csv"),
        str(folder / "out" / "gallery.html"),
    ]


@pytest.mark.slow
def test_pictures_follow_the_axes_that_are_asked_for(folder, monkeypatch):
    """An axis whose limits fall runs that way; log axes; one legend below panels that share it."""
    from dealib.study import panels

    text = STUDY.replace(
        "label: Thickness (µm)", "label: Thickness (µm), scale: log, limits: [20, 90]"
    )
    assert text != STUDY
    path, cache = folder / "axes.yaml", Cache(folder / "cases")
    path.write_text(text)
    plan = read(path)
    with Pool(1) as pool:
        assert all(ended.status == DONE for ended in pool.solve(sweep.missing([plan], cache)))
    results = Results(plan, cache, sweep.statuses(plan, cache, {}))
    monkeypatch.setattr(panels.plt, "close", lambda figure: None)
    assert panels.draw(results) is not None
    figure = panels.plt.gcf()
    first, second = (part.axes for part in figure.subfigs[:2])
    pushed, points = first
    left, right = pushed.get_xlim()
    assert left > 0 > -1 > right
    assert points.get_xscale() == "log"
    assert points.get_xlim()[0] > 0
    (legend,) = figure.subfigs[0].legends
    names = [text.get_text() for text in legend.get_texts()]
    assert {"none", "neo-Hookean", "30 um, neo-Hookean"} <= set(names)
    assert [axis.get_legend() for axis in first] == [None, None]
    titles = [axis.get_title(loc="left") for axis in second[:4]]
    assert titles[1:] == ["straightened", "inner end, true scale", "outer end, true scale"]
    monkeypatch.undo()
    panels.plt.close(figure)


def test_a_log_axis_needs_limits_above_zero(folder):
    path = folder / "log.yaml"
    path.write_text(STUDY.replace("limits: [0, -1]", "limits: [0, 1], scale: log"))
    with pytest.raises(
        ConfigError, match=r"panels\.0\.x\.limits: a log axis needs limits above zero"
    ):
        read(path)


def test_sweep_goes_on_past_failures_and_resumes(run_cli, folder):
    done = run_cli(folder, "sweep", "sweep.yaml", "-j", 2, "--cache", "swept")
    assert done.returncode == 3, done.stderr
    summary = pd.read_csv(folder / "runs" / "studies" / "voltages" / "summary.csv")
    assert summary["status"].value_counts().to_dict() == {"done": 10, "not converged": 2}
    failed = summary[summary["status"] != "done"]
    assert list(failed["case"]) == ["30 kV", "40 kV"]
    # how far is chance: beyond pull-in there are states far from any that a device comes to
    assert failed["error"].str.contains("stage 'raise' stopped after t = 0").all()
    assert failed["error"].str.contains("pull-in").all()
    assert failed["charge"].isna().all()
    solved = summary[summary["status"] == "done"]
    assert (solved["charge"] > 0).all()
    assert solved["charge"].is_monotonic_increasing
    assert "10 of 12 cases are solved; these are not:" in done.stderr
    for run in summary["run"]:
        assert "stopped" in (folder / run / "run.log").read_text() or run in set(solved["run"])
    again = run_cli(folder, "sweep", "sweep.yaml", "--cache", "swept")
    assert (again.returncode, again.stdout.splitlines()[0]) == (
        3,
        "12 cases in 1 study; 0 to solve",
    )
    retried = run_cli(folder, "sweep", "sweep.yaml", "--retry", "--cache", "swept")
    assert (retried.returncode, "2 to solve" in retried.stdout) == (3, True)


def test_an_interrupted_sweep_keeps_what_is_solved(folder):
    command = [sys.executable, "-m", "dealib", "sweep", "sweep.yaml", "-j", "1", "--cache", "cut"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        for line in process.stdout:
            if line.startswith(b"2/12"):
                process.send_signal(signal.SIGTERM)
        said = process.stderr.read().decode()
    assert process.returncode == 143
    ended = int(re.search(r"by SIGTERM after (\d+) of 12 cases, which are kept", said)[1])
    plan, cache = read(folder / "sweep.yaml"), Cache(folder / "cut")
    left = sweep.missing([plan], cache)
    assert 1 <= ended <= 12 - len(left) < 12  # one may have ended unheard
    assert [job.label for job in left] == [f"voltages: {c.label}" for c in plan.cases[-len(left) :]]


def test_a_cache_that_cannot_be_is_told(run_cli, folder):
    (folder / "file").write_text("")
    done = run_cli(folder, "sweep", "sweep.yaml", "-j", 1, "--cache", "file/cases", "--out", "no")
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    assert "0.1 kV: failed: cannot write file/cases/" in done.stderr
    assert "Not a directory" in done.stderr


@pytest.mark.mpi
def test_sweep_in_ranks(run_cli, folder):
    done = run_cli(folder, "sweep", "sweep.yaml", "--cache", "ranks", "--out", "r", "--mpi", 3)
    assert done.returncode == 3, done.stderr
    serial = read(folder / "sweep.yaml")
    summary = pd.read_csv(folder / "r" / "summary.csv")
    assert summary["status"].value_counts().to_dict() == {"done": 10, "not converged": 2}
    assert list(summary["case"]) == [c.label for c in serial.cases]


class Killer(Watcher):
    """Kills the worker of the first job at its first step."""

    killed = None

    def step(self, worker, job, step, total):
        if self.killed is None:
            self.killed = job.label
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)


def test_a_dead_worker_is_reported_and_replaced(folder, tmp_path):
    jobs = sweep.missing([read(folder / "study.yaml")], Cache(tmp_path / "cases"))
    watcher = Killer()
    with Pool(1, watcher) as pool:
        outcomes = {ended.job.label: ended for ended in pool.solve(jobs)}
    crashed = outcomes.pop(watcher.killed)
    assert (crashed.status, crashed.error) == ("crashed", "the process was ended by SIGKILL")
    assert [o.status for o in outcomes.values()] == ["done"] * 3
    left = sweep.missing([read(folder / "study.yaml")], Cache(tmp_path / "cases"))
    assert [job.label for job in left] == [watcher.killed]


def solve(plans, cache):
    with Pool(1) as pool:
        assert all(ended.status == "done" for ended in pool.solve(sweep.missing(plans, cache)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('field("S_RR", "film", min(force_N) / 0 - 1, 0.5, "push")',
         "along is a fraction from 0 to 1, not -inf"),
        ('timing("solv")', "no timing 'solv'; did you mean 'solve'?"),
        ('during(force_N, "push")', "this gives 3 numbers, not one"),
        ('1 / end(voltage_kV, "push") / 0', "'1 / end(voltage_kV, \"push\") / 0' is infinite"),
        ('log(end(force_N, "push"))', "'log(end(force_N, \"push\"))' is undefined"),
    ],
)  # fmt: skip
def test_failed_quantity_points_at_the_study(folder, text, message):
    """What only the results can tell; the others are there nevertheless."""
    cache = Cache(folder / "cases")
    solve([read(folder / "study.yaml")], cache)
    broken = folder / "broken.yaml"
    broken.write_text(STUDY.replace('-end(displacement_mm, "push")', text))
    plan = read(broken)
    results = Results(plan, cache, sweep.statuses(plan, cache, {}))
    (fault,) = results.faults
    assert f"quantities.depth: case '30 um, neo-Hookean': {message} (and 3 more)\n" in fault
    assert np.isnan(results.values["depth"]).all()
    assert np.isfinite(results.values["charge"]).all()


def test_a_damaged_case_is_solved_again(folder, tmp_path):
    """Whatever is damaged: the record, the history, the states, or numbers within a state."""
    plan, cache = read(folder / "study.yaml"), Cache(tmp_path / "cases")
    solve([plan], cache)
    whole = Results(plan, cache, sweep.statuses(plan, cache, {}))
    runs = [cache.folder / case.key for case in plan.cases]
    (runs[0] / "run.json").write_text("[]")
    (runs[1] / "history.csv").write_bytes(b"\x00\xff")
    (runs[2] / "results.h5").write_bytes((runs[2] / "results.h5").read_bytes()[:999])
    with h5py.File(runs[3] / "results.h5", "r") as file:
        at = file["states/00001"].id.get_chunk_info(0).byte_offset
    with (runs[3] / "results.h5").open("r+b") as file:
        file.seek(at + 100)
        file.write(b"damage")
    assert {s.status for s in sweep.statuses(plan, cache, {})} == {"unknown", "damaged"}
    assert len(sweep.missing([plan], cache)) == 4
    solve([plan], cache)
    again = Results(plan, cache, sweep.statuses(plan, cache, {}))
    for name, values in whole.values.items():
        np.testing.assert_array_equal(again.values[name], values)


def test_infinite_numbers_are_told_by_name_before_and_after_solving(run_cli, folder):
    for text, problem in {
        "1/0": "'1/0' is infinite",
        "0/0": "'0/0' is undefined",
        "9**9**9": "'9**9**9': an exponent is beyond 64",
    }.items():
        (folder / "inf.yaml").write_text(SWEEP.replace('end(charge_uC, "raise")', text))
        done = run_cli(folder, "study", "inf.yaml", "--cache", "swept")
        assert (done.returncode, done.stdout) == (2, "")
        assert f"inf.yaml:12:11: quantities.charge: {problem}\n" in done.stderr
    never = "at(force_N, voltage_kV, 99) + 1"  # which is no fault
    later = STUDY.replace('-end(displacement_mm, "push")', "max(1 / (step - step))")
    later = later.replace("quantities:", f"quantities:\n  never: {never}")
    (folder / "later.yaml").write_text(later)
    done = run_cli(folder, "study", "later.yaml", "--cache", "cases", "--out", "later")
    assert done.returncode == 2
    assert (
        "later.yaml:15:10: quantities.depth: case '30 um, neo-Hookean': 'max(1 / (step - step))' "
        "is infinite (and 3 more)\n" in done.stderr
    )
    assert "never" not in done.stderr
    table = pd.read_csv(folder / "later" / "tiny_study.csv")
    assert table["charge"].notna().all()
    assert table["depth"].isna().all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("y: {value: depth,", "y: {value: min(depth),", "panels.1: x has 2 values, y has 1\n"),
        ("{of(depth, \"30 um, neo-Hookean\"):.4f}", "{depth:.4f}",
         "comparison: {depth:.4f}: this gives 4 numbers, not one\n"),
    ],
)  # fmt: skip
def test_numbers_that_do_not_match_point_at_the_study(folder, old, new, message):
    assert old in STUDY
    broken, cache = folder / "mismatch.yaml", Cache(folder / "cases")
    broken.write_text(STUDY.replace(old, new))
    plan = read(broken)
    solve([plan], cache)
    results = Results(plan, cache, sweep.statuses(plan, cache, {}))
    with pytest.raises(ConfigError, match=re.escape(message)):
        _ = results.curves(1), results.comparison


@pytest.mark.parametrize(
    ("field", "region", "carriers"),
    [
        ("S_RR", "air", "bottom_electrode, film, top_electrode"),
        ("sigma_ZZ", "mount_block", "bottom_electrode, film, top_electrode"),
        ("tension", "top_electrode", "film"),
        ("wrinkling_use", "air", "film"),
        ("D_n", "air", "film"),
    ],
)
def test_a_field_that_a_region_does_not_carry_is_refused(field, region, carriers):
    config = dealib.load(ROOT / "configs" / "benchmark_strip_air.yaml").config
    with pytest.raises(ValueError, match=f"^{field} is a field of {carriers}, not of {region}$"):
        sample.check(config, field, region)
    for there in carriers.split(", "):
        sample.check(config, field, there)


def test_settings_in_points_and_windows(folder, tmp_path):
    (tmp_path / "tiny.yaml").write_text(BASE)
    text = STUDY.replace(
        "value: 1000 * thickness", 'value: 1000 * setting("geometry.film_thickness")'
    )
    assert text != STUDY
    (tmp_path / "study.yaml").write_text(text)
    plan = read(tmp_path / "study.yaml")
    cache = Cache(tmp_path / "none")
    results = Results(plan, cache, sweep.statuses(plan, cache, {}))
    assert [c.x.tolist() for c in results.curves(1)] == [[30, 60], [30, 60]]
    assert results.over('max(setting("geometry.film_thickness"))', range(4)) == 0.06


# --- the thesis ----------------------------------------------------------------------------------


def test_every_figure_has_a_study_that_validates():
    plans = {p.stem: read(p) for p in find(THESIS)}
    wanted = [4, 12, 13, 16, 19, 20, *range(23, 30), *range(31, 40)]
    assert set(plans) == {f"fig{n:02d}" for n in wanted}
    for name, plan in plans.items():
        assert plan.study.name == name
        assert plan.study.panels
        assert plan.study.windows
        assert plan.study.comparison
        assert plan.study.source.endswith(f"Fig. {int(name[3:])}")


# Windows that contradict others, see configs/thesis/identification.md; all others must hold.
CONTRADICTIONS = {
    ("fig12", "Displacement within the axis"),  # our coarsest mesh, 2.5 % stiffer
    ("fig20", "the same at 3 mm"),
    ("fig27", "mean stress through the film at its inner end"),
    ("fig27", "mean stress through the film at its outer end"),
    ("fig31", "stroke, energy, Mooney-Rivlin"),
    ("fig31", "change of the stroke to the next larger mass, energy, neo-Hookean"),  # 25 to 28 g
    ("fig31", "change of the stroke to the next larger mass, energy, Mooney-Rivlin"),
    ("fig34", "the same at 3 mm"),
    ("fig37", "change of the film's stress from device to device"),
    ("fig39", "top electrode: Charge density within the axis"),  # singular ends
    ("fig39", "bottom electrode: Charge density within the axis"),
}


@pytest.mark.slow
def test_physics_of_the_thesis(run_cli, tmp_path):
    done = run_cli(tmp_path, "study", THESIS, "-j", 2, "--out", "out")
    assert done.returncode == 0, done.stderr
    windows = pd.read_csv(tmp_path / "out" / "windows.csv")
    assert set(windows["study"]) == {p.stem for p in find(THESIS)}
    missed = windows[windows["verdict"] != "holds"]
    assert {*zip(missed["study"], missed["window"], strict=True)} == CONTRADICTIONS
    falls = "change of the stroke to the next larger mass, "
    changes = windows.set_index("window")["largest"].filter(like=falls)  # mm
    assert changes[f"{falls}thickness at rest, neo-Hookean"] < 0
    assert changes[f"{falls}thickness at rest, Mooney-Rivlin"] < 0
    assert changes[f"{falls}energy, neo-Hookean"] < 1e-3


def test_the_comparison_is_over_the_cases_that_are_solved_and_says_so():
    def status(label, reached):
        return SimpleNamespace(status=reached, case=SimpleNamespace(label=label))

    results = object.__new__(Results)
    text = 'Between {min(u):.2f} and {max(u):.2f} mm, {of(u, "a"):.1f} to {of(u, "c"):.1f}.'
    results.study = SimpleNamespace(comparison=text)
    results.statuses = (status("a", DONE), status("b", DONE), status("c", FAILED))
    results.values = {"u": np.array([-2.75, -1.25, np.nan])}
    assert results.comparison == ("Between -2.75 and -1.25 mm, -2.8 to nan. (2 of 3 cases.)")
    results.statuses = (status("a", FAILED),)
    assert results.comparison == "No case is solved."


SPACE = """\
name: plate
geometry:
  shape: laminate
  base: {kind: rectangle, length: 8 mm, width: 4 mm}
  symmetry: [X, Y]
  layers: [{name: film, thickness: 0.5 mm}, {name: cover, thickness: 0.1 mm, material: electrode}]
mesh: {columns: 4, sectors: 2, film_rows: 1}
materials:
  film: {law: neo_hookean, youngs_modulus: 1 MPa, relative_permittivity: 3.0}
  electrode: {law: neo_hookean, youngs_modulus: 1 MPa}
terminals: {top: {on: cover}, ground: {on: film.bottom, ground: true}}
holds: [{on: film.bottom, fix: Z}]
program: [{stage: rest}, {stage: actuate, terminal: {voltage: 40 kV}, steps: 4}]
"""
IN_SPACE = """\
name: plate_study
title: a plate in space
base: plate.yaml
vary: {thickness: {mesh.columns: [4]}}
panels:
  - {kind: contour, field: E, label: E (MV/m), stage: actuate, limits: [0, 100]}
  - {kind: shapes, times: [0 s, 1 s, 2 s, 1 s]}
"""


def test_panels_of_a_device_in_space_are_views(tmp_path, monkeypatch):
    from dealib.plots.render import check_rendering
    from dealib.study import panels

    try:
        check_rendering()
    except PlatformError as error:
        pytest.skip(str(error))
    (tmp_path / "plate.yaml").write_text(SPACE)
    path, cache = tmp_path / "study.yaml", Cache(tmp_path / "cases")
    path.write_text(IN_SPACE)
    plan = read(path)
    with Pool(1) as pool:
        assert all(ended.status == DONE for ended in pool.solve(sweep.missing([plan], cache)))
    results = Results(plan, cache, sweep.statuses(plan, cache, {}))
    monkeypatch.setattr(panels.plt, "close", lambda figure: None)
    panels.draw(results)
    figure = panels.plt.gcf()
    contour, shapes = (part.axes for part in figure.subfigs)
    assert [axis.get_title(loc="left") for axis in contour[:2]] == ["true scale", "cut in half"]
    assert contour[2].get_ylabel() == "E (MV/m)"
    assert contour[2].get_ylim() == (0, 100)
    titles = [axis.get_title().partition(":")[0] for axis in shapes]
    assert titles == ["0 s", "1 s", "2 s", "1 s", "", ""]
    seen = [np.asarray(axis.images[0].get_array()) for axis in shapes[:4]]
    assert not any(s[[0, -1], :, 3].any() or s[:, [0, -1], 3].any() for s in seen)  # whole
    # all from one point: under voltage the plate is wider
    width = [np.ptp(np.flatnonzero(s[..., 3].any(axis=0))) for s in seen]
    area = [(s[..., 3] > 0).sum() for s in seen]
    assert 0 < area[0] < area[1] < area[2]
    assert area[3] == pytest.approx(area[1], rel=1e-3)
    stretch = width[2] / width[0]
    assert 1.02 < stretch < 1.2  # 80 MV/m at E = 1 MPa
    monkeypatch.undo()
    panels.plt.close(figure)

    def blind():
        raise PlatformError("no picture here")

    for module in (panels.views, panels.render):
        monkeypatch.setattr(module, "check_rendering", blind)
    text, _ = panels.draw(results)
    assert text.count("no picture here") == 2


def test_studies_are_drawn_alike_by_one_process_and_by_two(tmp_path, monkeypatch):
    """A fault in a panel is told as well, whichever process met it, and the end of a process."""
    panels = "columns: 1\npanels:\n" + "".join(
        f"  - {{kind: curves, title: {title}, x: {{value: stretch, label: Stretch}}, "
        f"y: {{value: {value}, label: Stress (MPa)}}}}\n"
        for title, value in (("stress", "stress_MPa"), ("nothing", "sqrt(-stretch)"))
    )
    for name in ("one", "two"):
        material = "{law: neo_hookean, shear_modulus: 1 MPa, bulk_modulus: 50 MPa}"
        text = f"name: {name}\ntitle: {name}\n{panels}"
        text += f"material_test: {{material: {material}, stretch: [1, 2]}}\n"
        (tmp_path / f"{name}.yaml").write_text(text)
    found = {
        jobs: dealib.run_study(tmp_path, tmp_path / f"out{jobs}", jobs, cache=tmp_path / "cases")
        for jobs in (1, 2)
    }
    for name in ("one.svg", "two.svg", "one.png", "gallery.html"):
        drawn = [(tmp_path / f"out{jobs}" / name).read_bytes() for jobs in (1, 2)]
        assert drawn[0] == drawn[1]
        assert len(drawn[0]) > 2000
    for results in found.values():
        for one in results:
            (fault,) = one.faults
            assert "panels.1" in fault
            assert "is finite" in fault

    monkeypatch.setattr(studies, "_ignore_interrupt", partial(os._exit, 1))
    with pytest.raises(PlatformError, match=r"ended, perhaps since memory ran out.*jobs=1 draws"):
        dealib.run_study(tmp_path, tmp_path / "out3", 2, cache=tmp_path / "cases")
