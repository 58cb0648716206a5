"""Benchmarks of configs/validation: their references anew, and what `dealib validate` says."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar
from typer.testing import CliRunner
from verification.references import (
    EPS0,
    annulus,
    balloon,
    block,
    capacitor,
    circle,
    diaphragm,
    frequencies,
    line,
    strip,
    tube,
    unimorph,
)
from verification.references.laws import Film, gent, neo_hooke, ogden

import dealib
from dealib.cli.app import app
from dealib.errors import ConfigError
from dealib.validation.definition import SUITE, benchmark, find, read

EPS, SOFT = 4.7 * EPS0, neo_hooke(0.02)
# seconds together, of forms that other tests compile too
QUICK = [
    "benchmark_strip", "expanding_circle", "free_film",
    "pure_shear_strip", "thick_tube", "wrinkling",
]  # fmt: skip


def references(name: str) -> dict[str, float]:
    """The references of a benchmark, by quantity."""
    given, _ = benchmark(SUITE / f"{name}.yaml")
    return {c.name: x for c, x in zip(given.checks, given.numbers(), strict=True)}


def numbers(name: str, *quantities: str) -> list[float]:
    """Some of them."""
    found = references(name)
    return [found[q] for q in quantities]


# --- references, solved anew ---------------------------------------------------------------------


@pytest.mark.once
def test_films():
    film = partial(block.Block, thickness=0.5)
    for name, law, eps in (
        ("free_film", SOFT, EPS),
        ("gent_film", gent(0.02, 90.0), EPS),
        ("ogden_film", ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0)), 3 * EPS0),
    ):
        given = film(law, permittivity=eps)
        (voltage,) = numbers(name, "pull-in voltage")
        assert voltage == pytest.approx(block.limit_point(given).voltage, rel=1e-7)
        program = read(SUITE / f"{name}.yaml").cases[0].work.program
        driven = program[0].terminal.voltage[0]
        state = block.at_voltage(given, driven)
        first = next(q for q in references(name) if q.startswith("area strain"))
        assert numbers(name, first) == pytest.approx([state.l1**2 - 1], rel=1e-9)
    state = block.at_stretch(film(gent(0.02, 90.0), permittivity=EPS), 3.0)
    assert numbers("gent_film", "voltage on the second branch") == pytest.approx([state.voltage])
    assert references("gent_film")["area strain on the second branch"] == 8
    (curve,) = benchmark(SUITE / "free_film.yaml")[0].curves
    given = film(SOFT, permittivity=EPS)
    strain = [block.at_voltage(given, v).l1 ** 2 - 1 for v in curve.reference.x]
    assert curve.reference.y == pytest.approx(strain, abs=1e-6)


@pytest.mark.once
def test_expanding_circle():
    device = circle.Circle(Film(SOFT, 0.5, 1.5, EPS), 50.0, 25.0)
    states = [circle.at_voltage(device, v) for v in (3.28839, 5.48065, 7.6729)]
    strains = [(s.edge / 25) ** 2 - 1 for s in states]
    found = list(references("expanding_circle").values())
    assert found == pytest.approx([*strains, 1e3 * states[-1].capacitance], rel=1e-7)


@pytest.mark.once
def test_tube_and_balloon():
    given = tube.Tube(SOFT, 10.0, 11.0, EPS)
    free = tube.at_voltage(given, 8.76904, 0.0, "open")
    held = tube.at_voltage(given, 8.76904, 4e-4, "held")
    exact = [10 * (free.stretch - 1), free.inner - 10, held.inner - 10, 1e4 * held.capacitance]
    assert list(references("thick_tube").values()) == pytest.approx(exact, rel=1e-7)
    sphere = balloon.Balloon(gent(0.02, 30.0), 10.0, 2.0, EPS, thick=True)
    top = balloon.limit_pressures(sphere)[0]
    pressures = [1e3 * balloon.pressure(sphere, *at) for at in ((top,), (2.0,), (2.0, 8.76904))]
    exact = [*pressures, 500 * balloon.capacitance(sphere, 2.0)]
    assert list(references("balloon").values()) == pytest.approx(exact, rel=1e-7)


@pytest.mark.once
def test_membranes():
    device = annulus.Annulus(Film(neo_hooke(1.0), 0.1 / 1.44, 1.2, 3 * EPS0), 10.0, 20.0)
    volts = 0.03 / (3 * EPS0) ** 0.5
    flat, driven = annulus.push(device, 10.0), annulus.push(device, 10.0, volts)
    found = list(references("annular_membrane").values())
    stroke = found.pop(1)
    assert annulus.push(device, 10 + stroke, volts).force == pytest.approx(flat.force, rel=1e-7)
    exact = [10, flat.force, flat.force - driven.force, 1e3 * driven.capacitance]
    assert found == pytest.approx(exact, rel=1e-7)
    (curve,) = benchmark(SUITE / "annular_membrane.yaml")[0].curves
    forces = [annulus.push(device, u).force for u in curve.reference.x[1::2]]
    assert curve.reference.y[1::2] == pytest.approx(forces, rel=1e-7)

    dome = diaphragm.Diaphragm(Film(SOFT, 0.25, 1.2, EPS), 20.0)
    loads = ((1.25e-4, 0.0), (2.5e-4, 0.0), (2.5e-4, 2.19226))
    states = [diaphragm.at_pressure(dome, *load) for load in loads]
    exact = [*(s.height for s in states), states[-1].volume]
    assert list(references("diaphragm").values()) == pytest.approx(exact, rel=1e-7)


@pytest.mark.once
def test_bender_capacitor_and_line():
    layers = unimorph.Unimorph(SOFT, SOFT, 0.5, 0.5, EPS)
    bent = unimorph.bend(layers, 3.28839)
    exact = [unimorph.curvature(layers, 0.1), bent.curvature, bent.stretch - 1]
    assert list(references("bender").values()) == pytest.approx(exact, rel=1e-7)
    exact = [1e4 * EPS0 * capacitor.infinite_sheet(10, 1.0, er) for er in (1.0, 4.7)]
    assert list(references("capacitor").values()) == pytest.approx(exact, rel=1e-6)
    sheets = line.Sheets(1e4, 1e4, 1e-7)
    Z = [line.strip(sheets, x / 2e-5, 0.1, 0.02) for x in (0.3, 3.0, 30.0)]
    exact = [f(z) for z in Z for f in (lambda z: abs(z) / 1e6, lambda z: np.angle(z, deg=True))]
    assert list(references("resistive_electrodes").values()) == pytest.approx(exact, rel=1e-7)


@pytest.mark.once
def test_strip_and_generator():
    given = strip.Strip(SOFT, 0.5, 100 / 1.5, 1.5, EPS)
    load = 0.9122085048010974 / (0.5 * 100 / 1.5)

    def charge(volts: float) -> float:
        s = strip.at_load(given, load, volts)
        return s.capacitance * volts

    volts = 2.740322754535081
    state = strip.at_load(given, load, volts)
    rate = (charge(volts + 1e-4) - charge(volts - 1e-4)) / 2e-4
    found = references("pure_shear_strip")
    assert found["free stroke"] == pytest.approx(30 * (state.stretch / 1.5 - 1), rel=1e-7)
    k2 = 1 - state.capacitance / rate
    assert found["electromechanical coupling factor squared"] == pytest.approx(k2, rel=1e-6)
    # the strip's total nominal stress is linear in the square of the voltage
    blocked = EPS * (volts / 0.5) ** 2 * 1.5 * 1.5**2 * 0.5 * 100 / 1.5
    assert found["blocking force"] == pytest.approx(blocked, rel=1e-9)
    C = [EPS * (l * 1.5 / 0.5) ** 2 * 20 * 0.5 * 100 / 1.5 for l in (1.5, 2.5)]
    energy = 2.34**2 / 2 * (1 / C[0] - 1 / C[1])
    found = references("generator_cycle")
    assert found["electrical energy generated"] == pytest.approx(energy, rel=1e-9)
    assert found["energy density generated"] == pytest.approx(energy / (20 * 0.5 * 100 / 1.5))


@pytest.mark.once
def test_membrane_modes():
    k = [frequencies.disc(n, 1, 20.0)[0] for n in range(3)]
    film = Film(SOFT, 0.25, 1.2, EPS)
    rest, driven = (
        [x * (film.tension(v) / (960e-12 * 0.25)) ** 0.5 / (2 * np.pi) for x in k]
        for v in (0.0, 2.19226)
    )
    exact = [*rest, driven[0], driven[2]]
    assert list(references("membrane_modes").values()) == pytest.approx(exact, rel=1e-8)


@pytest.mark.once
def test_step_response():
    """One degree of freedom: the stretch of a strip without mass that moves a bar."""
    w, tau, volts, stress = 1.5, 0.02, 2.740322754535081, 0.9122085048010974 / (0.5 * 100 / 1.5)
    over = 20 * 0.5 * 100 / 1.5 / (1e-4 * 20**2)  # volume over mass times length squared

    def rates(t: float, y: np.ndarray) -> list[float]:
        square = EPS * (volts * -np.expm1(-t / tau) / 0.5) ** 2
        l = y[0]
        return [y[1], -over * (0.02 * (l - l**-3 * w**-2) - square * l * w**2 - stress)]

    def turns(t: float, y: np.ndarray) -> float:
        return y[1] if t > 0.01 else 1.0

    def passes(t: float, y: np.ndarray) -> float:
        return y[0] - 1.6978793724521326

    done = solve_ivp(
        rates, (0, 0.24), [1.5, 0.0], "DOP853", rtol=1e-10, atol=1e-12, events=[turns, passes]
    )
    exact = [20 * done.y_events[0][0][0] - 30, done.t_events[1][0]]
    assert list(references("step_response").values()) == pytest.approx(exact, rel=1e-6)


MODULUS, LOCK = 15.36, 5.99  # kPa; Wang et al. (2016)
BRANCHES = ((26.06, 0.6074), (26.53, 6.56), (10.83, 61.25))


def stiffness(squares: float) -> float:
    """Of Arruda and Boyce's chains, over the neo-Hookean stress, by the first invariant."""
    chain = (squares / 3) ** 0.5
    beta = brentq(lambda b: 1 / np.tanh(b) - 1 / b - chain / LOCK, 1e-6, 1e4)
    return MODULUS * LOCK / (3 * chain) * beta


