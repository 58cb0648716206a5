"""The interactive view in space of the report: its surface, its data, and the page in a browser."""

import base64
import html
import itertools
import json
import re
import sys
from typing import ClassVar

import numpy as np
import pytest
from chrome import BROWSER
from laminates import FILM, config, layer
from test_pictures import changed, simulated
from test_report import browse

from dealib.app import drawing
from dealib.plots import views
from dealib.plots.shape import LayerShape
from dealib.plots.surface import patches
from dealib.report import figures, page, space
from dealib.results.quantities import quantity

pytestmark = pytest.mark.once  # pages
EVIL = "</script><script>alert(1)</script>"
ON = [
    {"stage": "rest"},
    {"stage": EVIL, "terminal": {"voltage": "2 kV"}, "steps": 2},
]


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """A quarter of a plate, 8 by 4 by 0.7 mm, with an electrode on the film, from a file's mesh."""
    shape = {"base": {"kind": "rectangle", "length": "8 mm", "width": "4 mm"}}
    layers = [layer(), layer("cover", "0.2 mm", material="electrode")]
    given = config(
        "strip", *layers, geometry=shape | {"symmetry": ["X", "Y"]},
        mesh={"columns": 4, "sectors": 2},
        terminals={"top": {"on": "cover"}, "ground": {"on": "film.bottom", "ground": True}},
        holds=[{"on": "left", "fix": ["X", "Y", "Z"]}, {"on": "right", "fix": ["X", "Y", "Z"]}],
    )  # fmt: skip
    return simulated(changed(given, program=ON), tmp_path_factory.mktemp("plate"))


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """An annulus between two electrodes."""
    layers = [
        layer("low", "20 um", material="electrode"),
        layer(thickness="0.1 mm"),
        layer("high", "20 um", material="electrode"),
    ]
    given = config("annulus", *layers)
    return simulated(changed(given, program=ON), tmp_path_factory.mktemp("ring"))


def corners(shape, found, x=None):
    """Corners of all triangles in space, (triangles, 3, 3)."""
    x = shape.points if x is None else x
    every = [np.concatenate([x[p.nodes] @ one.T for one in p.maps])[p.triangles] for p in found]
    return np.concatenate(every)


