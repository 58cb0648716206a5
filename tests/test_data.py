"""Measured curves: headers, units, branches, and how well a run meets them."""

import numpy as np
import pytest
from typer.testing import CliRunner

from dealib.cli.app import app
from dealib.data.branches import branches
from dealib.data.branches import noise as noise_of
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
        (GOOD + "1,2\n1,2,3\n", ":1: 2 headers for 3 columns of numbers; put headers that contain "
         "a comma or a blank in quotes, and separate numbers with decimal commas by another "
         "delimiter"),
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
         ": column 'force [Nn]': expected a unit such as 'N'; 'Nn' is no unit; "
         "did you mean 'N'?"),
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


# --- which columns, and what is done to them -----------------------------------------------------


def chosen(tmp_path, text, history=COLUMNS, **keys):
    path = tmp_path / "data.csv"
    path.write_text(text)
    wanted = Selection.model_validate({"file": "data.csv", **keys})
    return measured(path, history, wanted)


def test_a_unit_is_given_where_the_file_has_none(tmp_path):
    text = "t,Load,Way\n0,100,-1\n1,200,-2\n"
    names = {"force": "Load [mN]", "displacement": "column 3 [mm]"}
    with pytest.raises(ConfigError, match=r"no column 'column 3 \[mm\]'; known: t, Load, Way"):
        chosen(tmp_path, text, columns=names)
    names["displacement"] = "Way [um]"
    found = chosen(tmp_path, text, columns=names, x="displacement")
    assert found.columns["force_N"].tolist() == [0.1, 0.2]
    assert found.columns["displacement_mm"].tolist() == [-0.001, -0.002]
    assert "force_N from 'Load [mN]', displacement_mm from 'Way [um]'" in found.account


def test_curves_side_by_side_keep_their_own_length(tmp_path):
    text = "a,,b,\nX,Y,X,Y\n0,0,0,0\n1,10,2,30\n2,20,,\n"
    first = chosen(tmp_path, text, columns={"voltage": "a X [kV]", "force": "a Y [N]"})
    second = chosen(tmp_path, text, columns={"voltage": "b X [kV]", "force": "b Y [N]"})
    assert first.columns["force_N"].tolist() == [0, 10, 20]
    assert second.columns["force_N"].tolist() == [0, 30]
    assert "1 row without a point left out" in second.account


def test_what_is_missing_of_one_curve_is_kept_of_the_other(tmp_path):
    """A logger that writes its channels in turn."""
    text = "voltage [kV],force [N],displacement [mm]\n0,1,\n1,,-1\n2,3,\n3,OL,-3\n4,5,9.9E37\n"
    found = chosen(tmp_path, text)
    assert found.points == 5
    run = {"voltage_kV": np.arange(5.0), "stage": ["a"] * 5}
    run |= {"force_N": 1 + np.arange(5.0), "displacement_mm": -np.arange(5.0)}
    force, displacement = compare(run, found)
    assert (force.x.tolist(), displacement.x.tolist()) == ([0, 2, 4], [1, 3])
    assert (force.rmse, displacement.rmse) == (pytest.approx(0), pytest.approx(0))


def test_time_is_no_curve_over_something_else(tmp_path):
    text = "time [s],displacement [mm],force [N]\n0,-1,1\n1,-2,2\n"
    found = chosen(tmp_path, text, x="displacement")
    assert found.curves == ["force_N"]
    assert list(found.columns) == ["displacement_mm", "time_s", "force_N"]  # for who needs them
    assert chosen(tmp_path, text).curves == ["displacement_mm", "force_N"]
    with pytest.raises(ConfigError, match="a curve needs two columns, x and y, that are no times"):
        chosen(tmp_path, text, x="displacement", ignore=("force [N]",))


def test_two_quantities_of_one_column_are_refused():
    names = {"displacement": "Load cell [mN]", "force": "Load cell [mN]"}
    with pytest.raises(ValueError, match=r"'Load cell \[mN\]' is displacement already"):
        Selection.model_validate({"file": "a.csv", "columns": names})