@pytest.mark.once
def test_vhb_uniaxial():
    """Transient networks that are stretched along one axis: A' = (C^-1 - A)/tau, in ODEs."""
    for rate in (0.01, 0.05):

        def slopes(t: float, a: np.ndarray, rate: float = rate) -> list[float]:
            l = 1 + rate * t
            return [
                x for i, (_, tau) in enumerate(BRANCHES)
                for x in ((l**-2 - a[2 * i]) / tau, (l - a[2 * i + 1]) / tau)
            ]  # fmt: skip

        a = solve_ivp(slopes, (0, 1.5 / rate), np.ones(6), rtol=1e-9, atol=1e-11).y[:, -1]
        l = 2.5
        stress = stiffness(l**2 + 2 / l) * (l - l**-2)
        for i, (g, _) in enumerate(BRANCHES):
            stress += g * (l**2 * a[2 * i] - a[2 * i + 1] / l) / l
        (known,) = numbers("vhb_uniaxial", f"stress at 2.5 by the same parameters at {rate} 1/s")
        assert known == pytest.approx(stress, rel=1e-6)


@pytest.mark.once
def test_vhb_rates():
    """The same of a free film: at each time the voltage gives its stretch."""

    def stretch(phi: float, a: np.ndarray, near: float) -> float:
        def miss(l: float) -> float:
            stress = stiffness(2 * l**2 + l**-4) * (l**2 - l**-4) - MODULUS * phi**2 * l**4
            for i, (g, _) in enumerate(BRANCHES):
                stress += g * (l**2 * a[2 * i] - a[2 * i + 1] * l**-4)
            return stress

        return brentq(miss, 0.9999, near, xtol=1e-14)

    found = references("vhb_rates")
    for (quantity, known), rate in zip(found.items(), (1e-6, 1e-3, 1e-2, 0.1), strict=True):
        phi = float(re.search(r"at ([\d.]+) and", quantity)[1])

        def slopes(t: float, a: np.ndarray, rate: float = rate) -> list[float]:
            l = stretch(1.6 * rate * t, a, 1.25)
            return [
                x for i, (_, tau) in enumerate(BRANCHES)
                for x in ((l**-2 - a[2 * i]) / tau, (l**4 - a[2 * i + 1]) / tau)
            ]  # fmt: skip

        if rate == 1e-6:  # the branches have relaxed
            given = minimize_scalar(
                lambda l, phi=phi: (
                    (stiffness(2 * l**2 + l**-4) * (l**-2 - l**-8) / MODULUS - phi**2) ** 2
                ),
                bounds=(1.01, 1.2), method="bounded", options={"xatol": 1e-10},
            )  # fmt: skip
            l = given.x
        else:
            end = phi / 1.6 / rate
            a = solve_ivp(slopes, (0, end), np.ones(6), rtol=1e-8, atol=1e-10).y[:, -1]
            l = stretch(phi, a, 1.25)
        assert known == pytest.approx(l**-2, rel=1e-6)


