"""Wrinkles of a tension field as fields and pictures: a pushed annulus whose crests are radial."""

import base64

import numpy as np
import pytest
from laminates import FILM, config, layer
from test_pictures import changed, simulated, titles

import dealib
from dealib.plots import crests, style, views
from dealib.plots.shape import LayerShape
from dealib.plots.surface import blocks
from dealib.report import figures, space
from dealib.results.quantities import quantity

PROGRAM = [
    {"stage": "push", "mount": {"displacement": "-3 mm"}, "steps": 2},
    {"stage": "actuate", "terminal": {"voltage": "7.3 kV"}, "steps": 4},
]


def pushed(folder, **geometry):
    """The annulus, pushed: tension is small around the axis, and the voltage takes it away."""
    given = config(
        "annulus", layer(thickness="0.1 mm"), geometry=geometry,
        physics={"model": "membrane", "wrinkling": "tension_field"},
        mesh={"columns": 8, "sectors": 6}, materials={"film": FILM | {"prestretch": 1.03}},
    )  # fmt: skip
    return simulated(changed(given, program=PROGRAM), folder)


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    """On a line, turned about the axis."""
    return pushed(tmp_path_factory.mktemp("line"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """In space, all around."""
    return pushed(tmp_path_factory.mktemp("whole"), space="3d")


@pytest.mark.once
def test_crests_run_outwards_all_around(line, whole):
    """A crest has no sign: averages of vectors cancelled where two neighbours had other signs."""
    for run in (line, whole):
        shape = LayerShape(run)
        found, share = shape.arrays["crest"], shape.arrays["wrinkling"]
        assert share.min() > 0.05  # it wrinkles everywhere
        assert np.linalg.norm(found, axis=1) == pytest.approx(share, rel=1e-9)
        if not shape.solid:
            assert np.abs(found[:, 2]).max() < 1e-12  # nothing around the axis
            continue
        out = shape.mesh.points[:, :2] / np.linalg.norm(shape.mesh.points[:, :2], axis=1)[:, None]
        around = found[:, 1] * out[:, 0] - found[:, 0] * out[:, 1]
        assert np.abs(around / share).max() < 0.02
    peak = [LayerShape(run).arrays["wrinkling"].max() for run in (line, whole)]
    assert peak[0] == pytest.approx(peak[1], rel=1e-3)


def test_lines_are_drawn_on_the_crests(line, whole):
    for run in (line, whole):
        shape = LayerShape(run)
        assert crests.lines(shape, quantity("u", shape.kinematics)) == []
        ((tubes, colour),) = crests.lines(shape, quantity("wrinkling", shape.kinematics))
        assert colour == "#d55e00"
        ends, size = crests.strokes(shape)
        assert size == pytest.approx(20, rel=1e-2)
        drawn = np.asarray(tubes.points).reshape(-1, 2, 20, 3).mean(axis=2)  # of twenty sides
        assert drawn == pytest.approx(ends, abs=1e-4)
        along, centre = ends[:, 1] - ends[:, 0], ends.mean(axis=1)
        assert np.linalg.norm(along, axis=1) == pytest.approx(0.8 * 20 / 24, rel=1e-2)
        R = np.linalg.norm(centre[:, :2], axis=1)
        assert ((R > 5.9) & (R < 10.1)).all()
        around = (along[:, 1] * centre[:, 0] - along[:, 0] * centre[:, 1]) / R
        assert np.abs(around).max() < 0.02
        # of a section six lines, every 8 degrees of 270
        assert len(R) == pytest.approx(289 if shape.solid else 6 * 34, abs=30 * shape.solid)
    what = quantity("wrinkling", LayerShape(line).kinematics)
    area = line.history["wrinkled_area_mm2"].iloc[-1]
    assert area == pytest.approx(np.pi * 64, rel=1e-3)
    told = crests.note(LayerShape(line), what, 1.0)
    assert told == "true scale; 201.1 mm² wrinkled, lines on the crests"


@pytest.mark.once
def test_they_are_in_the_pictures_and_the_report(line, whole):
    try:
        views.check_rendering()
    except dealib.errors.PlatformError as error:
        pytest.skip(str(error))
    with style.theme() as look:
        for run in (line, whole):
            shape = LayerShape(run)
            figure = views.draw_field(shape, quantity("wrinkling", shape.kinematics), look)
            image = np.asarray(figure.axes[0].images[0].get_array(), dtype=float)
            red = (image[..., 0] > 140) & (image[..., 1] < 110) & (image[..., 2] < 60)
            assert 1e-3 < red.mean() < 0.05
            if shape.solid:
                assert titles(figure)[0].endswith("mm² wrinkled, lines on the crests")
    assert "wrinkling" in figures.pictures(line)[0]
    assert [q.name for q in figures.turned(line)] == ["E", "wrinkling", "S_RR", "S_ZZ", "u"]


@pytest.mark.once
def test_the_interactive_view_has_them_and_what_holds_the_film(line, whole):
    for run in (line, whole):
        shape = LayerShape(run)
        data = space.view(run, figures.turned(run))
        lines = data["crests"]
        assert lines["name"] == "wrinkling"
        low, high = np.array(lines["ends"])
        numbers = np.frombuffer(base64.b64decode(lines["steps"][-1]), "<u2").reshape(-1, 2, 3)
        found = low + (high - low) * numbers / 65535
        assert found == pytest.approx(crests.strokes(shape)[0], abs=1e-3)
        *_, last = data["parts"]
        assert (last["plain"] == views.RIGID) == (not shape.solid)
    inner, outer = blocks(LayerShape(line), 2.0)
    assert inner[:, 0] == pytest.approx([0, 6, 6, 0], abs=1e-4)
    assert outer[:, 0] == pytest.approx([10, 11, 11, 10])
    z = inner[:, 1].mean(), outer[:, 1].mean()
    assert z == (pytest.approx(-3, abs=1e-6), pytest.approx(0, abs=1e-6))
    assert np.ptp(inner[:, 1]) == pytest.approx(2 * 2 * 0.1, rel=1e-2)
    rest = space.view(whole, [quantity("u", shape.kinematics)])
    assert rest["crests"] is None
