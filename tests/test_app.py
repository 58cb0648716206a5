"""The pages of `dealib app` and `dealib view`, in a headless browser and without one."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from http.client import HTTPConnection
from itertools import pairwise
from pathlib import Path

import pytest
from chrome import BROWSER, HINTS, Chrome

import dealib
from dealib.app import drawing
from dealib.app.page import serve
from dealib.app.solving import CHECK, FULL, QUICK, Session, sliders
from dealib.config import load
from dealib.errors import ConfigError

pytestmark = pytest.mark.once  # pages
CONFIGS = Path(__file__).parents[1] / "configs"
DEAP = CONFIGS / "deap100.yaml"
THICKNESS = "geometry.film_thickness"
PATIENCE = 300  # seconds: other tests may keep the machine busy
SMALL = ("mesh.columns=16", "mesh.film_rows=1")
browser = pytest.mark.skipif(BROWSER is None, reason="no chromium here")
# each time the curves are drawn: how many points, and the furthest that the first one goes
WATCH = """(() => {
  window.drawn = [];
  const plot = document.querySelector("#curves .js-plotly-plot");
  plot.on("plotly_afterplot", () =>
    window.drawn.push([plot.data[0].y.length, Math.min(...plot.data[0].y)]));
  document.querySelector("[role=slider]").focus();
})()"""
DRAWN = "(n, y) => window.drawn.find(d => d[0] == n && Math.abs(d[1] / y - 1) < 1e-4)"
MOTION = "displacement_mm"
THERE = "document.querySelector('#{} .js-plotly-plot').data.length"


@contextmanager
def page(folder, *arguments):
    """The address of a page that the command line shows; how it ended is in `ended`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "dealib", *map(str, arguments), "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(CONFIGS.parent)},
    )
    ended = {"process": process}
    try:
        line = process.stdout.readline()
        assert line.startswith("http://127.0.0.1:"), process.communicate()[1]
        ended["url"] = line.split()[0]
        yield ended
    finally:
        process.send_signal(signal.SIGINT)
        ended["said"] = process.communicate(timeout=PATIENCE)[1]
        ended["code"] = process.returncode
        print(ended["said"])  # pytest shows it where a test fails


@contextmanager
def chrome(folder, url):
    found = Chrome(folder, url)
    try:
        yield found
    finally:
        found.close()
    assert [line for line in found.said if not any(hint in line for hint in HINTS)] == []
    assert [a for a in found.asked if not a.startswith((url, "about:", "data:", "blob:"))] == []


def press(chrome, key):
    code = {"ArrowRight": 39, "End": 35, "Home": 36}[key]
    for kind in ("keyDown", "keyUp"):
        chrome.call(
            "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code
        )


@pytest.fixture(scope="module")
def session():
    return Session(load(DEAP, SMALL), [THICKNESS])


