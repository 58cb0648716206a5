"""Uncertainty: Sobol indices and intervals of known functions, breakdown by chance, the command."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import dealib
from dealib.design.distributions import Joint, Spread, scores
from dealib.design.propagation import Probability, Samples

# isort: split
import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS
from scipy import stats
from typer.testing import CliRunner

from dealib.cli.app import app
from dealib.errors import ConfigError, NotConverged, ValueAt

pytestmark = pytest.mark.once  # statistics of numbers that cases give
SMALL = Path(__file__).with_name("small.yaml")


# --- distributions -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "mean", "deviation", "quarter"),
    [
        ({"mean": "40 um", "deviation": "1 um"}, 0.04, 0.001, 0.04 - 0.0006744898),
        ({"mean": "40 um", "deviation": "2.5 %"}, 0.04, 0.001, 0.04 - 0.0006744898),
        ({"deviation": "10 %"}, 7, 0.7, 7 - 0.47214232),
        ({"min": "20 um", "max": "0.06 mm"}, 0.04, 0.04 / 12**0.5, 0.03),
        ({"min": "0 mm", "mode": "1 mm", "max": "1 mm"}, 2 / 3, 18**-0.5, 0.5),
        # mu and sigma of ln x: sigma^2 = ln(1 + 0.25), mu = ln 2 - sigma^2 / 2
        (
            {"mean": "2 mm", "deviation": "50 %", "distribution": "lognormal"},
            *(2, 1, np.exp(np.log(2) - np.log(1.25) / 2 - 0.6744898 * np.log(1.25) ** 0.5)),
        ),
        # half of a normal one: mean + sqrt(2/pi) deviations
        (
            {"mean": "1 mm", "deviation": "1 mm", "min": "1 mm"},
            *(1 + (2 / np.pi) ** 0.5, (1 - 2 / np.pi) ** 0.5, 1 + 0.3186394),
        ),
    ],
)
def test_distributions(given, mean, deviation, quarter):
    found = Spread.model_validate(given).of("mm", 7.0)
    assert found.mean() == pytest.approx(mean, rel=1e-6)
    assert found.std() == pytest.approx(deviation, rel=1e-6)
    assert found.ppf(0.25) == pytest.approx(quarter, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "where", "said"),
    [
        ({"mean": "1 mm", "deviation": "0 um"}, "deviation", "must be above 0"),
        ({"min": "2 mm", "max": "1 mm"}, "max", "must be above min"),
        ({"min": "0 mm", "mode": "2 mm", "max": "1 mm"}, "mode", "must lie between min and max"),
        (
            {"mean": "-1 mm", "deviation": "1 mm", "distribution": "lognormal"},
            *("mean", "must be above 0 in a lognormal distribution"),
        ),
        (
            {"mean": "1 mm", "deviation": "1 um", "min": "2 mm"},
            *(None, "has a probability of nearly 0 between min and max"),
        ),
        ({"min": "1 mm", "mode": "2 mm"}, None, "a triangular distribution needs max"),
        ({"mean": "1 mm", "mode": "2 mm"}, None, "a normal distribution needs deviation"),
        (
            {"mean": "1 mm", "deviation": "1 mm", "mode": "2 mm"},
            *("mode", "is not a key of a normal distribution"),
        ),
        ({"min": "1 mm", "max": "1 kV"}, "max", "'kV' is not a unit of that kind"),
        ({"min": "1 mm", "max": 2}, "max", "expected a unit such as 'mm'; '2' has no unit"),
    ],
)
def test_impossible_distributions(given, where, said):
    with pytest.raises(ValueAt) as found:
        Spread.model_validate(given).of("mm", 7.0)
    assert found.value.where == (() if where is None else (where,))
    assert said in str(found.value)


CORRELATION = np.array([[1, 0.6, 0], [0.6, 1, -0.3], [0, -0.3, 1]])


def test_correlated_points():
    normal = Joint(("a", "b", "c"), (stats.norm(2, 0.1),) * 3, CORRELATION)
    x = normal.of(scores(2**13, 3, seed=4))
    assert np.corrcoef(x.T) == pytest.approx(CORRELATION, abs=0.003)
    assert x.mean(axis=0) == pytest.approx([2, 2, 2], abs=1e-4)
    assert x.std(axis=0) == pytest.approx([0.1, 0.1, 0.1], rel=2e-3)
    # in another order the points are others, of the same distribution
    other = normal.of(scores(2**13, 3, seed=4), [2, 0, 1])
    assert np.corrcoef(other.T) == pytest.approx(CORRELATION, abs=0.003)
    # ranks of a Gaussian copula, whatever the distributions are: (6 / pi) asin(r / 2)
    mixed = Joint(("a", "b", "c"), (stats.uniform(), stats.lognorm(1), stats.norm()), CORRELATION)
    ranks = stats.spearmanr(mixed.of(scores(2**13, 3, seed=4))).statistic
    assert ranks == pytest.approx(6 / np.pi * np.arcsin(CORRELATION / 2), abs=0.004)


def test_points_go_on_where_fewer_ended():
    assert np.array_equal(scores(32, 3, seed=7)[:16], scores(16, 3, seed=7))
    assert not np.allclose(scores(16, 3, seed=8), scores(16, 3, seed=7))


# --- known functions -----------------------------------------------------------------------------


def ishigami(x):
    """T. Ishigami and T. Homma, Proc. ISUMA (1990) 398, with a = 7, b = 0.1."""
    a, b, c = x.T
    return {"y": np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)}


@pytest.fixture(scope="module")
def known_function():
    variables = Joint(("a", "b", "c"), (stats.uniform(-np.pi, 2 * np.pi),) * 3, np.eye(3))
    return Samples(variables, ishigami, 256, seed=1)


def test_sobol_indices_of_a_known_function(known_function):
    alone = (0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, 49 / 8, 0.0)
    together = 0.1**2 * np.pi**8 * (1 / 18 - 1 / 50)
    variance = sum(alone) + together
    totals = (alone[0] + together, alone[1], together)
    known = known_function.known("y")
    for k, name in enumerate("abc"):
        first, total = alone[k] / variance, totals[k] / variance
        assert known.first[name][0] == pytest.approx(first, rel=0.02, abs=1e-3)
        assert known.total[name][0] == pytest.approx(total, rel=0.02)
        assert abs(known.first[name][0] - first) <= known.first[name][1] + 1e-3
        assert abs(known.total[name][0] - total) <= known.total[name][1]
    assert known.numbers["mean"][0] == pytest.approx(3.5, rel=0.005)
    assert known.numbers["deviation"][0] == pytest.approx(variance**0.5, rel=0.005)
    assert 0.99 < known.explained < 1


def test_the_error_of_what_is_left_out(known_function):
    """The closed form against processes that have really been left without a sample."""
    x, y, smooth = known_function._known("y")
    missed = []
    for k in (3, 77, 200):
        others = np.arange(len(y)) != k
        missed.append(y[k] - smooth.through(x[others], y[others]).at(x[k : k + 1])[0])
    from scipy.linalg import cho_solve

    inverse = cho_solve((smooth.process.L_, True), np.eye(len(y)))
    closed = np.ravel(smooth.process.alpha_) / np.diag(inverse) * y.std()
    assert missed == pytest.approx(closed[[3, 77, 200]], rel=0.02)  # mean and scale differ


def test_a_probability(known_function):
    x = np.random.default_rng(1).uniform(-np.pi, np.pi, (4_000_000, 3))
    exact = float((ishigami(x)["y"] > 10).mean())
    found = known_function.beyond("y", 10, 1)
    assert found.probability_low <= exact <= found.probability_high
    assert found.probability == pytest.approx(exact, rel=0.03)
    assert found.probability_high - found.probability_low < 0.3 * found.probability
    below = known_function.beyond("y", 10, -1)
    assert below.probability == pytest.approx(1 - found.probability)


def test_sobol_indices_of_correlated_variables():
    """A sum of normal variables, by the closed forms of conditional variances.

    (S. Kucherenko, S. Tarantola and P. Annoni, Comput. Phys. Commun. 183 (2012) 937, Sec. 5.1.)
    """
    sigma = np.array([1.0, 1.0, 2.0])
    covariance = CORRELATION * np.outer(sigma, sigma)
    joint = Joint(("a", "b", "c"), tuple(stats.norm(0, s) for s in sigma), CORRELATION)
    known = Samples(joint, lambda x: {"y": x.sum(axis=1)}, 32).known("y")
    variance, precision = covariance.sum(), np.linalg.inv(covariance)
    for k, name in enumerate("abc"):
        first = covariance[k].sum() ** 2 / covariance[k, k] / variance
        total = 1 / precision[k, k] / variance
        assert known.first[name][0] == pytest.approx(first, rel=0.01)
        assert known.total[name][0] == pytest.approx(total, rel=0.01)
    assert known.numbers["deviation"][0] == pytest.approx(variance**0.5, rel=1e-3)
    assert known.numbers["q95"][0] == pytest.approx(1.644854 * variance**0.5, rel=2e-3)


def test_what_has_no_result_counts():
    """A function that is not known beyond a bound: it is violated there."""

    def model(x):
        return {"y": np.where(x[:, 0] < 0.9, x[:, 0] + x[:, 1], np.nan)}

    joint = Joint(("a", "b"), (stats.uniform(),) * 2, np.eye(2))
    samples = Samples(joint, model, 64, seed=2)
    assert samples.unsolved.probability == pytest.approx(0.1, abs=0.02)
    assert samples.unsolved.probability_low < 0.1 < samples.unsolved.probability_high
    found = samples.beyond("y", 1.5, 1)
    exact = 0.1 + 0.5 * 0.4**2  # x > 0.9, and x + y > 1.5 below it
    assert found.probability_low < exact < found.probability_high
    assert found.probability == pytest.approx(exact, abs=0.03)
    assert samples.known("y").numbers["mean"][0] == pytest.approx(0.45 + 0.5, abs=0.02)
    with pytest.raises(NotConverged, match="only 0 of 16 samples have a result, which are too few"):
        Samples(joint, lambda x: {"y": np.full(len(x), np.nan)}, 16)


def test_what_no_process_predicts_is_told_by_the_samples():
    noise = np.random.default_rng(3).normal(5, 2, 128)
    joint = Joint(("a", "b"), (stats.uniform(),) * 2, np.eye(2))
    samples = Samples(joint, lambda x: {"y": noise}, 128)
    known = samples.known("y")
    assert known.explained < 0.3
    assert known.numbers["mean"][0] == pytest.approx(noise.mean())
    assert known.numbers["deviation"][0] == pytest.approx(noise.std(ddof=1))
    assert known.numbers["mean"][1] == pytest.approx(1.96 * noise.std() / 128**0.5, rel=0.7)
    assert samples.beyond("y", 5, 1).probability == (noise > 5).mean()


def test_one_variable_and_a_quantity_that_does_not_vary():
    joint = Joint(("a",), (stats.norm(3, 0.1),), np.eye(1))
    samples = Samples(joint, lambda x: {"y": 2 * x[:, 0], "same": 4 + 0 * x[:, 0]}, 16)
    known = samples.known("y")
    assert known.numbers["deviation"][0] == pytest.approx(0.2, rel=1e-3)
    assert (known.first["a"][0], known.total["a"][0]) == pytest.approx((1, 1), abs=1e-3)
    same = samples.known("same")
    assert same.numbers["mean"][0] == same.numbers["q5"][0] == pytest.approx(4)
    assert same.numbers["deviation"][0] == pytest.approx(0, abs=1e-9)
    assert same.first["a"][0] == pytest.approx(0, abs=1e-9)
    assert samples.beyond("same", 3.9, 1).probability == 1
    assert samples.beyond("same", 4.1, 1).probability == 0


def test_probabilities():
    assert Probability.of(100, 0, 0, 0).probability == 0
    assert Probability.of(100, 0, 0, 0).probability_high == pytest.approx(
        0.037, abs=1e-3
    )  # Wilson's
    assert Probability.of(100, 50, 40, 60).probability_low == pytest.approx(0.309, abs=1e-3)


# --- breakdown by chance -------------------------------------------------------------------------

STIFF = {
    "limits.weibull": "{strength: 80 MV/m, shape: 12, volume: 100 mm^3}",
    "materials.film.youngs_modulus": "1 GPa",  # the field is uniform, V / H
    "program": "[{stage: actuate, terminal: {voltage: 4 kV}, steps: 1}]",
}
IN_SPACE = (
    "{shape: laminate, space: 3d, symmetry: [X, Y], base: {kind: annulus, inner_radius: 8 mm, "
    "outer_radius: 12 mm}, layers: [{name: film, thickness: 50 um}]}"
)


@pytest.mark.parametrize(
    ("changes", "volume"),
    [
        ({}, np.pi * 80 * 0.05),
        ({"physics": "{model: membrane}"}, np.pi * 80 * 0.05),
        ({"geometry": IN_SPACE}, np.pi * 80 * 0.05),
        ({"geometry.outer_radius": "24 mm", "geometry.inner_radius": "16 mm"}, np.pi * 320 * 0.05),
    ],
)
def test_breakdown_of_a_uniform_field(changes, volume):
    """1 - exp(-(E / E0)^m V / V0), E = E0: of four times the size four times the exponent."""
    *_, state = dealib.Simulation(dealib.load(SMALL, {**STIFF, **changes}))
    assert state.row["failure_probability"] == pytest.approx(1 - np.exp(-volume / 100), rel=1e-4)


def test_the_weakest_link_is_in_the_strongest_field():
    """Of a soft film the field varies: the integral lies between those of its ends."""
    soft = {**STIFF, "materials.film.youngs_modulus": "1 MPa"}
    soft["program"] = soft["program"].replace("4 kV", "3 kV")
    *_, state = dealib.Simulation(dealib.load(SMALL, soft))
    use = (state.row["field_max_MV_per_m"] / 80) ** 12 * np.pi * 80 * 0.05 / 100
    assert 0.01 * use < -np.log1p(-state.row["failure_probability"]) < use


# --- designs -------------------------------------------------------------------------------------

DESIGN = """\
base: {small}
description: A strip of known scatter
set: {{mesh.columns: 4, program.0.steps: 1, program.1: '{program}'}}
variables:
  geometry.film_thickness: {{mean: 50 um, deviation: 0.2 um}}
  materials.film.youngs_modulus: {{deviation: 0.5 %}}
  program.1.terminal.voltage: {{min: 1.995 kV, max: 2.005 kV}}
