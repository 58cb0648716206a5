"""Pictures and sampled fields of every kind of device, against values known in closed form."""

from pathlib import Path

import numpy as np
import pytest
from conftest import case
from laminates import BASES, FILM, config, layer

import dealib
from dealib.config import resolved
from dealib.device.gmsh_model import gmsh_model
from dealib.errors import ConfigError
from dealib.plots import contours, style, views
from dealib.plots.animation import usual
from dealib.plots.curves import overview
from dealib.plots.mesh import draw_mesh
from dealib.plots.profiles import draw_profiles, film, lines
from dealib.plots.shape import LayerShape
from dealib.report import facts
from dealib.results.quantities import SURFACE_CHARGE, quantity
from dealib.study import sample

pytestmark = pytest.mark.once  # of stored results
ON = [{"stage": "actuate", "terminal": {"voltage": "1 kV"}}]
EPS = 3 * 8.8541878128e-6  # N/kV^2


def simulated(given, folder):
    """The run of a config."""
    return dealib.simulate(dealib.Case(given, resolved(given), Path()), folder / "run")


def changed(given, **sections):
    """A config with other sections."""
    return type(given).model_validate(given.model_dump(exclude_none=True) | sections)


@pytest.fixture(scope="module")
def tube(tmp_path_factory):
    """A thick tube under 1 kV, that hardly deforms."""
    stiff = FILM | {"youngs_modulus": "1000 MPa"}
    given = config(
        "tube", layer("wall", "2 mm", material="film"), materials={"film": stiff},
        mesh={"film_rows": 6, "grading": "uniform"},
    )  # fmt: skip
    return simulated(changed(given, program=ON), tmp_path_factory.mktemp("tube"))


@pytest.fixture(scope="module")
def membrane(tmp_path_factory):
    """An annular membrane between electrodes, pushed and under 2 kV."""
    program = [
        {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 2},
        {"stage": "actuate", "terminal": {"voltage": "2 kV"}},
    ]
    layers = [
        layer("low", "20 um", material="electrode"),
        layer("film", "100 um"),
        layer("high", "20 um", material="electrode"),
    ]
    taut = {"film": FILM | {"prestretch": 1.1}}
    given = config("annulus", *layers, physics={"model": "membrane"}, materials=taut)
    return simulated(changed(given, program=program), tmp_path_factory.mktemp("membrane"))


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """A quarter of a rectangle in three dimensions."""
    shape = {"base": {"kind": "rectangle", "length": "8 mm", "width": "4 mm"}}
    given = config(
        "strip", geometry=shape | {"symmetry": ["X", "Y"]}, mesh={"columns": 4, "sectors": 2},
        terminals={"top": {"on": "film.top"}, "ground": {"on": "film.bottom", "ground": True}},
        holds=[{"on": "left", "fix": ["X", "Y", "Z"]}, {"on": "right", "fix": ["X", "Y", "Z"]}],
    )  # fmt: skip
    return simulated(changed(given, program=ON), tmp_path_factory.mktemp("plate"))


def titles(figure):
    """Titles of the panels."""
    return [a.get_title(loc="left") for a in figure.axes if a.get_title(loc="left")]


def test_the_field_in_a_tube_is_that_of_a_cylindrical_capacitor(tube):
    shape = LayerShape(tube)
    found = shape.section.layer("wall")
    t = np.linspace(0, 1, 9)
    E = quantity("E_R", shape.kinematics).of(shape.arrays)
    exact = 1 / ((4 + 2 * t) * np.log(6 / 4))
    assert np.abs(found.at(E, np.full(9, 0.3), t)) == pytest.approx(exact, rel=2e-3)
    charge = lines(shape, SURFACE_CHARGE)
    Z, outer = charge["electrode at the top face"]
    assert Z[[0, -1]] == pytest.approx([0, 10])
    assert np.abs(outer) == pytest.approx(1e3 * EPS / (6 * np.log(1.5)), rel=5e-3)
    whole = 2 * np.pi * 6e-3 * 10 * np.abs(outer).mean()
    assert whole == pytest.approx(abs(tube.history["charge_uC"].iloc[-1]), rel=5e-3)