# --- the suite -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("validation") / "cases"


@pytest.fixture(scope="module")
def table(cache):
    """The quick benchmarks."""
    return dealib.validate(QUICK, cache=cache)


def call(*arguments):
    """The command in this process; its result."""
    return CliRunner().invoke(app, ["validate", *map(str, arguments)])


def test_all_definitions_are_whole_and_on_the_page():
    page = (SUITE / "README.md").read_text(encoding="utf-8")
    kinds = []
    for path in find([]):
        given = read(path).benchmark
        kinds.append(given.kind)
        assert f"[{path.stem}]({path.name})" in page
        assert given.device["name"] == path.stem
        # numbers that are read off files of others stay outside the repository
        assert all(c.reference.file is None or given.licence for c in given.curves)
    assert len(kinds) == 22
    assert set(kinds) == {"analytical", "code", "measured"}


@pytest.mark.once
def test_quick_benchmarks_are_within_their_tolerances(table):
    assert set(table["benchmark"]) == set(QUICK)
    assert (table["verdict"] == "within").all(), table[table["verdict"] != "within"]
    assert (table["difference"].abs() <= table["allowed"]).all()
    assert len(table) == 5 + 6 + 4 + 3 + 4 + 2


@pytest.mark.slow
def test_all_benchmarks_are_within_their_tolerances(cache):
    table = dealib.validate(cache=cache)
    wrong = table[~table["verdict"].isin(["within", "skipped"])]
    assert wrong.empty, wrong.to_string()
    assert set(table["benchmark"]) == {path.stem for path in find([])}


