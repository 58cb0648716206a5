"""Measured curves: headers, units, branches, and how well a run meets them."""

import numpy as np
import pytest
from typer.testing import CliRunner

from dealib.cli.app import app
from dealib.data.branches import branches
from dealib.data.compare import compare
from dealib.data.measured import measured
from dealib.data.names import split_unit
from dealib.data.schema import Selection
from dealib.errors import ConfigError
from dealib.plots.compare import draw_comparison

COLUMNS = (
    "time_s",
    "displacement_mm",
    "force_N",
    "voltage_kV",
    "capacitance_pF",
    "elastic_energy_mJ",
    "field_max_MV_per_m",
    "thickness_stretch_min",
    "newton_iterations",
)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("force_N", ("force", "N")),
        ("Force [mN]", ("force", "mN")),
        ("field max (V/um)", ("field_max", "V/um")),
        ("field_max_MV_per_m", ("field_max", "MV/m")),
        ("elastic_energy_mJ", ("elastic_energy", "mJ")),
        ("thickness_stretch_min", ("thickness_stretch_min", "")),
        ("newton_iterations", ("newton_iterations", "")),
        ("displacement", ("displacement", "")),
    ],
)
def test_headers(header, expected):
    assert split_unit(header) == expected


@pytest.mark.parametrize(
    "text",
    [
        "displacement [m],force [mN]\n-0.001,-100\n-0.002,-250\n",
        "# a note\ndisplacement_um;Force (N)\n-1000;-0,1\n\n-2000;-0,25\n",
        "displacement (mm)\tforce [kgf]\n-1\t-0.0101971621\n-2\t-0.0254929053\n",
    ],
)
def test_units_and_delimiters(tmp_path, text):
    (tmp_path / "data.csv").write_text(text)
    found = measured(tmp_path / "data.csv", COLUMNS)
    assert (found.x, found.curves) == ("displacement_mm", ["force_N"])
    assert found.columns["displacement_mm"] == pytest.approx([-1, -2])
    assert found.columns["force_N"] == pytest.approx([-0.1, -0.25])


def test_columns_by_other_names(tmp_path):
    (tmp_path / "data.csv").write_text("no,Load cell [mN],u [mm]\n1,-100,-1\n2,-250,-2\n")
    names = {"force": "Load cell [mN]", "displacement": "u [mm]"}
    wanted = Selection(file="data.csv", columns=names, x="displacement")
    found = measured(tmp_path / "data.csv", COLUMNS, wanted)
    assert found.x == "displacement_mm"
    assert found.columns["force_N"] == pytest.approx([-0.1, -0.25])


GOOD = "displacement [mm],force [N]\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ": the file is empty"),
        (GOOD + "1,2\n", ": expected a header line and at least two lines of numbers"),
        (GOOD + "1,2\n1\n", ": fewer than two rows have numbers for x and a curve"),
        (GOOD + "1,2\n1,2,3\n", ":1: 2 headers for 3 columns of numbers; a header with a comma or a "
         "blank in it needs quotes, numbers with decimal commas another delimiter"),
        (GOOD + "1,2\n1,x\n1,3\n", ":3: force [N]: 'x' is no number"),
        (GOOD + "1,nan\n1,2\n", ": fewer than two rows have numbers for x and a curve"),
        ("displacement,force [N]\n1,2\n3,4\n",
         ": column 'displacement' has no unit; write 'displacement [mm]', here or as columns: "
         "{displacement: 'displacement [mm]'}"),
        ("displacement [mm],farce [N]\n1,2\n3,4\n",
         ": column 'farce [N]' is no quantity of a run; did you mean 'force'?; name those that "
         "are (columns) or leave it out (ignore)"),
        ("displacement [mm],force [kV]\n1,2\n3,4\n",
         ": column 'force [kV]': expected a unit such as 'N'; 'kV' is not a unit of that kind"),
        ("displacement [mm],force [Nn]\n1,2\n3,4\n",
         ": column 'force [Nn]': expected a unit such as 'N'; 'Nn' is no unit"),
        ("force [N]\n1\n3\n", ": a curve needs two columns, x and y"),
        ("time [s],displacement [mm],force [N],force [mN]\n1,2,3,4\n3,4,5,6\n",
         ": columns 'force [N]' and 'force [mN]' are both force: name one (columns) or leave one "
         "out (ignore)"),
    ],
)  # fmt: skip
def test_bad_data(tmp_path, text, expected):
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(ConfigError) as error:
        measured(path, COLUMNS)
    assert str(error.value) == f"{path}{expected}"