def test_a_tube_is_drawn_along_its_axis(tube):
    shape = LayerShape(tube)
    with style.theme() as look:
        figure = views.draw_field(shape, quantity("S_ZZ", shape.kinematics), look)
        assert titles(figure) == [
            "true scale", "straightened", "low end, true scale", "high end, true scale"
        ]  # fmt: skip
        straight = figure.axes[1]
        assert straight.get_xlabel() == "Z on the mesh (mm)"
        assert straight.get_ylabel() == "R on the mesh (mm)"
        figure = draw_profiles(shape, [SURFACE_CHARGE])
        assert titles(figure) == ["along wall", "low end", "high end"]
        mesh = draw_mesh(tube.directory / "mesh.msh", tube.config)
        assert [a.get_title() for a in mesh.axes] == ["whole", "low end", "high end"]
    assert [q.name for q in usual(tube)] == ["S_ZZ", "E"]


def test_a_membrane_on_a_line_is_drawn_with_its_thickness(membrane):
    shape = LayerShape(membrane)
    assert shape.layers == ("low", "film", "high")
    assert shape.thickness == pytest.approx(0.14)
    strip = shape.section.layer("film")
    s = strip.positions
    low, high = (strip.at(shape.mesh.points + shape.displacement, s, t) for t in (0.0, 1.0))
    stretch = strip.at(shape.arrays["J"], s, 0.5)
    x = (low + high) / 2
    along = np.gradient(x, strip.start + s * strip.length, axis=0, edge_order=2)
    stretch = stretch / np.linalg.norm(along, axis=1) / (x[:, 0] / (6 + 4 * s))
    assert np.linalg.norm(high - low, axis=1) == pytest.approx(0.1 * stretch, rel=2e-2)
    # across the deformed line
    tilt = np.einsum("ni,ni->n", high - low, along) / np.linalg.norm(along, axis=1)
    assert np.abs(tilt).max() < 2e-2 * 0.1
    _, sigma = strip.charge(shape.arrays, 1)
    ds = np.linalg.norm(np.diff(x, axis=0), axis=1)
    ring = 2 * np.pi * x[:, 0] * sigma
    charge = ((ring[1:] + ring[:-1]) / 2 * ds).sum()
    assert abs(charge) == pytest.approx(membrane.history["charge_uC"].iloc[-1], rel=1e-2)
    with style.theme() as look:
        figure = views.draw_field(shape, quantity("E", shape.kinematics), look)
        assert titles(figure)[1:] == [
            "straightened",
            "inner end, true scale",
            "outer end, true scale",
        ]


def test_a_disc_has_one_end(tmp_path):
    chamber = {"pump": {"on": "film.bottom"}}
    program = [{"stage": "inflate", "chamber": {"pressure": "1 kPa"}}, *ON]
    run = simulated(changed(config("disc"), chambers=chamber, program=program), tmp_path)
    shape = LayerShape(run)
    with style.theme() as look:
        figure = views.draw_field(shape, quantity("E", shape.kinematics), look)
        assert titles(figure)[-1] == "outer end, true scale"
        assert len(titles(figure)) == 3
        assert titles(draw_profiles(shape, [SURFACE_CHARGE])) == ["along film", "outer end"]
        axes = overview([run]).axes
        assert axes[0].get_xlabel() == "Pressure (kPa)"
        assert axes[0].get_ylabel() == "Volume (mm³)"
    assert "p = 1 kPa, vol = " in shape.when
    assert facts.program(run.config)[0]["inputs"] == "chamber: pressure 1 kPa"
    assert dict(facts.device(run.config)["Ports"])["chamber pump"] == "on film.bottom, along Z"
    assert dict(facts.energy(run))["Work done at the chamber pump"].endswith(" mJ")


def test_a_strip_has_fields_of_its_plane_and_the_film_under_voltage_is_drawn(tmp_path):
    terminals = {"hot": {"on": "active.top"}, "ground": {"on": "active.bottom", "ground": True}}
    layers = [layer("passive", material="film"), layer("active", material="film")]
    given = changed(config("strip", *layers), terminals=terminals, program=ON)
    run = simulated(given, tmp_path)
    shape = LayerShape(run)
    assert film(shape) == "active"
    assert quantity("S_YY", shape.kinematics).component == (2, 2)
    with pytest.raises(
        ConfigError, match=r"no field .S_RR. to draw; known: phi, J.* S_XX, S_ZZ, S_Y"
    ):
        quantity("S_RR", shape.kinematics)
    with pytest.raises(ConfigError, match="this device is no body of revolution"):
        views.draw_revolved(shape, quantity("E", shape.kinematics), style.LIGHT)
    middle = shape.section.layer("active")
    found = middle.at(quantity("E", shape.kinematics).of(shape.arrays), np.array([0.5]), 0.5)
    assert found == pytest.approx(2, rel=2e-2)  # 1 kV over 0.5 mm
    with style.theme():
        labels = [a.get_xlabel() for a in overview([run]).axes]
    assert "Voltage (kV)" in labels  # without mount or chamber