@pytest.mark.once
def test_a_wrong_number_fails_and_stands_in_table_and_page(table, cache, tmp_path):
    text = (SUITE / "wrinkling.yaml").read_text(encoding="utf-8")
    wrong = text.replace("reference: unit * sqrt", "reference: 1.01 * unit * sqrt", 1)
    assert wrong != text
    (tmp_path / "wrinkling.yaml").write_text(wrong, encoding="utf-8")
    out = tmp_path / "out"
    done = call(tmp_path / "wrinkling.yaml", "--out", out, "--cache", cache)
    assert done.exception.exit_code == 1
    assert str(done.exception).startswith("1 of 2 quantities are outside their tolerance\n")
    assert "wrinkling voltage: -0.99 %" in str(done.exception)
    assert "1 case in 1 benchmark; 0 to solve" in done.output  # what is solved is kept
    rows = pd.read_csv(out / "results.csv")
    assert rows["verdict"].tolist() == ["outside", "within"]
    results = json.loads((out / "results.json").read_text())
    assert [r["verdict"] for r in results["results"]] == ["outside", "within"]
    page = (out / "results.html").read_text(encoding="utf-8")
    assert '<td class="verdict bad">outside</td>' in page
    assert "1 of 2 quantities within their tolerance" in page


@pytest.mark.once
def test_the_page_holds_all_it_shows(table, cache, tmp_path):
    done = call(*QUICK, "--out", tmp_path, "--cache", cache, "--jobs", 1)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "results.html").read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="(?:https?:|/)', page)
    for name in QUICK:
        given, _ = benchmark(SUITE / f"{name}.yaml")
        assert f'<section id="{name}">' in page
        assert page.count("<svg") == 1  # free_film's curve
        assert all(f"<td>{c.name}" in page for c in given.checks)


