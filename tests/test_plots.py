"""Curves, contours, profiles, animations and the revolved view, from result files."""

import shutil
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case, thinned
from matplotlib.image import imread
from PIL import Image
from typer.testing import CliRunner

import dealib
from dealib.cli.app import app
from dealib.device.kinematics import AXISYMMETRIC
from dealib.errors import ConfigError, DealibError, PlatformError
from dealib.plots import animation, render, style, views
from dealib.plots.contours import magnification, scale
from dealib.plots.curves import curves, overview
from dealib.plots.labels import label
from dealib.plots.limits import BEYOND
from dealib.plots.profiles import lines
from dealib.plots.shape import LayerShape, drawn, typical_step
from dealib.results.elements import Cell
from dealib.results.fields import fields
from dealib.results.quantities import SURFACE_CHARGE, quantities, quantity
from dealib.results.sampling import LayerStrip, locate, reference_grid

pytestmark = pytest.mark.once  # of stored results


def invoke(*arguments):
    """Standard output of a command; its error is raised."""
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    if result.exception is not None:
        raise result.exception
    return result.stdout.strip()


@pytest.fixture(scope="module")
def shape(strip_run):
    """The last step: 3 mm down, 2.5 kV."""
    return LayerShape(strip_run)


@pytest.mark.parametrize(
    ("column", "text"),
    [
        ("time_s", "Time (s)"),
        ("field_max_MV_per_m", "Peak field (MV/m)"),
        ("charge_uC", "Charge (µC)"),
        ("thickness_stretch_min", "Smallest thickness stretch"),
        ("newton_iterations", "Newton iterations"),
        ("tip_pressure_kPa", "Tip pressure (kPa)"),
        ("density_mC_per_m2", "Density (mC/m²)"),
        ("displacement_mm.disc.X", "Displacement of disc.X (mm)"),
        ("capacitance_pF.left.right", "Capacitance of left and right (pF)"),
        ("capacitance_pF.left.left", "Capacitance of left (pF)"),
    ],
)
def test_columns_have_friendly_labels_with_units(column, text):
    assert label(column) == text


def test_curves_show_the_history(strip_run):
    with style.theme():
        figure = curves([strip_run, strip_run], "displacement_mm", ["force_N", "voltage_kV"])
        force, voltage = figure.axes
        assert (force.get_ylabel(), voltage.get_xlabel()) == ("Force (N)", "Displacement (mm)")
        red = [line for line in force.lines if line.get_color() == BEYOND["beyond"]]  # no tension
        lines = [line for line in force.lines if line not in red]
        assert len(lines) == len(red) == 2
        assert lines[1].get_xdata()[12] == pytest.approx(-3)
        assert lines[1].get_ydata()[-1] == pytest.approx(-0.81331, rel=1e-4)
        assert np.isnan(red[1].get_ydata()[:13]).all()


def test_no_stable_run_is_drawn_as_the_unstable_parts_of_another(strip_run, tmp_path):
    """Four runs overlaid, one of which is unstable: its short dashes are nobody else's."""
    runs = []
    for k in range(4):
        shutil.copytree(strip_run.directory, tmp_path / f"run{k}")
        runs.append(dealib.open(tmp_path / f"run{k}"))
    for name, value in (("unstable_modes", 1), ("limit_point", 0), ("bifurcation", 0)):
        runs[0].history[name] = value
    lines = curves(runs, "displacement_mm", ["force_N"]).axes[0].lines
    on = [line._unscaled_dash_pattern[1] for line in lines if len(line.get_xdata()) > 2]
    longest = [max(pattern[::2], default=np.inf) if pattern else np.inf for pattern in on]
    assert longest[0] == 2
    assert min(longest[1:]) > 3


