"""Tables for system simulation: exact at their nodes, reciprocal everywhere, checked between."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import CONFIGS, case
from watch import At

import dealib
from dealib.errors import ConfigError, Interrupted
from dealib.program.tables import tables_case
from dealib.results.tables import collect

pytestmark = pytest.mark.once  # of states as they are stored
SMALL = {"mesh__columns": 16, "mesh__film_rows": 1, "tables__points": "[9, 9]"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Tables of the shipped config on a coarse mesh."""
    run = dealib.simulate(tables_case(case("tables", **SMALL)), tmp_path_factory.mktemp("t") / "t")
    tables = collect(run)
    tables.save(run.directory)
    return run, tables


def direct(u, v):
    """Force and charge of the device at a displacement and a voltage, solved for them."""
    program = [
        {"stage": "go", "mount": {"displacement": f"{u} mm"}, "steps": 3},
        {"stage": "on", "terminal": {"voltage": f"{v} kV"}},
    ]
    *_, last = dealib.Simulation(case("tables", **SMALL, program=program))
    return last.row["force_N"], last.row["charge_uC"]


def test_walk_meets_every_node_once(made):
    run, tables = made
    h = run.history
    assert len(h) == 1 + 9 * 9  # and the state at rest: no increment was cut
    assert tables["displacement_mm"] == pytest.approx(np.linspace(-2.5, -0.5, 9))
    assert tables["voltage_kV"] == pytest.approx(np.linspace(0, 2.5, 9))
    steps = np.abs(np.diff(h[["displacement_mm", "voltage_kV"]].to_numpy(), axis=0)).max(axis=1)
    assert steps.max() < 0.51  # each from its neighbour
    assert h["newton_iterations"].sum() < 5 * len(h)


def test_between_the_nodes_against_direct_solves(made):
    """Relative to the largest force and charge; the nodes themselves to the solver's tolerance."""
    _, tables = made
    scale = np.abs(tables["force_N"]).max(), np.abs(tables["charge_uC"]).max()
    worst = [0.0, 0.0]
    for u, v in ((-0.63, 0.2), (-1.11, 1.7), (-1.61, 2.34), (-2.2, 0.9), (-2.4, 2.4)):
        for k, (found, exact) in enumerate(
            zip((tables.force(u, v), tables.charge(u, v)), direct(u, v), strict=True)
        ):
            worst[k] = max(worst[k], abs(found - exact) / scale[k])
    assert 1e-9 < worst[0] < 2e-5
    assert worst[1] < 1e-5
    at_node = direct(-1.5, 1.25)
    assert tables.force(-1.5, 1.25) == pytest.approx(at_node[0], rel=1e-8)
    assert tables.charge(-1.5, 1.25) == pytest.approx(at_node[1], rel=1e-8)


def test_the_error_falls_with_the_third_power_of_the_spacing(made):
    _, tables = made
    halved = {n: a[::2, ::2] if a.ndim == 2 else a[::2] for n, a in tables.plain().items()}
    quarter = {n: a[::4, ::4] if a.ndim == 2 else a[::4] for n, a in tables.plain().items()}
    U, V = np.meshgrid(tables["displacement_mm"], tables["voltage_kV"], indexing="ij")
    errors = [
        np.abs(type(tables)(some).force(U, V) - tables["force_N"]).max()
        for some in (quarter, halved)
    ]
    assert np.log2(errors[0] / errors[1]) > 2.5