@pytest.mark.once
def test_numbers_of_another_code(table, cache, tmp_path):
    other = tmp_path / "other.csv"
    good = "benchmark, quantity, value\nwrinkling,wrinkling voltage,15.7\n"
    other.write_text(good)
    given = ("--against", other, "--out", tmp_path, "--cache", cache)
    done = call(*given)
    assert done.exit_code == 0, done.output
    assert "1 of 1 quantities within their tolerance" in done.output
    page = (tmp_path / "against-other.html").read_text(encoding="utf-8")
    assert "Validation of other" in page
    assert (
        f'<td class="number">{table.set_index("quantity")["value"]["wrinkling voltage"]:.6g}'
        in page
    )
    other.write_text(good.replace("15.7", "15.5"))
    assert call(*given).exception.exit_code == 1
    other.write_text(good.replace("15.7", ""))
    assert "1 without a value" in str(call(*given).exception)
    # dealib's own table is such a file
    own = tmp_path / "own.csv"
    table.to_csv(own, index=False)
    done = call("--against", own, "--out", tmp_path, "--cache", cache)
    assert f"{len(table)} of {len(table)} quantities within" in done.output
    for text, said in (
        (good.replace("wrinkling,", "wrinkles,"), "no benchmark 'wrinkles'; did you mean"),
        (good.replace("voltage,", "volts,"), "no quantity 'wrinkling volts'; did you mean"),
        (good.replace("15.7", "high"), "other.csv:2: 'high' is no number"),
        (good + "wrinkling,wrinkling voltage,15.7\n", "other.csv:3: wrinkling, .* given twice"),
        ("a,b\n1,2\n", "other.csv:1: the column 'benchmark' is missing"),
        ("benchmark,quantity,value\n", "no results below the head"),
    ):
        other.write_text(text)
        with pytest.raises(ConfigError, match=said):
            raise call(*given).exception


CURVE = """\
curves:
  - name: strain
    rms: 1.e-3
    x: {value: 'during(voltage_kV, "actuate")', label: V}
    y: {value: '(1 + during(edge_mm, "actuate") / 10) ** 2 - 1', label: strain}
    reference: {label: measured, file: data/film.csv, branch: loading}
"""


@pytest.mark.once
def test_curves_in_files_are_skipped_where_they_are_absent(table, cache, tmp_path, monkeypatch):
    text = (SUITE / "free_film.yaml").read_text(encoding="utf-8")
    file = tmp_path / "free_film.yaml"
    head = text[: text.index("checks:")]
    file.write_text(head + CURVE, encoding="utf-8")
    monkeypatch.setenv("DEALIB_DATA", str(tmp_path / "elsewhere"))
    row = dealib.validate(file, cache=cache).iloc[0]
    assert (row["verdict"], row["note"]) == ("skipped", "data/film.csv is not at hand")
    data = tmp_path / "elsewhere" / "data" / "film.csv"
    data.parent.mkdir(parents=True)
    data.write_text("V,strain\n0,0\n3.596881,0.0404\n6.576216,0.21\n3.596881,0.9\n")
    assert dealib.validate(file, cache=cache)["verdict"].tolist() == ["within"]
    data.write_text("0,0\n3.596881,0.0404\n6.576216,0.22\n")
    assert dealib.validate(file, cache=cache)["verdict"].tolist() == ["outside"]
    data.write_text("0,0\n3.5,0.04\n60,0.2\n")
    with pytest.raises(ConfigError, match="holds only 2 of 3 points of the reference"):
        dealib.validate(file, cache=cache)
    data.write_text("0,0\nx,y\n")
    with pytest.raises(ConfigError, match=r"film\.csv:2: expected two numbers"):
        dealib.validate(file, cache=cache)


