"""What is too large, too deep or no file at all is refused at once, and sizes are estimated."""

import os
import re
import time
from collections import defaultdict
from pathlib import Path

from mpi4py import MPI

import pytest
from conftest import CONFIGS, case
from test_bad_input import BASE, dealib  # noqa: F401 - a fixture

from dealib.config import load
from dealib.config.size import size
from dealib.device.msh import read as read_mesh
from dealib.errors import ConfigError
from dealib.fem.domain import build_domain, build_spaces
from dealib.fem.electrodes import build_map
from dealib.log import to_terminal
from dealib.patience import patience
from dealib.reading import read_text
from dealib.study.plan import read

pytestmark = pytest.mark.once  # refused before dolfinx is asked
SMALL = CONFIGS.parent / "tests" / "small.yaml"


def refused(text, tmp_path, of=load):
    """The message about a file, without its name."""
    path = tmp_path / "case.yaml"
    path.write_text(text)
    begin = time.process_time()
    with pytest.raises(ConfigError) as caught:
        of(path)
    assert time.process_time() - begin < 5
    assert caught.value.exit_code == 2
    return str(caught.value).removeprefix(f"{path}:").splitlines()[0]


# --- texts -----------------------------------------------------------------------------------


def bomb(levels, width):
    """Anchors that each refer to the one before several times."""
    lines = ["a0: &a0 [" + ",".join(["x"] * width) + "]"]
    lines += [
        f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * width)}]" for k in range(1, levels)
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def study(text):
    return f"name: s\ntitle: t\nbase: base.yaml\n{text}"


TOO_LARGE = [
    ("aliases", bomb(8, 9) + BASE,
     "6:10: the aliases up to here stand for more than 100000 values"),
    ("aliases of keys", BASE + bomb(5, 30),
     "26:18: the aliases up to here stand for more than 100000 values"),
    ("a list within itself", BASE + "x: &a [1, *a]\n", "23:11: a value that contains itself"),
    ("brackets", "x: " + "[" * 400 + "]" * 400 + "\n" + BASE,
     "1:54: more than 50 levels of nesting"),
    ("braces", "x: " + "{a: " * 3000, "1:201: more than 50 levels of nesting"),
    ("indents", "\n".join(" " * k + "a:" for k in range(900)),
     "51:51: more than 50 levels of nesting"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "said"), [t[1:] for t in TOO_LARGE], ids=[t[0] for t in TOO_LARGE]
)
def test_small_texts_do_not_stand_for_large_trees(tmp_path, text, said):
    assert refused(text, tmp_path) == said
    assert (
        refused(study(text.removeprefix(BASE)), tmp_path, read).split(": ")[1]
        == said.split(": ")[1]
    )


def test_aliases_that_are_few_are_welcome(tmp_path):
    text = BASE.replace("law: neo_hookean\n", "law: &law neo_hookean\n", 1)
    text = text.replace("law: neo_hookean", "law: *law")
    (tmp_path / "case.yaml").write_text(text)
    assert load(tmp_path / "case.yaml").config.materials["electrode"].law == "neo_hookean"


def test_the_limits_hold_for_overrides(tmp_path):
    (tmp_path / "case.yaml").write_text(BASE)
    with pytest.raises(ConfigError, match=r"^set program=\[\[.*: more than 50 levels of nesting$"):
        load(tmp_path / "case.yaml", ["program=" + "[" * 1000])


def test_a_long_line_is_shown_in_part(tmp_path):
    text = "x: '" + "y" * 100_000 + "'\n" + BASE
    (tmp_path / "case.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "case.yaml")
    assert max(map(len, str(caught.value).splitlines())) < 300
    (tmp_path / "case.yaml").write_text(BASE.replace("columns: 8", f"grading: {'y' * 10_000}"))
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "case.yaml")
    assert max(map(len, str(caught.value).splitlines())) < 300


# --- files -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command", ["check", "run", "mesh", "study", "calibrate", "export", "bias"]
)
def test_what_is_no_file_is_not_read(dealib, tmp_path, command):  # noqa: F811
    os.mkfifo(tmp_path / "pipe.yaml")
    for path, kind in (("pipe.yaml", "it is a pipe"), ("/dev/zero", "it is a device")):
        said = f"dealib: {path}: cannot read the config: {kind}\n"
        assert dealib(command, path) == (2, "", said)


def test_a_huge_file_is_not_read_to_its_end(tmp_path):
    with (tmp_path / "case.yaml").open("wb") as file:
        file.truncate(10**12)  # takes no place on the disk
    with pytest.raises(ConfigError, match=r"case\.yaml: larger than 1 MB, too large"):
        load(tmp_path / "case.yaml")
    with pytest.raises(ConfigError, match="larger than 1000 MB, too large for a mesh"):
        read_mesh(tmp_path / "case.yaml")


