"""Coupon fits: laws, branches and softening from tests of specimens."""

import csv
import itertools
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from scipy.integrate import solve_ivp, trapezoid
from synthetic_coupons import FITS, texts

import dealib
from dealib.__main__ import main
from dealib.calibration.candidates import Candidate
from dealib.calibration.coupon_data import CouponPlan, polyline, turns
from dealib.calibration.coupon_fit import run_coupon
from dealib.calibration.report import failures, headline
from dealib.calibration.starts import starts
from dealib.config import Config
from dealib.config.library import add, read_library
from dealib.errors import ConfigError
from dealib.materials import LAWS, coupon
from dealib.materials.functions import erf
from dealib.materials.response import response, stability_limit
from dealib.materials.softening import softening, withheld


def call(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["dealib", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    return (stop.value.code, *capsys.readouterr())


def quiet(line):
    pass


def fit(path):
    return run_coupon(CouponPlan(path), quiet)


def write(path, x, y, head="stretch,stress [MPa]"):
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    path.write_text(f"{head}\n{rows}")


# --- the material in homogeneous tests -----------------------------------------------------------


@pytest.mark.parametrize("mode", coupon.MODES)
@pytest.mark.parametrize("name", LAWS)
def test_incompressible_stress_is_the_limit_of_the_compressible_one(name, mode):
    given = LAWS[name].example()
    del given["youngs_modulus"]
    law = LAWS[name].model_validate({"law": name, "youngs_modulus": "1 MPa", **given})
    stiff = law.model_copy(update={"bulk_modulus": 1e6})
    stretch = np.array([0.8, 1.0, 1.3])
    _, found = coupon.energy(type(law), law.values, mode, stretch)
    assert found == pytest.approx(response(stiff, mode, stretch)[0], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("evolution", ["multiplicative", "network"])
def test_branches_follow_their_differential_equation(evolution):
    """Loading and unloading at 0.5 1/s against scipy, C_i = diag(a^2, 1/a, 1/a) or its inverse."""
    tau, G = 0.7, 0.4

    def stretch(t):
        return 1 + 0.5 * t if t < 2 else 2 - 0.5 * (t - 2)

    def rate(t, inner):
        a, b = inner  # of C_i, or of its inverse
        c, d = stretch(t) ** 2, 1 / stretch(t)
        if evolution == "network":
            return [(1 / c - a) / tau, (1 / d - b) / tau]
        l = (c / a + 2 * d / b) / 3
        return [(c - l * a) / tau, (d - l * b) / tau]

    law = SimpleNamespace(shear_modulus=0.0, bulk_modulus=0.0)
    material = coupon.IncompressibleMaterial(LAWS["neo_hookean"], law, evolution, ((G, tau),))
    for step, tolerance in ((0.02, 5e-4), (0.005, 5e-4 / 16)):  # of second order
        times, stretches, corners = coupon.refined([0, 2, 3.5], [1, 2, 1.25], step)
        assert stretches[corners].tolist() == [1, 2, 1.25]
        (found,) = coupon.stresses(coupon.Path("uniaxial", times, stretches), [material])
        exact = solve_ivp(rate, (0, 3.5), [1, 1], t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.02)
        a, b = exact.y if evolution == "network" else 1 / exact.y
        expected = G * (stretches * a - b / stretches**2)
        assert found == pytest.approx(expected, abs=tolerance * expected.max())


def test_without_time_branches_are_relaxed():
    path = coupon.Path("uniaxial", *coupon.refined([0, np.inf], [1, 2])[:2])
    law = SimpleNamespace(shear_modulus=1.0, bulk_modulus=0.0)
    for evolution in ("multiplicative", "network"):
        bare = coupon.IncompressibleMaterial(LAWS["neo_hookean"], law)
        with_branch = coupon.IncompressibleMaterial(
            LAWS["neo_hookean"], law, evolution, ((1.0, 5.0),)
        )
        a, b = (coupon.stresses(path, [m])[0] for m in (bare, with_branch))
        assert a == pytest.approx(path.stretch - path.stretch**-2)
        assert b == pytest.approx(a, abs=1e-9)


SOFT = SimpleNamespace(r=2.0, m=0.2)


def test_softening_dissipates_the_area_between_loading_and_unloading():
    law = SimpleNamespace(shear_modulus=0.6, bulk_modulus=0.0)
    times, stretch, corners = coupon.refined([0, 1, 2, 3], [1, 2.5, 1, 2.5], 1e-3)
    path = coupon.Path("uniaxial", times, stretch)
    (P,) = coupon.stresses(
        path, [coupon.IncompressibleMaterial(LAWS["neo_hookean"], law, mullins=SOFT)]
    )
    up, down, again = (slice(a, b + 1) for a, b in itertools.pairwise(corners))
    area = trapezoid(P[up], stretch[up]) + trapezoid(P[down], stretch[down])
    W = float(coupon.energy(LAWS["neo_hookean"], law, "uniaxial", np.array([2.5]))[0][0])
    assert pytest.approx(0.3 * (2.5**2 + 2 / 2.5 - 3)) == W
    assert withheld(W, W, SOFT) == pytest.approx(area, rel=1e-4)
    # reloading takes the way of unloading, and from its end on the first one
    assert P[again] == pytest.approx(P[down][::-1])
    assert P[up] == pytest.approx(0.6 * (stretch[up] - stretch[up] ** -2))


def test_softening_of_forms_is_that_of_numbers():
    expression = softening(ufl.as_ufl(0.3), ufl.as_ufl(0.5), SOFT)
    assert float(expression) == pytest.approx(softening(0.3, 0.5, SOFT))
    assert softening(0.5, 0.5, SOFT) == 1
    assert erf(0.5) == pytest.approx(0.5204998778)


def test_permanent_set_stays_and_does_not_grow_again():
    law = SimpleNamespace(shear_modulus=0.5, bulk_modulus=0.0)
    material = coupon.IncompressibleMaterial(
        LAWS["neo_hookean"], law, set=SimpleNamespace(shear_modulus=0.3, energy=0.2)
    )
    times, stretch, corners = coupon.refined([0, 1, 2, 3, 4], [1, 2, 1, 2, 1], coupon.FINE)
    (P,) = coupon.stresses(coupon.Path("uniaxial", times, stretch), [material])
    down, again, last = (slice(a, b + 1) for a, b in itertools.pairwise(corners[1:]))
    free = np.interp(0.0, P[down][::-1], stretch[down][::-1])
    assert 1.05 < free < 1.4  # where it is left
    assert P[last] == pytest.approx(P[down], abs=1e-12)
    assert P[again] == pytest.approx(P[down][::-1], abs=1e-12)
    # at rest again, both networks are in balance: G (l - l^-2) + G_2 (A l - B l^-2) = 0
    assert P[corners[0]] == 0


# --- data ----------------------------------------------------------------------------------------


def test_turns_of_noisy_data():
    t = np.linspace(0, 4, 121)
    exact = np.interp(t, [0, 1, 2, 3, 4], [1, 1.5, 1, 2, 1.2])
    corners, rows = turns(exact)
    assert corners == pytest.approx([1, 1.5, 1, 2, 1.2])
    assert rows == [0, 31, 61, 91]
    noisy = exact + np.random.default_rng(1).normal(0, 0.004, len(t))
    corners, rows = turns(noisy, 0.004)
    assert corners[:-1] == pytest.approx([1, 1.5, 1, 2], abs=0.01)
    assert rows[1:] == pytest.approx([31, 61, 91], abs=1)
    # two rows that are alike on both sides of a turn
    exact = np.interp(np.arange(60), [0, 29.5, 59], [1, 2, 1])
    assert turns(exact)[1] == [0, 30]


def test_path_of_a_file_with_time():
    t = np.linspace(0, 10, 400)
    y = np.interp(t, [0, 2, 7, 10], [1, 2, 2, 1.3])
    noisy = y + np.random.default_rng(1).normal(0, 0.003, len(t))
    times, values = polyline(t, noisy, 0.003)
    assert len(times) < 20
    assert np.interp(t, times, values) == pytest.approx(y, abs=0.006)
    times, values = polyline(t, y, 0.0)
    assert np.interp(t, times, values) == pytest.approx(y, abs=1e-3)


GENT = SimpleNamespace(shear_modulus=0.3, j_lim=20.0, bulk_modulus=0.0)


def coupon_file(folder, text, **columns):
    """A coupon file beside uniaxial data of a Gent law."""
    stretch = np.linspace(1, 3, 30)
    stress = coupon.energy(LAWS["gent"], GENT, "uniaxial", stretch)[1]
    write(folder / "data.csv", stretch, stress)
    write(folder / "force.csv", 100 * (stretch - 1), 20 * stress, "strain [%],force [N]")
    write(folder / "true.csv", 50 * (stretch - 1), 1e3 * stress * stretch,
          "displacement [mm],true stress [kPa]")  # fmt: skip
    (folder / "coupon.yaml").write_text(text)
    return folder / "coupon.yaml"


ONE = "name: one\ntests:\n  - {file: data.csv}\nmaterial: {laws: [gent]}\n"


def test_all_kinds_of_columns_give_one_material(tmp_path):
    text = ONE.replace(
        "  - {file: data.csv}\n",
        "  - {file: data.csv}\n"
        "  - {file: force.csv, specimen: {width: 10 mm, thickness: 2 mm}}\n"
        "  - {file: true.csv, specimen: {length: 5 cm}}\n",
    )
    fitted = fit(coupon_file(tmp_path, text))
    assert fitted.found.values == pytest.approx({"j_lim": 20, "shear_modulus": 0.3}, rel=2e-3)
    assert fitted.found.points == 90
    assert headline(fitted) == "the fit succeeded"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("data.csv", "none.csv", "3:12: tests.0.file: there is no file TMP/none.csv"),
        ("data.csv", "force.csv", "3:5: tests.0.specimen.width: this key is missing; force.csv "
         "needs it"),
        ("{file: data.csv}", "{file: data.csv, mode: biaxial}", "3:28: tests.0.mode: 'biaxial' is "
         "not allowed; one of uniaxial, equal-biaxial, pure shear"),
        ("{file: data.csv}", "{file: data.csv, relaxation: {stretch: 2, ramp: 1 s}}",
         "3:34: tests.0.relaxation: data.csv has no column of time"),
        ("{file: data.csv}", "{file: data.csv, rate: 1 Hz, relaxation: {stretch: 2, ramp: 1 s}}",
         "3:28: tests.0.rate: a relaxation has its own ramp; drop rate"),
        ("{file: data.csv}", "{file: data.csv, rate: 0.1}",
         "3:28: tests.0.rate: expected a rate with its unit, such as '0.01 1/s'; '0.1' has no "
         "unit"),
        ("{file: data.csv}", "{file: data.csv, path: [1, 0.5]}",
         "3:28: tests.0.path: data.csv turns more often than this: [1, 3]"),
        ("{file: data.csv}", "{file: data.csv, sigma: {force: 1 N}}",
         "3:30: tests.0.sigma.force: no column of data.csv; it has stretch, stress"),
        ("{file: data.csv}", "{file: data.csv, sigma: {stress: 1 mm}}",
         "3:38: tests.0.sigma.stress: expected a unit such as 'MPa'; 'mm' is not a unit of that "
         "kind"),
        ("[gent]", "[gentt]", "4:19: material.laws.0: unknown law 'gentt'; did you mean 'gent'?"),
        ("laws: [gent]", "branches: 9", "4:22: material.branches: expected numbers from 0 to 6"),
    ],
)  # fmt: skip
def test_bad_coupon_files_are_explained(tmp_path, old, new, expected):
    assert old in ONE
    path = coupon_file(tmp_path, ONE.replace(old, new))
    with pytest.raises(ConfigError) as error:
        CouponPlan(path)
    said = str(error.value).splitlines()[0]
    assert said == f"{path}:{expected.replace('TMP', str(tmp_path))}"


def test_data_that_begin_while_held_ask_for_a_relaxation(tmp_path):
    path = coupon_file(tmp_path, ONE.replace("data.csv", "held.csv"))
    rows = "".join(f"{t},2,{1 / t}\n" for t in range(1, 20))
    (tmp_path / "held.csv").write_text("time [s],stretch,stress [MPa]\n" + rows)
    with pytest.raises(ConfigError, match=r"held\.csv starts at the stretch 2: give relaxation"):
        CouponPlan(path)


# --- fits ----------------------------------------------------------------------------------------


def test_synthetic_tests_are_what_they_say():
    for name, text in texts().items():
        assert (FITS / name).read_text() == text


def estimates(folder):
    with (folder / "parameters.csv").open() as file:
        rows = list(csv.reader(file))[1:]
    return {key: list(map(float, numbers[:4])) for key, *numbers in rows}


def assert_inside(found, true, width):
    """Truths lie in the intervals, and these say something."""
    assert set(found) == set(true)
    for key, value in true.items():
        _, error, low, high = found[key]
        assert low < value < high, key
        assert 0 < error < width * abs(value), key


@pytest.mark.once
def test_example_finds_law_and_values(tmp_path, monkeypatch, capsys):
    for file in FITS.glob("*"):
        shutil.copy(file, tmp_path)
    text = (tmp_path / "coupon.yaml").read_text()
    text = text.replace("# output: {library: my_materials.yaml}", "output: {library: mine.yaml}")
    (tmp_path / "coupon.yaml").write_text(text)
    (tmp_path / "mine.yaml").write_text(
        "# mine\nsoft:\n  values: {law: neo_hookean, youngs_modulus: 1 MPa}  # kept\n"
    )
    out = tmp_path / "out"
    code, said, _ = call(monkeypatch, capsys, "calibrate", tmp_path / "coupon.yaml", "--out", out)
    assert code == 0
    assert "\ncoupon: the fit succeeded\n" in said
    assert "gent is the best of 7 candidates by AICc." in said
    assert_inside(estimates(out), {"shear_modulus": 0.25, "j_lim": 14.0}, 0.01)
    assert (out / "report.html").read_text().count("data:image/png;base64,") == 1
    # the result is a section of a config ...
    config = tmp_path / "device.yaml"
    config.write_text((FITS.parent / "membrane.yaml").read_text())
    shown = (out / "material.yaml").read_text()
    loaded = dealib.load(config, set={"materials.film": shown.split("film:")[1]}).config
    film = loaded.materials["film"]
    assert (film.law, film.relative_permittivity) == ("gent", 2.8)
    assert film.values.shear_modulus == pytest.approx(0.25, rel=0.01)
    assert film.values.bulk_modulus == pytest.approx(1e3 * film.values.shear_modulus, rel=1e-4)
    # ... and of the library, beside what is there
    assert (tmp_path / "mine.yaml").read_text().startswith("# mine\nsoft:")
    assert "# kept" in (tmp_path / "mine.yaml").read_text()
    config.write_text("library: mine.yaml\n" + config.read_text())
    named = dealib.load(config, set={"materials.film": "{library: coupon, prestretch: 1.2}"}).config
    assert named.materials["film"].values == film.values
    # a second time it is neither overwritten nor forgotten
    again = ("calibrate", tmp_path / "coupon.yaml", "--out", tmp_path / "other")
    code, _, err = call(monkeypatch, capsys, *again)
    assert code == 2
    assert err == (
        f"dealib: {tmp_path / 'mine.yaml'} has a material 'coupon'; --overwrite it, or give "
        "output.material\n"
    )
    assert not (tmp_path / "other").exists()


@pytest.mark.once
def test_rates_find_branches_and_their_number():
    fitted = fit(FITS / "coupon_rates.yaml")
    assert "neo_hookean, 2 branches is the best of 5 candidates by AICc." in fitted.notes
    true = {
        "shear_modulus": 15.0,  # kPa
        "branches.0.shear_modulus": 25.0,
        "branches.0.relaxation_time": 2.0,
        "branches.1.shear_modulus": 12.0,
        "branches.1.relaxation_time": 40.0,
    }
    found = {e.key: (e.value, e.error, e.low, e.high) for e in fitted.found.estimates}
    assert_inside(found, true, 0.03)
    assert all(c.r2 > 0.998 for (c,) in fitted.found.comparisons)


@pytest.mark.once
def test_cycles_find_softening_and_set(tmp_path):
    fitted = fit(FITS / "coupon_cycles.yaml")
    assert "yeoh, mullins, permanent set is the best of 5 candidates by AICc." in fitted.notes
    true = {
        "c10": 0.2,
        "c20": -0.015,
        "c30": 0.004,
        "mullins.r": 1.8,
        "mullins.m": 0.12,
        "permanent_set.shear_modulus": 0.08,
        "permanent_set.energy": 0.2,
    }
    found = {e.key: (e.value, e.error, e.low, e.high) for e in fitted.found.estimates}
    assert_inside(found, true, 0.05)
    config = dealib.load(FITS.parent / "softening.yaml").config.model_dump(mode="json")
    config["materials"]["film"] = fitted.material["values"] | {"relative_permittivity": 2.8}
    film = Config.model_validate(config).materials["film"]  # a device takes it
    assert film.mullins.m == pytest.approx(0.12, rel=0.05)
    assert film.permanent_set.shear_modulus == pytest.approx(0.08, rel=0.05)
    assert "mullins:" in fitted.files["material.yaml"]


def gent_trial(folder, seed, noise=0.005):
    """Three tests of a Gent law with noise in stretch and stress, fitted."""
    random = np.random.default_rng(seed)
    lines = ["name: trial", "tests:"]
    for mode, largest in (("uniaxial", 3.0), ("pure shear", 2.5), ("equal-biaxial", 2.0)):
        stretch = np.linspace(1, largest, 30)
        stress = coupon.energy(LAWS["gent"], GENT, mode, stretch)[1]
        x, y = stretch + random.normal(0, noise, 30), stress + random.normal(0, noise, 30)
        write(folder / f"{mode}.csv", x, y)
        sigma = f"{{stress: {noise} MPa, stretch: {noise}}}"
        lines.append(f"  - {{file: {mode}.csv, mode: {mode}, sigma: {sigma}}}")
    (folder / "trial.yaml").write_text("\n".join([*lines, "material: {laws: [gent]}\n"]))
    return fit(folder / "trial.yaml").found


@pytest.mark.once
@pytest.mark.slow
def test_truth_lies_in_the_intervals_in_95_of_100_trials_with_noise_in_x_and_y(tmp_path):
    """Two parameters, 100 trials: 190 of 200 expected, with a standard deviation of 3."""
    hits = []
    for seed in range(100):
        found = {e.key: e for e in gent_trial(tmp_path, seed).estimates}
        true = {"shear_modulus": 0.3, "j_lim": 20.0}
        hits += [found[key].low < value < found[key].high for key, value in true.items()]
    assert 184 <= sum(hits) <= 198


def test_no_success_is_told_by_exit_code_and_headline(tmp_path, monkeypatch, capsys):
    """One branch more than a relaxation shows, and a long run that is never seen."""
    text = ONE.replace("{file: data.csv}", "{file: data.csv, rate: 0.1 1/s}")
    path = coupon_file(tmp_path, text.replace("[gent]", "[gent], branches: 2"))
    out = tmp_path / "out"
    code, said, err = call(monkeypatch, capsys, "calibrate", path, "--out", out)
    assert code == 3
    assert "\none: NO SUCCESS: " in said
    assert err.startswith("dealib: one: the fit failed: ")
    assert "NO SUCCESS" in (out / "report.html").read_text()


def test_a_law_that_is_unstable_within_its_use_is_not_chosen(tmp_path):
    """Mooney-Rivlin with C01 < 0 fits a bar that softens, but no film."""
    path = coupon_file(tmp_path, ONE.replace("[gent]", "[mooney_rivlin, neo_hookean]"))
    p = SimpleNamespace(c10=0.3, c01=-0.08, bulk_modulus=0.0)
    stretch = np.linspace(1, 2, 30)
    noise = np.random.default_rng(1).normal(0, 1e-3, 30)
    stress = coupon.energy(LAWS["mooney_rivlin"], p, "uniaxial", stretch)[1]
    write(tmp_path / "data.csv", stretch, stress + noise)
    fitted = fit(path)
    law = LAWS["mooney_rivlin"].model_construct(None, law="mooney_rivlin", **vars(p))
    limit = min(stability_limit(law, mode) for mode in coupon.MODES)
    assert limit < 2
    assert "neo_hookean is the best of 2 candidates by AICc." in fitted.notes
    (told,) = (n for n in fitted.notes if "mooney_rivlin is closer, but" in n)
    assert float(told.rstrip(".").rsplit(" ", 1)[1]) == pytest.approx(limit, rel=0.02)


def test_starts_are_near_the_end(tmp_path):
    """Moduli by linear least squares: for exact data of a Gent law the start is the end."""
    plan = CouponPlan(coupon_file(tmp_path, ONE))
    candidate = Candidate(LAWS["gent"], 0, 0, "multiplicative", False, False, "MPa")
    best = starts(candidate, plan.specimens, {})[0]
    assert best["shear_modulus"].start == pytest.approx(0.3, rel=1e-2)
    assert best["j_lim"].start == pytest.approx(20, rel=1e-2)
    assert candidate.moduli == ["shear_modulus"]
    ogden = Candidate(LAWS["ogden"], 2, 1, "network", True, False, "kPa")
    assert ogden.moduli == ["mu.0", "mu.1"]
    assert ogden.shapes == ["alpha.0", "alpha.1"]
    assert ogden.label == "ogden, 2 terms, 1 branch, mullins"


# --- a user's own library ------------------------------------------------------------------------


MINE = """\
my_film:
  description: mine
  values: {law: gent, shear_modulus: 0.3 MPa, j_lim: 20, bulk_modulus: 300 MPa,
    relative_permittivity: 3.1}
"""


def device(folder, film, library="library: mine.yaml\n", text=MINE):
    (folder / "mine.yaml").write_text(text)
    config = folder / "device.yaml"
    config.write_text(library + (FITS.parent / "membrane.yaml").read_text())
    return dealib.load(config, set={"materials.film": film}).config


def test_own_library_stands_beside_the_published_one(tmp_path):
    config = device(tmp_path, "{library: my_film, prestretch: 1.1}")
    assert config.materials["film"].values.j_lim == 20
    assert config.materials["film"].prestretch == (1.1, 1.1)
    stiffer = device(tmp_path, "{library: my_film, youngs_modulus: 1.5 MPa}")
    assert stiffer.materials["film"].values.shear_modulus == 0.5
    assert device(tmp_path, "{library: elastosil_2030}").materials["film"].law == "yeoh"
    # the resolved config stands alone
    (tmp_path / "mine.yaml").unlink()
    (tmp_path / "resolved.yaml").write_text(dealib.config.resolved(config))
    assert dealib.load(tmp_path / "resolved.yaml").config == config
    with pytest.raises(ConfigError, match=r"unknown material 'my_film'; did you mean 'deap_film'"):
        dealib.load(FITS.parent / "membrane.yaml", set={"materials.film": "{library: my_film}"})


@pytest.mark.parametrize(
    ("film", "library", "text", "expected"),
    [
        ("{library: my_filn}", "library: mine.yaml\n", MINE, "unknown material 'my_filn'; did you "
         "mean 'my_film'?"),
        ("{library: mine.yaml}", "", MINE, "unknown material 'mine.yaml'; name a file by 'library: "
         "mine.yaml' at the top level of the config, and here one of its materials"),
        ("{library: my_film}", "library: none.yaml\n", MINE, "1:10: library: there is no file "
         "'none.yaml'"),
        ("{library: my_film}", "library: mine.yaml\n", "my_film: {values: {law: gant}}\n",
         "mine.yaml:1:25: my_film.values.law: expected a law; did you mean 'gent'?"),
        ("{library: my_film}", "library: mine.yaml\n", "my_film: {value: {law: gent}}\n",
         "mine.yaml:1:11: my_film.value: unknown key; did you mean 'values'?"),
        ("{library: my_film}", "library: mine.yaml\n", MINE.replace("0.3 MPa", "0.3"),
         "shear_modulus: expected a stress with its unit, such as '1 MPa'; '0.3' has no unit"),
    ],
)  # fmt: skip
def test_mistakes_in_a_library_are_explained(tmp_path, film, library, text, expected):
    with pytest.raises(ConfigError) as error:
        device(tmp_path, film, library, text)
    assert expected in str(error.value)


def test_adding_keeps_what_is_there(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("# my materials\n" + MINE)
    new = {"law": "neo_hookean", "youngs_modulus": "1 MPa"}
    path.write_text(add(path, "new", {"values": new}))
    assert path.read_text().startswith("# my materials\nmy_film:")
    assert set(read_library(path)) == {"my_film", "new"}
    path.write_text(add(path, "new", {"values": new | {"youngs_modulus": "2 MPa"}}))
    assert read_library(path)["new"].values["youngs_modulus"] == "2 MPa"


def test_command_lists_and_draws_own_materials(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.yaml").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    code, said, _ = call(monkeypatch, capsys, "materials", "--library", "mine.yaml")
    assert code == 0
    assert "my_film: mine\n    gent: shear_modulus 0.3 MPa, j_lim 20" in said
    code, said, _ = call(monkeypatch, capsys, "materials", "my_film", "--library", "mine.yaml")
    assert code == 0
    assert "stable up to a stretch of 10" in said or "locks at" in said
    assert (tmp_path / "my_film.png").stat().st_size > 10_000


# --- published data, where they are at hand ------------------------------------------------------

DATA = Path(os.environ.get("DEALIB_DATA", FITS.parents[2] / "shared" / "data")) / "published"


@pytest.mark.skipif(not DATA.is_dir(), reason="published data are not at hand")
def test_acrylic_at_three_rates(tmp_path):
    """VHB 4910 of Hossain, Vu and Steinmann (2012), with equilibrium of Wang et al. (2016)."""
    files = {f"rate_{r}.csv": f"Hossain2012_stretch2p5_rate0p{r}.csv" for r in ("01", "03", "05")}
    files["equilibrium.csv"] = "wang2016_eq_stretch.csv"
    for name, source in files.items():
        text = (DATA / source).read_text()
        (tmp_path / name).write_text("stretch,stress [kPa]\n" + text)
    tests = [f"  - {{file: rate_{r}.csv, rate: 0.{r} 1/s}}" for r in ("01", "03", "05")]
    lines = ["name: vhb", "tests:", *tests, "  - file: equilibrium.csv", "material:"]
    lines += ["  laws: [neo_hookean, yeoh, gent, arruda_boyce]", "  branches: [1, 2]"]
    (tmp_path / "vhb.yaml").write_text("\n".join([*lines, "  evolution: network\n"]))
    fitted = fit(tmp_path / "vhb.yaml")
    assert failures(fitted.found) == []
    assert any(n.startswith("gent, 2 branches is the best") for n in fitted.notes)
    assert all(c.r2 > 0.985 for (c,) in fitted.found.comparisons)
    assert [c.rmse < 1.5e-3 for (c,) in fitted.found.comparisons[:3]] == [True] * 3  # 1.5 kPa
    found = fitted.found.values
    # Foo et al. (2012): J_lim 110, 18 kPa; Wang et al. (2016): 15.4 kPa at equilibrium
    assert found["j_lim"] == pytest.approx(110, rel=0.1)
    assert 12 < found["shear_modulus"] < 18
    fitted.draw(tmp_path / "vhb.png")
    assert (tmp_path / "vhb.png").stat().st_size > 30_000