def test_unknown_columns_are_left_out_by_name(tmp_path):
    text = "No.,voltage (ch 1) [kV],force [N],Temp [degC]\n1,0,1,20\n2,1,2,21\n"
    found = chosen(tmp_path, text, ignore=("No.", "Temp"))
    assert (found.x, found.curves) == ("voltage_kV", ["force_N"])
    with pytest.raises(ConfigError, match=r"column 'No\.' is no quantity of a run"):
        chosen(tmp_path, text)


RAMP = "time [s],displacement [mm],force [N]\n" + "".join(
    f"{0.1 * i:.1f},{0.05 * i + 1},{0.01 * i + 0.2}\n" for i in range(21)
)


def test_a_column_is_prepared_in_the_order_that_is_documented(tmp_path):
    prepare = {
        "displacement": {"sign": -1, "zero": "start"},
        "force": {"factor": 2, "offset": "100 mN", "zero": 3, "range": ["0 N", "150 mN"]},
    }
    found = chosen(tmp_path, RAMP, x="displacement", prepare=prepare)
    i = np.arange(21)
    force = 2 * (0.01 * i + 0.2) + 0.1
    force -= force[:3].mean()  # at row 1
    kept = (force >= 0) & (force <= 0.15)
    assert kept.sum() == 8
    assert found.columns["force_N"] == pytest.approx(force[kept])
    assert found.columns["displacement_mm"] == pytest.approx(-0.05 * i[kept])
    assert "displacement_mm times -1; zero of displacement_mm at -1 mm; force_N times 2; " in (
        found.account
    )
    assert "13 rows outside a range left out" in found.account


def test_a_shift_moves_a_column_in_time(tmp_path):
    found = chosen(tmp_path, RAMP, prepare={"force": {"shift": "250 ms"}})
    t, force = found.columns["time_s"], found.columns["force_N"]
    late = np.isfinite(force)
    assert t[late][0] == pytest.approx(0.3)  # nothing was measured before
    assert force[late] == pytest.approx(0.2 + 0.1 * (t[late] - 0.25))
    with pytest.raises(ConfigError, match="a shift needs a column of times that increase"):
        chosen(tmp_path, RAMP.replace("time [s]", "voltage [kV]"),
               prepare={"force": {"shift": "1 s"}})  # fmt: skip


def test_outliers_are_left_out_and_noise_is_smoothed(tmp_path):
    rng = np.random.default_rng(7)
    t = np.linspace(0, 10, 500)
    force = np.sin(t) + rng.normal(0, 0.02, 500)
    spikes = [50, 200, 333, 334, 470]
    force[spikes] += 0.5
    lines = "".join(f"{a:.4f},{b:.6f}\n" for a, b in zip(t, force, strict=True))
    prepare = {"force": {"outliers": 6, "smooth": 21}}
    found = chosen(tmp_path, "time [s],force [N]\n" + lines, prepare=prepare)
    t, smooth = found.columns["time_s"], found.columns["force_N"]
    assert len(t) == 495
    assert "5 outliers of force_N left out; force_N smoothed over 21 rows" in found.account
    # the filter's window of 21 rows leaves 0.31 of the noise, by its sum of squared weights
    assert np.std((smooth - np.sin(t))[10:-10]) == pytest.approx(0.02 * 0.327, rel=0.25)


def test_means_over_the_plateaus_of_a_switched_voltage(tmp_path):
    rng = np.random.default_rng(3)
    steps = np.repeat([0.0, 1.0, 2.0, 1.0, 0.0], 40)
    since = np.tile(np.arange(40), 5)
    creep = -0.1 * steps**2 * (1 - np.exp(-since / 4))
    text = "".join(
        f"{0.1 * i:.1f},{v + rng.normal(0, 1e-3):.5f},{u + rng.normal(0, 1e-4):.6f}\n"
        for i, (v, u) in enumerate(zip(steps, creep, strict=True))
    )
    text = "time [s],voltage [kV],displacement [mm]\n" + text
    found = chosen(tmp_path, text, x="voltage", plateaus={"of": "voltage", "settle": 0.75})
    assert found.columns["voltage_kV"] == pytest.approx([0, 1, 2, 1, 0], abs=1e-3)
    assert found.columns["displacement_mm"] == pytest.approx([0, -0.1, -0.4, -0.1, 0], abs=2e-4)
    with pytest.raises(ConfigError, match="force_N has no plateaus of at least 3 rows"):
        chosen(tmp_path, RAMP, plateaus={"of": "force"})


