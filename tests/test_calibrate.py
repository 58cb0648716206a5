"""Fits: the true values of synthetic data lie in the reported intervals."""

import csv
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import FITS, RELAXING, TRUE, texts

from dealib.__main__ import main
from dealib.calibration import fit as fitting
from dealib.calibration import report
from dealib.calibration.cases import Cases
from dealib.calibration.fit import run_search
from dealib.calibration.objective import Objective
from dealib.calibration.schema import FitPlan
from dealib.cases.cache import Cache
from dealib.cases.workers import Pool
from dealib.config import load
from dealib.errors import ConfigError, Interrupted, NotConverged


def call(monkeypatch, capsys, *arguments, cache=None):
    options = [] if cache is None else ["--cache", cache]
    monkeypatch.setattr(sys, "argv", ["dealib", "calibrate", *map(str, [*arguments, *options])])
    with pytest.raises(SystemExit) as stop:
        main()
    return (stop.value.code, *capsys.readouterr())


def table(path):
    with path.open() as file:
        return list(csv.reader(file))[1:]


@pytest.mark.once
def test_synthetic_data_are_what_they_say():
    for name, text in texts().items():
        assert (FITS / name).read_text() == text


@pytest.mark.once
def test_example_finds_the_true_values(tmp_path, monkeypatch, capsys):
    fit, out, cache = FITS / "example.yaml", tmp_path / "fit", tmp_path / "cases"
    code, said, _ = call(monkeypatch, capsys, fit, "--out", out, "-j", 2, cache=cache)
    assert code == 0
    rows = {key: list(map(float, row[:4])) for key, *row in table(out / "parameters.csv")}
    assert set(rows) == set(TRUE)
    for key, true in TRUE.items():
        value, error, low, high = rows[key]
        assert low < true < high
        assert low < value < high
        assert 0 < error < 0.03 * true  # the data say something
    plan = FitPlan(fit)
    correlation = np.array([list(map(float, row[1:])) for row in table(out / "correlation.csv")])
    assert np.diag(correlation) == pytest.approx(1)
    assert correlation[0, 1] < -0.9  # a stiffer film and a more stretched one are much alike
    assert "hardly tell them apart" in said
    # the best config stands there to be run
    best = load(out / "best.yaml").config
    assert best.materials["film"].prestretch[0] == rows["materials.film.prestretch"][0]
    assert best.mesh.columns == plan.fit.set["mesh.columns"]
    for name in ("report.txt", "report.md", "report.html"):
        assert "materials.film.youngs_modulus" in (out / name).read_text()
    assert (out / "report.html").read_text().count("data:image/png;base64,") == 1
    residuals = np.array([list(map(float, r)) for r in table(out / "curve_1.csv")])
    assert np.std(residuals[:, 2] - residuals[:, 1]) == pytest.approx(2e-3, rel=0.5)  # the noise

    # again: refused, then from the cases solved before
    before = (out / "parameters.csv").read_text()
    code, _, err = call(monkeypatch, capsys, fit, "--out", out)
    assert code == 2
    assert err == (
        f"dealib: {out} exists and is not empty; --resume it, --overwrite it, or choose another "
        "--out\n"
    )
    for more in ("--resume", "--overwrite"):
        code, said, _ = call(monkeypatch, capsys, fit, "--out", out, more, "-j", 1, cache=cache)
        assert code == 0
        assert re.search(r"(?<!\d)0 cases solved\.", said)
        assert (out / "parameters.csv").read_text() == before
    # one of them damaged: it is solved again
    case = next(path for path in cache.iterdir() if path.is_dir())
    (case / "results.h5").write_bytes(b"no results")
    code, said, _ = call(monkeypatch, capsys, fit, "--out", out, "--resume", "-j", 1, cache=cache)
    assert code == 0
    assert re.search(r"(?<!\d)1 cases solved\.", said)
    assert (out / "parameters.csv").read_text() == before


