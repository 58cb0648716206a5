"""The report of a run, as a file and in a headless browser."""

import html
import io
import json
import os
import re
import shutil
import subprocess

import h5py
import pytest
from chrome import BROWSER, FLAGS, HINTS
from matplotlib.image import imread

import dealib
from dealib.errors import ConfigError
from dealib.plots import style
from dealib.plots.curves import overview
from dealib.report import facts
from dealib.report.page import render
from dealib.report.space import library

pytestmark = pytest.mark.once  # pages
LOUD = ("--hide-scrollbars", "--enable-logging=stderr")


@pytest.fixture(scope="module")
def page(strip_run):
    """The page of benchmark_strip, written by the command."""
    from typer.testing import CliRunner

    from dealib.cli.app import app

    result = CliRunner().invoke(app, ["report", str(strip_run.directory)])
    assert result.exception is None
    path = strip_run.directory / "report.html"
    assert result.stdout.strip() == str(path)
    return path


def test_the_page_tells_what_was_solved(page):
    text = html.unescape(re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8")))
    text = " ".join(text.split())
    for part in (
        "strip (benchmark_strip) done beyond: wrinkling 1.112 beyond: pull-in 1.148",
        "wrinkling 1.112 1 is the limit; largest at step 17, t = 17 s, actuate: a real film",
        "Three strips without air, on which two independent codes agree",
        "−3…0 mm displacement",
        "0.26193 N force change in “actuate”",
        "230.3…359.1 pF capacitance",
        "film thickness 30 µm",
        "mount on inner, along Z",
        "shear modulus 0.334 MPa",
        "push mount: displacement −3 mm 12 s 12",
        "actuate terminal: voltage 2.5 kV 5 s 5",
        "Steps 17 of 17 planned",
        "lost share of the mounted tension, thickness average",
        "step 17, t = 17 s, actuate field over the one at which the film itself loses stability",
        "Largest voltage 2.5 kV step 17, t = 17 s, actuate",
        "dolfinx " + dealib.open(page.parent).info["versions"]["dolfinx"],
        "grading: tanh",
    ):
        assert part in text
    assert "Warnings" not in text


def test_the_page_is_self_contained(page):
    text = page.read_text(encoding="utf-8")
    assert text.count(library()) == 1
    text = text.replace(library(), "")
    sources = re.findall(r'(?:src|srcset|href)="([^"]{0,30})', text)
    assert len([s for s in sources if s.startswith("data:image/")]) == 2 * 9
    assert all(s.startswith(("data:", "#")) for s in sources)
    assert "@import" not in re.search(r"<style>(.*?)</style>", text, re.DOTALL)[1]
    assert len(text.encode()) < 5e6


def test_the_energy_balance_closes(strip_run):
    assert facts.share(strip_run) < 0.2
    told = dict(facts.energy(strip_run))
    assert told["Work done at the mount"] == "1.1998 mJ"
    h = strip_run.history
    residual = h["energy_residual_mJ"].abs().max()
    stored = h["elastic_energy_mJ"] + h["electric_energy_mJ"]
    largest = (stored - stored[0]).max()  # more than the work of either port
    share = f"{100 * residual / largest:.2g} % of the largest change of stored energy"
    assert told["Largest residual of the balance"].endswith(f"mJ: {share}, {largest:.5g} mJ")


def test_curves_are_dark_by_their_colours(strip_run):
    """Recoloured they are what the dark theme draws, but for names within the file."""
    drawn = []
    for dark in (False, True):
        with style.theme(dark):
            data = io.BytesIO()
            style.save(overview([strip_run]), data, "svg")
        drawn.append(re.sub(r"<dc:date>.*?</dc:date>|m[0-9a-f]{10}", "", data.getvalue().decode()))
    light, dark = drawn
    assert light != dark
    assert style.darkened(light) == dark


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("0.03 mm", "30 µm"),
        ("-3.0 mm", "−3 mm"),
        ("0.333333333 MPa", "0.333333 MPa"),
        (("0.0 kV", "2.5 kV", "0.0 kV"), "0 → 2.5 → 0 kV"),
        ((1.15, 1.2), "1.15, 1.2"),
        ({"stiffness": "0.1 N/mm"}, "stiffness 0.1 N/mm"),
        (True, "yes"),
    ],
)
def test_values_are_written_for_the_eye(value, text):
    assert facts.text(value) == text


def test_an_unfinished_run_says_so(strip_run, tmp_path):
    shutil.copytree(strip_run.directory, tmp_path / "run")
    info = strip_run.info | {"status": "not converged", "error": "stage 'push' stopped"}
    del info["timings"], info["ended"]
    (tmp_path / "run" / "run.json").write_text(json.dumps(info))
    rows = (tmp_path / "run" / "history.csv").read_text().splitlines(keepends=True)[:9]
    (tmp_path / "run" / "history.csv").write_text("".join(rows))
    with h5py.File(tmp_path / "run" / "results.h5", "a") as file:
        for column in file["history"].values():
            column.resize(8, axis=0)
    run = dealib.open(tmp_path / "run")
    assert facts.warnings(run)[0] == "The run is not complete: not converged. stage 'push' stopped"
    assert dict(facts.solution(run))["Steps"] == "7 of 17 planned"
    (tmp_path / "run" / "history.csv").unlink()
    with h5py.File(tmp_path / "run" / "results.h5", "a") as file:
        del file["history"]
    with pytest.raises(ConfigError, match="no step has converged yet"):
        render(dealib.open(tmp_path / "run"))


def browse(page, folder, *options):
    """Run the browser on a page; returns what it prints."""
    environment = os.environ | {"DBUS_SESSION_BUS_ADDRESS": "disabled:"}
    return subprocess.run(
        [BROWSER, *FLAGS, *LOUD, f"--user-data-dir={folder}", *options, page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env=environment,
    )


@pytest.mark.skipif(BROWSER is None, reason="no chromium here (Debian: apt install chromium)")
def test_a_browser_shows_the_page(page, tmp_path):
    found = browse(page, tmp_path / "a", "--dump-dom")
    said = [line for line in found.stderr.splitlines() if "CONSOLE" in line]
    assert not [line for line in said if not any(hint in line for hint in HINTS)]
    assert found.stdout.count("<figure") == 11
    for dark, paper in ((False, 1.0), (True, 0.09)):
        shot = tmp_path / f"{dark}.png"
        options = [f"--screenshot={shot}", "--window-size=1180,6800"]
        options += ["--blink-settings=preferredColorScheme=0"] if dark else []
        browse(page, tmp_path / f"b{dark}", *options)
        picture = imread(shot)[..., :3]
        assert picture.shape[:2] == (6800, 1180)
        assert picture[3, 3].mean() == pytest.approx(paper, abs=0.01)
        assert picture[6650:].std() > 0.01  # the page reaches down here
        assert picture[2000:5000].std() > 0.1  # the pictures are there