correlations:
  - {{between: [geometry.film_thickness, materials.film.youngs_modulus], coefficient: -0.6}}
breakdown: {{strength: 80 MV/m, shape: 12, volume: 100 mm^3}}
quantities:
  force: end(force_N, "actuate")
  failure: max(failure_probability)
subject_to: ['force <= -0.09', '0 <= max(charge_uC) <= 1']
sampling: {{samples: 16, seed: 3}}
"""
PROGRAM = "{stage: actuate, terminal: {voltage: 2 kV}, steps: 1}"


def write(folder, text=DESIGN, name="strip.yaml", **changes):
    path = folder / name
    text = text.format(small=SMALL, program=PROGRAM)
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A design, the tables of `dealib.uncertainty`, and the cache of its cases."""
    folder = tmp_path_factory.mktemp("design")
    path = write(folder)
    return path, dealib.uncertainty(path, cache=folder / "cases"), folder / "cases"


def command(*arguments):
    return CliRunner().invoke(app, ["uncertainty", *map(str, arguments)])


def test_a_device_that_is_linear_in_its_scatter(solved):
    """Mean and deviation against linear propagation by slopes of one run (0.5 % of scatter).

    The failure goes with E^12, so that its deviation of 5 % has a part of second order, 0.05^2.
    """
    summary = solved[1][0].set_index("quantity")
    for name, tolerance in (("force", 5e-4), ("failure", 4e-3)):
        row = summary.loc[name]
        assert row["deviation"] == pytest.approx(row["linear_deviation"], rel=tolerance)
        assert row["explained"] > 0.9999
        assert row["q5"] < row["q50"] < row["q95"]
    samples, force = solved[1][2], summary.loc["force"]
    assert force["mean"] == pytest.approx(samples["force"].mean(), abs=0.1 * force["deviation"])
    assert force["deviation_error"] < 0.01 * force["deviation"]