def test_many_rows_become_few_without_a_bias(tmp_path):
    rng = np.random.default_rng(11)
    u = np.concatenate([np.linspace(0, 1, 3000), np.linspace(1, 0, 3000)])
    x, y = u + rng.normal(0, 2e-3, 6000), u**2 + rng.normal(0, 0.02, 6000)
    rows = "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(x, y, strict=True))
    found = chosen(tmp_path, "displacement [mm],force [N]\n" + rows, resample=60)
    u, force = found.columns["displacement_mm"], found.columns["force_N"]
    assert len(u) == pytest.approx(60, abs=2)
    # noise of a mean of 100 rows, with that of x where the slope is 2 u
    assert np.std(force - u**2) == pytest.approx(0.002, rel=0.4)
    assert abs(np.mean(force - u**2)) < 1e-3
    assert [b.stop for b in branches(u)] == pytest.approx([30, 60], abs=2)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"prepare": {"farce": {}}}, "prepare: no column 'farce'; did you mean 'force'?"),
        ({"plateaus": {"of": "volts"}}, "plateaus.of: no column 'volts'; known: "
         "time, displacement, force"),
        ({"prepare": {"force": {"offset": "1 mm"}}}, "expected a unit such as 'N'; 'mm' is not a "
         "unit of that kind"),
        ({"prepare": {"force": {"smooth": 31}}}, "21 values are too few to smooth over 31 rows"),
        ({"x": "voltage"}, "a curve needs a column 'voltage' and one more"),
        ({"prepare": {"force": {"range": ["5 N", "6 N"]}}}, "fewer than two rows have numbers for "
         "x and a curve"),
    ],
)  # fmt: skip
def test_impossible_preparations_say_so(tmp_path, keys, said):
    with pytest.raises(ConfigError) as error:
        chosen(tmp_path, RAMP, **keys)
    assert str(error.value) == f"{tmp_path / 'data.csv'}: {said}"


# --- turning points ------------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "noise"), [(200, 0.02), (2000, 0.03), (200_000, 0.04)])
def test_noise_makes_no_branches(rows, noise):
    rng = np.random.default_rng(rows)
    up = np.linspace(0, 1, rows)
    for x, count in ((up, 1), (np.concatenate([up, up[::-1], up]), 3)):
        noisy = x + rng.normal(0, noise, len(x))
        assert len(branches(noisy)) == count
        assert len(branches(-noisy)) == count
        assert noise_of(noisy) == pytest.approx(noise, rel=0.25)


def test_few_points_of_real_cycles_are_branches():
    assert len(branches(np.array([0, 1, 0, 1, 0.0]))) == 4
    assert len(branches(np.sin(np.arange(40)))) == pytest.approx(40 / np.pi, abs=1.5)
    assert len(branches(np.array([0, 0.5, 1, 0.9, 1.4, 2]), turn=0.2)) == 1
    assert len(branches(np.array([0, 0.5, 1, 0.9, 1.4, 2]), turn=0.05)) == 3


def test_turning_points_of_many_rows_are_those_of_all_rows():
    x = np.sin(np.linspace(0, 20, 300_001))
    turns = [b.stop - 1 for b in branches(x)][:-1]
    exact = (np.arange(6) + 0.5) * np.pi / 20 * 300_000
    assert turns == pytest.approx(exact[: len(turns)], abs=1)
    assert len(turns) == 6


def test_what_would_bring_points_into_the_range_is_told(tmp_path):
    run = hysteresis()
    for x, hint in (
        ([-0.2, -0.9], "sign: -1"),
        ([200, 900], "factor: 1e-3"),
        ([5.0, 5.4, 5.9], "zero: start"),
    ):
        with pytest.raises(ConfigError) as error:
            compare(run, measured_of(tmp_path, x, np.ones(len(x))))
        hint = f"with prepare: {{displacement: {{{hint}}}}} 100% would lie inside"
        assert str(error.value).endswith(hint)


