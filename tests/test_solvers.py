"""The linear solvers: which one is chosen, and that they agree."""

from __future__ import annotations

import functools
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import laminates
import pytest

from dealib import Case, ConfigError, Simulation, load
from dealib.config import linear, resolved
from dealib.config.linear import choose
from dealib.fem.compat import HAS_HYPRE
from dealib.fem.domain import build_domain

needs_hypre = pytest.mark.skipif(not HAS_HYPRE, reason="PETSc without hypre")
ON_TOP = {"plate": {"on": "film.top", "along": "Z", "free": ["X", "Y"]}}
PROGRAM = [
    {"stage": "press", "mount": {"force": "-0.5 N"}, "steps": 2},
    {"stage": "actuate", "terminal": {"voltage": "30 kV"}},
    {"stage": "charge", "terminal": {"charge": "-60 nC"}, "mount": {"displacement": "-0.2 mm"}},
]


def block(thickness="4 mm", cells=4, rows=2, **sections):
    """A block of rubber of 8 mm x 8 mm on the floor, a plate on its top."""
    base = {"kind": "rectangle", "length": "8 mm", "width": "8 mm"}
    sectors = 2 * (cells // 4)
    mesh = {"columns": cells, "sectors": sectors, "film_rows": rows, "grading": "uniform"}
    given = {
        "geometry": {"base": base, "space": "3d"},
        "mesh": mesh,
        "mounts": ON_TOP,
        "holds": [{"on": "film.bottom", "fix": ["X", "Y", "Z"]}],
        "program": PROGRAM,
    }
    return laminates.config("strip", laminates.layer(thickness=thickness), **given | sections)


@functools.cache
def states(method, cells=4, stages=3, bulk=None):
    """Rows of the history, and Krylov iterations for each linear system.

    Args:
        method: Key `solver.linear`.
        cells: Number of cells on a side.
        stages: Number of stages.
        bulk: Bulk modulus, over the shear modulus, in the mixed form; None for the other one.
    """
    given = {"solver": {"linear": method}, "program": PROGRAM[:stages]}
    if bulk is not None:
        moduli = {"shear_modulus": "0.3 MPa", "bulk_modulus": f"{0.3 * bulk} MPa"}
        film = {"law": "neo_hookean", "relative_permittivity": 3.0, **moduli}
        given |= {"materials": {"film": film}, "physics": {"formulation": "mixed"}}
    run = laminates.simulation(block(cells=cells, rows=cells // 2, **given))
    found, krylov, solves = [], 0, 0
    for state in run:
        found.append(state.row)
        krylov += state.engine.newton.linear_iterations
        solves += state.engine.newton.linear_solves
    return found, krylov / solves


@needs_hypre
@pytest.mark.parametrize("bulk", [None, 1e4], ids=["displacement", "mixed"])
def test_multigrid_finds_the_states_of_a_factorisation(bulk):
    """Loaded and prescribed mounts and terminals: ports are unknowns of the blocks, too."""
    direct, one = states("direct", bulk=bulk)
    iterative, many = states("iterative", bulk=bulk)
    assert one == pytest.approx(1.0, abs=0.2)
    assert many > 2
    assert direct[-1]["displacement_mm"] == pytest.approx(-0.2)
    assert abs(direct[2]["displacement_mm"]) > 0.01
    names = ("displacement_mm", "force_N", "charge_uC", "voltage_kV", "elastic_energy_mJ")
    for a, b in zip(direct, iterative, strict=True):
        for name in (*names, "capacitance_pF"):
            assert b[name] == pytest.approx(a[name], rel=1e-8, abs=1e-10), name


@needs_hypre
@pytest.mark.slow
def test_iterations_hardly_depend_on_the_size():
    """2,000 to 26,000 unknowns."""
    counts = [states("iterative", cells, stages=1)[1] for cells in (4, 8, 12)]
    assert max(counts) < 25
    assert max(counts) < 1.25 * min(counts)


@needs_hypre
def test_iterations_of_the_mixed_form_hardly_depend_on_size_and_bulk_modulus():
    """1,300 and 3,100 unknowns; compressible and hardly so."""
    given = (4, 50.0), (4, 1e4), (6, 1e4)
    counts = [states("iterative", cells, 1, bulk)[1] for cells, bulk in given]
    assert max(counts) < 22
    assert max(counts) < 1.25 * min(counts)


@needs_hypre
@pytest.mark.slow
def test_iterations_of_the_mixed_form_stay_on_finer_meshes():
    """1,300 and 9,700 unknowns."""
    counts = [states("iterative", cells, 1, 1e4)[1] for cells in (4, 8)]
    assert max(counts) < 22
    assert max(counts) < 1.25 * min(counts)


def test_the_body_s_shape_and_size_choose():
    thick, film = block(thickness="4 mm"), block(thickness="50 um", rows=1)
    assert not choose(thick, 39_000).iterative
    assert choose(thick, 41_000).iterative
    assert not choose(film, 400_000).iterative
    assert choose(block(physics={"formulation": "mixed"}), 41_000).iterative
    assert choose(thick.model_copy(update={"solver": solver("iterative")}), 100).iterative
    assert not choose(thick.model_copy(update={"solver": solver("direct")}), 1e6).iterative


@pytest.mark.once
def test_a_curved_wall_of_a_mesh_file_is_thin():
    """The box around a quarter of a cylinder is cubic, its wall of 0.5 mm is not."""
    config = load(Path(__file__).parent.parent / "configs/published/cylinder.yaml").config
    sizes = build_domain(config, MPI.COMM_WORLD, None).sizes
    assert 0.5 < sizes.thickness < 0.8
    assert sizes.span == pytest.approx(100)
    assert not choose(config, 41_000, sizes).iterative
    assert choose(config, 41_000, replace(sizes, thickness=20.0)).iterative


def solver(method):
    return block(solver={"linear": method}).solver


def test_memory_decides_where_shape_does_not(monkeypatch):
    plate = block(thickness="0.4 mm", rows=4)
    assert not choose(plate, 500_000).iterative
    monkeypatch.setattr(linear, "machine_memory", lambda: 4e9)
    found = choose(plate, 500_000)
    assert found.iterative
    assert found.note.startswith("a factorisation would need ")
    assert found.note.endswith(" GB, more than the machine has")
    # too thin for multigrid: it stays with the factorisation, which `refuse_too_large` refuses
    assert not choose(block(thickness="50 um", rows=4), 500_000).iterative


# unknowns, peak memory (GB) of runs of a few steps: films of one cell, plates, blocks
MEASURED = [
    ("50 um", 1, 199_339, 1.74), ("50 um", 1, 396_811, 3.51), ("50 um", 1, 1_006_123, 8.61),
    ("1 mm", 4, 33_571, 0.55), ("8 mm", 12, 54_051, 1.07),
]  # fmt: skip


@pytest.mark.parametrize(("thickness", "rows", "unknowns", "memory"), MEASURED)
def test_memory_of_a_factorisation_is_near_what_was_measured(thickness, rows, unknowns, memory):
    config = block(thickness=thickness, rows=rows, solver={"linear": "direct"})
    assert choose(config, unknowns).memory / 1e9 == pytest.approx(memory, rel=0.25)


def test_memory_of_multigrid_is_near_what_was_measured():
    config = block(thickness="8 mm", rows=12, solver={"linear": "iterative"})
    assert choose(config, 54_051).memory / 1e9 == pytest.approx(0.93, rel=0.2)


@pytest.mark.parametrize(
    ("base", "sections", "reason"),
    [
        ("strip", {}, "only for solids in three dimensions"),
        ("rectangle", {"output": {"modes": 1}},
         "only without output.modes, which factorises each tangent"),
    ],
)  # fmt: skip
def test_what_cannot_be_iterated_is_told(base, sections, reason):
    sections = sections | {"solver": {"linear": "iterative"}}
    given = laminates.config("strip", **sections) if base == "strip" else block(**sections)
    assert linear.not_iterative(given) == reason


def test_the_message_names_key_and_cure():
    name = Path(__file__).parents[1] / "configs/benchmark_strip.yaml"
    with pytest.raises(ConfigError, match=(
        r"solver\.linear=iterative: iterative: only for solids in three dimensions; choose auto or "
        r"direct"
    )):  # fmt: skip
        load(name, ("solver.linear=iterative",))


def test_a_factorisation_beyond_the_machine_is_refused(monkeypatch):
    """Of an own mesh the unknowns are not known before; here the estimate before is left out."""
    monkeypatch.setattr("dealib.fem.linear.machine_memory", lambda: 1e6)
    given = block(solver={"linear": "direct"})
    with pytest.raises(ConfigError, match=(
        r"unknowns need about 0\.\d+ GB of memory with a factorisation, and this machine has "
        r"0\.001 GB: choose a coarser mesh"
    )):  # fmt: skip
        Simulation(Case(given, resolved(given), Path()))


@needs_hypre
def test_a_process_that_still_holds_a_simulation_ends_well():
    """PETSc ends after Python, and must find nothing left that it would call there."""
    code = (
        "import test_solvers as t; run = t.laminates.simulation(t.block(solver={'linear': "
        "'iterative'})); print(sum(1 for _ in run))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parent
    )
    assert (done.returncode, done.stdout) == (0, "5\n"), done.stderr


@needs_hypre
def test_the_log_says_what_was_chosen():
    run = laminates.simulation(block(solver={"linear": "iterative"}))
    assert run.engine.newton.linear_solver.startswith("FGMRES with multigrid, about 0.")
    run = laminates.simulation(block())
    assert run.engine.newton.linear_solver.startswith("LDL^T by MUMPS, about 0.")