def test_the_scatter_is_that_of_the_file(solved):
    samples = solved[1][2]
    assert list(samples) == [
        *("sample", "geometry.film_thickness [um]", "materials.film.youngs_modulus [MPa]"),
        *("program.1.terminal.voltage [kV]", "force", "failure", "max(charge_uC)", "error"),
    ]
    assert (samples["error"] == "").all()
    thickness, modulus, voltage = (samples.iloc[:, k] for k in (1, 2, 3))
    assert thickness.mean() == pytest.approx(50, abs=0.05)
    assert modulus.mean() == pytest.approx(1, abs=0.001)  # the base's value
    assert np.corrcoef(thickness, modulus)[0, 1] == pytest.approx(-0.6, abs=0.15)
    assert voltage.between(1.995, 2.005).all()
    assert voltage.mean() == pytest.approx(2, abs=5e-4)


def test_sobol_indices_of_a_device(solved):
    """Breakdown follows the field, E ~ V/H: scatter of the modulus alone changes nothing."""
    sobol = solved[1][1].set_index(["quantity", "key"])
    total = sobol.loc["failure", "total"]
    assert total["geometry.film_thickness"] > 0.5
    assert total["materials.film.youngs_modulus"] < 0.01
    # it is correlated with the thickness: alone it tells 0.36 of what the thickness does
    first = sobol.loc["failure", "first"]
    ratio = first["materials.film.youngs_modulus"] / first["geometry.film_thickness"]
    assert ratio == pytest.approx(0.36, abs=0.02)