@pytest.mark.once
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("name: wrinkling\n", "name: other\n", "is called as its file, here 'wrinkling'"),
        ("kind: analytical", "kind: exact", "kind: 'exact' is not allowed"),
        ("device:", "devices:", "did you mean 'device'"),
        ("device:\n", "device: 3\nx:\n", "expected a mapping of keys, not 3"),
        ("shear_modulus: 20 kPa", "shear_modulus: 20", "device.materials.film|materials.film"),
        ("value: sqrt(squared)", "value: sqrt(square)", "checks.0.value: .* no quantity"),
        ("at(voltage_kV ** 2", "at(volts ** 2", "quantities.squared: unknown name 'volts'"),
        ("reference: unit *", "reference: units *", "checks.0.reference: unknown name 'units'"),
        ("tolerance: {relative: 1.e-3}", "tolerance: {relative: 0}", "must be above 0"),
        ("tolerance: {relative: 1.e-3}", "tolerance: {}", "give one of relative, absolute"),
        ("name: true tension at rest", "name: wrinkling voltage", "checks.1.name: two quantities"),
        ("unit: 0.5 *", "unit: 0 / 0 + 0.5 *", "constants.unit: .* is no finite number"),
        ("checks:", "cases: {a: {mesh.column: 3}}\nchecks:", r"case 'a' of .*wrinkling\.yaml"),
        ("checks:", "modes: {}\nspectrum: {band: [1 Hz, 2 Hz]}\nchecks:", "exclude each other"),
    ],
)  # fmt: skip
def test_mistakes_are_told_with_their_place(old, new, said, tmp_path):
    text = (SUITE / "wrinkling.yaml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "wrinkling.yaml").write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as error:
        read(tmp_path / "wrinkling.yaml")
    assert "wrinkling.yaml" in str(error.value)


@pytest.mark.once
def test_other_files_and_names(tmp_path):
    for given, said in (
        (["wrinkle"], "there is no benchmark 'wrinkle'; did you mean 'wrinkling'"),
        ([tmp_path], "no benchmarks here"),
        ([CONFIGS / "deap100.yaml"], "a config, not a benchmark; 'dealib run"),
        (["wrinkling", "--kind", "code"], "none of these benchmarks is of the kind 'code'"),
        (["--kind", "exact"], "--kind exact: unknown"),
    ):
        with pytest.raises(ConfigError, match=re.escape(said)):
            raise call(*given, "--out", tmp_path / "out").exception
    done = CliRunner().invoke(app, ["check", str(SUITE / "wrinkling.yaml")])
    assert "a benchmark, not a config; 'dealib validate" in str(done.exception)


@pytest.mark.once
def test_the_example_of_the_page_is_a_benchmark(tmp_path):
    page = (SUITE / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.M | re.S)
    (tmp_path / "my_film.yaml").write_text(example, encoding="utf-8")
    given = read(tmp_path / "my_film.yaml")
    assert given.benchmark.numbers() == pytest.approx([0.21])
    (table,) = re.findall(r"^```text\n(.*?)^```$", page, re.M | re.S)
    for name, quantity, _ in (row.split(",") for row in table.splitlines()[1:]):
        assert quantity in references(name)
    assert Path(SUITE).name == "validation"
