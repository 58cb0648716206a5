"""On 2 and 3 ranks the same numbers as on one, and the same errors; a hang is a failure."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pandas as pd
import pytest
from conftest import case
from parallel_run import ENDS

import dealib
from dealib.cli import launched
from dealib.cli.mpi import environment, mpirun
from dealib.config import resolved
from dealib.fem.compat import HAS_HYPRE

pytestmark = pytest.mark.mpi
SCRIPT = Path(__file__).with_name("parallel_run.py")
ROOT = SCRIPT.parent.parent
PATIENCE = 900  # seconds without progress: where all is busy, ranks wait for each other

PUSH = "{stage: push, mount: {displacement: -3 mm}, steps: 4}"
VOLTAGE = "{stage: actuate, terminal: {voltage: 2.5 kV}, steps: 2}"
CASES = {
    "strip": ("benchmark_strip", {"mesh.columns": 20, "program": f"[{PUSH}, {VOLTAGE}]"}),
    "air": ("benchmark_strip_air", {"mesh.columns": 12, "program": f"[{PUSH}, {VOLTAGE}]"}),
    "force": (
        "deap100",
        {
            "mesh.columns": 20,
            "sensing.sheet_resistance": "10 kohm",
            "program": "[{stage: preload, mount: {force: -0.3 N}, steps: 3},"
            " {stage: actuate, terminal: {voltage: [0 V, 2.5 kV, 0 V]}, steps: 4}]",
        },
    ),
    "auto": (
        "benchmark_strip",
        {
            "mesh.columns": 20,
            "program": "[{stage: push, mount: {displacement: -3 mm}, steps: auto, rows: 30},"
            " {stage: actuate, terminal: {voltage: 2.5 kV}, steps: auto, rows: 10}]",
        },
    ),
    # few columns and many rows: the ends, and so the mount, are split over the ranks
    "charge": (
        "benchmark_strip",
        {
            "mesh.columns": 4,
            "mesh.film_rows": 12,
            "mesh.electrode_rows": 4,
            "geometry.film_thickness": "1 mm",
            "geometry.electrode_thickness": "0.3 mm",
            "program": "[{stage: push, mount: {displacement: -1 mm}, steps: 2},"
            " {stage: charge, terminal: {charge: 0.03 uC}, steps: 2}]",
        },
    ),
    "bias": (  # with a second film, which is measured by a run of its own
        "bias_double_cone",
        {
            "mesh.columns": 12,
            "output.fields": "every",
            "program": "[{stage: couple, mount: {bias: [{film: {distance: 3 mm}}, {mass: 10 g}]},"
            " steps: 3}, {stage: actuate, terminal: {voltage: 2 kV}, steps: 2}]",
        },
    ),
    "branch": (  # with the air's one-way rows and one equation in two ports
        "pull_in",
        {
            "mesh.columns": 12,
            "mesh.film_rows": 1,
            "output.fields": "every",
            "program": "[{stage: load, mount: {force: -0.4 N}, steps: 8}, {stage: branch, follow:"
            " {vary: voltage, along: displacement, until: {displacement: -5.35 mm}}, steps: 6}]",
        },
    ),
    "thick": (  # multigrid of all fields, with the mount's and the terminal's values unknown
        "devices/expanding_circle",
        {
            "geometry.base": "{kind: rectangle, length: 8 mm, width: 8 mm}",
            "geometry.space": "3d",
            "geometry.layers": "[{name: film, thickness: 6 mm}]",
            "mesh": "{columns: 6, sectors: 2, film_rows: 2, grading: uniform}",
            "materials.film": "{law: neo_hookean, shear_modulus: 0.33 MPa, bulk_modulus: 10 GPa,"
            " relative_permittivity: 3.0}",
            "physics.formulation": "mixed",
            "terminals": "{drive: {on: film.top}, ground: {on: film.bottom, ground: true}}",
            "mounts": "{plate: {on: film.top, along: Z, free: [X, Y]}}",
            "holds": "[{on: film.bottom, fix: [X, Y, Z]}]",
            "probes": None,
            "solver": f"{{linear: {'iterative' if HAS_HYPRE else 'auto'}}}",
            "program": "[{stage: press, mount: {force: -0.5 N}, steps: 2},"
            " {stage: charge, terminal: {charge: -40 nC}}]",
        },
    ),
    "clamps": (
        "benchmark_strip_air",
        {
            "mesh.columns": 12,
            "geometry.clamps": "{width: 2 mm, height: 1.5 mm}",
            "program": "[{stage: push, mount: {displacement: -1 mm}, steps: 3},"
            " {stage: actuate, terminal: {voltage: 2 kV}, steps: 2}]",
        },
    ),
}
HOPELESS = {  # past pull-in there is no equilibrium
    "mesh.columns": 4,
    "solver.max_cuts": 2,
    "program": "[{stage: pull_in, mount: {force: 0 N}, terminal: {voltage: 50 kV}, steps: 4}]",
}


def start(ranks: int, *arguments: str | Path) -> subprocess.Popen[str]:
    """Start `python ARGUMENTS` on several ranks."""
    return subprocess.Popen(
        [mpirun(), "-n", str(ranks), sys.executable, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=environment() | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
    )


def finish(process: subprocess.Popen[str], directory: Path | None = None) -> tuple[int, str]:
    """Exit code and stderr; fails if the ranks hang.

    Args:
        process: Of mpirun.
        directory: A folder in which the ranks write while they are at work.
    """
    while True:
        try:
            _, errors = process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            files = directory.rglob("*") if directory else ()
            if time.time() - max((f.stat().st_mtime for f in files), default=0) < PATIENCE:
                continue
            process.terminate()  # mpirun ends its ranks
            pytest.fail(f"hangs: {process.args}")
        return process.returncode, errors


def write(directory: Path, name: str, config: str, changes: dict[str, object]) -> Path:
    """A config file of a shipped config with changes."""
    path = directory / f"{name}.yaml"
    path.write_text(
        resolved(case(config, **{k.replace(".", "__"): v for k, v in changes.items()}).config)
    )
    return path


@pytest.fixture(scope="module")
def configs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    directory = tmp_path_factory.mktemp("configs")
    return {name: write(directory, name, *given) for name, given in CASES.items()}


@pytest.fixture(scope="module")
def serial(configs, tmp_path_factory) -> Path:
    directory = tmp_path_factory.mktemp("serial")
    for name, path in configs.items():
        dealib.simulate(dealib.load(path), directory / name, comm=MPI.COMM_SELF)
    return directory


@pytest.fixture(scope="module", params=[2, pytest.param(3, marks=pytest.mark.slow)])
def parallel(request, configs, tmp_path_factory) -> Path:
    """Run directories of all cases on a number of ranks."""
    directory = tmp_path_factory.mktemp(f"on{request.param}")
    ranks = start(request.param, "-m", "mpi4py", SCRIPT, directory, *configs.values())
    code, errors = finish(ranks, directory)
    assert code == 0, errors
    return directory


def assert_histories_equal(one: pd.DataFrame, other: pd.DataFrame) -> None:
    """All columns equal, to 1e-8 of the column's largest value where rounding can enter."""
    assert list(one) == list(other)
    exact, count = ["step", "time_s", "stage"], "newton_iterations"
    pd.testing.assert_frame_equal(one[exact], other[exact])
    # the tolerance is so near rounding that it may take an iteration more
    assert (one[count] - other[count]).abs().max() <= 1
    for column in one.columns.drop([*exact, count]):
        size = max(one[column].abs().max(), 1e-9)
        assert other[column].to_numpy() == pytest.approx(one[column], abs=1e-8 * size), column


