"""The only module that knows which dolfinx is installed: 0.5.2, 0.9, 0.10 or 0.11.

`dealib.fem` imports it before anything else, since the order in which libraries load matters.
"""

from __future__ import annotations

import functools
import logging
import os
import platform
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# one BLAS thread is fastest at these sizes; set before PETSc loads its BLAS
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from mpi4py import MPI as _MPI  # noqa: E402, F401 - finds the MPI that dolfinx's wheel needs

_setdlopenflags = sys.setdlopenflags
sys.setdlopenflags = lambda flags: None  # dolfinx 0.5 asks for RTLD_GLOBAL: VTK would abort
_root_level = logging.getLogger().level
import dolfinx  # noqa: E402

sys.setdlopenflags = _setdlopenflags
logging.getLogger().setLevel(logging.WARNING)  # ffcx 0.5 turns its INFO lines on at import

from petsc4py import PETSc  # noqa: E402

import numpy as np  # noqa: E402
import numpy.typing as npt  # noqa: E402
import ufl  # noqa: E402
from dolfinx import fem  # noqa: E402
from dolfinx import mesh as _mesh  # noqa: E402
from dolfinx.fem import petsc as _petsc  # noqa: E402

VERSION: str = dolfinx.__version__
LEGACY = not hasattr(fem, "functionspace")  # Debian 12's 0.5.2: elements live in UFL, not in Basix

if LEGACY:

    def element(mesh: Any, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
        """Lagrange-type element of a value shape: () scalar, (n,) vector, (m, n) tensor."""
        cell = mesh.ufl_cell()
        if family == "DG" and cell.cellname() in ("quadrilateral", "hexahedron"):
            family = "DQ"
        if not shape:
            return ufl.FiniteElement(family, cell, degree)
        if len(shape) == 1:
            return ufl.VectorElement(family, cell, degree, dim=shape[0])
        return ufl.TensorElement(family, cell, degree, shape=shape)

    def mixed_element(elements: list[Any]) -> Any:
        """Element of a monolithic space."""
        return ufl.MixedElement(*elements)
else:
    import basix.ufl

    def element(mesh: Any, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
        """Lagrange-type element of a value shape: () scalar, (n,) vector, (m, n) tensor."""
        return basix.ufl.element(family, mesh.basix_cell(), degree, shape=shape)

    def mixed_element(elements: list[Any]) -> Any:
        """Element of a monolithic space."""
        return basix.ufl.mixed_element(list(elements))


_reasons = vars(PETSc.SNES.ConvergedReason)
DIVERGED_NAN: int = next(
    _reasons[name]
    for name in ("DIVERGED_FNORM_NAN", "DIVERGED_FUNCTION_NANORINF")  # PETSc renamed it
    if name in _reasons
)


def tabulate(ufl_element: Any, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Basis functions of a scalar element at reference points, (points, functions)."""
    if LEGACY:
        from ffcx.element_interface import create_element

        ufl_element = create_element(ufl_element)
    return np.asarray(ufl_element.tabulate(0, points)[0])


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the compiler's lines out of the user's terminal (its errors are raised)."""
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


def functionspace(mesh: Any, element: Any) -> Any:
    """A function space; its element may have to be compiled."""
    with _quiet():
        return (fem.FunctionSpace if LEGACY else fem.functionspace)(mesh, element)


@functools.cache
def _compiler_flags() -> tuple[str, ...]:
    """Flags for the forms' C code, with a mark of this processor.

    The code is compiled for the machine that runs it; the mark keeps apart what different machines
    compile into one shared cache. Not-a-number must stay: it shows an inverted element.
    """
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            features = next((line for line in file if line.startswith(("flags", "Features"))), "")
    except OSError:
        features = platform.processor()
    mark = zlib.crc32(features.encode())
    fast = ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only")
    return (*fast, f"-DDEALIB_PROCESSOR={mark}")


def form(expression: Any) -> Any:
    """Compile a UFL form."""
    suffix = "params" if LEGACY else "options"
    with _quiet():
        flags = list(_compiler_flags())
        return fem.form(expression, **{f"jit_{suffix}": {"cffi_extra_compile_args": flags}})


def expression(ufl_expression: Any, points: npt.NDArray[np.float64]) -> Any:
    """Compile an expression for evaluation at reference points."""
    with _quiet():
        return fem.Expression(ufl_expression, points)


def evaluate(compiled: Any, mesh: Any, cells: npt.NDArray[np.int32], points: int) -> Any:
    """Values of a compiled expression, of shape (cells, points, components)."""
    if len(cells) == 0:
        size = int(np.prod(compiled.ufl_expression.ufl_shape, dtype=int))
        return np.empty((0, points, size))
    values = compiled.eval(*((cells,) if LEGACY else (mesh, cells)))
    return np.asarray(values).reshape(len(cells), points, -1)


def petsc_vec(u: Any) -> Any:
    """The PETSc vector that shares memory with a function."""
    return u.vector if LEGACY else u.x.petsc_vec


def create_vector(linear_form: Any) -> Any:
    """A ghosted PETSc vector with the layout of a compiled linear form."""
    try:
        return _petsc.create_vector(linear_form)  # up to 0.9
    except (AttributeError, TypeError):
        return _petsc.create_vector(linear_form.function_spaces[0])  # from 0.10


def local_cells(mesh: Any) -> int:
    """Number of owned cells; ghosts come after them."""
    return int(mesh.topology.index_map(mesh.topology.dim).size_local)


def _table(adjacency: Any) -> Any:
    if isinstance(adjacency, np.ndarray):
        return adjacency
    return adjacency.array.reshape(adjacency.num_nodes, -1)


def cell_dofs(space: Any) -> npt.NDArray[np.int32]:
    """Degrees of freedom of each local cell, ghosts included (blocks, not unrolled)."""
    return np.asarray(_table(space.dofmap.list))


def original_cells(mesh: Any) -> npt.NDArray[np.int64]:
    """For each local cell its index in the mesh as it was read, the same on any number of ranks."""
    return np.asarray(mesh.topology.original_cell_index, dtype=np.int64)


def cell_name(mesh: Any) -> str:
    """'quadrilateral' or 'triangle'."""
    return str(mesh.topology.cell_name())


def from_gmsh(model: Any, comm: Any) -> tuple[Any, Any, Any, dict[str, tuple[int, int]]]:
    """Distribute rank 0's Gmsh model: mesh, cell tags, facet tags, {name: (dim, tag)}."""
    names = {}
    if comm.rank == 0:
        names = {model.getPhysicalName(d, t): (d, t) for d, t in model.getPhysicalGroups()}
    names = comm.bcast(names, root=0)
    try:
        from dolfinx.io import gmsh as reader  # from 0.10
    except ImportError:
        from dolfinx.io import gmshio as reader
    kw: dict[str, Any] = {}
    if not LEGACY:  # newer versions drop ghost cells of a Gmsh mesh unless told
        ghosts = _mesh.GhostMode.shared_facet
        try:
            kw["partitioner"] = _mesh.create_cell_partitioner(ghosts)
        except TypeError:
            kw["partitioner"] = _mesh.create_cell_partitioner(ghosts, 2)
    mesh, cells, facets = reader.model_to_mesh(model, comm, 0, gdim=2, **kw)[:3]
    return mesh, cells, facets, names


def cell_nodes(mesh: Any) -> npt.NDArray[np.int32]:
    """Geometry nodes of each local cell, ghosts included."""
    g = mesh.geometry
    return np.asarray(g.dofmaps[0] if hasattr(g, "dofmaps") else _table(g.dofmap))