def test_overview_is_two_by_two_with_inputs_in_time(strip_run):
    with style.theme(dark=True) as look:
        figure = overview([strip_run])
        labels = [(a.get_xlabel(), a.get_ylabel()) for a in figure.axes]
        assert figure.get_facecolor() == pytest.approx((0x15 / 255, 0x19 / 255, 0x1E / 255, 1))
        assert look.paper == "#15191e"
    assert ("Displacement (mm)", "Capacitance (pF)") in labels
    assert ("Voltage (kV)", "Peak field (MV/m)") in labels
    assert ("Time (s)", "Voltage (kV)") in labels
    (legend,) = figure.legends
    assert legend.get_title().get_text() == strip_run.title == "strip (benchmark_strip)"
    (told,) = legend.get_texts()
    assert told.get_text() == "beyond: wrinkling 1.112, pull-in 1.148 (1 is the limit)"
    assert told.get_color() == BEYOND["beyond"]


def test_pictures_come_in_three_formats_and_two_themes(strip_run, tmp_path):
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        file = tmp_path / f"a{suffix}"
        invoke("plot", strip_run.directory, "-y", "force_N", "--out", file)
        assert file.read_bytes().startswith(start)
    light = invoke("plot", strip_run.directory)
    dark = invoke("plot", strip_run.directory, "--dark")
    assert light == str(strip_run.directory / "plots" / "overview.png")
    assert imread(light)[0, 0, :3] == pytest.approx(1)
    assert imread(dark)[0, 0, :3] == pytest.approx(np.array([0x15, 0x19, 0x1E]) / 255, abs=0.01)
    assert invoke("plot", strip_run.directory) == light  # its own files are replaced


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-y", "force"], "no column 'force' to plot; did you mean 'force_N'?"),
        (["-y", "stage"], "no column 'stage' to plot"),
        (["-x", "force_N"], "-x force_N: give -y, the columns to draw against it"),
        (["--field", "S_RZR"], "there is no field 'S_RZR' to draw; did you mean 'S_RZ'?"),
        (["--field", "D_n"], "there is no field 'D_n' to draw; did you mean"),
        (["--profile", "Dn"], "there is no profile 'Dn' to draw; did you mean 'D_n'?"),
        (["--field", "E", "--step", "99"], "the fields of step 99 are not stored; stored: 0 .. 17"),
        (["--step", "3"], "--step belongs to --field, --profile or --revolved"),
        (["--field", "E", "-y", "force_N"], "give one of: -x and -y (curves), --field, --profile"),
        (["--out", "a.jpg"], "--out a.jpg: the name must end in .png, .svg, .pdf"),
        (["--out", "no/a.png"], "no/a.png: there is no folder no"),
    ],
)
def test_mistakes_are_explained(strip_run, arguments, message):
    with pytest.raises(DealibError, match=r"\w") as caught:
        invoke("plot", strip_run.directory, *arguments)
    assert message in str(caught.value)
    assert caught.value.exit_code == 2


def test_nothing_is_overwritten_unless_told(strip_run, tmp_path):
    file = tmp_path / "a.png"
    file.write_text("mine")
    with pytest.raises(DealibError, match="exists; choose another --out, or --overwrite it"):
        invoke("plot", strip_run.directory, "--out", file)
    assert file.read_text() == "mine"
    invoke("plot", strip_run.directory, "--out", file, "--overwrite")
    assert file.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("name", "area"), [("quadrilateral", 1.0), ("triangle", 0.5)])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_small_triangles_fill_a_cell(name, area, n):
    points, triangles = reference_grid(Cell(name, 2), n)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    areas = np.linalg.det(np.stack([b - a, c - a], axis=1)) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(area)
    assert len(np.unique(triangles)) == len(points)


@pytest.mark.parametrize("name", ["quadrilateral", "triangle"])
def test_extrapolation_from_gauss_points_is_exact_for_linear_fields(name):
    cell = Cell(name, 2)
    linear = np.array([2.0, -3.0])
    assert cell.from_gauss @ (1 + cell.gauss @ linear) == pytest.approx(1 + cell.nodes @ linear)


def test_a_homogeneous_deformation_has_homogeneous_stress(strip_run):
    points = strip_run.mesh.points
    state = np.column_stack([0.05 * points[:, 0], -0.1 * points[:, 1], points[:, 1]])
    found = fields(strip_run.config, strip_run.mesh, state)
    film = np.unique(strip_run.mesh.cells[strip_run.mesh.in_region("film")])
    S = found["second_pk_stress"][film]
    assert np.ptp(S, axis=0).max() < 1e-9
    assert found["E"][film, 1] == pytest.approx(-1 / 0.9)
    assert found["J"][film] == pytest.approx(1.05**2 * 0.9)