def test_the_command_solves_nothing_again(solved, tmp_path):
    path, (summary, sobol, samples), cache = solved
    done = command(path, "--cache", cache, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert done.output.startswith("strip: 0 cases to solve\n")
    for name, table in (("summary", summary), ("sobol", sobol), ("samples", samples)):
        written = pd.read_csv(tmp_path / "out" / f"{name}.csv", float_precision="round_trip")
        assert list(written) == list(table)
        for column in table.select_dtypes("number"):
            assert np.array_equal(written[column], table[column], equal_nan=True), column
    assert (tmp_path / "out" / "uncertainty.png").stat().st_size > 10_000
    assert "(by the slopes at the means " in done.output
    assert "max(charge_uC) >= 0 is not met: 0 % (95 %: 0 to 0.0234 %)" in done.output
    again = command(path, "--cache", cache, "--out", tmp_path / "out")
    assert isinstance(again.exception, ConfigError)
    assert "summary.csv exists; choose another --out, or --overwrite it" in str(again.exception)


def test_a_limit_at_the_median_is_missed_by_half(solved, tmp_path):
    path, (summary, _, _), cache = solved
    median = summary.set_index("quantity").loc["force", "q50"]
    text = path.read_text().replace("force <= -0.09", f"force <= {float(median)!r}")
    other = tmp_path / "median.yaml"
    other.write_text(text)
    found, _, _ = dealib.uncertainty(other, cache=cache)
    (row,) = (r for _, r in found.iterrows() if r["quantity"].startswith("force <= "))
    assert row["probability"] == pytest.approx(0.5, abs=0.01)
    assert row["probability_low"] < 0.5 < row["probability_high"]


# --- what goes wrong -----------------------------------------------------------------------------

THICKNESS = "{mean: 50 um, deviation: 0.2 um}"
MISTAKES = [  # what is written instead of what, line and column, what is said
    (THICKNESS, "{mean: 50 um}", "5:28: variables.geometry.film_thickness: a normal distribution "
     "needs deviation"),
    (THICKNESS, "{mean: 50 um, deviation: 0 um}", "5:53: variables.geometry.film_thickness."
     "deviation: must be above 0"),
    (THICKNESS, "{mean: 50 kV, deviation: 1 um}", "5:35: variables.geometry.film_thickness.mean: "
     "expected a unit such as 'mm'; 'kV'"),
    (THICKNESS, "{mean: 50 um, deviation: 1 um, min: 60 um, max: 50 um}", "5:76: variables."
     "geometry.film_thickness.max: must be above min"),
    (THICKNESS, "{mean: 50 um, spread: 1 um}", "5:42: variables.geometry.film_thickness.spread: "
     "unknown key"),
    (THICKNESS, "{choices: [40 um, 50 um]}", "5:38: variables.geometry.film_thickness.choices: a "
     "choice has no distribution; name a number"),
    ("geometry.film_thickness: {mean", "geometry.film_thicknes: {mean", "5:3: variables.geometry."
     "film_thicknes: the config has no number 'geometry.film_thicknes'; did you mean"),
    ("materials.film.youngs_modulus]", "materials.film.prestretch]", "9:15: correlations.0.between:"
     " 'materials.film.prestretch' is not a variable"),
    ("materials.film.youngs_modulus]", "geometry.film_thickness]", "9:15: correlations.0.between: "
     "expected two different variables, and each pair once"),
    ("coefficient: -0.6", "coefficient: -1.2", "9:86: correlations.0.coefficient: must be "
     "above -1, not -1.2"),
    ("{strength: 80 MV/m, ", "{", "10:1: breakdown.strength: this key is missing"),
    ("max(failure_probability)", "max(failure)", "13:12: quantities.failure: unknown name "
     "'failure'"),
    ("'force <= -0.09'", "'force'", "14:14: subject_to.0: 'force' is not an inequality"),
    ("samples: 16", "samples: 20", "15:21: sampling.samples: 20 is not allowed"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), MISTAKES)
def test_mistakes_are_told_with_their_place(old, new, said, tmp_path):
    path = write(tmp_path, change=(old, new))
    done = command(path, "--out", tmp_path / "out")
    assert isinstance(done.exception, ConfigError), done.output
    assert f"{path}:{said}" in str(done.exception)
    assert not (tmp_path / "out").exists()


def test_correlations_that_cannot_be(tmp_path):
    pairs = [("a", "b", 0.9), ("b", "c", 0.9), ("a", "c", -0.9)]
    names = dict(zip("abc", ("geometry.film_thickness", "materials.film.youngs_modulus",
                             "program.1.terminal.voltage"), strict=True))  # fmt: skip
    given = [f"{{between: [{names[a]}, {names[b]}], coefficient: {r}}}" for a, b, r in pairs]
    path = write(tmp_path)
    text, (start, rest) = path.read_text(), path.read_text().split("  - {between")
    path.write_text(f"{start}  - " + "\n  - ".join(given) + rest[rest.index("\n") :])
    assert path.read_text() != text
    done = command(path)
    said = f"{path}:8:1: correlations: these coefficients contradict each other"
    assert said in str(done.exception)


def test_too_few_samples(tmp_path):
    text, more = write(tmp_path).read_text(), ("film.relative_permittivity", "film.prestretch")
    more = [*(f"materials.{name}" for name in more), "geometry.inner_radius"]
    more += ["geometry.outer_radius", "program.0.mount.displacement"]
    lines = "".join(f"  {name}: {{deviation: 1 %}}\n" for name in more)
    path = tmp_path / "many.yaml"
    path.write_text(text.replace("correlations:", f"{lines}correlations:"))
    done = command(path, "--cache", tmp_path / "cases")
    said = "20:21: sampling.samples: 16 samples are too few for these variables; take 18 or more"
    assert f"{path}:{said}" in str(done.exception)


def test_a_sample_that_is_impossible(tmp_path):
    path = write(tmp_path, change=(THICKNESS, "{mean: 50 um, deviation: 40 um}"))
    done = command(path, "--cache", tmp_path / "cases")
    assert isinstance(done.exception, ConfigError)
    assert f"{path}:4:1: variables: sample " in str(done.exception)
    assert "is impossible; limit its variables by min and max" in str(done.exception)


def test_optimise_wants_bounds(tmp_path):
    path = write(tmp_path, change=("quantities:", "maximise: force\nquantities:"))
    done = CliRunner().invoke(app, ["optimise", str(path), "--out", str(tmp_path / "out")])
    assert isinstance(done.exception, ConfigError)
    assert f"{path}:5:3: variables.geometry.film_thickness: a distribution is for `dealib" in str(
        done.exception
    )


def test_samples_beyond_pull_in_are_counted(tmp_path):
    """Free of load the strip is pulled in between 4.6 and 5.4 kV."""
    path = write(
        tmp_path,
        program=("voltage: 2 kV", "voltage: 5 kV"),
        voltage=("{min: 1.995 kV, max: 2.005 kV}", "{min: 4 kV, max: 5.3 kV}"),
        limits=("['force <= -0.09', '0 <= max(charge_uC) <= 1']", "['force <= 1000']"),
    )
    done = command(path, "--cache", tmp_path / "cases", "--out", tmp_path / "out", "-j", "1")
    assert done.exit_code == 0, done.output
    samples = pd.read_csv(tmp_path / "out" / "samples.csv")
    lost = samples["error"].notna()
    assert 1 <= lost.sum() <= 6
    assert samples.loc[lost, "force"].isna().all()
    assert samples.loc[~lost, "force"].notna().all()
    assert samples.loc[lost].iloc[:, 3].min() > samples.loc[~lost].iloc[:, 3].max() - 0.2
    assert samples.loc[lost, "error"].str.contains("pull-in").all()
    said = f"{lost.sum()} of 16 samples have no result: they count as meeting no limit"
    assert said in done.output
    summary = pd.read_csv(tmp_path / "out" / "summary.csv").set_index("quantity")
    for row in ("no result", "force <= 1000"):
        assert summary.loc[row, "probability"] == pytest.approx(lost.mean(), abs=1e-3)
        assert summary.loc[row, "probability_low"] < lost.mean()
        assert summary.loc[row, "probability_high"] > lost.mean()


def test_an_interruption_keeps_what_is_solved(tmp_path):
    path, cache = write(tmp_path, seed=("seed: 3", "seed: 4")), tmp_path / "cases"
    words = [sys.executable, "-m", "dealib", "uncertainty", path, "--cache", cache, "-j", "1"]
    out = ["--out", tmp_path / "out"]
    job = subprocess.Popen([*words, *out], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                           text=True, start_new_session=True)  # fmt: skip
    assert job.stdout is not None
    for line in job.stdout:
        if line.startswith("3/17"):
            job.send_signal(signal.SIGINT)
            break
    rest = job.communicate(timeout=300)[0]
    assert job.returncode == 130
    kept = len(list(cache.glob("*.json")))
    assert 3 <= kept < 17
    assert "solved cases are kept, the same command goes on with the others" in rest
    assert not (tmp_path / "out").exists()
    done = command(path, "--cache", cache, *out, "-j", "1")
    assert done.exit_code == 0
    assert done.output.startswith(f"strip: {17 - kept} cases to solve\n")


def test_the_shipped_design(tmp_path):
    """Its stroke scatters by 6 %, three quarters of it by the film's thickness."""
    path = CONFIGS / "designs" / "scatter.yaml"
    summary, sobol, samples = dealib.uncertainty(path, cache=tmp_path / "cases")
    stroke = summary.set_index("quantity").loc["stroke"]
    assert stroke["mean"] == pytest.approx(0.576, abs=0.002)
    assert stroke["deviation"] == pytest.approx(stroke["linear_deviation"], rel=0.02)
    assert stroke["deviation"] / stroke["mean"] == pytest.approx(0.062, abs=0.002)
    first = sobol.set_index(["quantity", "key"]).loc["stroke", "first"]
    assert first["geometry.film_thickness"] == pytest.approx(0.777, abs=0.01)
    assert len(samples) == 16