def test_a_mesh_that_is_no_file_is_not_read(dealib, tmp_path):  # noqa: F811
    os.mkfifo(tmp_path / "m.msh")
    (tmp_path / "case.yaml").write_text(BASE.replace("columns: 8", "file: m.msh"))
    for command in ("check", "mesh", "run"):
        said = "dealib: m.msh: cannot read the mesh: it is a pipe\n"
        assert dealib(command, "case.yaml") == (2, "", said)


def test_text_files_may_begin_with_a_mark_and_end_lines_as_on_windows(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    assert read_text(path, "config", 100) == "a: 1\nb: 2\n"


LONG = "x" * 6000


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "case.yaml", "--out", LONG],
        ["run", "case.yaml", f"--out={LONG}"],
        ["run", LONG],
        ["check", "a/" * 3000],
        ["mesh", "case.yaml", "--out", f"{LONG}.msh"],
        ["export", "case.yaml", "--out", LONG],
        ["study", "case.yaml", "--out", LONG],
        ["info", LONG],
        ["report", "x", "--out", LONG],
        ["run", "case.yaml", "--set", f"output.directory={LONG}"],
        ["run", "case.yaml", "--set", f"mesh.file={LONG}"],
        ["run", "case.yaml", "--set", f"name={LONG}"],
    ],
)
def test_paths_that_no_disk_takes(dealib, tmp_path, arguments):  # noqa: F811
    (tmp_path / "case.yaml").write_text(BASE)
    code, out, err = dealib(*arguments)
    assert (code, out) == (2, "")
    assert err.endswith(": too long for a path\n")
    assert len(err) < 300
    assert [p.name for p in tmp_path.iterdir()] == ["case.yaml"]


def test_a_path_without_a_nul(tmp_path):
    said = refused(BASE + 'output: {directory: "a\\0b"}\n', tmp_path)
    assert said == "23:21: output.directory: a path must not contain control characters"


# --- sizes -----------------------------------------------------------------------------------

AIR = "air_height: 6 mm"
TABLES = "tables: {{displacement: [0 mm, -2 mm], voltage: [0 V, 2 kV], points: {}}}\nprogram:"
# (what, text in BASE, its replacement, message)
SIZES = [
    ("columns", "columns: 8", "columns: 1000000000",
     r"8:1: mesh: about 1\.\de\+11 unknowns, 4 steps, \d+ TB of memory, [\d.]+ (days|years), "
     r"[\d.]+ TB of disk; this machine has [\d.]+ GB of memory: choose a coarser mesh"),
    ("more columns than a float", "columns: 8", f"columns: {'1' * 400}0", r"8:1: mesh: about "),
    ("rows", "columns: 8", "columns: 8\n  film_rows: 100000000", r"8:1: mesh: about "),
    ("air", "columns: 8", "columns: 8\n  air_size: 1 nm", r"8:1: mesh: about "),
    ("steps", "mm}, steps: 2", "mm}, steps: 1000000000",
     r"19:1: program: at most 1,000,000 steps, not about 1,710 unknowns, 1e\+09 steps, "),
    ("cycles", "[0 V, 2 kV, 0 V]}, steps: 2", "[0 V, 2 kV, 0 V]}, steps: 2, cycles: 1000000",
     r"19:1: program: at most 1,000,000 steps, not about 1,710 unknowns, 2,000,000 steps, "),
    ("a long path", "terminal: {voltage: [0 V, 2 kV, 0 V]}, steps: 2",
     "follow: {vary: force, until: {displacement: -3 mm}, states: 2000000}",
     r"19:1: program: at most 1,000,000 steps"),
    ("tables", "program:", TABLES.format("[100000, 100000]"),
     r"19:61: tables.points: at most 1,000,000 steps, not about 1,710 unknowns, 1e\+10 steps, "
     r"\d+ MB of memory, \d+ years, "),
    ("branches", "    prestretch: 1.1", "    prestretch: 1.1\n    branches: ["
     + ", ".join(["{shear_modulus: 20 kPa, relaxation_time: 1 s}"] * 500) + "]",
     "16:15: materials.film.branches: expected at most 30 items, not 500"),
    ("cuts", "program:", "solver: {max_cuts: 1000000}\nprogram:",
     "19:20: solver.max_cuts: must be at most 40, not 1000000"),
    ("a film that is no film", "30 um", "1e-308 um",
     "5:19: geometry.film_thickness: '1e-308 um' is too small for a length"),
    ("a film of an atom", "30 um", "1e-3 nm",
     "5:19: geometry.film_thickness: 1e-09 mm are less than a millionth of the strips' length "
     r"\(4 mm\); check the unit"),
    ("a strip that is no strip", "12 mm", "8.000001 mm",
     "4:17: geometry.outer_radius: the ring is narrower than a millionth of inner_radius; check "
     "the unit"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), [s[1:] for s in SIZES], ids=[s[0] for s in SIZES])