@pytest.mark.once
def test_derivatives_come_from_the_run_itself(tmp_path, monkeypatch):
    """They are those of differences of whole runs, which take a case a parameter more."""
    text = (FITS / "example.yaml").read_text().replace("../", f"{FITS.parent}/")
    text = re.sub(r"file: (synthetic_\w+)", rf"file: {FITS}/\1", text)
    text = text.replace("set: ", "set:\n  solver.predictor_order: 0\n  solver.tolerance: 1e-12 #")
    path = tmp_path / "fit.yaml"
    path.write_text(text.replace("method:", "method:\n  difference: 1e-4"))
    found, solved = [], []
    monkeypatch.setattr(fitting, "search", lambda task, progress: search_once(task, found))
    for told in (True, False):
        if not told:
            monkeypatch.setattr(fitting, "known", lambda config: False)
        with Pool(1) as pool:
            cases = Cases(Cache(tmp_path / f"cases{told}"), pool)
            with pytest.raises(Interrupted):
                run_search(FitPlan(path), cases, lambda line: None)
        solved.append(cases.solved)
    assert solved == [1, 1 + len(TRUE)]  # both curves are of one case
    for slope, difference in zip(*(J.T for J in found), strict=True):
        assert np.abs(slope - difference).max() < 2e-4 * np.abs(slope).max()


def search_once(task, found):
    objective = Objective(task, lambda line: None)
    found.append(objective.jacobian(objective.numbers(objective.parameters())))
    raise Interrupted("enough", 2)


@pytest.mark.slow
def test_branches_are_found_from_a_relaxation_curve(tmp_path, monkeypatch, capsys):
    out = tmp_path / "fit"
    given = (FITS / "relaxation.yaml", "--out", out, "-j", 2)
    code, _, _ = call(monkeypatch, capsys, *given, cache=tmp_path / "cases")
    assert code == 0
    rows = {key: list(map(float, row[:4])) for key, *row in table(out / "parameters.csv")}
    for key, true in RELAXING.items():
        value, error, low, high = rows[key]
        scale = 1e3 if "shear" in key else 1.0  # kPa
        assert low < scale * true < high
        assert 0 < error < 0.05 * value


# --- the fit itself, on a model in closed form ---------------------------------------------------

FIT = """\
name: line
base: base.yaml
parameters:
  materials.film.youngs_modulus: {start: 1 MPa, min: 100 kPa, max: 10 MPa}
  materials.film.relative_permittivity: {start: 2, min: 1, max: 9}
data:
  - file: data.csv
    sigma: {force: 10 mN}
"""


class Lines:
    """Stands for the solver: F = E u + eps u^2, and no convergence above E = 5 MPa."""

    solved = 0

    def histories(self, cases, spectra):
        found = []
        for case in cases:
            film = case.config.materials["film"]
            modulus = 2 * (1 + 0.5) * film.shear_modulus
            self.solved += 1
            if modulus > 5:
                found.append(NotConverged("pull-in"))
                continue
            u = np.linspace(0, 1, 101)
            F = modulus * u + film.relative_permittivity * u**2
            stage = np.array(["push"] * len(u))
            found.append({"displacement_mm": u, "force_N": F, "time_s": u, "stage": stage})
        return found

    def slopes(self, case, wanted):
        return {}


def line_fit(folder, noise_seed=None, text=FIT, modulus=2.0, permittivity=3.0):
    base = (FITS.parent / "membrane.yaml").read_text()
    base = base.replace("shear_modulus: 1 MPa\n    bulk_modulus: 1000 MPa", "youngs_modulus: 1 MPa")
    (folder / "base.yaml").write_text(base)
    (folder / "fit.yaml").write_text(text)
    u = np.linspace(0.05, 1, 20)
    F = modulus * u + permittivity * u**2
    if noise_seed is not None:
        F = F + np.random.default_rng(noise_seed).normal(0, 0.01, len(u))
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), F.tolist(), strict=True))
    (folder / "data.csv").write_text("displacement [mm],force [N]\n" + rows)
    return FitPlan(folder / "fit.yaml")


def fit(plan):
    return run_search(plan, Lines(), lambda line: None)


def search(plan):
    return fit(plan).found


def test_exact_data_give_the_exact_values(tmp_path):
    fitted = search(line_fit(tmp_path))
    assert [e.value for e in fitted.estimates] == pytest.approx([2, 3], rel=1e-6)
    assert [e.unit for e in fitted.estimates] == ["MPa", ""]
    assert fitted.points == 20


@pytest.mark.once
def test_intervals_hold_as_often_as_they_say(tmp_path):
    """Linear least squares: 95 % intervals contain the truth in about 95 of 100 fits."""
    inside = [
        e.low < true < e.high
        for seed in range(20)
        for e, true in zip(search(line_fit(tmp_path, seed)).estimates, (2, 3), strict=True)
    ]
    assert len(inside) == 40
    assert np.mean(inside) >= 0.85