def test_sampling_follows_second_order_cells(shape):
    R, Z = shape.mesh.points.T
    nodal = R**2 + 40 * R * Z - 300 * Z**2
    x, z = shape.strips.points.T
    assert shape.strips(nodal) == pytest.approx(x**2 + 40 * x * z - 300 * z**2, rel=1e-12)
    film = LayerStrip(shape.mesh, "film")
    s, t = film.positions, np.linspace(0.1, 0.7, len(film.positions))
    x, z = 8.35 + 4 * s, 0.03 * (t - 0.5)
    assert film.at(nodal, s, t) == pytest.approx(x**2 + 40 * x * z - 300 * z**2, rel=1e-9)


def test_points_are_found_in_their_cells(shape):
    """Of every cell the middle and the nodes; of a point outside, the nearest cell."""
    mesh = shape.mesh
    for region in shape.layers:
        cells = mesh.in_region(region)
        found, at = locate(mesh, cells, mesh.corners[cells].mean(axis=1))
        assert found.tolist() == cells.tolist()
        assert at == pytest.approx(0.5, abs=1e-9)
        nodes = np.unique(mesh.cells[cells])
        found, at = locate(mesh, cells, mesh.points[nodes])
        N, _ = mesh.cell.shape(at)
        back = np.einsum("pn,pni->pi", N, mesh.points[mesh.cells[found]])
        assert back == pytest.approx(mesh.points[nodes], abs=1e-12)
    film = mesh.in_region("film")
    found, _ = locate(mesh, film, np.array([[13.0, 0.0141]]))
    assert mesh.corners[found[0]].max(axis=0) == pytest.approx([12.35, 0.015])


def test_the_deformed_strip_and_its_magnified_thickness(shape):
    _, middle = shape.middle
    assert middle[0] == pytest.approx([8.35, -3])
    assert middle[-1] == pytest.approx([12.35, 0], abs=1e-7)
    factor = magnification(shape)
    assert factor == 5
    assert shape.layers == ("bottom_electrode", "film", "top_electrode")
    end = np.isclose(shape.strips.points[:, 0], 12.35)
    assert np.ptp(shape.moved()[end, 1]) == pytest.approx(0.05)
    assert np.ptp(shape.moved(factor)[end, 1]) == pytest.approx(0.25)


def test_surface_charge_adds_up_to_the_charge_of_the_terminal(shape):
    total, film = {}, LayerStrip(shape.mesh, "film")
    for face in (1, -1):
        R, sigma = film.charge(shape.arrays, face)
        nodes = film.face(face)
        x = shape.mesh.points[nodes] + shape.displacement[nodes]
        along = np.linalg.norm(np.diff(x, axis=0), axis=1)
        ring = 2 * np.pi * x[:, 0] * sigma
        total[face] = float(((ring[1:] + ring[:-1]) / 2 * along).sum())
        middle = np.abs(sigma[(R > 9) & (R < 11.5)])
        assert np.all((middle > 2.6e-3) & (middle < 3.0e-3))  # C/m^2
    charge = shape.run.history["charge_uC"].iloc[-1]
    assert total[1] == pytest.approx(charge, rel=2e-3)
    assert total[-1] == pytest.approx(-charge, rel=2e-3)
    shown = lines(shape, SURFACE_CHARGE)["electrode at the top face"][1]
    assert shown == pytest.approx(1e3 * film.charge(shape.arrays, 1)[1])


def test_charge_along_a_film_that_is_not_flat(tmp_path):
    """A mesh of the user, 10 % thinner at the outer end."""
    small, columns = CONFIGS.parent / "tests" / "small.yaml", 20
    changes = {"mesh.columns": columns, "program": "[{stage: on, terminal: {voltage: 1 kV}}]"}
    path = thinned(dealib.load(small, set=changes), tmp_path / "own.msh", lambda s: 1 - 0.1 * s)
    run = dealib.simulate(dealib.load(small, set={**changes, "mesh.file": path}), tmp_path / "run")
    shape = LayerShape(run)
    for sign in (1, -1):
        R, sigma = LayerStrip(shape.mesh, "film").charge(shape.arrays, sign)
        assert len(R) == 2 * columns + 1
        ring = 2 * np.pi * R * sigma
        charge = ((ring[1:] + ring[:-1]) / 2 * np.diff(R)).sum()
        assert charge == pytest.approx(sign * run.history["charge_uC"].iloc[-1], rel=2e-3)