@pytest.mark.parametrize("name", CASES)
def test_same_history(name, serial, parallel):
    one, other = dealib.open(serial / name), dealib.open(parallel / name)
    assert other.info["ranks"] > one.info["ranks"] == 1
    assert_histories_equal(one.history, other.history)
    log = (other.directory / "run.log").read_text()
    assert ("resumed" in log) == (name in ENDS)


@pytest.mark.parametrize("name", CASES)
def test_same_mesh_states_and_fields(name, serial, parallel):
    one, other = dealib.open(serial / name), dealib.open(parallel / name)
    for array in ("points", "cells", "region"):
        np.testing.assert_array_equal(getattr(one.mesh, array), getattr(other.mesh, array))
    assert one.stored_steps == other.stored_steps
    for index in range(len(one.stored_steps)):
        size = np.abs(one.state(index)).max(axis=0) + 1e-9
        assert (np.abs(one.state(index) - other.state(index)) <= 1e-8 * size).all()
    loaded = one.stored_steps.index(int(one.history["voltage_kV"].abs().idxmax()))
    fields = other.arrays(loaded)
    for key, values in one.arrays(loaded).items():
        # a derivative on cells of 7.5 um: 1e-8 of the displacement is 1e-6 of the strain
        assert fields[key] == pytest.approx(values, abs=1e-6 * np.abs(values).max()), key