def test_errors_are_those_of_linear_least_squares(tmp_path):
    fitted = search(line_fit(tmp_path, 1))
    u = np.linspace(0.05, 1, 20)
    A = np.column_stack([u, u**2])
    covariance = np.linalg.inv(A.T @ A) * 0.01**2 * fitted.reduced_chi2
    errors = np.sqrt(np.diag(covariance))
    assert [e.error for e in fitted.estimates] == pytest.approx(errors.tolist(), rel=1e-3)
    expected = covariance[0, 1] / errors.prod()
    assert fitted.correlation[0, 1] == pytest.approx(expected, abs=1e-3)


def test_profile_agrees_with_covariance_where_the_model_is_linear(tmp_path):
    plain = search(line_fit(tmp_path, 1))
    profile = search(line_fit(tmp_path, 1, FIT + "method: {intervals: profile}\n"))
    for a, b in zip(plain.estimates, profile.estimates, strict=True):
        assert (b.low, b.high) == pytest.approx((a.low, a.high), rel=1e-3)


def test_bounds_are_kept_and_told(tmp_path):
    fitted = fit(line_fit(tmp_path, text=FIT.replace("max: 9", "max: 2.5")))
    assert 2.49 < fitted.found.estimates[1].value <= 2.5
    assert report.headline(fitted) == (
        "NO SUCCESS: At its bound (widen it, or take the parameter out): "
        "materials.film.relative_permittivity."
    )


def test_no_success_is_an_exit_code(tmp_path):
    from dealib.cli.calibrate import tell

    plan = line_fit(tmp_path, text=FIT.replace("max: 9", "max: 2.5"))
    fitted = replace(fit(plan), directory=tmp_path)
    report.write_report(fitted, tmp_path)
    with pytest.raises(NotConverged, match="line: the fit failed: At its bound") as error:
        tell(fitted)
    assert error.value.exit_code == 3
    assert "NO SUCCESS" in (tmp_path / "report.txt").read_text().splitlines()[0]
    assert "NO SUCCESS" in (tmp_path / "report.md").read_text()


def changed(folder, x=lambda u: u, y=lambda F: F, header="displacement [mm],force [N]"):
    """The plan of `line_fit` with data that were changed."""
    plan = line_fit(folder)
    u = np.linspace(0.05, 1, 20)
    rows = zip(x(u).tolist(), y(2 * u + 3 * u**2).tolist(), strict=True)
    (folder / "data.csv").write_text(header + "\n" + "".join(f"{a},{b}\n" for a, b in rows))
    return plan


@pytest.mark.parametrize(
    ("x", "y", "hint"),
    [
        (lambda u: -u, lambda F: F, "spans -1 .. -0.05 mm, the run's 0 .. 1 mm; with prepare: "
         "{displacement: {sign: -1}} 100% would lie inside"),
        (lambda u: -u, lambda F: -F, "spans -1 .. -0.05 mm, the run's 0 .. 1 mm; with prepare: "
         "{displacement: {sign: -1}} 100% would lie inside, and force then has the opposite sign "
         "too"),
        (lambda u: u + 6, lambda F: F, "spans 6.05 .. 7 mm, the run's 0 .. 1 mm; with "
         "prepare: {displacement: {zero: start}} 100% would lie inside"),
        (lambda u: 1e3 * u, lambda F: F, "spans 50 .. 1000 mm, the run's 0 .. 1 mm; with "
         "prepare: {displacement: {factor: 1e-3}} 100% would lie inside"),
        (lambda u: 40 * u - 25, lambda F: F, "spans -23 .. 15 mm, the run's 0 .. 1 mm"),
    ],
)  # fmt: skip
def test_data_mostly_outside_are_refused_with_a_hint(tmp_path, x, y, hint):
    with pytest.raises(ConfigError) as error:
        fit(changed(tmp_path, x, y))
    share = "5%" if "-23" in hint else "0%"
    said = f"{tmp_path / 'data.csv'}: {share} of the points lie inside the run: displacement {hint}"
    assert str(error.value) == said


def test_a_mirrored_force_is_no_success(tmp_path):
    fitted = fit(changed(tmp_path, y=lambda F: -F))
    said = report.failures(fitted.found)
    assert said[-1].startswith("data.csv, force_N: R2 is -")
    assert said[-1].endswith(", worse than a constant, and the sign looks mirrored.")