def test_profiles_run_along_the_film(shape):
    found = lines(shape, quantity("E", AXISYMMETRIC))
    assert list(found) == ["top face", "middle", "bottom face"]
    R, values = found["middle"]
    assert len(R) == 121
    inside = (R > 9) & (R < 11.5)
    for other in ("top face", "bottom face"):
        assert found[other][1][inside] == pytest.approx(values[inside], rel=2e-3)
    assert values[inside] == pytest.approx(2.5 / 0.0243, rel=0.05)  # V over the thinned film


def test_colour_scales_leave_singular_points_out(shape):
    E = shape.strips(quantity("E", AXISYMMETRIC).of(shape.arrays))
    found = scale(shape, E, style.LIGHT)
    assert (found.norm.vmin, found.cmap, found.extend) == (0, "viridis", "max")
    assert 105 < found.norm.vmax < E.max() - 10
    both = np.where(shape.strips.points[:, 0] > 10, 1.0, -2.0)
    found = scale(shape, both, style.LIGHT)
    ends = found.norm.vmin, found.norm.vcenter, found.norm.vmax
    assert (*ends, found.cmap) == (-2, 0, 2, "RdBu_r")
    found = scale(shape, both, style.LIGHT, quantity("pull_in_use", AXISYMMETRIC))
    ends = found.norm.vmin, found.norm.vcenter, found.norm.vmax
    assert (*ends, found.extend) == (0, 1, 2, "min")  # 1 is the limit
    near = np.where(shape.strips.points[:, 0] > 10, 1.3, 0.9)
    norm = scale(shape, near, style.LIGHT, quantity("pull_in_use", AXISYMMETRIC)).norm
    assert (norm.vmin, norm.vcenter, norm.vmax) == pytest.approx((0.7, 1, 1.3))


def test_quantities_are_drawn_only_where_they_say_something(shape):
    """No field in electrodes, no margin of theirs: there the colours are plain."""
    everywhere = [*shape.layers]
    for name, regions in (
        ("E", ["film"]), ("D_Z", ["film"]), ("maxwell_ZZ", ["film"]),
        ("wrinkling_use", ["film"]), ("tension", ["film"]),
        ("S_RR", everywhere), ("sigma_TT", everywhere), ("u", everywhere), ("phi", everywhere),
    ):  # fmt: skip
        what = quantity(name, AXISYMMETRIC)
        assert sorted(drawn(shape.run, what)) == sorted(regions), name
        z = shape.strips.points[:, 1]
        empty = np.isnan(shape.values(what))
        if regions == everywhere:
            assert not empty.any()
        else:
            assert empty[np.abs(z) > 0.0151].all()
            assert not empty[np.abs(z) < 0.0149].any()
    low = scale(shape, shape.values(quantity("E", AXISYMMETRIC)), style.LIGHT).norm.vmin
    assert low > 50  # MV/m: not the zero of the electrodes


def test_contours_show_whole_and_both_ends(shape):
    with style.theme() as look:
        figure = views.draw_field(shape, quantity("S_RR", AXISYMMETRIC), look)
        titles = [a.get_title(loc="left") for a in figure.axes[:4]]
        assert figure.axes[4].get_ylabel() == "Second Piola-Kirchhoff stress S$_{RR}$ (MPa)"
        straight, inner = figure.axes[1:3]
        assert straight.get_ylim()[0] < -25 < 25 < straight.get_ylim()[1]  # um
        assert inner.get_xlim()[0] < 8.35 < inner.get_xlim()[1] < 8.8
        assert inner.get_ylim()[0] < -3 < inner.get_ylim()[1]
    assert titles == [
        "thickness magnified 5 times",
        "straightened",
        "inner end, true scale",
        "outer end, true scale",
    ]