def test_film_edges_and_ports_are_split(parallel):
    """Else the tests above would show little."""
    split = {name: json.loads((parallel / name / "split.json").read_text()) for name in CASES}

    def ranks(name: str, part: str) -> int:
        return int(np.count_nonzero(split[name][part]))

    for name in ("strip", "force"):  # along the strips: the film's edges, the terminal
        for part in ("film", "film_top", "film_bottom", "top_electrode"):
            assert ranks(name, part) > 1, (name, part)
    for part in ("inner", "outer"):  # across them: the mount
        assert ranks("charge", part) > 1, part


# --- the program on several ranks ----------------------------------------------------------------


def test_run_with_mpi_option(serial, configs, tmp_path):
    """Also from a Python in which MPI runs already, as it does here."""
    run = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-m", "dealib", "run", configs["strip"], "--mpi=2", f"--out={run}"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("unknowns") == 1  # one rank speaks
    found = dealib.open(run)
    assert (found.info["status"], found.info["ranks"]) == ("done", 2)
    assert_histories_equal(dealib.open(serial / "strip").history, found.history)


def test_a_wrong_config_is_told_once(configs, tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(configs["strip"].read_text().replace("columns: 20", "columns: 21"))
    code, errors = finish(start(2, "-m", "dealib", "run", wrong, "--out", tmp_path / "run"))
    assert code == 2
    assert errors.count("multiple of 2") == errors.count("dealib: ") == 1
    assert not (tmp_path / "run").exists()


def test_an_existing_run_is_told_once(serial, configs):
    code, errors = finish(
        start(2, "-m", "dealib", "run", configs["strip"], "--out", serial / "strip")
    )
    assert code == 2
    assert errors.count("exists and is not empty") == errors.count("dealib: ") == 1


def test_more_ranks_than_cells_are_refused(tmp_path):
    push = "[{stage: push, mount: {displacement: -1 mm}, steps: 1}]"
    mesh = {"mesh.columns": 4, "mesh.film_rows": 1, "geometry.electrode_thickness": "0 um"}
    config = write(tmp_path, "tiny", "benchmark_strip", mesh | {"program": push})
    code, errors = finish(start(5, "-m", "dealib", "run", config, "--out", tmp_path / "run"))
    assert code == 2
    assert errors.count("5 ranks are too many for 4 cells, some get none; use fewer") == 1


def test_not_converged_on_all_ranks(tmp_path):
    config = write(tmp_path, "hopeless", "benchmark_strip", HOPELESS)
    code, errors = finish(start(2, "-m", "dealib", "run", config, "--out", tmp_path / "run"))
    assert code == 3
    assert errors.count("'pull_in' stopped after") == 1
    run = dealib.open(tmp_path / "run")
    assert run.info["status"] == "not converged"
    assert len(run.history) == len(run.stored_steps) > 0


def test_what_stops_rank_0_stops_all(tmp_path):
    """The folder of the states vanishes in the middle of a run."""
    push = "[{stage: push, mount: {displacement: -3 mm}, steps: 2000}]"
    changes = {"mesh.columns": 4, "program": push}
    config = write(tmp_path, "long", "benchmark_strip", changes)
    run = tmp_path / "run"
    process = start(2, "-m", "dealib", "run", config, "--out", run)
    until = time.monotonic() + PATIENCE
    while not (run / "states" / "00002.h5").exists() and time.monotonic() < until:
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)
    (run / "states").rename(run / "moved")
    code, errors = finish(process)
    assert code == 4
    assert errors.count("cannot write") == 1


def test_a_process_by_itself_starts_no_daemon(monkeypatch):
    own: dict[str, str] = {}
    monkeypatch.setattr(os, "environ", own)
    launched.begin_quickly()
    assert own == launched.ALONE
    assert not launched.ALONE.keys() & environment().keys()  # mpirun's ranks talk to each other
    for kept in ("OMPI_MCA_btl", "PMIX_RANK"):  # the user's choice, and a launcher's child
        own.clear()
        own[kept] = "3"
        launched.begin_quickly()
        assert own == {kept: "3"}
    own["OMPI_MCA_btl"] = "tcp,self"
    assert environment()["OMPI_MCA_btl"] == "tcp,self"