@pytest.mark.parametrize("count", [2, 8])
def test_the_overview_shows_all_terminals(tmp_path, count):
    """Voltage, charge and capacitance of each, with its name; beyond six a note."""
    names = [f"t{k}" for k in range(count)]
    driven = names[-1] if count == 2 else names[1]
    terminals = {
        name: {"on": "film.top", "within": [f"{k + 0.1} mm", f"{k + 0.9} mm"]}
        for k, name in enumerate(names)
    }
    terminals["ground"] = {"on": "film.bottom", "ground": True}
    program = [{"stage": "on", "terminals": {driven: {"voltage": "1 kV"}}, "steps": 2}]
    given = config("strip", terminals=terminals, program=program, mesh={"columns": 20})
    run = simulated(given, tmp_path)
    with style.theme():
        figure = overview([run])
        _, _, capacitance, field, voltage, charge = figure.axes[:6]
        (legend,) = figure.legends[-1:]
        told = [text.get_text() for text in legend.get_texts()]
    assert told == [f"terminal {n}" for n in names[:6]] + ["and 2 more"] * (count == 8)
    assert field.get_xlabel() == f"Voltage of {driven} (kV)"  # the one that is driven
    for axis, column in ((voltage, "voltage_kV.{0}"), (charge, "charge_uC.{0}"),
                         (capacitance, "capacitance_pF.{0}.{0}")):  # fmt: skip
        drawn = [line.get_ydata().tolist() for line in axis.lines if len(line.get_xdata()) == 3]
        for name in names[:6]:
            assert run.history[column.format(name)].tolist() in drawn


def test_the_time_of_a_device_in_motion_is_that_of_its_motion(tmp_path):
    """A second of loading would hide a tenth of a second of swinging."""
    given = case("dynamics/step_response", mesh__columns=8, mesh__film_rows=1, program__3__steps=20)
    run = dealib.simulate(given, tmp_path / "run")
    with style.theme():
        time = next(a for a in overview([run]).axes if a.get_xlabel() == "Time (s)")
    (line,) = time.get_lines()
    moving = run.history[run.history["stage"] == given.config.program[-1].stage]["time_s"]
    before = run.history["time_s"][moving.index[0] - 1]
    assert line.get_xdata() == pytest.approx([before, *moving])


def test_a_mesh_of_ones_own_is_drawn_whole(tmp_path):
    given = changed(config("annulus"), program=ON)
    with gmsh_model(given) as session:
        session.write(str(tmp_path / "own.msh"))
    sections = {
        "geometry": {"shape": "mesh", "file": str(tmp_path / "own.msh"), "space": "axisymmetric"},
        "terminals": {"hot": {"on": "film.top"}, "ground": {"on": "film.bottom", "ground": True}},
        "holds": [{"on": "outer", "fix": ["R", "Z"]}, {"on": "inner", "fix": ["R", "Z"]}],
    }
    run = simulated(changed(given, **sections), tmp_path)
    shape = LayerShape(run)
    with style.theme() as look:
        assert titles(views.draw_field(shape, quantity("E", shape.kinematics), look)) == [
            "true scale"
        ]
    with pytest.raises(ConfigError, match="profiles run along the layers of a laminate"):
        draw_profiles(shape, [SURFACE_CHARGE])
    with pytest.raises(
        ValueError, match="only laminates in a plane have fields along their layers"
    ):
        sample.check(run.config, "E", "film")
    assert dict(facts.device(run.config)["Mesh"]) == {"order": "2"}