def test_every_field_of_the_help_can_be_drawn(shape):
    without_limits = {"breakdown_use", "locking_use", "stability_use", "stretch_use"}
    for what in quantities(AXISYMMETRIC).values():
        if what.name in without_limits:
            with pytest.raises(ConfigError, match="its config sets no limit"):
                what.of(shape.arrays)
            continue
        if what.name == "wrinkling" or what.is_mode:
            why = "stability is lost" if what.is_mode else "physics.wrinkling: tension_field only"
            with pytest.raises(ConfigError, match=why):
                what.of(shape.arrays)
            continue
        values = what.of(shape.arrays)
        assert values.shape == (len(shape.mesh.points),)
        assert np.isfinite(values).all()
    assert quantity("D", AXISYMMETRIC).of(shape.arrays).max() == pytest.approx(
        1e3 * 3 * 8.8541878128e-6 * quantity("E", AXISYMMETRIC).of(shape.arrays).max(), rel=1e-9
    )


def test_field_and_profile_files(strip_run):
    field = invoke("plot", strip_run.directory, "--field", "S_ZZ", "--step", "12", "--dark")
    profile = invoke("plot", strip_run.directory, "--profile", "D_n", "--profile", "S_RR")
    assert field.endswith("plots/field-S_ZZ-step00012-dark.png")
    assert profile.endswith("plots/profile-D_n+S_RR-step00017.png")
    assert imread(field).std() > 0.05
    assert imread(profile).std() > 0.05


def test_animation_as_mp4(strip_run):
    path = invoke("animate", strip_run.directory, "--seconds", "0.5")
    assert path.endswith("plots/animation-S_RR+E.mp4")
    with av.open(path) as film:
        stream = film.streams.video[0]
        pictures = [f.to_ndarray(format="rgb24").astype(float) for f in film.decode(video=0)]
    assert (stream.codec.name, stream.width, stream.height) == ("h264", 1280, 720)
    assert len(pictures) == 10
    assert np.abs(pictures[-1] - pictures[0]).max() > 100


def test_an_animation_tells_time_stage_and_inputs(strip_run):
    with style.theme() as look:
        for _ in animation.frames(strip_run, [quantity("E", AXISYMMETRIC)], look, 3):
            pass
        figure = style.plt.gcf()
        told = figure._suptitle.get_text()
    assert told.split() == [
        *("strip", "(benchmark_strip)", "t", "=", "17.00", "s,", "actuate"),
        *("−3", "mm,", "−0.813", "N,", "2.5", "kV"),
    ]


def test_animation_as_gif(strip_run, tmp_path):
    path = tmp_path / "a.gif"
    invoke("animate", strip_run.directory, "--seconds", "0.5", "--out", path, "--dark")
    with Image.open(path) as film:
        assert film.n_frames == 5
        assert film.info["duration"] == 100
        assert film.convert("RGB").getpixel((0, 0)) == pytest.approx((0x15, 0x19, 0x1E), abs=3)
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


def test_the_revolved_view_shows_film_electrode_and_rigid_parts(strip_run):
    try:
        views.check_rendering()
    except PlatformError as error:
        pytest.skip(str(error))
    picture = imread(invoke("plot", strip_run.directory, "--revolved"))[:, :1300, :3]
    film = np.ptp(picture, axis=2) > 0.2  # has colour
    electrode = (np.ptp(picture, axis=2) < 0.15) & (picture.mean(axis=2) < 0.35)
    assert film.mean() > 0.2  # most of what is seen
    assert electrode.mean() > 0.05


def test_without_rendering_the_revolved_view_is_refused(strip_run, monkeypatch):
    monkeypatch.setattr(render, "_PROBE", "import os; os.abort()")
    with pytest.raises(PlatformError, match="apt install libegl1") as caught:
        invoke("plot", strip_run.directory, "--revolved")
    assert caught.value.exit_code == 4


