"""What README and the guide show works: commands, configs and Python; all links resolve.

Commands run in order in a scratch copy, whose meshes are coarse, its programs short and its thesis
small, so that this takes a minute.
"""

import json
import os
import re
import shlex
import shutil
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from ruamel.yaml import YAML as Reader
from typer.testing import CliRunner

import dealib
from dealib.calibration.coupon_schema import Coupon
from dealib.calibration.schema import Fit
from dealib.cli.app import app

pytestmark = pytest.mark.once  # each command has tests of its own
ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
GUIDE = sorted((ROOT / "notebooks" / "guide").glob("*.md"))
RUN_BESIDE = {"python.md"}  # in a folder of its own (`test_python.py`)
SHOWN = "\n".join(
    [README, *(p.read_text(encoding="utf-8") for p in GUIDE if p.name not in RUN_BESIDE)]
)
FENCED = re.findall(r"^```(\w+)\n(.*?)^```$", SHOWN, re.MULTILINE | re.DOTALL)
YAML = [text for language, text in FENCED if language == "yaml"]
PYTHON = [text for language, text in FENCED if language == "python"]
INDENTED = re.findall(r"^    (\S.*)$", re.sub(r"^```.*?^```$", "", SHOWN, flags=re.M | re.S), re.M)
COMMANDS = [
    line.split("  #")[0].rstrip() for line in INDENTED if line.startswith(("./", ".venv/bin/"))
]
PAGES = [  # whose links must resolve
    *(ROOT / "README.md", *GUIDE, ROOT / "meshes" / "README.md", ROOT / "tests" / "README.md"),
    *sorted((ROOT / "tests").glob("*/README.md")),
    ROOT / "configs" / "validation" / "README.md",
    *sorted((ROOT / "notebooks").glob("*.*")),
]
CHEAP = {  # no suite within the suite, no more processes than there are, a short film
    "./test": "./test --version",
    ".venv/bin/dealib animate runs/deap100": ".venv/bin/dealib animate runs/deap100 --seconds 0.5",
    ".venv/bin/dealib animate runs/resonance-modes --field mode2": (
        ".venv/bin/dealib animate runs/resonance-modes --field mode2 --seconds 0.5"
    ),
    ".venv/bin/dealib sweep configs/my_study.yaml -j 8": (
        ".venv/bin/dealib sweep configs/my_study.yaml -j 1"
    ),
    ".venv/bin/dealib uncertainty configs/designs/scatter.yaml -j 2": (
        ".venv/bin/dealib uncertainty configs/designs/scatter.yaml -j 1"
    ),
}
PAGES_IN_BROWSER = (".venv/bin/dealib app", ".venv/bin/dealib view")  # they end with Ctrl-C
THESIS = ("fig04", "fig19")  # the studies of the copy's thesis


def coarse(text):
    """A config or study that solves a hundred times as fast."""
    text = re.sub(r"\bcolumns: \d+", "columns: 8", text)
    text = re.sub(r"\bfilm_rows: \d+", "film_rows: 1", text)
    most = 6 if "name: sensing" in text else 3  # a map needs rows
    text = re.sub(r"\bsteps: (\d+)", lambda m: f"steps: {min(int(m[1]), most)}", text)
    text = re.sub(r"\bcycles: \d+", "cycles: 1", text)
    if "\nparameters:" in text:  # of a fit
        text = text.replace("\nmethod:\n", "\nmethod:\n  tolerance: 0.05\n")
    text = text.replace("[50 ms, 1 s, 10 s, 100 s, 2000 s]", "[50 ms, 100 s, 2000 s]")  # of rates
    text = text.replace("duration: 1.25 s", "duration: 30 ms")  # of six arms that swing
    return re.sub(r"\bair_height: \S+ mm", "air_height: 0 mm", text)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A checkout whose .venv runs the code under test."""
    root = tmp_path_factory.mktemp("readme") / "dealib"
    root.mkdir()
    for name in ("configs", "meshes"):
        shutil.copytree(ROOT / name, root / name)
    for name in ("run", "test"):
        shutil.copy(ROOT / name, root)
    for path in (root / "configs").rglob("*.yaml"):
        path.write_text(coarse(path.read_text(encoding="utf-8")), encoding="utf-8")
    for path in (root / "configs" / "thesis").glob("fig*.yaml"):
        if path.stem not in THESIS:
            path.unlink()
    scripts = {
        "setup/setup.sh": "",
        ".venv/bin/dealib": f'exec {shlex.quote(sys.executable)} -m dealib "$@"',
        ".venv/bin/python": f'exec {shlex.quote(sys.executable)} "$@"',
    }
    for name, line in scripts.items():
        script = root / name
        script.parent.mkdir(parents=True, exist_ok=True)
        script.write_text(f"#!/bin/sh\n{line}\n")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
    (study,) = (text for text in YAML if "\nvary:" in text)
    (root / "configs" / "my_study.yaml").write_text(coarse(study))
    return root


def shell(command, root):
    """Run a line in a process of its own, as a user does."""
    environment = os.environ | {
        "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"
    }  # fmt: skip
    done = subprocess.run(
        command, shell=True, cwd=root, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"


def here(command):
    """Run a line of dealib in this process, whose libraries are loaded."""
    done = CliRunner().invoke(app, shlex.split(command)[1:])
    assert done.exit_code == 0, f"{command}\n{done.output[-2000:]}\n{done.exception!r}"


def serves(command, root):
    """A page is served, and Ctrl-C ends it."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        f"exec {command} --no-browser",
        shell=True, cwd=root, env=environment, stdout=subprocess.PIPE, text=True,
    ) as job:  # fmt: skip
        line = job.stdout.readline()
        job.send_signal(signal.SIGINT)
        assert line.startswith("http://127.0.0.1"), command
    assert job.returncode == 130


