"""Keeps Debian's packages: prints pip constraints, or checks that nothing shadows them.

An unconstrained pip would put a newer numpy over Debian's, and petsc4py and scipy would fail. A
PyPI h5py next to Debian's dolfinx fails or crashes.
"""

import importlib
import importlib.metadata
import sys

KEPT = ("numpy", "scipy", "mpi4py", "petsc4py", "cffi", "fenics-ffcx", "fenics-ufl", "fenics-basix")
FROM_DEBIAN = ("numpy", "scipy", "h5py", "mpi4py", "petsc4py", "dolfinx", "ufl", "basix")


def constraints() -> list[str]:
    """'name==version' of the kept packages that this interpreter has."""
    found = []
    for name in KEPT:
        try:
            found.append(f"{name}=={importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def check() -> int:
    """Report packages that do not come from Debian."""
    sys.setdlopenflags = lambda flags: None  # dolfinx 0.5 would make VTK abort
    wrong = []
    for name in FROM_DEBIAN:
        try:
            path = importlib.import_module(name).__file__ or ""
        except ImportError as error:
            wrong.append(f"{name} does not import: {error}")
            continue
        if not path.startswith("/usr/lib/"):
            wrong.append(
                f"{name} comes from {path}, not from Debian; remove .venv and set up again"
            )
    for line in wrong:
        print(f"setup: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    if "--check" in sys.argv:
        sys.exit(check())
    print("\n".join(constraints()))