def measured_of(tmp_path, x, y):
    lines = "".join(f"{a!r},{b!r}\n" for a, b in zip(map(float, x), map(float, y), strict=True))
    (tmp_path / "data.csv").write_text(GOOD + lines)
    return measured(tmp_path / "data.csv", COLUMNS)


def test_branches_ignore_noise():
    x = np.concatenate([np.linspace(0, 1, 21), np.linspace(0.95, 0, 20), np.linspace(0.05, 1, 20)])
    noisy = x + 0.02 * (-1) ** np.arange(len(x))
    for values in (x, noisy, -x):
        ends = [b.stop for b in branches(values)]
        assert ends == pytest.approx([21, 41, 61], abs=2)
    assert branches(np.ones(4)) == [slice(0, 4)]


def hysteresis():
    """A run that loads along F = u and unloads along F = u - 0.2 u (1 - u), with a hold between."""
    up, down = np.linspace(0, 1, 11), np.linspace(1, 0, 11)[1:]
    u = np.concatenate([up, [1.0], down])
    F = np.concatenate([up, [1.0], down - 0.2 * down * (1 - down)])
    stage = ["load"] * 11 + ["hold"] + ["unload"] * 10
    return {"displacement_mm": u, "force_N": F, "stage": stage}


def test_loading_and_unloading_are_told_apart(tmp_path):
    run = hysteresis()
    x = np.array([0.1, 0.5, 0.9, 0.9, 0.5, 0.1])
    y = np.array([0.1, 0.5, 0.9, 0.882, 0.45, 0.082])
    (found,) = compare(run, measured_of(tmp_path, x, y))
    assert found.computed == pytest.approx(y, abs=1e-12)
    assert (found.rmse, found.r2) == (pytest.approx(0, abs=1e-12), pytest.approx(1))
    # without its unloading, the run's only curve serves for both
    only = {k: v[:11] for k, v in run.items()}
    (found,) = compare(only, measured_of(tmp_path, x, y))
    assert found.computed == pytest.approx(x, abs=1e-12)
    assert found.of_branch(1).rmse == pytest.approx(np.sqrt((0.018**2 * 2 + 0.05**2) / 3))


def test_a_branch_begins_where_the_abscissa_leaves_its_rest(tmp_path):
    """Loaded at 0 V, then a voltage cycle: the force at 0 V is that under the load."""
    voltage = np.array([0, 1e-15, 0, 1, 2, 1, 0.0])
    force = np.array([0, -0.1, -0.3, -0.28, -0.2, -0.28, -0.3])
    run = {"voltage_kV": voltage, "force_N": force, "stage": ["load"] * 3 + ["cycle"] * 4}
    path = tmp_path / "data.csv"
    path.write_text("voltage [kV],force [N]\n0,-0.3\n1,-0.28\n2,-0.2\n")
    (found,) = compare(run, measured(path, ["voltage_kV", "force_N"]))
    assert found.computed == pytest.approx([-0.3, -0.28, -0.2], abs=1e-12)
    assert found.rmse == pytest.approx(0, abs=1e-12)