def test_time_is_no_curve_beside_another_abscissa(tmp_path):
    plan = line_fit(tmp_path, text=FIT.replace("    sigma", "    x: displacement\n    sigma"))
    rows = [line.split(",") for line in (tmp_path / "data.csv").read_text().splitlines()[1:]]
    (tmp_path / "data.csv").write_text(
        "time [s],displacement [mm],force [N]\n"
        + "".join(f"{i},{u},{F}\n" for i, (u, F) in enumerate(rows))
    )
    found = fit(plan).found
    assert [c.y_name for c in found.comparisons[0]] == ["force_N"]
    assert [e.value for e in found.estimates] == pytest.approx([2, 3], rel=1e-6)


@pytest.mark.once
def test_intervals_hold_with_noise_in_both_columns(tmp_path):
    """Orthogonal distances: 60 intervals of 95 %; with an exact abscissa they would be biased."""
    text = FIT.replace("{force: 10 mN}", "{force: 10 mN, displacement: 20 um}")
    plan = line_fit(tmp_path, text=text)
    hits, scales = [], []
    for seed in range(30):
        random = np.random.default_rng(seed)
        u = np.linspace(0.05, 0.95, 40)
        x, y = u + random.normal(0, 0.02, 40), 2 * u + 3 * u**2 + random.normal(0, 0.01, 40)
        rows = "".join(f"{a},{b}\n" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        (tmp_path / "data.csv").write_text("displacement [mm],force [N]\n" + rows)
        found = search(plan)
        hits += [e.low < true < e.high for e, true in zip(found.estimates, (2, 3), strict=True)]
        scales.append(found.noise[0][0].scale)
    assert np.mean(hits) >= 0.88
    assert np.mean(scales) == pytest.approx(1, abs=0.05)  # the noise is what it is said to be


def test_points_that_the_run_does_not_reach_are_told(tmp_path):
    plan = line_fit(tmp_path)
    (tmp_path / "data.csv").write_text(
        "displacement [mm],force [N]\n0.5,1.75\n1,5\n1.5,8.98\n2,12.96\n"
    )
    told = report.remarks(fit(plan))
    assert "data.csv, force_N: the run does not reach 2 of 4 points" in " ".join(told)
    assert not any("does not reach" in r for r in report.remarks(fit(line_fit(tmp_path))))


def test_cases_that_do_not_converge_are_stepped_around(tmp_path):
    start = FIT.replace("start: 1 MPa", "start: 4.9 MPa")
    fitted = search(line_fit(tmp_path, text=start))
    assert fitted.estimates[0].value == pytest.approx(2, rel=1e-4)
    with pytest.raises(NotConverged, match="the case at the start does not converge: pull-in"):
        search(line_fit(tmp_path, text=FIT.replace("start: 1 MPa", "start: 6 MPa")))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("base: base.yaml", "base: none.yaml", "2:7: base: there is no file TMP/none.yaml"),
        ("file: data.csv", "file: none.csv", "7:11: data.0.file: there is no file TMP/none.csv"),
        ("min: 100 kPa", "min: 100 kV",
         "4:54: parameters.materials.film.youngs_modulus.min: expected a unit such as 'MPa'; 'kV' "
         "is not a unit of that kind"),
        ("start: 1 MPa", "start: 1.5 N",
         "4:42: parameters.materials.film.youngs_modulus.start: expected a unit such as 'kPa'; 'N' "
         "is not a unit of that kind"),
        ("start: 1 MPa", "start: 1.5",
         "4:42: parameters.materials.film.youngs_modulus.start: expected a unit such as 'kPa'; "
         "'1.5' has no unit"),
        ("min: 100 kPa", "min: 0.1",
         "4:54: parameters.materials.film.youngs_modulus.min: expected a unit such as 'MPa'; '0.1' "
         "has no unit"),
        ("max: 10 MPa", "max: 10",
         "4:68: parameters.materials.film.youngs_modulus.max: expected a unit such as 'kPa'; '10' "
         "has no unit"),
        ("max: 9", "max: 9 MPa",
         "5:65: parameters.materials.film.relative_permittivity.max: expected a plain number; "
         "'9 MPa' has a unit"),
        ("start: 2,", "start: 12,",
         "5:49: parameters.materials.film.relative_permittivity.start: the start must lie between "
         "min and max"),
        ("start: 2,", "start: two,",
         "5:49: parameters.materials.film.relative_permittivity.start: expected a number, with its "
         "unit if it has one, not 'two'"),
        ("start: 2, ", "",
         "5:3: parameters.materials.film.relative_permittivity.start: this key is missing: where "
         "the search starts, such as '1 MPa'"),
        ("film.relative", "film.relativ",
         "5:3: parameters.materials.film.relativ_permittivity: in TMP/base.yaml, set "
         "materials.film.relativ_permittivity=2.0: unknown key; did you mean "
         "'relative_permittivity'?"),
        ("materials.film.relative_permittivity: {start: 2,", "mesh.columns: {start: 8,",
         "5:3: parameters.mesh.columns: in TMP/base.yaml, set mesh.columns=8.008: expected a "
         "whole number, not 8.008"),
        ("    sigma", "    stage: pull\n    sigma",
         "8:12: data.0.stage: the program has no such stage; it has prestrain, push, actuate"),
        ("    sigma", "    stages: pull\n    sigma",
         "8:5: data.0.stages: unknown key; did you mean 'stage'?"),
        ("    sigma", "    columns: {displacement: F, force: F}\n    sigma",
         "8:39: data.0.columns.force: 'F' is displacement already; a column is one quantity"),
        ("name: line", "name: a b",
         "1:7: name: use letters, digits, '_', '-', '.' and '+' only"),
    ],
)  # fmt: skip
def test_bad_fit(tmp_path, old, new, expected):
    assert old in FIT
    with pytest.raises(ConfigError) as error:
        line_fit(tmp_path, text=FIT.replace(old, new, 1))
    said = str(error.value).splitlines()[0]
    assert said == f"{tmp_path / 'fit.yaml'}:{expected.replace('TMP', str(tmp_path))}"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("{force: 10 mN}", "{force: 10 mm}",
         "8:20: data.0.sigma.force: expected a unit such as 'N'; 'mm' is not a unit of that kind"),
        ("{force: 10 mN}", "{force: 10}",
         "8:20: data.0.sigma.force: expected a unit such as 'N'; '10' has no unit"),
        ("{force: 10 mN}", "{force: 0 mN}", "8:20: data.0.sigma.force: must be above 0"),
        ("{force: 10 mN}", "{farce: 1 N}",
         "8:13: data.0.sigma.farce: no curve of this file; it has displacement, force"),
    ],
)  # fmt: skip
def test_bad_sigma(tmp_path, old, new, expected):
    plan = line_fit(tmp_path, text=FIT.replace(old, new, 1))
    with pytest.raises(ConfigError) as error:
        search(plan)
    assert str(error.value).splitlines()[0] == f"{Path(tmp_path) / 'fit.yaml'}:{expected}"


