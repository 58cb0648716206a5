"""The run directory: everything is there, readable without dolfinx, and true."""

import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case
from typer.testing import CliRunner

import dealib
from dealib.cli.app import app
from dealib.errors import ConfigError
from dealib.fem.layout import Layout
from dealib.fem.problem import build_problem
from dealib.program.run import line
from dealib.results import stages, store, xdmf
from dealib.results.summary import actuations
from dealib.units import counted, neat

FIRST = [
    *("step", "time_s", "stage", "displacement_mm", "force_N", "voltage_kV", "charge_uC"),
    *("capacitance_pF", "elastic_energy_mJ", "electric_energy_mJ", "field_max_MV_per_m"),
    *("thickness_stretch_min", "newton_iterations"),
]
FIELDS = {
    "u": 3,
    "phi": 1,
    "E": 3,
    "D": 3,
    "cauchy_stress": 9,
    "second_pk_stress": 9,
    "maxwell_stress": 9,
    "J": 1,
}


def test_run_directory(strip_run):
    found = {p.name for p in strip_run.directory.iterdir()}
    wanted = "config.yaml config.resolved.yaml run.json mesh.msh history.csv results.h5 fields.xdmf"
    assert set(wanted.split()) <= found
    assert list(strip_run.history.columns[: len(FIRST)]) == FIRST
    assert strip_run.info["status"] == "done"
    phases = {"import", "mesh", "forms", "assembly", "factorisation", "solve", "output", "total"}
    assert phases <= set(strip_run.info["timings"])
    given = (CONFIGS / "benchmark_strip.yaml").read_text()
    assert (strip_run.directory / "config.yaml").read_text() == given
    assert dealib.load(strip_run.directory / "config.resolved.yaml").config == strip_run.config


def test_results_file_stands_alone(strip_run, tmp_path):
    copy = tmp_path / "alone.h5"
    copy.write_bytes((strip_run.directory / store.STATES).read_bytes())
    with h5py.File(copy, "r") as file:
        assert len(file["states"]) == len(strip_run.history)
        force = file["history/force_N"][:]
        assert file["versions/dolfinx"][()].decode()
        assert "benchmark_strip" in file["config"][()].decode()
        assert file["states/00017"].shape[1] == 3
    assert force == pytest.approx(strip_run.history["force_N"].to_numpy(), rel=1e-15)


def test_xdmf_in_pyvista(strip_run):
    import pyvista as pv

    reader = pv.get_reader(strip_run.directory / xdmf.FIELDS)
    assert reader.time_values == pytest.approx(strip_run.history["time_s"].tolist())
    reader.set_active_time_value(reader.time_values[-1])
    grid = reader.read()
    assert set(grid.celltypes) == {pv.CellType.BIQUADRATIC_QUAD}
    inner = np.isclose(grid.points[:, 0], 8.35)
    assert grid.point_data["u"][inner, 1] == pytest.approx(-3, abs=1e-6)
    assert grid.point_data["u"][inner, 0] == pytest.approx(0, abs=1e-6)
    assert grid.point_data["phi"].max() == pytest.approx(2.5, abs=1e-6)
    assert grid.point_data["phi"].min() == pytest.approx(0, abs=1e-9)
    for name, size in FIELDS.items():
        values = np.asarray(grid.point_data[name])
        assert values.reshape(len(grid.points), -1).shape[1] == size, name
        assert np.isfinite(values).all()


def test_fields_of_the_reader_agree_with_the_file(strip_run):
    import pyvista as pv

    grid = strip_run.fields(-1)
    reader = pv.get_reader(strip_run.directory / xdmf.FIELDS)
    reader.set_active_time_value(reader.time_values[-1])
    other = reader.read()
    for name in FIELDS:
        a, b = np.asarray(grid.point_data[name]), np.asarray(other.point_data[name])
        assert a.ravel() == pytest.approx(b.ravel(), rel=1e-5, abs=1e-6 * np.abs(a).max())


@pytest.mark.parametrize("viscous", [False, True])
def test_fields_of_large_meshes_come_in_blocks(strip_run, viscous, tmp_path, monkeypatch):
    """However many cells are taken at a time, the fields are the same."""
    run = strip_run
    if viscous:
        run = dealib.simulate(CONFIGS.parent / "tests" / "viscous.yaml", tmp_path / "run")
    arrays = [run.arrays(-1)]
    for room in (2e5, 1.0):  # some cells, and a cell at a time
        monkeypatch.setattr("dealib.results.fields._ROOM", room)
        arrays.append(run.arrays(-1))
    for name, whole in arrays[0].items():
        for other in arrays[1:]:
            assert other[name] == pytest.approx(whole, abs=1e-13 * np.abs(whole).max()), name