def test_a_picture_of_a_step_defaults_to_the_largest_voltage(strip_run, tmp_path):
    copied = shutil.copytree(strip_run.directory, tmp_path / "run")
    history = strip_run.history.copy()
    history.loc[history["step"] == 17, "voltage_kV"] = 0.0
    history.to_csv(copied / "history.csv", index=False)
    assert typical_step(dealib.open(copied)) == 16
    history["voltage_kV"] = 0.0
    history.to_csv(copied / "history.csv", index=False)
    assert 12 <= typical_step(dealib.open(copied)) <= 17  # 3 mm down


def test_a_run_without_fields_has_curves_and_a_report_only(tmp_path):
    small = {"mesh__columns": 8, "mesh__film_rows": 2, "mesh__grading": "ends"}
    run = dealib.simulate(case("benchmark_strip", output__fields="none", **small), tmp_path / "a")
    with pytest.raises(DealibError, match=r"no fields are stored \(output.fields is 'none'"):
        invoke("plot", run.directory, "--field", "E")
    with pytest.raises(DealibError, match="an animation needs at least two stored steps"):
        invoke("animate", run.directory)
    page = Path(invoke("report", run.directory)).read_text(encoding="utf-8")
    assert "No fields are stored" in page
    assert page.count("data:image/png") == 2  # the mesh, light and dark


def test_no_stored_state_under_voltage_is_told_not_drawn_as_its_field(tmp_path):
    """The voltage comes back to zero within rounding, so that the last stored state has none."""
    small = {"mesh__columns": 8, "mesh__film_rows": 2, "mesh__grading": "ends"}
    back = "[0 kV, 2 kV, 0 kV]"
    changes = {"program__2__terminal__voltage": back, "program__2__steps": 4}
    changes["output__fields"] = "stage"
    run = dealib.simulate(case("benchmark_strip", **small, **changes), tmp_path / "run")
    history = pd.read_csv(run.directory / "history.csv")
    history.loc[16, "voltage_kV"] = -2e-54
    history.to_csv(run.directory / "history.csv", index=False)
    run = dealib.open(run.directory)
    assert run.stored_steps == [0, 12, 16]
    assert typical_step(run) == 12  # of the largest displacement
    told = LayerShape(run, 16).when
    assert told.endswith("V = 0 kV (no state under voltage was stored)")
    page = Path(invoke("report", run.directory)).read_text(encoding="utf-8")
    assert (
        "No state under voltage was stored, so there is no picture of the electric field." in page
    )
    assert "Electric field at the largest voltage" not in page
    assert "charge on the inner faces" not in page


def small(directory, **changes):
    source = CONFIGS.parent / "tests" / "small.yaml"
    given = {k.replace("__", "."): v for k, v in changes.items()}
    return dealib.simulate(dealib.load(source, set=given), directory)


def test_the_overview_of_a_run_without_voltage_shows_stretches_instead_of_fields(tmp_path):
    program = "[{stage: push, mount: {displacement: -2 mm}, steps: 3}]"
    run = small(tmp_path / "run", program=program)
    with style.theme():
        figure = overview([run])
        last = figure.axes[3]
        assert (last.get_xlabel(), last.get_ylabel()) == (
            "Displacement (mm)", "Smallest thickness stretch"
        )  # fmt: skip
        assert last.lines[0].get_ydata().tolist() == run.history["thickness_stretch_min"].tolist()
        assert figure.legends == []  # nothing is marked


@pytest.mark.filterwarnings("error::UserWarning")
def test_pictures_of_a_run_that_ended_at_its_first_state(tmp_path):
    run = small(tmp_path / "run", stop_when="[capacitance_pF > 1 pF]")
    assert len(run.history) == 1
    with style.theme():
        force, time, capacitance, _, voltage, held = overview([run]).axes
        for axis in (force, time, voltage, held):
            assert axis.get_ylim() == (-1, 1)
        assert force.get_xlim() == (-1, 1)
        C = run.history["capacitance_pF"][0]
        assert capacitance.get_ylim() == pytest.approx((0.95 * C, 1.05 * C))
        assert time.lines[0].get_marker() == "."  # a line of one point is none
    page = Path(invoke("report", run.directory)).read_text(encoding="utf-8")
    assert "Newton iterations by step" not in page