def test_what_cannot_fit_is_refused_with_the_estimate(tmp_path, old, new, said):
    assert old in BASE
    assert re.match(said, refused(BASE.replace(old, new, 1), tmp_path))


def test_a_study_of_too_many_cases(tmp_path):
    (tmp_path / "base.yaml").write_text(BASE)
    axes = "\n".join(
        f"  a{k}: {{program.1.steps: {list(range(1, 101))}}}" for k in range(4)
    )  # fmt: skip
    said = refused(study(f"vary:\n{axes}\n"), tmp_path, read)
    assert said == "4:1: vary: 1e+08 cases; a study has at most 10,000"


def test_check_tells_the_size(dealib, tmp_path):  # noqa: F811
    code, out, err = dealib("check", CONFIGS / "deap100.yaml")
    assert (code, err) == (0, "")
    assert re.fullmatch(
        r".*deap100.yaml: valid; deap100: prestrain, preload, hold, actuate\n"
        r"about 10,\d00 unknowns, 31 steps, 2\d\d MB of memory, [\d.]+ s, \d\d MB of disk\n"
        r"not seen here: whether terminals touch; `dealib run --dry-run` sees it\n",
        out,
    )


def test_a_full_disk_is_told_before_the_run(dealib, tmp_path, monkeypatch):  # noqa: F811
    usage = type("usage", (), {"free": 3e5})
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage)
    (tmp_path / "case.yaml").write_text(BASE)
    for command in (["check", "case.yaml"], ["run", "case.yaml", "--out", "runs/case"]):
        code, out, err = dealib(*command)
        assert (code, out) == (2, "")
        assert re.fullmatch(
            r"dealib: runs/case: about 1,710 unknowns, 4 steps, .* MB of memory, .* s, . MB of "
            r"disk; the disk has 0 MB left: choose output.fields: stage or none, or another "
            r"--out\n",
            err,
        )
    assert [p.name for p in tmp_path.iterdir()] == ["case.yaml"]


# What runs took, on Debian 12: unknowns, peak memory (MB), disk (MB)
MEASURED = [
    ("benchmark_strip", {}, 3943, 183, 6.9),
    ("benchmark_strip", {"mesh__columns": 960}, 63343, 331, 106.4),
    ("benchmark_strip", {"mesh__columns": 480, "mesh__film_rows": 16, "mesh__electrode_rows": 4},
     123775, 523, 181.2),
    ("deap100", {}, 10489, 206, 28.3),
    ("deap100", {"mesh__columns": 240}, 40753, 361, 107.7),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "unknowns", "memory", "disk"), MEASURED)
def test_the_estimate_is_near_what_was_measured(name, changes, unknowns, memory, disk):
    found = size(case(name, **changes).config)
    assert found.unknowns == pytest.approx(unknowns, rel=0.1)
    assert found.memory / 1e6 == pytest.approx(memory, rel=0.25)
    assert found.disk / 1e6 == pytest.approx(disk, rel=0.25)


FIELD = {"physics__model": "membrane", "physics__wrinkling": "tension_field"}
# Seconds of one processor that runs took: solids in space, sheets, tension fields, planes
TAKEN = [
    ("published/beam", {}, 6.1),
    ("published/blister", {}, 24.0),
    ("published/cylinder", {}, 69.2),
    ("published/gripper", {}, 9.8),
    ("published/helix", {}, 35.1),
    ("published/helix", {"program__0__steps": 24}, 34.8),
    ("devices/minimum_energy_structure", {}, 26.1),
    ("devices/wrinkling_film", {}, 7.2),
    ("devices/positioning_stage", {}, 3.8),
    ("devices/positioning_stage", FIELD, 9.5),
    ("devices/wrinkling_film", FIELD, 5.4),
    ("devices/segmented_annulus", FIELD, 4.0),
    ("devices/segmented_annulus", {}, 1.8),
    ("devices/stack", {}, 1.9),
    ("membrane", {}, 3.1),
]


@pytest.mark.parametrize(("name", "changes", "seconds"), TAKEN)
def test_the_time_is_estimated_to_a_factor_of_two(name, changes, seconds):
    assert 0.5 < size(case(name, **changes).config).seconds / seconds < 2


def test_rows_that_are_interpolated_take_neither_time_nor_disk():
    """Of 100 to 400 rows a stage of `benchmark_strip` solves 14 to 41, of `deap100` 53."""
    given = {"program__1__steps": "auto", "program__1__rows": 400}
    each, few, many = (
        size(case("benchmark_strip", **{"program__1__steps": n} | more).config)
        for n, more in ((50, {}), (400, {}), ("auto", given))
    )
    assert (many.steps, many.seconds) == (few.steps, each.seconds)
    assert each.disk < many.disk < each.disk + 400 * 500 < few.disk


