"""A run that was killed while it compiled does not spoil the cache for the next."""

import fcntl
import os
import subprocess
import sys
import time

import pytest
from conftest import said

CODE = """
import sys, ufl
from dealib import patience
patience._MOMENT = 1e9  # seconds: a busy machine would be told that it compiles
from mpi4py import MPI
from dolfinx import mesh
from dealib.fem import compat
m = mesh.create_unit_square(MPI.COMM_SELF, 2, 2, mesh.CellType.quadrilateral)
V = compat.functionspace(m, compat.element(m, "Lagrange", 1))
print(compat.cache_folder())
compat.form(ufl.TestFunction(V) * ufl.dx)
"""


def compile_in(cache):
    """Compile a small form in a process of its own, which ends before it gives up on a mark."""
    return subprocess.run(
        [sys.executable, "-c", CODE],
        env=os.environ | {"XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
        timeout=300,  # FFCx waits 600 s for whoever has left a mark
    )


def test_stale_marks_are_removed_and_live_ones_waited_for(tmp_path):
    job = compile_in(tmp_path)
    assert job.returncode == 0, job.stderr
    assert said(job.stderr) == ""
    (folder,) = (tmp_path / "fenics" / "dealib").iterdir()  # of this dolfinx
    assert job.stdout.strip() == str(folder)
    (ready,) = folder.glob("*/libffcx_forms_*.c.cached")
    # as a kill leaves it: the C file is there, what follows it is not
    ready.unlink()
    for built in folder.glob("*/libffcx_forms_*.so"):
        built.unlink()
    source = ready.with_suffix("")
    source.write_text("half a fi")
    job = compile_in(tmp_path)
    assert job.returncode == 0, job.stderr
    assert ready.exists()
    assert source.read_text() != "half a fi"

    # another process that compiles is waited for, and its mark is left alone meanwhile
    ready.unlink()
    with (ready.parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        waiting = subprocess.Popen(
            [sys.executable, "-c", CODE],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
            stdout=subprocess.DEVNULL,
        )
        time.sleep(4)
        assert waiting.poll() is None
        assert source.exists()
        ready.write_text("")  # it has finished
    assert waiting.wait(300) == 0


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [3, 5])
def test_killed_while_compiling(tmp_path, seconds):
    from test_interruption import command

    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    first = subprocess.Popen(
        command("--out", tmp_path / "a"),
        env=environment,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
    )
    time.sleep(seconds)
    os.killpg(first.pid, 9)
    first.wait()
    second = subprocess.run(
        command("--out", tmp_path / "a", "--resume"), env=environment, timeout=300
    )
    assert second.returncode == 0


def test_a_cache_that_cannot_be_written_is_explained(tmp_path):
    (tmp_path / "fenics").write_text("a file, no folder")
    job = compile_in(tmp_path)
    assert "PlatformError: cannot compile into" in job.stderr