def volume(triangles):
    """Volume inside a surface whose triangles look outwards, by the divergence theorem."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.einsum("ti,ti->", np.cross(a, b), c) / 6


def test_the_surface_of_a_plate_is_closed_and_looks_outwards(plate):
    shape = LayerShape(plate)
    found = patches(shape, ["film"], False, 10_000)
    # the walls in the planes of symmetry lie inside, twice: they cancel
    assert volume(corners(shape, found)) == pytest.approx(8 * 4 * 0.5, rel=1e-9)
    both = patches(shape, ["film", "cover"], False, 10_000)
    assert volume(corners(shape, both)) == pytest.approx(8 * 4 * 0.7, rel=1e-9)
    inner = np.abs(corners(shape, both)[..., 2].mean(axis=1) - 0.5 / 2 + 0.7 / 2) < 1e-6
    assert len(both[0].triangles) < len(found[0].triangles) + len(
        patches(shape, ["cover"], False, 10_000)[0].triangles
    )  # without the faces between them
    assert not inner.all()
    half = corners(shape, patches(shape, ["cover"], True, 10_000))
    assert half[..., 1].min() > -1e-9  # the near half shows the film
    assert volume(half) == pytest.approx(8 * 2 * 0.2, rel=1e-9)


def test_the_surface_of_a_body_of_revolution_is_closed(ring):
    shape = LayerShape(ring, n=2)
    found = patches(shape, ["film"], False, 30_000)
    sector = 30 * np.sin(0.75 * 2 * np.pi / 60)  # of sixty triangles, instead of 0.75 pi
    exact = sector * (10**2 - 6**2) * 0.1
    assert volume(corners(shape, found)) == pytest.approx(exact, rel=1e-6)
    cut = corners(shape, patches(shape, ["high"], True, 30_000))
    assert volume(cut) == pytest.approx(0.75 * np.pi / 2 * 64 * 0.02, rel=1e-3)


def test_too_many_triangles_are_thinned_out_and_reach_as_far(plate, ring):
    for run, whole, most in ((plate, [8, 4, 0.5], 200), (ring, [20, 20, 0.1], 60)):
        shape = LayerShape(run, n=2)
        every, found = (patches(shape, ["film"], False, most) for most in (10_000, most))
        lost = [len(a.triangles) - len(b.triangles) for a, b in zip(every, found, strict=True)]
        assert [patch.left_out for patch in found][-1] == lost[-1] > 0
        if shape.solid:
            assert len(found[0].triangles) <= most
        assert np.ptp(corners(shape, found).reshape(-1, 3), axis=0) == pytest.approx(
            whole, rel=3e-3
        )


def test_steps_are_chosen_at_equal_distances_with_those_that_matter():
    class Many:
        stored_steps: ClassVar = list(range(0, 300, 3))

    found = space._chosen(Many, 150, 40)
    assert len(found) == 40
    assert {0, 150, 297} <= set(found)
    assert max(np.diff(found)) <= 12
    assert space._chosen(Many, 150, 200) == Many.stored_steps
    assert space._chosen(Many, 150, 2) == [150, 297]


def unpacked(text, ends, shape):
    low, high = np.array(ends, float)
    numbers = np.frombuffer(base64.b64decode(text), "<u2").reshape(shape)
    return low + np.where(high > low, high - low, 1) * numbers / 65535


@pytest.mark.parametrize("which", ["plate", "ring"])
def test_the_data_are_those_of_the_run(which, request):
    run = request.getfixturevalue(which)
    whats = figures.turned(run)
    names = ["E", "S_XX", "S_ZZ", "u"] if which == "plate" else ["E", "S_RR", "S_ZZ", "u"]
    assert [q.name for q in whats] == names
    found = space.view(run, whats)
    assert len(found["labels"]) == len(run.stored_steps) == 4
    assert found["start"] == 3
    assert found["labels"][3].endswith("V = 2 kV")
    film, cover, *held = found["parts"]
    assert [part["plain"] for part in held] == [views.RIGID] * (which == "ring")
    assert all(not patch["values"] for part in held for patch in part["patches"])
    assert [film["conductor"], cover["conductor"]] == [False, True]
    assert "E" in film["patches"][0]["values"]
    assert "E" not in cover["patches"][0]["values"]  # plain
    assert "u" in cover["patches"][0]["values"]
    shape = LayerShape(run, 3, n=2)
    factor = 2 if which == "ring" else 1
    assert found["note"] == ("Thickness magnified 2 times." if factor == 2 else "True scale.")
    assert factor == 1 or np.ptp(shape.moved(2)[:, 1]) > 1.9 * 0.14
    for part, names in ((film, ["film"]), (cover, shape.layers)):
        names = [n for n in names if part is film or n != "film"]
        mine = patches(shape, names, part is cover, 30_000)
        for patch, one in zip(mine, part["patches"], strict=True):
            size = (4, one["n"], shape.points.shape[1])
            x = unpacked(one["points"], found["ends"], size)
            span = np.ptp(found["ends"], axis=0).max() / 65535
            assert x[3] == pytest.approx(shape.moved(factor)[patch.nodes], abs=span)
            u = unpacked(one["values"]["u"], found["quantities"][-1]["ends"], size[:2])
            exact = shape.values(quantity("u", shape.kinematics))[patch.nodes]
            assert u[3] == pytest.approx(exact, abs=1e-4 * exact.max())
            triangles = np.frombuffer(base64.b64decode(one["triangles"]), "<u4")
            assert triangles.max() == one["n"] * len(one["maps"]) - 1
    # with colours that the other pictures have
    assert found["quantities"][0]["colours"][0] == [0.0, "#440154"]  # viridis
    assert found["quantities"][0]["range"][1] == pytest.approx(
        20 if which == "ring" else 4, rel=0.2
    )


def text_of(run, monkeypatch):
    monkeypatch.setattr(figures, "pictures", lambda run: ({}, []))
    return page.render(run)


def test_names_are_text_in_the_page(plate, monkeypatch):
    text = text_of(plate, monkeypatch)
    assert "<script>alert" not in text
    assert text.count("<script") - space.library().count("<script") == 3
    data = re.search(r'<script id="space-data" type="application/json">(.*?)</script>', text)[1]
    assert EVIL in json.loads(data)["labels"][3]
    assert not re.findall(r'<script[^>]*src=|<link[^>]*href="http', text)


def test_without_plotly_the_page_says_so(plate, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "plotly"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "plotly", None)
    text = html.unescape(text_of(plate, monkeypatch))
    assert (
        "plotly is not installed (run setup/setup.sh, or pip install plotly); "
        "the interactive view is left out." in text
    )
    assert "<script" not in text.replace(EVIL, "")


def test_a_device_in_a_plane_has_none(tmp_path):
    given = changed(config("strip", materials={"film": FILM}), program=[{"stage": "rest"}])
    run = simulated(given, tmp_path)
    assert space.view(run, figures.turned(run)) == {}


MOVED = """
<script>
addEventListener("load", () => setTimeout(() => {
  const plot = document.getElementById("space"), slider = document.getElementById("space-step");
  const seen = () => plot.data.map(trace => [trace.visible, trace.x.length, Math.min(...trace.z),
    Math.max(...trace.z), trace.intensity ? Math.max(...trace.intensity) : null]);
  const told = [slider.value, slider.max, seen()];
  slider.value = 0;
  document.getElementById("space-quantity").selectedIndex = 3;
  document.getElementById("space-conductors").checked = false;
  slider.dispatchEvent(new Event("input"));
  const waiting = setInterval(() => {
    if (!document.getElementById("space-label").textContent.startsWith("step 0")) return;
    clearInterval(waiting);
    told.push(seen(), document.getElementById("space-label").textContent);
    const result = document.createElement("pre");
    result.id = "result";
    result.textContent = JSON.stringify(told);
    document.body.append(result);
  }, 100);
}, 500));
</script>
"""


@pytest.mark.skipif(BROWSER is None, reason="no chromium here (Debian: apt install chromium)")
def test_the_slider_and_the_menu_move_the_view(plate, tmp_path, monkeypatch):
    path = tmp_path / "page.html"
    text = text_of(plate, monkeypatch)
    path.write_text(text.replace("</body>", f"{MOVED}</body>"), encoding="utf-8")
    options = ["--virtual-time-budget=15000", "--dump-dom"]
    found = browse(path, tmp_path / "browser", *options)
    shown = re.search(r'<pre id="result">(.*?)</pre>', found.stdout)
    assert shown, found.stderr
    start, last, first_seen, then_seen, label = json.loads(html.unescape(shown[1]))
    assert (start, last) == ("3", "3")
    film, cover, _ = first_seen  # without wrinkles no line is drawn
    end = LayerShape(plate, 3)
    E = quantity("E", end.kinematics)
    assert film[4] == pytest.approx(np.nanmax(end.values(E)), rel=1e-4)
    assert cover[4] is None
    assert cover[0]
    film, cover, _ = then_seen
    assert film[1:] == [film[1], pytest.approx(-0.35, abs=1e-4), pytest.approx(0.15, abs=1e-4),
                        pytest.approx(0, abs=1e-6)]  # fmt: skip
    assert not cover[0]
    assert label.startswith("step 0")


SEEN = """
<script>
addEventListener("load", () => setTimeout(() => {
  const plot = document.getElementById("space"), scene = plot._fullLayout.scene;
  const icon = document.querySelector(".modebar svg").getBoundingClientRect();
  const result = document.createElement("pre");
  result.id = "result";
  result.textContent = JSON.stringify([scene.camera.eye, scene.aspectratio,
    [plot.clientWidth, plot.clientHeight], icon.width]);
  document.body.append(result);
}, 500));
</script>
"""


@pytest.mark.skipif(BROWSER is None, reason="no chromium here (Debian: apt install chromium)")
@pytest.mark.parametrize("wide", [390, 1100])
@pytest.mark.parametrize("sizes", [(1, 1, 8), (8, 8, 0.1), (8, 1, 1)])
def test_the_whole_device_is_seen_at_first(sizes, wide, plate, tmp_path, monkeypatch):
    """Also on a phone, where the icons above the view were as wide as other pictures."""
    path, text = tmp_path / "page.html", text_of(plate, monkeypatch)
    data = json.loads(re.search(r'id="space-data" type="application/json">(.*?)</script>', text)[1])
    box = json.dumps([[0, size] for size in sizes])
    text = text.replace(json.dumps(data["box"]), box)
    assert box in text
    path.write_text(text.replace("</body>", f"{SEEN}</body>"), encoding="utf-8")
    options = ["--virtual-time-budget=15000", f"--window-size={wide},844", "--dump-dom"]
    found = browse(path, tmp_path / "browser", *options)
    shown = re.search(r'<pre id="result">(.*?)</pre>', found.stdout)
    assert shown, found.stderr
    eye, ratio, (width, height), icon = json.loads(html.unescape(shown[1]))
    assert 10 < icon < 30
    place = np.array([eye[k] for k in "xyz"])
    ahead = place / np.linalg.norm(place)
    right = np.cross([0, 0, 1], ahead) / np.linalg.norm(np.cross([0, 0, 1], ahead))
    half = np.array([ratio[k] for k in "xyz"]) / 2
    corners = half * np.array(list(itertools.product((-1, 1), repeat=3)))
    depth = np.linalg.norm(place) - corners @ ahead
    up, across = corners @ np.cross(ahead, right) / depth, corners @ right / depth
    high = np.tan(np.pi / 8)  # plotly's camera sees 45 degrees
    assert np.abs(up).max() < high
    assert np.abs(across).max() < high * width / height
    filled = max(np.abs(up).max() / high, np.abs(across).max() * height / (high * width))
    assert filled > 0.6  # and it is not far away


@pytest.mark.parametrize("cut", ["whole", "cut across Z"])
def test_the_app_shows_all_of_it_in_true_scale(cut, plate):
    drawn = drawing.device(plate, 3, "E", cut, 0.5)
    scene = drawn["layout"]["scene"]
    ratio = np.array([scene["aspectratio"][k] for k in "xyz"])
    widths = np.ptp([scene[f"{k}axis"]["range"] for k in "xyz"], axis=1)
    assert ratio / ratio[0] == pytest.approx(widths / widths[0])
    for k in "xyz":
        low, high = scene[f"{k}axis"]["range"]
        places = np.concatenate([part[k] for part in drawn["data"]])
        assert low < places.min() <= places.max() < high
    away = np.linalg.norm(list(scene["camera"]["eye"].values()))
    assert np.linalg.norm(ratio) / 2 < away * np.sin(np.pi / 8)  # the sphere around it is seen