def test_stress_jumps_at_the_faces(strip_run):
    """Film and electrode keep their own stress where they touch, and both are right."""
    mesh, fields = strip_run.mesh, strip_run.arrays(0)  # mounted, at rest
    film = np.unique(mesh.cells[mesh.in_region("film")])
    top = np.unique(mesh.cells[mesh.in_region("top_electrode")])
    assert not set(film) & set(top)
    on_face = np.abs(mesh.points[:, 1] - 0.015) < 1e-9
    film, top = film[on_face[film]], top[on_face[top]]
    assert len(film) == len(top) == 121
    S = fields["second_pk_stress"]
    # equal-biaxial pre-stretch 1.15 of a slightly compressible neo-Hookean film (closed form)
    G, kappa, l, lz = 0.334, 16.67, 1.15, strip_run_thickness()
    J = l * l * lz
    deviator = G * J ** (-5 / 3)
    I1 = 2 * l * l + lz * lz
    sigma = deviator * (l * l - I1 / 3) + kappa * (J - 1)
    assert S[film, 0, 0] == pytest.approx(sigma, rel=1e-9)
    assert S[film, 2, 2] == pytest.approx(sigma, rel=1e-9)
    assert S[film, 1, 1] == pytest.approx(0, abs=1e-9)
    assert S[top] == pytest.approx(0, abs=1e-9)


def strip_run_thickness():
    from dealib.materials import thickness_stretch

    return thickness_stretch(case("benchmark_strip").config.materials["film"], 1.15, 1.15)


def test_field_in_the_film(strip_run):
    """Nearly uniform: V over the deformed thickness, from top to bottom; none in electrodes."""
    mesh, fields = strip_run.mesh, strip_run.arrays(-1)
    film = np.unique(mesh.cells[mesh.in_region("film")])
    top = np.unique(mesh.cells[mesh.in_region("top_electrode")])
    E = np.linalg.norm(fields["E"], axis=1)
    assert E[top] == pytest.approx(0)
    middle = film[np.abs(mesh.points[film, 0] - 10.35) < 0.5]
    assert 80 < E[middle].min() < E[middle].max() < 160  # MV/m
    eps = 8.8541878128e-6 * 3
    assert fields["D"][film] == pytest.approx(eps * fields["E"][film])
    centre = mesh.cells[mesh.in_region("film"), 8]  # of one cell each: not averaged
    trace = np.trace(fields["maxwell_stress"][centre], axis1=1, axis2=2)
    assert trace == pytest.approx(-eps * E[centre] ** 2 / 2, rel=1e-9)


def test_layout_scatter_is_the_inverse_of_gather():
    problem = build_problem(case("benchmark_strip_air", mesh__columns=16).config, MPI.COMM_SELF)
    layout = Layout.of(problem)
    w = problem.spaces.w
    w.x.array[:] = np.random.default_rng(0).standard_normal(len(w.x.array))
    before = w.x.array.copy()
    nodal = layout.gather()
    w.x.array[:] = 0
    layout.scatter(nodal)
    assert np.array_equal(w.x.array, before)


def test_a_run_is_read_without_the_mesh_file_it_came_from(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "configs").mkdir()
    mesh, config = tmp_path / "meshes/strips_air.msh", tmp_path / "configs/own.yaml"
    shutil.copy(CONFIGS.parent / "meshes" / mesh.name, mesh)
    short = (CONFIGS / "own_mesh.yaml").read_text().split("program:")[0]
    config.write_text(short + "program: [{stage: prestrain}]\n")
    monkeypatch.chdir(tmp_path)
    run = dealib.simulate(config, "run")
    mesh.unlink()
    monkeypatch.chdir("/")
    again = dealib.open(tmp_path / run.directory)
    assert again.fields(-1).n_points == len(again.mesh.points)
    assert not Path(again.config.mesh.file).exists()
    assert repr(again) == f"<Run {tmp_path / 'run'}: done>"