def test_reciprocity_and_energy_to_rounding(made):
    """Force and charge are derivatives of one potential; a closed path does no net work."""
    _, tables = made
    u, v, h = -1.37, 1.49, 1e-4
    across = (tables.force(u, v + h) - tables.force(u, v - h)) / (2 * h)
    along = (tables.charge(u + h, v) - tables.charge(u - h, v)) / (2 * h)
    assert across == pytest.approx(tables.coupling(u, v), rel=1e-7)
    assert -along == pytest.approx(tables.coupling(u, v), rel=1e-7)
    points, weights = np.polynomial.legendre.leggauss(4)
    work = 0.0
    corners = [(-2.5, 0.0), (-0.5, 0.0), (-0.5, 2.5), (-2.5, 2.5), (-2.5, 0.0)]
    for (u0, v0), (u1, v1) in pairwise(corners):
        for cell in range(8):  # exact for cubics, cell by cell
            s = (cell + (1 + points) / 2) / 8
            U, V = u0 + s * (u1 - u0), v0 + s * (v1 - v0)
            power = tables.force(U, V) * (u1 - u0) - tables.charge(U, V) * (v1 - v0)
            work += weights @ power / 16
    assert abs(work) < 1e-13 * np.abs(tables["potential_mJ"]).max()


def test_capacitance(made):
    """Charge over voltage at the nodes; of the interpolant at 0 V that of the frozen body."""
    _, tables = made
    on = tables["voltage_kV"] > 0
    ratio = 1e3 * tables["charge_uC"][:, on] / tables["voltage_kV"][on]
    assert tables["capacitance_pF"][:, on] == pytest.approx(ratio, rel=1e-12)
    assert tables.capacitance(tables["displacement_mm"], 0.0) == pytest.approx(
        tables["capacitance_pF"][:, 0], rel=1e-4
    )
    assert (tables.stiffness([-2.2, -1.2], 1.0) > 0).all()


def test_files_hold_the_same(made):
    run, tables = made
    for name in ("", "tables.csv", "tables.h5", "tables.mat"):
        read = dealib.tables(run.directory / name)
        for key, values in tables.plain().items():
            assert np.array_equal(read[key], values), (name, key)
    script = (
        "import sys, dealib; t = dealib.tables(sys.argv[1]); print(float(t.force(-1.4, 1.1)),"
        "sorted(m for m in ('dolfinx', 'petsc4py', 'gmsh') if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(run.directory)],
        capture_output=True, text=True, check=True, cwd=CONFIGS.parent,
    )  # fmt: skip
    value, loaded = done.stdout.split(maxsplit=1)
    assert float(value) == float(tables.force(-1.4, 1.1))
    assert loaded.strip() == "[]"


def test_rows_may_come_in_another_order(made, tmp_path):
    """As a spreadsheet leaves them: by voltage first."""
    run, tables = made
    head, *lines = (run.directory / "tables.csv").read_text().splitlines()
    lines.sort(key=lambda line: [-float(x) for x in line.split(",")[1::-1]])
    (tmp_path / "tables.csv").write_text("\n".join([head, *lines]))
    read = dealib.tables(tmp_path / "tables.csv")
    for key, values in tables.plain().items():
        assert np.array_equal(read[key], values), key


