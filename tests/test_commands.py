"""Commands that no other test runs on real output: mesh, info, dry runs, a study's report."""

import gmsh
import pytest
from conftest import CONFIGS

import dealib

pytestmark = pytest.mark.once  # texts and files


@pytest.fixture
def command(program):
    """Runs the program; returns its exit code, output and errors."""

    def run(*arguments, cwd):
        done = program(*arguments, cwd=cwd)
        return done.returncode, done.stdout, done.stderr

    return run


def test_mesh_writes_file_and_picture(command, tmp_path):
    config = CONFIGS / "benchmark_strip_air.yaml"
    view = tmp_path / "m.png"
    code, out, err = command("mesh", config, "--out", "m.msh", "--view", view, cwd=tmp_path)
    assert (code, err) == (0, "")
    assert "bottom_electrode 60, film 240, top_electrode 60, air" in out
    assert view.read_bytes().startswith(b"\x89PNG")
    case = dealib.load(config, set={"mesh.file": str(tmp_path / "m.msh")})
    assert case.config.mesh.file == str(tmp_path / "m.msh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "m.msh"))
        names = {gmsh.model.getPhysicalName(*g) for g in gmsh.model.getPhysicalGroups()}
    finally:
        gmsh.finalize()
    assert {"film", "air", "inner", "outer", "film_top"} <= names
    code, _, err = command("mesh", config, "--out", "m.msh", cwd=tmp_path)
    assert code == 2
    assert "m.msh exists" in err


def test_mesh_refuses_a_picture_of_an_unknown_format(command, tmp_path):
    config = CONFIGS / "benchmark_strip.yaml"
    code, out, err = command("mesh", config, "--out", "m.msh", "--view", "m.txt", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert err == "dealib: --view m.txt: the name must end in .png, .svg, .pdf\n"
    assert not (tmp_path / "m.msh").exists()


def test_info_tells_what_a_run_holds(command, strip_run, tmp_path):
    code, out, err = command("info", strip_run.directory, cwd=tmp_path)
    assert (code, err) == (0, "")
    # the directory's name tells runs of one config apart; what is beyond a limit comes first
    told = "strip (benchmark_strip): done; beyond: wrinkling 1.112, pull-in 1.148\n"
    assert out.startswith(told)
    assert "beyond: pull-in 1.148 (1 is the limit), step 17, t = 17 s, actuate: a film" in out
    for part in ("-3 .. 0 mm", "359.12 pF", "dolfinx", "timings", "steps"):
        assert part in out
    assert "17" in next(line for line in out.splitlines() if line.startswith("steps"))


def test_dry_run_writes_nothing(command, tmp_path):
    code, out, err = command("run", CONFIGS / "benchmark_strip.yaml", "--dry-run", cwd=tmp_path)
    assert (code, err) == (0, "")
    assert "3943 unknowns, 17 steps" in out
    assert not list(tmp_path.iterdir())


def test_report_of_a_study_is_its_gallery(command, tmp_path):
    study = CONFIGS / "thesis" / "fig04.yaml"
    code, out, err = command("report", study, "--out", "pages", cwd=tmp_path)
    assert (code, err) == (0, "")
    page = (tmp_path / "pages" / "gallery.html").read_text()
    assert "gallery.html" in out
    assert "Fig. 4" in page
    assert "<svg" in page