def test_data_are_prepared_and_their_reading_is_told(tmp_path):
    """Counted the other way round, from another zero, with a cell that is missing."""
    keys = """
    x: displacement
    columns: {displacement: "Weg [um]", force: "Kraft [mN]"}
    prepare: {displacement: {sign: -1, offset: 50 um}, force: {sign: -1, offset: -7 mN}}
    sigma"""
    plan = line_fit(tmp_path, text=FIT.replace("\n    sigma", keys))
    u = np.linspace(0.05, 1, 20)
    force = 2 * u + 3 * u**2
    rows = "".join(
        f"{i};{50 - 1e3 * a:.6f};{-7 - 1e3 * F:.6f}\n"
        for i, (a, F) in enumerate(zip(u, force, strict=True))
    )
    data = "Nr;Weg;Kraft\n;um;mN\n" + rows.replace(".", ",") + "20;1,0;\n"
    (tmp_path / "data.csv").write_text(data, encoding="utf-16")
    told = []
    fitted = run_search(plan, Lines(), told.append)
    assert told[0].startswith("data.csv: UTF-16; columns separated by ';'; decimal mark ','; ")
    assert told[0].endswith("; force_N plus -7 mN; 1 row without a point left out")
    (curve,) = fitted.found.comparisons[0]
    assert len(curve.measured) == 20
    assert [e.value for e in fitted.found.estimates] == pytest.approx([2, 3], rel=1e-4)


def test_foreign_directory_is_left_alone(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("precious")
    for option in ("--resume", "--overwrite"):
        code, _, err = call(monkeypatch, capsys, FITS / "example.yaml", "--out", out, option)
        assert (code, err) == (
            2, f"dealib: {out} is not the directory of a fit; it is left unchanged\n",
        )  # fmt: skip
    assert [p.name for p in out.iterdir()] == ["mine.txt"]


def test_resume_and_overwrite_exclude_each_other(tmp_path, monkeypatch, capsys):
    given = (FITS / "example.yaml", "--out", tmp_path, "--resume", "--overwrite")
    code, _, err = call(monkeypatch, capsys, *given)
    assert (code, err) == (2, "dealib: --overwrite and --resume exclude each other\n")
