"""Texts of users are texts: no formula in a table, no mathtext in a picture."""

import csv
import json
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from conftest import CONFIGS, case
from test_bad_input import BASE, dealib  # noqa: F401 - a fixture

import dealib as package
from dealib.config import load
from dealib.config.names import fault
from dealib.errors import ConfigError
from dealib.plots.labels import plain
from dealib.study.plan import read

pytestmark = pytest.mark.once  # texts
FORMULAS = ["=cmd|'/C calc'!A0", "+1+cmd|' /C calc'!A0", "-2+3+cmd|x", "@SUM(1)", " =1", "-x",
            "+", "-1 mm=2", "-1 mm|x", "-1!A0"]  # fmt: skip
CONTROLS = ["\t=1", "\r=1", "a\tb", "a\nb", "\x1b[31mred", "a\x00", "\u202eevil"]
HARMLESS = ["push", "-1 mm", "+2.5 kV", "-1", "-1e-3 N/mm^2", "-2 mm, 1 kV", "-2 mm, neo-Hookean",
            "2 = 2", "a@b", "1-2", "$_$", "日本", "<b>", "x, y; z", "'quoted'", ""]  # fmt: skip


@pytest.mark.parametrize("text", FORMULAS)
def test_what_a_spreadsheet_would_work_out_is_refused(text):
    sign = text.strip()[0]
    assert fault(text) == f"must not begin with '{sign}': spreadsheets would take it for a formula"


@pytest.mark.parametrize("text", CONTROLS)
def test_what_a_terminal_would_obey_is_refused(text):
    assert fault(text) == f"{text!r} holds a tab, a line break or another control character"


@pytest.mark.parametrize("text", HARMLESS)
def test_other_texts_are_welcome(text):
    assert fault(text) == ""


def told(path, of):
    with pytest.raises(ConfigError) as caught:
        of(path)
    return str(caught.value).removeprefix(f"{path}:").splitlines()[0]


def test_a_stage_that_is_a_formula(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text(BASE.replace("{stage: push", "{stage: \"=cmd|'/C calc'!A0\""))
    assert told(path, load) == (
        "21:13: program.1.stage: must not begin with '=': spreadsheets would take it for a formula"
    )
    path.write_text(BASE.replace("name: case", "name: -case"))
    assert told(path, load) == "1:7: name: must begin with a letter, a digit or '_'"


STUDY = """\
name: s
title: Study
base: base.yaml
vary: {axis: {coarse: {mesh.columns: 6}, fine: {mesh.columns: 8}}}
label: "{axis}"
quantities: {F: 'end(force_N, "push")'}
windows:
  - {name: a number, value: F, low: 0, unit: N, source: a book}
"""


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("{axis: {c", '{"=axis": {c', "vary.=axis"),
        ("{coarse:", '{"@coarse":', "vary.axis.@coarse"),
        ('label: "{axis}"', 'label: "={axis}"', "vary: label '=coarse'"),
        ("name: a number", 'name: "+a"', "windows.0.name"),
        ("unit: N", 'unit: "=N"', "windows.0.unit"),
        ("source: a book", 'source: "-book"', "windows.0.source"),
    ],
)
def test_a_study_with_a_formula(tmp_path, old, new, where):
    (tmp_path / "base.yaml").write_text(BASE)
    path = tmp_path / "s.yaml"
    text = STUDY.replace("{axis}", "{=axis}") if "=axis" in new else STUDY
    assert old in text
    path.write_text(text.replace(old, new))
    assert told(path, read).split(": ", 1)[1].startswith(f"{where}: must not begin with")


def test_labels_that_are_negative_numbers_are_welcome(tmp_path):
    (tmp_path / "base.yaml").write_text(BASE)
    (tmp_path / "s.yaml").write_text(
        STUDY.replace(
            "{axis: {coarse: {mesh.columns: 6}, fine: {mesh.columns: 8}}}",
            "{axis: {program.1.mount.displacement: [-1 mm, -2 mm]}}",
        )
    )
    assert [c.label for c in read(tmp_path / "s.yaml").cases] == ["-1 mm", "-2 mm"]


# --- pictures --------------------------------------------------------------------------------


def drawn(text, **how):
    """What Matplotlib shows of a text, and whether it takes it for mathtext."""
    figure, axis = plt.subplots()
    try:
        found = axis.set_title(text, **how)
        figure.canvas.draw()
        return found._preprocess_math(found.get_text())
    finally:
        plt.close(figure)


