"""`dealib --version` and `dealib doctor`: what is installed, and what of it works."""

import os
import platform
import subprocess
import sys

import gmsh
import numpy as np
import pytest
from conftest import CONFIGS

from dealib.fem import compat
from dealib.tasks import doctor

PROBES = ["packages", "compiler", "solver", "MPI", "3-D pictures", "movies"]


def command(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "dealib", *arguments],
        cwd=CONFIGS.parent,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def states(out):
    """Name and state of each line."""
    return {line[:12].strip(): line[13:20].strip() for line in out.splitlines()[:-1]}


def test_versions_are_those_of_the_libraries():
    from petsc4py import PETSc  # after compat, which finds the MPI that dolfinx's wheel needs

    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    done = command("--version")
    assert done.returncode == 0
    assert done.stdout == (
        f"dealib 0.1.0, dolfinx {compat.VERSION}, PETSc {petsc}, Gmsh {gmsh.__version__}, "
        f"numpy {np.__version__}, Python {platform.python_version()}\n"
    )


def test_versions_are_told_without_what_takes_seconds_to_import():
    code = (
        "import sys; from dealib.versions import versions; versions();"
        "print({'dolfinx', 'ufl', 'gmsh', 'pandas', 'matplotlib', 'pyvista'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=CONFIGS.parent, capture_output=True, text=True, check=True
    )
    assert done.stdout == "set()\n"


@pytest.mark.mpi
def test_all_is_well():
    done = command("doctor")
    assert done.returncode == 0, done.stdout + done.stderr
    assert states(done.stdout) == dict.fromkeys(PROBES, "ok")
    assert done.stdout.endswith("\ndealib works here\n")
    assert f"dolfinx {compat.VERSION}" in done.stdout
    assert "unknowns, 4 steps in " in done.stdout


@pytest.mark.once
def test_without_a_compiler_nothing_works():
    done = command("doctor", CC="false")
    assert done.returncode == 4
    assert states(done.stdout + "\n") == {"packages": "ok", "compiler": "failed"}
    assert "; apt install gcc libc6-dev python3-dev\n" in done.stdout
    assert "dealib: dealib does not work here: compiler failed; the rest was not tried" in (
        done.stderr
    )


@pytest.mark.once
def test_crashing_pictures_and_missing_movies_are_told_and_done_without(tmp_path, monkeypatch):
    (tmp_path / "pyvista.py").write_text("import os\nos.kill(os.getpid(), 11)\n")
    (tmp_path / "av.py").write_text("raise ModuleNotFoundError('no av', name='av')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # of the probes' processes
    wanted = ("solver", *PROBES[4:])  # the pictures are of the run that `solver` makes
    probes = tuple(probe for probe in doctor._PROBES if probe.name in wanted)
    monkeypatch.setattr(doctor, "_PROBES", probes)
    lines = []
    doctor.doctor(lines.append)
    out = "\n".join(lines) + "\n"
    assert states(out) == {"solver": "ok"} | dict.fromkeys(PROBES[4:], "failed")
    assert "3-D pictures failed  3-D pictures need off-screen OpenGL (Debian: apt install " in out
    assert "movies       failed  the Python module 'av' is missing; " in out
    assert out.endswith("\ndealib works here, except for 3-D pictures, movies\n")


def test_a_crash_is_told_by_its_signal():
    with pytest.raises(doctor._Failed, match=r"^ended by SIGSEGV$"):
        doctor._child("-c", "import os; os.kill(os.getpid(), 11)")


def test_a_wrong_capacitance_is_a_failure(tmp_path, monkeypatch):
    monkeypatch.setattr(doctor, "EPSILON_0", 2 * doctor.EPSILON_0)
    said = r"at rest has 230\.32 pF, as a plate capacitor 460\.64 pF"
    with pytest.raises(doctor._Failed, match=said):
        doctor._solver(tmp_path)