def test_a_cyclic_test_is_printed_in_few_lines(tmp_path, strip_run):
    u = -1 - np.sin(np.linspace(0, 400, 8000))
    rows = "".join(f"{a:.5f},{0.3 * a:.5f}\n" for a in u)
    (tmp_path / "cycles.csv").write_text(GOOD + rows)
    path = str(tmp_path / "cycles.csv")
    done = CliRunner().invoke(app, ["compare", str(strip_run.directory), path])
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert len(lines) == 12
    assert lines[-1].strip() == "and 120 more"


def test_compare_takes_several_files_and_says_how_each_was_read(tmp_path, strip_run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    h = strip_run.history.iloc[1:13]
    pairs = list(zip(h["displacement_mm"], h["force_N"], strict=True))
    text = "Weg;Kraft;Nr.\nmm;mN;\n"
    text += "".join(f"{-u:.6f};{-1e3 * F:.4f};{i}\n".replace(".", ",") for i, (u, F) in
                    enumerate(pairs))  # fmt: skip
    (tmp_path / "a.csv").write_text(text, encoding="utf-16")
    (tmp_path / "b.csv").write_text(text)

    def call(*arguments):
        return CliRunner().invoke(app, ["compare", str(strip_run.directory), *arguments])

    files = ("a.csv", "b.csv", "--out", "both.png")
    columns = ("--column", "displacement=Weg", "--column", "force=Kraft")
    signs = ("--set", "prepare.displacement.sign=-1", "--set", "prepare.force.sign=-1")
    done = call(*files, *columns, *signs)
    assert done.exit_code == 0, done.exception
    assert done.output.count("force_N  12      ") == 2
    assert "a.csv: UTF-16; columns separated by ';'; decimal mark ','" in done.output
    assert all(float(line.split()[-1]) > 0.999999 for line in done.output.splitlines()
               if line.startswith("force_N "))  # fmt: skip
    assert (tmp_path / "both.png").is_file()
    assert "no point to compare; with prepare: {displacement: {sign: -1}}" in str(
        call(*files[:2], *columns).exception
    )
    for arguments, said in (
        (("--set", "prepare.force.sgn=1"), "prepare.force.sgn: unknown key; did you mean 'sign'?"),
        (("--set", "x"), "--set x: expected KEY=VALUE, such as prepare.force.sign=-1"),
        (("--column", "force"), "--column: expected QUANTITY=HEADER, such as force='Load [N]'"),
        (("--ignore", "Weg"), "b.csv: column 'Kraft [mN]' is no quantity of a run"),
    ):
        error = call("b.csv", *arguments).exception
        assert isinstance(error, ConfigError)
        assert str(error).startswith(said)


def test_data_command_shows_what_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("Zeit;Kraft $x\ns;N\n0,5;1,5\n0,6;OL\n0,7;-2,5\n")
    done = CliRunner().invoke(app, ["data", "a.csv"])
    assert done.exit_code == 0, done.exception
    assert done.output.splitlines() == [
        "a.csv: UTF-8; columns separated by ';'; decimal mark ','; header in line 2; "
        "3 rows from line 3 on; 1 overload cell",
        "column    unit  numbers  first  least  largest",
        "Zeit      s     3        0.5    0.5    0.7",
        "Kraft $x  N     2        1.5    -2.5   1.5",
        "a-data.png",
    ]
    assert (tmp_path / "a-data.png").read_bytes().startswith(b"\x89PNG")
    again = CliRunner().invoke(app, ["data", "a.csv"])
    assert len(again.output.splitlines()) == 4
    assert str(again.exception) == "a-data.png exists; choose another --out, or --overwrite it"
    (tmp_path / "b.csv").write_text("t [s];U [V]\n1;1.250\n2;2.250\n")
    error = CliRunner().invoke(app, ["data", "b.csv"]).exception
    assert "'1.250' is 1.25 with decimals or 1250 with a thousands mark" in str(error)
    done = CliRunner().invoke(app, ["data", "b.csv", "--set", "format.decimal=,"])
    assert done.output.splitlines()[3].split() == ["U", "V", "2", "1250", "1250", "2250"]
