"""Versions of everything that results depend on; dolfinx and Gmsh are not imported for them."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = (
    *("dealib", "fenics-dolfinx", "fenics-ffcx", "fenics-ufl", "fenics-basix"),
    *("dolfinx-solver-real", "petsc4py", "gmsh", "numpy", "scipy"),  # the first one is a wheel
)
_NAMES = {"petsc": "PETSc", "gmsh": "Gmsh", "python": "Python"}
# packages of dealib that results do not depend on
_BESIDE = {
    *("calibration", "cases", "cli", "data", "export", "plots", "report", "study", "validation"),
}


def version_line() -> str:
    """All versions in one line."""
    return ", ".join(f"{_NAMES.get(name, name)} {v}" for name, v in versions().items())


def versions() -> dict[str, str]:
    """Versions that people ask for, by name, or "missing"."""
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
    """Versions of the packages that are installed, by name."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@functools.cache
def source() -> str:
    """Hash of those of dealib's modules that results depend on."""
    root, digest = Path(__file__).parent, hashlib.sha256()
    for file in sorted([*root.rglob("*.py"), *root.rglob("*.yaml")]):
        if file.relative_to(root).parts[0] not in _BESIDE:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _petsc() -> str:
    """What PETSc says itself: Debian 13 has petsc4py 3.22.4 with PETSc 3.22.5."""
    try:
        from mpi4py import MPI  # noqa: F401 - finds the MPI that dolfinx's wheel needs
        from petsc4py import PETSc
    except ImportError:
        return "missing"
    return ".".join(map(str, PETSc.Sys.getVersion()))
