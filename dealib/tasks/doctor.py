"""`dealib doctor`: what is installed and whether it works, one line each.

Each probe runs in a process of its own, so that a library that crashes is reported as well.
"""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from dealib.config.templates import template
from dealib.errors import PlatformError
from dealib.files import write_text
from dealib.units import EPSILON_0
from dealib.versions import version_line

_SECONDS = 300  # time limit of a probe on a busy machine
_PROGRAM = (
    "[{stage: prestrain}, {stage: push, mount: {displacement: -0.1 mm}, steps: 2},"
    " {stage: actuate, terminal: {voltage: 1 kV}, steps: 2}]"
)
_IMPORTS = "import numpy, scipy, h5py, pandas, matplotlib, gmsh; from dealib.fem import compat"
_FORM = """
import ufl
from mpi4py import MPI
from dolfinx import mesh
from dealib.fem import compat
m = mesh.create_unit_square(MPI.COMM_SELF, 1, 1, mesh.CellType.quadrilateral)
V = compat.functionspace(m, compat.element(m, "Lagrange", 1))
compat.form(ufl.TestFunction(V) * ufl.dx)
"""


class _Failed(Exception):
    """A probe failed."""


@dataclass(frozen=True)
class _Probe:
    """A test of one part of the installation.

    Attributes:
        name: The part.
        run: Tests it with files in a folder, and returns the result in words.
        cure: What to do if it fails.
        needed: Whether dealib cannot work without it.
    """

    name: str
    run: Callable[[Path], str]
    cure: str
    needed: bool = False


def doctor(tell: Callable[[str], None] = print) -> None:
    """Test whether solver, MPI, 3-D pictures and movies work on this machine.

    Args:
        tell: Called with each line of the report.

    Raises:
        PlatformError: If a part that dealib needs does not work.
    """
    try:
        folder = tempfile.TemporaryDirectory(prefix="dealib-doctor-")
    except OSError as error:
        raise PlatformError(
            f"cannot make a temporary folder: {error}; set TMPDIR to a folder"
        ) from None
    lacking = []
    with folder:
        for probe in _PROBES:
            try:
                tell(f"{probe.name:<12} ok      {probe.run(Path(folder.name))}")
            except _Failed as error:
                tell(f"{probe.name:<12} failed  {error}; {probe.cure}")
                if probe.needed:
                    raise PlatformError(
                        f"dealib does not work here: {probe.name} failed; the rest was not tried"
                    ) from None
                lacking.append(probe.name)
    tell("dealib works here" + (f", except for {', '.join(lacking)}" if lacking else ""))


def _child(*arguments: str | Path, **environment: str) -> float:
    """Run Python with arguments.

    Returns:
        The time that it took, s.

    Raises:
        _Failed: With the last line of its error output.
    """
    begin = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, *arguments],
            env=os.environ | environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _Failed(f"no answer within {_SECONDS} s") from None
    if done.returncode < 0:
        raise _Failed(f"ended by {signal.Signals(-done.returncode).name}")
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        ours = [line for line in lines if line.startswith("dealib: ")]
        raise _Failed((ours or lines)[-1].removeprefix("dealib: "))
    return time.perf_counter() - begin


def _packages(_: Path) -> str:
    missing = []
    for line in requires("dealib") or ():
        name = re.match(r"[\w.-]+", line)
        if name is None or "extra ==" in line:
            continue
        try:
            version(name[0])
        except PackageNotFoundError:
            missing.append(name[0])
    if missing:
        raise _Failed(f"missing: {', '.join(missing)}")
    _child("-c", _IMPORTS)
    return version_line()


def _compiler(folder: Path) -> str:
    return f"a form compiled in {_child('-c', _FORM, XDG_CACHE_HOME=str(folder / 'cache')):.1f} s"


def _run(folder: Path, name: str, *options: str) -> float:
    """Solve a tiny problem into folder/name; returns the time of the whole process, s."""
    config = folder / "tiny.yaml"
    write_text(config, template("benchmark"))
    changes = ("--set", "mesh.columns=8", "--set", f"program={_PROGRAM}")
    return _child("-m", "dealib", "run", config, *changes, "--out", folder / name, *options)


def _solver(folder: Path) -> str:
    from dealib.results.reader import Run  # imported after the probe of the packages

    seconds = _run(folder, "one")
    run = Run(folder / "one")
    sizes, found = run.config.device.sizes, float(run.history["capacitance_pF"].iloc[0])
    assert sizes is not None
    permittivity = EPSILON_0 * run.config.film.permittivity.at(1.0)
    plates = 1e3 * permittivity * sizes.area / sizes.thickness  # pF
    if not math.isclose(found, plates, rel_tol=1e-3):
        raise _Failed(f"the film at rest has {found:.5g} pF, as a plate capacitor {plates:.5g} pF")
    return (
        f"{run.info['unknowns']} unknowns, {run.info['steps']} steps in "
        f"{run.info['timings']['solve']:.2f} s, with start and end {seconds:.1f} s"
    )


def _mpi(folder: Path) -> str:
    from dealib.results.reader import Run

    seconds = _run(folder, "two", "--mpi", "2")
    one, two = (float(Run(folder / n).history["force_N"].iloc[-1]) for n in ("one", "two"))
    if not math.isclose(one, two, rel_tol=1e-6):
        raise _Failed(f"the force on 2 ranks is {two:.9g} N, on one {one:.9g} N")
    return f"2 ranks give the same force, in {seconds:.1f} s"


def _picture(folder: Path) -> str:
    seconds = _child(
        "-m", "dealib", "plot", folder / "one", "--revolved", "--out", folder / "p.png"
    )
    return f"a picture drawn off screen in {seconds:.1f} s"


def _movie(folder: Path) -> str:
    words = ("--seconds", "0.5", "--out", folder / "m.mp4")
    seconds = _child("-m", "dealib", "animate", folder / "one", *words)
    return f"a film of {(folder / 'm.mp4').stat().st_size / 1000:.0f} kB written in {seconds:.1f} s"


_AGAIN = "remove .venv and run setup/setup.sh"
_PROBES = (
    _Probe("packages", _packages, _AGAIN, needed=True),
    _Probe("compiler", _compiler, "apt install gcc libc6-dev python3-dev", needed=True),
    _Probe("solver", _solver, _AGAIN, needed=True),
    _Probe("MPI", _mpi, "apt install openmpi-bin; all but --mpi works without"),
    _Probe("3-D pictures", _picture, "all but `plot --revolved` and 3-D in reports works without"),
    _Probe("movies", _movie, f"{_AGAIN}; all but `animate` works without"),
)
