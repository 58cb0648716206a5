"""Versions of everything that results depend on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

_NAMES = {"petsc": "PETSc", "gmsh": "Gmsh", "python": "Python"}


def version_line() -> str:
    """All versions in one line."""
    return ", ".join(f"{_NAMES.get(name, name)} {v}" for name, v in versions().items())


def versions() -> dict[str, str]:
    """Versions by name, or "missing"; dolfinx and Gmsh are not imported, which takes seconds."""
    return {
        "dealib": _installed("dealib"),
        "dolfinx": _installed("fenics-dolfinx", "dolfinx-solver-real"),  # Debian's, PyPI's
        "petsc": _petsc(),
        "gmsh": _installed("gmsh"),
        "numpy": _installed("numpy"),
        "python": platform.python_version(),
    }


def _installed(*packages: str) -> str:
    for package in packages:
        try:
            return version(package)
        except PackageNotFoundError:
            continue
    return "missing"


def _petsc() -> str:
    """What PETSc says itself: Debian 13 has petsc4py 3.22.4 with PETSc 3.22.5."""
    try:
        from mpi4py import MPI  # noqa: F401 - finds the MPI that dolfinx's wheel needs
        from petsc4py import PETSc
    except ImportError:
        return "missing"
    return ".".join(map(str, PETSc.Sys.getVersion()))