def no_rendering():
    from dealib.errors import PlatformError
    from dealib.plots.render import check_rendering

    try:
        check_rendering()
    except PlatformError:
        return True
    return False


def prose(page):
    """A page's text, of a notebook its Markdown cells, without code."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = [c["source"] for c in json.loads(text)["cells"] if c["cell_type"] == "markdown"]
        text = "\n\n".join("".join(cell) for cell in cells)
    return re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)


def anchors(page):
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_resolve(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if target.startswith("https://"):
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        assert file.exists(), f"{page}: {target}"
        assert not anchor or anchor in anchors(file), f"{page}: {target}"


def test_readme_is_short_and_leads_to_every_page():
    assert len(README.splitlines()) <= 220
    for page in GUIDE:
        assert f"](notebooks/guide/{page.name})" in README, page
        assert re.match(r"# .+\n\nThis page is for everyone who(se)? ", page.read_text("utf-8")), (
            page
        )


def test_pictures_are_shown():
    for picture in (ROOT / "notebooks" / "pictures").iterdir():
        assert f"pictures/{picture.name})" in SHOWN, picture


def test_readme_lists_every_command():
    section = README.partition("\n## Commands\n")[2].partition("\n## ")[0]
    told = re.findall(r"`(\w+)`", section.partition("|\n|")[2])
    assert sorted(told) == sorted(typer.main.get_command(app).commands)


def test_commands_are_found():
    assert len(COMMANDS) >= 25
    for part in ("./run configs/deap100.yaml", "./test", "dealib compare", "dealib export"):
        assert any(part in command for command in COMMANDS), part


def test_every_command_works(copy, monkeypatch):
    """In order, as each may use what an earlier one has made."""
    monkeypatch.chdir(copy)
    for given in dict.fromkeys(COMMANDS):
        if "--revolved" in given and no_rendering():
            continue
        command = CHEAP.get(given, given)
        if given.startswith(PAGES_IN_BROWSER):
            serves(given, copy)
        elif command.startswith(".venv/bin/dealib "):
            here(command)
        else:
            shell(command, copy)
    for file in (
        *("runs/deap100/report.html", "runs/deap100/plots/overview.png", "comparison.png"),
        *("runs/deap100/plots/animation-S_RR+E.mp4", "runs/thicker/history.csv"),
        *("runs/studies/thesis/gallery.html", "runs/studies/thickness/summary.csv"),
        *("runs/tables-tables/tables.csv", "mooney_rivlin.png", "bias_negative_rate-bias.png"),
    ):
        assert (copy / file).is_file(), file
    # Python last: it reads what the commands have written
    shell(shlex.join([sys.executable, "-c", "\n".join(PYTHON)]), copy)


def test_every_piece_of_a_config_is_valid(tmp_path):
    (whole,) = (text for text in YAML if "\ngeometry:" in text)
    pieces = [text for text in YAML if text != whole and "\nvary:" not in text]
    of_data = {
        head: t for head in ("data:", "name: my_silicone") for t in YAML if t.startswith(head)
    }
    fit, coupon = (Reader(typ="safe").load(text) for text in of_data.values())
    example = (ROOT / "configs" / "fits" / "example.yaml").read_text(encoding="utf-8")
    Fit.model_validate(Reader(typ="safe").load(example) | fit)
    Coupon.model_validate(coupon)
    pieces = [text for text in pieces if text not in of_data.values()]
    assert len(pieces) >= 4
    for k, text in enumerate([whole, *pieces]):
        config, piece = (Reader(typ="safe").load(t) for t in (whole, text))
        if isinstance(piece, list):
            config["program"] += piece
            config["geometry"]["air_height"] = "12 mm"  # its branch goes far
        elif "film" in piece:
            config["materials"]["film"] |= piece["film"]
        else:
            config |= piece
        path = tmp_path / f"{k}.yaml"
        Reader(typ="safe").dump(config, path)
        dealib.load(path)


def test_the_first_example_tells_what_it_does_beyond_its_limits():
    """Numbers of README, on the shipped mesh: beyond at 2.5 kV, inside at 2.2 kV."""
    told = dict(re.findall(r"^beyond: (\S+) (\S+) \(1 is the limit\)", README, re.MULTILINE))
    assert set(told) == {"wrinkling", "pull-in"}
    case = dealib.load(ROOT / "configs" / "deap100.yaml", set={"geometry.air_height": "0 mm"})
    rows = [s.row for s in dealib.Simulation(case) if s.row["time_s"] <= 25]
    for name, value in told.items():
        used = [row[f"{name.replace('-', '_')}_use"] for row in rows]
        assert max(used) == pytest.approx(float(value), abs=0.03)  # the air adds a little
        below = [u for u, row in zip(used, rows, strict=True) if row["voltage_kV"] <= 2.2]
        assert max(below) < 1