def test_outside_and_absent_tables_are_explained(made, tmp_path):
    _, tables = made
    with pytest.raises(ValueError, match=r"a displacement of -2\.5 \.\. -0\.5 mm only"):
        tables.force(-2.6, 1.0)
    with pytest.raises(ValueError, match=r"a voltage of 0 \.\. 2\.5 kV only"):
        tables.charge(-2.0, [1.0, 2.6])
    with pytest.raises(
        ConfigError, match=r"no tables here; dealib.export_tables\(case\) makes them"
    ):
        dealib.tables(tmp_path)
    (tmp_path / "tables.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ConfigError, match=r"tables.csv: no tables of dealib"):
        dealib.tables(tmp_path / "tables.csv")
    (tmp_path / "tables.mat").touch()
    with pytest.raises(ConfigError, match=r"tables.mat: no tables of dealib \(Mat file appears to"):
        dealib.tables(tmp_path / "tables.mat")
    with pytest.raises(ConfigError, match="the key tables is missing"):
        tables_case(case("membrane"))


def test_command_goes_on_where_it_was_stopped(tmp_path):
    given = case("tables", **SMALL | {"tables__points": "[4, 3]"})
    whole = collect(dealib.simulate(tables_case(given), tmp_path / "whole"))
    out = tmp_path / "tables"
    with pytest.raises(Interrupted):
        dealib.simulate(tables_case(given), out, observers=[At(7, Interrupted("enough", 15, True))])
    with pytest.raises(ConfigError, match="6 of 12 nodes are not solved"):
        collect(dealib.open(out))
    changes = SMALL | {"tables__points": "[4, 3]"}
    sets = [f"--set={key.replace('__', '.')}={value}" for key, value in changes.items()]
    command = [sys.executable, "-m", "dealib", "export", str(CONFIGS / "tables.yaml"), *sets]
    command += ["--out", str(out)]
    again = subprocess.run(command, capture_output=True, text=True, cwd=CONFIGS.parent)
    assert again.returncode == 2
    assert "exists and is not empty" in again.stderr
    done = subprocess.run(
        [*command, "--resume"], capture_output=True, text=True, cwd=CONFIGS.parent
    )
    assert done.returncode == 0, done.stderr
    assert "resumed after step 7" in done.stdout
    assert "tables.mat" in done.stdout
    assert json.loads((out / "run.json").read_text())["status"] == "done"
    for key, values in dealib.tables(out).plain().items():
        assert np.allclose(values, whole[key], rtol=1e-9, atol=1e-12), key


def test_three_ports(tmp_path):
    """Two terminals and a mount: duals between the nodes, and reciprocity of all pairs."""
    sizes = {"displacement": "[0 mm, -1 mm]", "points": "[4, 3, 3]"}
    axes = {f"tables.{key}": value for key, value in sizes.items()}
    given = dealib.load(
        CONFIGS / "devices" / "segmented_annulus.yaml",
        set={
            **{"mesh.columns": "16", "mesh.film_rows": "1"},
            **axes,
            "tables.voltage": "{drive: [0 kV, 1 kV], sense: [0 kV, 1 kV]}",
        },
    )
    tables = collect(dealib.simulate(tables_case(given), tmp_path / "t"))
    assert list(tables.axes) == ["displacement_mm", "voltage_kV.drive", "voltage_kV.sense"]
    assert tables["charge_uC.sense"].shape == (4, 3, 3)
    at, h = [-0.61, 0.8, 0.3], 1e-4
    names = ["displacement", "voltage.drive", "voltage.sense"]
    for i, dual in enumerate(["force", "charge.drive", "charge.sense"]):
        for j, by in enumerate(names):
            moved = [[x + sign * h * (k == j) for k, x in enumerate(at)] for sign in (1, -1)]
            slope = (tables.dual(dual, *moved[0]) - tables.dual(dual, *moved[1])) / (2 * h)
            assert slope == pytest.approx(tables.slope(dual, by, *at), rel=1e-6, abs=1e-9), (i, j)
    program = [
        {"stage": "go", "mount": {"displacement": f"{at[0]} mm"}, "steps": 2},
        {
            "stage": "on",
            "terminals": {
                n: {"voltage": f"{v} kV"} for n, v in zip(("drive", "sense"), at[1:], strict=True)
            },
        },
    ]
    stages = [type(given.config.program[0]).model_validate(s) for s in program]
    config = given.config.model_copy(update={"program": tuple(stages)})
    *_, last = dealib.Simulation(replace(given, config=config))
    assert tables.dual("charge.drive", *at) == pytest.approx(last.row["charge_uC.drive"], rel=1e-3)
    assert tables.dual("charge.sense", *at) == pytest.approx(last.row["charge_uC.sense"], rel=1e-3)
    assert tables.dual("force", *at) == pytest.approx(last.row["force_N"], rel=2e-3)
    for ending in ("csv", "h5", "mat"):
        tables.save(tmp_path)
        read = dealib.tables(tmp_path / f"tables.{ending}")
        assert list(read.plain()) == list(tables.plain())
        assert all(np.array_equal(read[name], values) for name, values in tables.plain().items())