@browser
def test_the_page_follows_its_sliders(tmp_path, session):
    (tmp_path / "deap100-app-1.yaml").write_text("kept\n")
    (slider,) = session.sliders
    steps = [slider.key.value + k * (slider.high - slider.low) / 100 for k in (1, 2, 3)]
    expected = [session._solve(session.config((value,)), True).history for value in steps]
    ends = [history[MOTION].min() for history in expected]
    assert all(b / a < 0.995 for a, b in pairwise(ends))  # far more than they are compared by
    sets = [f"--set={s}" for s in SMALL]
    with page(tmp_path, "app", DEAP, "--key", THICKNESS, *sets) as shown:
        port = int(shown["url"].split(":")[2].strip("/"))
        assert listens(port) == ["0100007F"]
        with chrome(tmp_path / "profile", shown["url"]) as seen:
            seen.until(THERE.format("curves"))
            seen.until(THERE.format("device"))
            told = "document.querySelector('#status').innerText"
            seen.until(f"{told}.includes('deviates by displacement')")
            seen.run(WATCH)
            for quick in expected:
                press(seen, "ArrowRight")
                seen.until(f"({DRAWN})({len(quick)}, {quick[MOTION].min()})")
            # all steps follow where the slider rests, and only after the quick ones
            seen.until(f"({DRAWN})(32, {quick[MOTION].min()})")
            points = seen.run("window.drawn.map(d => d[0])")
            assert points.index(len(quick)) < points.index(32)
            # a thinner film is beyond more limits, and is red
            seen.run("document.querySelector('[role=slider]').focus()")
            red = "document.querySelector('#margins').innerHTML.includes('209, 36, 47')"
            press(seen, "End")
            seen.until(f"{told}.includes('checked') && !{red}")
            press(seen, "Home")
            seen.until("document.querySelector('#problem').innerText.includes('Try')")
            old = "document.querySelector('#status').innerText.includes('earlier position')"
            assert seen.run(old)
            assert seen.run(THERE.format("curves")) >= 4  # the last good ones
            for _ in range(45):
                press(seen, "ArrowRight")
            seen.until(f"{told}.includes('checked')")
            assert seen.run(red)
            seen.run("document.querySelector('#save').click()")
            seen.until("document.querySelector('#saved').innerText.includes('-app-2.yaml')")
            last = seen.run(
                "document.querySelector('#curves .js-plotly-plot').data"
                ".filter(t => t.line.color != '#777777' && t.line.width != 4).map(t => t.y)"
            )
            assert seen.run("document.querySelectorAll('script[src^=http]').length") == 0
    assert (shown["code"], shown["said"]) == (130, "dealib: stopped by SIGINT\n")
    assert (tmp_path / "deap100-app-1.yaml").read_text() == "kept\n"
    case = load(tmp_path / "deap100-app-2.yaml")
    assert case.config.geometry.film_thickness == pytest.approx(0.95 * 0.03199)
    run = dealib.simulate(case, tmp_path / "run")
    for name, values in zip(drawing.columns(run)[2], last, strict=True):
        assert run.history[name].tolist() == pytest.approx(values, rel=1e-9, abs=1e-12)


@browser
def test_a_run_is_viewed(strip_run, tmp_path):
    with (
        page(tmp_path, "view", strip_run.directory) as shown,
        chrome(tmp_path / "profile", shown["url"]) as seen,
    ):
        seen.until(THERE.format("device"))
        text = seen.run("document.body.innerText")
        assert "step 17, t = 17 s, actuate" in text
        assert "wrinkling 1.112" in text
        title = "document.querySelector('#device .js-plotly-plot').layout.title.text"
        seen.run("document.querySelectorAll('#step [role=slider]')[0].focus()")
        press(seen, "Home")
        seen.until(f"{title}.includes('step 0')")
    assert shown["code"] == 130
    assert "Traceback" not in shown["said"]


def listens(port):
    """Addresses that listen at a port, as the kernel writes them."""
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    if Path("/proc/net/tcp6").exists():
        lines += Path("/proc/net/tcp6").read_text().splitlines()[1:]
    found = [line.split()[1:4] for line in lines]
    return [
        at.split(":")[0] for at, _, state in found if state == "0A" and int(at[-4:], 16) == port
    ]


def test_sliders_go_as_far_as_the_schema_allows():
    config = load(DEAP).config
    (s,) = sliders(config, [THICKNESS])
    assert (s.low, s.high) == pytest.approx((0.5 * 0.03199, 1.5 * 0.03199))
    (s,) = sliders(config, ["geometry.inner_radius"])
    assert s.high == pytest.approx(1.5 * 5.614)
    (s,) = sliders(config, ["geometry.outer_radius"])  # it must stay above the inner one
    assert s.low == pytest.approx(0.6 * 10.205)
    names = [s.key.name for s in sliders(config, [])]
    assert {THICKNESS, "materials.film.youngs_modulus", "program.1.mount.force"} <= {*names}
    assert not [n for n in names if n.startswith(("mesh", "solver", "output"))]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--key", "geometry.film_thicknes"], "no number 'geometry.film_thicknes'; did you mean"),
        (["--key", "name"], "the config has no number 'name'"),
    ],
)
def test_wrong_keys(options, said):
    from typer.testing import CliRunner

    from dealib.cli.app import app

    found = CliRunner().invoke(app, ["app", str(DEAP), *options, "--no-browser"])
    assert isinstance(found.exception, ConfigError)
    assert said in str(found.exception)