def test_the_picture_shows_the_run_between_the_measured_points(tmp_path, monkeypatch):
    run = hysteresis()
    x, y = np.array([0.1, 0.9, 0.5, 0.1]), np.array([0.1, 0.9, 0.45, 0.082])
    (found,) = compare(run, measured_of(tmp_path, x, y))
    loading, unloading = found.curves
    assert loading[0, [0, -1]].tolist() == unloading[0, [0, -1]].tolist() == [0.1, 0.9]
    assert loading[1] == pytest.approx(loading[0], abs=1e-12)
    u = unloading[0]
    assert unloading[1] == pytest.approx(u - 0.2 * u * (1 - u), abs=2e-4)
    assert [len(found.of_branch(k).curves) for k in (0, 1)] == [1, 1]
    figures = []
    monkeypatch.setattr("dealib.plots.compare.save", lambda figure, _: figures.append(figure))
    draw_comparison([found], tmp_path / "a.png")
    above, below = figures[0].axes
    drawn = [line for line in above.lines if len(line.get_xdata()) > len(x)]
    assert [line.get_ydata().tolist() for line in drawn] == [c[1].tolist() for c in found.curves]
    assert below.get_ylabel() == "computed −\nmeasured (N)"


def test_rmse_and_r2_by_hand(tmp_path):
    run = {"displacement_mm": [0.0, 2.0], "force_N": [0.0, 4.0], "stage": ["a", "a"]}
    (found,) = compare(run, measured_of(tmp_path, [0.5, 1.0, 1.5], [1.1, 1.9, 3.1]))
    assert found.rmse == pytest.approx(0.1)
    mean = 6.1 / 3
    total = (1.1 - mean) ** 2 + (1.9 - mean) ** 2 + (3.1 - mean) ** 2
    assert found.r2 == pytest.approx(1 - 0.03 / total)


def test_nothing_is_made_up_beyond_the_run(tmp_path):
    run = hysteresis()
    data = measured_of(tmp_path, [0.5, 1.0, 1.5], [0.5, 1.0, 1.5])
    (found,) = compare(run, data, "load")
    assert found.inside.tolist() == [True, True, False]
    (found,) = compare(run, data, "load", extrapolate=True)
    assert found.computed == pytest.approx([0.5, 1.0, 1.5])
    assert found.beyond.tolist() == [False, False, True]
    with pytest.raises(ConfigError, match=r"spans 5 .. 6, the run 0 .. 1: no point to compare"):
        compare(run, measured_of(tmp_path, [5, 6], [1, 2]))
    with pytest.raises(ConfigError, match="the run has no stage 'pull'; it has load, hold, unload"):
        compare(run, data, "pull")


def test_compare_command(strip_run, tmp_path, monkeypatch):
    """A run against its own history in other units, with a known offset on one curve."""
    monkeypatch.chdir(tmp_path)
    h = strip_run.history.iloc[:13]
    lines = [
        f"{u / 25.4!r},{1e3 * F + 2!r},{C!r}"
        for u, F, C in zip(h["displacement_mm"], h["force_N"], h["capacitance_pF"], strict=True)
    ]
    head = "displacement [inch],force_mN,capacitance [pF]"
    (tmp_path / "data.csv").write_text("\n".join([head, *lines]))

    def call(*arguments):
        return CliRunner().invoke(app, ["compare", str(strip_run.directory), *arguments])

    done = call("data.csv", "--out", "picture.png")
    assert done.exit_code == 0
    force, capacitance = done.output.splitlines()[2:4]
    assert force.split()[:4] == ["force_N", "13", "0.002", "N"]
    assert capacitance.split()[0] == "capacitance_pF"
    assert float(capacitance.split()[-1]) == 1
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
    for suffix, head in ((".svg", b"<?xml"), (".pdf", b"%PDF")):
        assert call("data.csv", "--out", f"picture{suffix}").exit_code == 0
        assert (tmp_path / f"picture{suffix}").read_bytes().startswith(head)
    for out, said in (
        ("picture.png", "picture.png exists; choose another --out, or --overwrite it"),
        ("picture.bmp", "--out picture.bmp: the name must end in .png, .svg, .pdf"),
        ("no/picture.png", "no/picture.png: there is no folder no"),
    ):
        error = call("data.csv", "--out", out).exception
        assert isinstance(error, ConfigError)
        assert str(error) == said
