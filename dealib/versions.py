"""Versions of all that results depend on, without importing dolfinx or Gmsh."""

from __future__ import annotations

import functools
import hashlib
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = (
    *("dealib", "fenics-dolfinx", "fenics-ffcx", "fenics-ufl", "fenics-basix"),
    *("dolfinx-solver-real", "petsc4py", "gmsh", "numpy", "scipy"),  # the first: dolfinx's wheel
)
_NAMES = {"petsc": "PETSc", "gmsh": "Gmsh", "python": "Python"}
# packages of dealib that the results of a run do not depend on
_WITHOUT_EFFECT = {
    *("calibration", "cases", "cli", "data", "export", "plots", "report", "study", "validation"),
}


def version_line() -> str:
    """The versions of `versions` in one line."""
    return ", ".join(f"{_NAMES.get(name, name)} {v}" for name, v in versions().items())


def versions() -> dict[str, str]:
    """The main versions for display, by name; "missing" if a package is not installed."""
    found = installed()
    return {
        "dealib": found.get("dealib", "missing"),
        "dolfinx": found.get("fenics-dolfinx") or found.get("dolfinx-solver-real", "missing"),
        "petsc": _petsc(),
        "gmsh": found.get("gmsh", "missing"),
        "numpy": found.get("numpy", "missing"),
        "python": platform.python_version(),
    }


@functools.cache
def installed() -> dict[str, str]:
    """Versions of the installed packages that results depend on, by name."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@functools.cache
def source() -> str:
    """Hash of the modules of dealib that the results of a run depend on."""
    root, digest = Path(__file__).parent, hashlib.sha256()
    for file in sorted([*root.rglob("*.py"), *root.rglob("*.yaml")]):
        if file.relative_to(root).parts[0] not in _WITHOUT_EFFECT:
            digest.update(file.read_bytes())
    return digest.hexdigest()


@functools.cache
def git_hash() -> str | None:
    """Commit of the checkout that dealib runs from, if it is one."""
    try:
        found = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=60,  # a busy machine may need seconds
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() if found.returncode == 0 else None


def _petsc() -> str:
    """PETSc's own version, which may differ from petsc4py's, as on Debian 13."""
    try:
        from mpi4py import MPI  # noqa: F401 - finds the MPI that dolfinx's wheel needs
        from petsc4py import PETSc
    except ImportError:
        return "missing"
    return ".".join(map(str, PETSc.Sys.getVersion()))