DISC, SOLID = "devices/expanding_circle", {"geometry__space": "3d", "probes": None}
SHEET = {"physics__model": "membrane"}
# the same in other spaces: name, changes, unknowns, peak memory (MB)
SPACES = [
    (DISC, SOLID | {"mesh__columns": 16, "geometry__symmetry": "[X, Y]"}, 12324, 315),
    (DISC, SOLID | {"mesh__columns": 8}, 38035, 648),
    (DISC, SOLID | {"mesh__columns": 8, "mesh__film_rows": 4}, 70563, 1300),
    (DISC, SOLID | {"mesh__columns": 16, "mesh__sectors": 12}, 78547, None),
    (DISC, SOLID | {"mesh__columns": 8, "physics__formulation": "mixed"}, 42131, None),
    (DISC, SOLID | {"mesh__columns": 16, "mesh__order": 1}, 6795, None),
    (DISC, SHEET | SOLID | {"mesh__columns": 20}, 7588, 230),
    (DISC, SHEET | SOLID | {"mesh__columns": 20, "mesh__order": 1}, 1876, None),
    (DISC, SHEET | {"mesh__columns": 200}, 800, 216),
    (DISC, SHEET | {"mesh__columns": 4000}, 16000, 229),
    (DISC, SHEET | {"mesh__columns": 200, "mesh__order": 1}, 400, None),
    (DISC, {"physics__formulation": "mixed"}, 2039, None),
]


@pytest.mark.parametrize(("name", "changes", "unknowns", "memory"), SPACES)
def test_the_estimate_holds_in_other_spaces(name, changes, unknowns, memory):
    given = {"physics__formulation": "displacement"} | changes
    found = size(case(name, **given).config)
    assert found.unknowns == pytest.approx(unknowns, rel=0.2)
    if memory is not None:
        assert 0.5 < found.memory / (memory * 1e6) < 2
        known = size(case(name, **given).config, unknowns).memory / 1e6
        assert known == pytest.approx(memory, rel=0.25)


@pytest.mark.parametrize("name", [
    "devices/balloon", "devices/positioning_stage", "devices/stack", "devices/wrinkling_film",
    "devices/minimum_energy_structure", "published/beam", "published/blister", "own_mesh",
    "pull_in", "softening", "harvesting", "dynamics/pump_cycle",
])  # fmt: skip
def test_unknowns_are_counted_before_there_is_a_mesh(name):
    """Patches, triangles, tetrahedra, mounts, layers of some thickness, air."""
    config = case(name).config
    domain = build_domain(config, MPI.COMM_WORLD, None)
    mixed = config.physics.formulation == "mixed"
    spaces = build_spaces(domain, config.mesh.order, mixed)
    solved = build_map(domain, spaces, config, config.sensing.charging).owned
    assert size(config).unknowns == pytest.approx(solved, rel=0.2 if name == "pull_in" else 0.05)


def test_the_estimate_knows_what_a_run_takes(strip_run):
    files = [f for f in strip_run.directory.rglob("*") if f.is_file()]
    used = sum(f.stat().st_size for f in files if f.suffix != ".html")  # a report, of other tests
    found = size(strip_run.config, strip_run.info["unknowns"])
    assert found.disk == pytest.approx(used, rel=0.3)
    assert found.steps == strip_run.info["steps"]
    own = case("own_mesh").config
    cells = size(own).unknowns / 11
    true = sum(len(c) for parts in read_mesh(Path(own.mesh.file)).cells(2).values() for c in parts)
    assert cells == pytest.approx(true, rel=0.4)


# --- patience --------------------------------------------------------------------------------


def test_what_takes_long_is_told_once(monkeypatch, capsys):
    monkeypatch.setattr("dealib.patience._MOMENT", 0.4)
    to_terminal(False)
    for _ in range(4):  # longer than a moment only together
        with patience("waiting for a test"):
            time.sleep(0.15)
    with patience("something short"):
        pass
    time.sleep(0.5)
    assert set(capsys.readouterr().out.splitlines()) == {"dealib: waiting for a test ..."}


def test_compiling_and_meshing_say_so(dealib, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setattr("dealib.patience._MOMENT", 0.0)
    monkeypatch.setattr("dealib.patience._spent", defaultdict(float))
    (tmp_path / "case.yaml").write_text(SMALL.read_text())
    code, out, err = dealib("run", "case.yaml", "--dry-run")
    assert code == 0, err
    assert "dealib: meshing ...\n" in out
    assert (
        "dealib: compiling the equations of this kind of problem, which is done once ...\n" in out
    )
    assert [p.name for p in tmp_path.iterdir()] == ["case.yaml"]