@pytest.mark.parametrize("text", ["$_$", "$x$", "$", "a$b$c$", r"\$x\$", r"$\bad{$", "50 % of $3"])
def test_a_dollar_is_a_dollar(text):
    assert drawn(plain(text)) == (text, False)


def test_plain_text_beside_our_own_mathtext():
    shown, math = drawn(f"Field $E_R$ of {plain('$_$')}")
    assert math == "TeX" or math is True
    assert r"\$_\$" in shown


def test_no_label_is_left_out_of_a_key():
    figure, axis = plt.subplots()
    axis.plot([0, 1], label=plain("_hidden"))
    assert [t.get_text() for t in axis.legend().get_texts()] == [" _hidden"]
    plt.close(figure)


@pytest.fixture(scope="module")
def strange(tmp_path_factory):
    """A finished run whose stages have the strangest names that are allowed."""
    folder = tmp_path_factory.mktemp("strange")
    stages = [
        {"stage": "prestrain"},
        {"stage": "$_$", "mount": {"displacement": "-1 mm"}, "steps": 2},
        {"stage": r"_\bad{$", "terminal": {"voltage": ["0 V", "1 kV", "0 V"]}, "steps": 2},
    ]
    given = case("benchmark_strip", mesh__columns=6, mesh__film_rows=1, program=json.dumps(stages))
    run = package.simulate(given, folder / "$x_$")
    info = json.loads((run.directory / "run.json").read_text())
    (run.directory / "run.json").write_text(json.dumps(info | {"name": r"$\frac{$"}))
    return package.open(run.directory)


@pytest.mark.parametrize(
    "arguments",
    [
        ["report"], ["plot"], ["plot", "-y", "force_N"], ["plot", "--field", "E"],
        ["plot", "--profile", "E"], ["plot", "--revolved"], ["animate", "--out", "film.gif"],
        ["info"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_pictures_of_a_run_with_strange_names(dealib, strange, arguments):  # noqa: F811
    command, *options = arguments
    if command == "animate":
        options += ["--seconds", "0.5"]
    code, out, err = dealib(command, strange.directory, *options)
    assert (code, err) == (0, "")
    if command != "info":
        assert Path(out.splitlines()[-1]).stat().st_size > 1000


def test_two_runs_are_told_apart_by_strange_names(dealib, strange):  # noqa: F811
    code, _, err = dealib("plot", strange.directory, strange.directory, "--out", "a.png")
    assert (code, err) == (0, "")


def test_measured_data_in_a_file_with_a_strange_name(dealib, strange, tmp_path):  # noqa: F811
    (tmp_path / "$_$.csv").write_text("displacement [mm],force [N]\n-0.2,-0.01\n-0.9,-0.05\n")
    code, _, err = dealib(
        "compare", strange.directory, "$_$.csv", "--stage", "$_$", "--out", "a.png"
    )
    assert (code, err) == (0, "")
    assert (tmp_path / "a.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_study_with_strange_labels(dealib, tmp_path):  # noqa: F811
    strange = r"$\bad{$"
    small = (CONFIGS.parent / "tests" / "small.yaml").read_text()
    (tmp_path / "base.yaml").write_text(small)
    (tmp_path / "s.yaml").write_text(f"""\
name: s
title: '{strange}'
base: base.yaml
vary: {{axis: {{'{strange}': {{program.1.steps: 1}}, '_x': {{program.1.steps: 2}}}}}}
quantities: {{F: 'end(force_N, "push")', u: 'end(displacement_mm, "push")'}}
panels:
  - kind: curves
    title: '{strange}'
    x: {{value: displacement_mm, label: '{strange}'}}
    y: {{value: force_N, label: '{strange}'}}
    references: [{{label: '{strange}', x: [0], y: [0]}}]
  - {{kind: points, x: {{value: u, label: '$u'}}, y: {{value: F, label: '$'}}}}
  - {{kind: contour, field: E, label: '{strange}', stage: push, where: {{axis: '{strange}'}}}}
  - {{kind: shapes, times: [1 s], title: '{strange}', where: {{axis: _x}}}}
windows:
  - {{name: '{strange}', value: max(F), high: 1}}
""")
    code, _, err = dealib("study", "s.yaml", "-j", "1")
    assert (code, err) == (0, ""), err
    page = (tmp_path / "runs/studies/s/gallery.html").read_text()
    assert page.count(strange) > 5
    with (tmp_path / "runs/studies/s/s.csv").open() as file:
        assert [row["case"] for row in csv.DictReader(file)] == [strange, "_x"]
