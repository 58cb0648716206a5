"""Versions of what results depend on, without importing any of it."""

from __future__ import annotations

import functools
import hashlib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = (
    *("dealib", "fenics-dolfinx", "fenics-ffcx", "fenics-ufl", "fenics-basix"),
    *("petsc4py", "gmsh", "numpy", "scipy"),
)
# packages of dealib that results do not depend on
_BESIDE = {"calibration", "cases", "cli", "data", "plots", "report", "study"}


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