def test_a_plate_in_space_is_mirrored_with_the_signs_of_its_components(plate):
    shape = LayerShape(plate)
    for name in ("E", "u_X", "S_XY"):
        what = quantity(name, shape.kinematics)
        parts = [
            body for body, _ in views.bodies(shape, what, shape.mesh.points, shape.values(what))
        ]
        assert len(parts) == 4
        assert np.ptp(np.concatenate([p.points for p in parts]), axis=0) == pytest.approx(
            [8, 4, 0.5]
        )
        signs = [np.sign(p["values"][np.abs(p["values"]).argmax()]) for p in parts]
        odd = {"E": [1, 1, 1, 1], "u_X": [1, -1, 1, -1], "S_XY": [1, -1, -1, 1]}[name]
        assert [s * signs[0] for s in signs] == odd
    with pytest.raises(ValueError, match="contours are drawn of devices in a plane"):
        contours.fill(None, shape, quantity("E", shape.kinematics), style.LIGHT)
    with pytest.raises(
        ValueError, match="only laminates in a plane have fields along their layers"
    ):
        sample.check(plate.config, "E", "film")
    with pytest.raises(ConfigError, match="no field 'S_RR' to draw"):
        quantity("S_RR", shape.kinematics)


def test_a_plate_in_space_is_seen_whole_and_cut(plate):
    try:
        views.check_rendering()
    except dealib.errors.PlatformError as error:
        pytest.skip(str(error))
    shape = LayerShape(plate)
    with style.theme() as look:
        figure = views.draw_field(shape, quantity("E", shape.kinematics), look)
        whole, cut = (a.images[0].get_array() for a in figure.axes[:2])
        assert titles(figure) == ["true scale", "cut in half"]
        assert figure.axes[2].get_ylabel() == "Electric field |E| (MV/m)"
        coloured = [(np.ptp(p.astype(float), axis=2) > 40).mean() for p in (whole, cut)]
        assert min(coloured) > 0.3
        figure = draw_mesh(plate.directory / "mesh.msh", plate.config)
        assert figure.axes[0].images[0].get_array().std() > 10


def test_several_terminals_have_their_names(tmp_path):
    terminals = {
        "drive": {"on": "film.top", "within": ["6 mm", "8 mm"]},
        "sense": {"on": "film.top", "within": ["8.5 mm", "10 mm"]},
        "ground": {"on": "film.bottom", "ground": True},
    }
    program = [{"stage": "actuate", "terminals": {"drive": {"voltage": "1 kV"}}}]
    run = simulated(changed(config("annulus"), terminals=terminals, program=program), tmp_path)
    with style.theme():
        labels = {a.get_ylabel() for a in overview([run]).axes}
    assert {"Voltage (kV)", "Charge (µC)", "Capacitance (pF)"} <= labels
    assert facts.program(run.config)[0]["inputs"] == "terminal drive: voltage 1 kV"
    told = [name for _, name in facts.headline(run)]
    assert [t for t in told if t.startswith("capacitance")] == [
        "capacitance of drive", "capacitance of sense"
    ]  # fmt: skip
    assert LayerShape(run).when.endswith("V of drive = 1 kV")
    assert BASES["annulus"]["kind"] == "annulus"


def test_layers_of_a_sheet_that_meet_other_layers_on_a_part_have_charge_along_them(tmp_path):
    """Where a layer's neighbours change, the mesh of the results has two nodes at one place."""
    layers = [
        layer("film", "0.1 mm"),
        layer("skin", "20 um", material="electrode", within=["2 mm", "8 mm"]),
    ]
    given = config(
        "tube", *layers, physics={"model": "membrane"},
        materials={"film": FILM | {"prestretch": 1.1}},
        terminals={"hot": {"on": "skin"}, "ground": {"on": "film.bottom", "ground": True}},
    )  # fmt: skip
    run = simulated(changed(given, program=ON), tmp_path)
    shape = LayerShape(run)
    assert shape.layers == ("film", "skin")
    Z, sigma = lines(shape, SURFACE_CHARGE)["electrode at the top face"]
    assert np.isfinite(sigma).all()
    assert (np.diff(Z) > 0).all()
    outside, inside = np.abs(sigma[(Z < 1.9) | (Z > 8.1)]), np.abs(sigma[(Z > 3) & (Z < 7)])
    assert outside.max() < 1e-9
    assert inside == pytest.approx(1e3 * EPS * 10, rel=0.1)  # 1 kV over 0.1 mm