def test_reading_needs_no_dolfinx(strip_run):
    code = (
        "import sys, dealib; r = dealib.open(sys.argv[1]); g = r.fields(-1); r.history;"
        "assert g.n_points and 'dolfinx' not in sys.modules and 'petsc4py' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code, strip_run.directory], check=True)


def test_missing_step_and_missing_run(strip_run, tmp_path):
    with pytest.raises(ConfigError, match="18 stored steps, no number 99"):
        strip_run.state(99)
    with pytest.raises(ConfigError, match=r"no run here \(there is no run\.json\)"):
        dealib.open(tmp_path)


@pytest.mark.parametrize(("wanted", "stored"), [("stage", [0, 2, 3]), ("none", [])])
def test_fields_are_stored_as_asked(tmp_path, wanted, stored):
    small = case(
        "benchmark_strip",
        mesh__columns=8,
        output__fields=wanted,
        program="[{stage: push, mount: {displacement: -0.2 mm}, steps: 2},"
        " {stage: hold, steps: 1}]",
    )
    run = dealib.simulate(small, tmp_path / "run")
    assert run.stored_steps == stored
    assert (run.directory / xdmf.FIELDS).exists() is bool(stored)


def test_an_existing_directory_is_kept(strip_run, tmp_path):
    before = (strip_run.directory / "history.csv").read_bytes()
    with pytest.raises(ConfigError, match="exists and is not empty"):
        dealib.simulate(case("benchmark_strip"), strip_run.directory)
    (tmp_path / "precious.txt").write_text("mine")
    with pytest.raises(ConfigError, match="no run directory of dealib"):
        dealib.simulate(case("benchmark_strip"), tmp_path, overwrite=True)
    with pytest.raises(ConfigError, match="nothing to resume, there is no run here; start it"):
        dealib.simulate(case("benchmark_strip"), tmp_path, resume=True)
    assert (tmp_path / "precious.txt").read_text() == "mine"
    assert (strip_run.directory / "history.csv").read_bytes() == before


def test_stages_of_one_name_are_told_apart_and_the_mount_decides_what_is_told(tmp_path):
    """Held, led and free mounts under voltage; two stages in a row have one name."""
    program = (
        "[{stage: push, mount: {displacement: -1 mm}, steps: 2}, "
        "{stage: up, terminal: {voltage: 1 kV}, steps: 2}, "
        "{stage: up, duration: 2 s, terminal: {voltage: 2 kV}, steps: 2}, "
        "{stage: lead, mount: {displacement: -1.2 mm}}, "
        "{stage: let go, mount: {force: -0.1 N}, steps: 4}, "
        "{stage: up, terminal: {voltage: [2 kV, 1 kV, 0 kV]}, steps: 4}, {stage: rest}]"
    )
    small = CONFIGS.parent / "tests" / "small.yaml"
    run = dealib.simulate(dealib.load(small, set={"program": program}), tmp_path / "run")
    h = run.history
    F, u = h["force_N"], h["displacement_mm"]
    number = stages.numbers(h, run.config.program)
    assert number.tolist() == [0, 0, 0, 1, 1, 2, 2, 3, *[4] * 4, *[5] * 4, 6]
    one, two, free, three = actuations(run)
    assert (one.stage, two.stage, free.stage, three.stage) == (
        "up (1)", "up (2)", "let go", "up (3)"
    )  # fmt: skip
    for held, change in ((one, F[4] - F[2]), (two, F[6] - F[4])):
        assert (held.what, held.unit, held.kept) == ("force change", "N", "mount held")
        assert held.value == pytest.approx(change)
    for moving, change in ((free, abs(u[8:12] - u[7]).max()), (three, abs(u[14] - u[11]))):
        assert (moving.what, moving.unit, moving.kept) == ("stroke", "mm", "")
        assert moving.value == pytest.approx(change)
    text = CliRunner().invoke(app, ["info", str(run.directory)]).stdout
    assert f"force change in 'up (2)'  {F[6] - F[4]:.5g} N at up to 2 kV (mount held)" in text
    assert "'lead'" not in text
    assert text.count("stroke in") == 2


def test_what_a_path_set_free_is_held_after_it(tmp_path):
    """A force after one of the force, a displacement after one of the displacement."""
    small, up = CONFIGS.parent / "tests" / "small.yaml", "{stage: up, terminal: {voltage: 1 kV}}"
    for start, follow, stroke in (
        ("displacement: -1 mm", "{vary: force, until: {displacement: -1.2 mm}}", True),
        ("force: -0.1 N", "{vary: displacement, until: {force: -0.15 N}}", False),
    ):
        push = f"{{stage: push, mount: {{{start}}}, steps: 2}}"
        program = f"[{push}, {{stage: path, follow: {follow}, steps: 2}}, {up}]"
        run = dealib.simulate(dealib.load(small, set={"program": program}), tmp_path / start[:5])
        (told,) = actuations(run)
        u, F = run.history["displacement_mm"], run.history["force_N"]
        moved = abs(u - u.iloc[-2]).iloc[-1], abs(F - F.iloc[-2]).iloc[-1]
        assert (moved[1] < 1e-9) == stroke
        expected = ("stroke", moved[0]) if stroke else ("force change", moved[1])
        assert (told.what, told.value) == expected


def test_a_stage_ends_early_by_its_condition():
    program = dealib.load(
        CONFIGS.parent / "tests" / "small.yaml",
        set={"program": "[{stage: a, duration: 4 s}, {stage: a, duration: 2 s}]"},
    ).config.program
    h = pd.DataFrame({"stage": ["prestrain", "a", "a", "a", "a"], "time_s": [0.0, 1, 2, 3, 4]})
    h["step"] = h.index
    assert stages.numbers(h, program).tolist() == [0, 0, 0, 0, 0]
    assert stages.numbers(h, program, [{"step": 2}]).tolist() == [0, 0, 0, 1, 1]


def test_a_line_of_the_log_has_no_negative_zero():
    row = {"step": 3, "time_s": 1.0, "stage": "off", "displacement_mm": -1e-9, "force_N": -0.0}
    row |= {"voltage_kV": -2e-17, "capacitance_pF": 1.0, "newton_iterations": 1}
    assert "u   0.00000 mm  F   0.00000 N  V   0.00000 kV" in line(row)


def test_numbers_for_the_eye():
    assert [neat(-1e-17), neat(-0.4), neat(1234567, 3)] == ["0", "-0.4", "1.23e+06"]
    assert [counted(1, "study"), counted(2, "study"), counted(0, "case")] == [
        "1 study", "2 studies", "0 cases"
    ]  # fmt: skip