class Page:
    """A page that says no more than 'here'."""

    def __init__(self):
        import flask

        self.server = flask.Flask("page")
        self.server.add_url_rule("/", view_func=lambda: "here")


def test_a_port_in_use():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"^port {port}: Address already in use; choose"):
            serve(Page(), port)


def test_other_machines_and_names_are_refused():
    address = serve(Page(), 0)
    port = int(re.fullmatch(r"http://127.0.0.1:(\d+)/", address)[1])
    assert listens(port) == ["0100007F"]
    for host, status in (("localhost", 200), ("127.0.0.1", 200), ("evil.example", 403)):
        connection = HTTPConnection("127.0.0.1", port)
        connection.request("GET", "/", headers={"Host": f"{host}:{port}"})
        assert connection.getresponse().status == status


def test_the_newest_position_wins(session):
    """Stale ones are dropped, also in the midst of being solved."""
    found = {}

    def ask(name, level, factor):
        found[name] = session.ask(level, (factor * 0.03199,))

    first = threading.Thread(target=ask, args=("first", QUICK, 1.1))
    first.start()
    while session._newest != (1.1 * 0.03199,):
        time.sleep(0.01)
    newest = threading.Thread(target=ask, args=("newest", QUICK, 1.2))
    newest.start()
    threading.Thread(target=session.serve, daemon=True).start()
    first.join(PATIENCE)
    newest.join(PATIENCE)
    assert found["first"] is None
    assert found["newest"].run.config.geometry.film_thickness == pytest.approx(1.2 * 0.03199)
    assert session.ask(FULL, (1.1 * 0.03199,)) is None  # of an earlier position
    assert session.ask(QUICK, (None,)) is None  # a field that is being typed in
    full = session.ask(FULL, (1.2 * 0.03199,))
    assert len(full.run.history) == 32  # rows
    quick = found["newest"].run.history
    ends = [h[h["stage"] == "actuate"]["displacement_mm"].min() for h in (quick, full.run.history)]
    assert ends[0] == pytest.approx(ends[1], rel=0.005)
    checked = session.ask(CHECK, (1.2 * 0.03199,))
    assert re.search(r"the membrane deviates by displacement \d", checked.told)


def test_a_quick_reply_takes_half_of_a_full_one_at_most(session):
    """By the processor's time, as drawn: a slider that is dragged gets these."""
    x, chosen = "time_s", [MOTION, "voltage_kV"]

    def seconds(level, factor):
        begin = time.thread_time()
        answer = session._answer(session._ticket, level, (factor * 0.03199,))
        assert answer.run.history[MOTION].min() < -2
        assert len(drawing.curves(answer.run, x, chosen)["data"]) >= 2
        return time.thread_time() - begin

    least = [min(seconds(level, 1.01 + k / 100) for k in range(3)) for level in (QUICK, FULL)]
    assert least[0] < 0.5 * least[1]
    assert least[0] < 1.5


def test_what_is_no_laminate_is_solved_as_a_solid(monkeypatch):
    monkeypatch.setattr(Session, "_solve", lambda self, *_: None)
    found = Session(load(CONFIGS / "devices" / "cone.yaml"))
    assert not found.checks
    assert found._model.startswith("solid (no membrane: ")


def test_without_dash_the_command_to_install_it_is_told(monkeypatch, strip_run):
    from dealib.app.page import build
    from dealib.errors import PlatformError

    monkeypatch.setitem(sys.modules, "dash", None)
    with pytest.raises(PlatformError, match=r"pip install 'dash>=4,<5'"):
        build(strip_run)


def test_fields_of_a_section(strip_run):
    assert drawing.cuts(strip_run) == ["section"]
    assert "wrinkling_use" in drawing.fields(strip_run)
    first, *paths = drawing.device(strip_run, 17, "E", "section", 0.5)["data"]
    assert len(paths) > 20
    assert first["marker"]["cmax"] == pytest.approx(90, rel=0.5)
