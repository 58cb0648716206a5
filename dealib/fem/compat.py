"""The only module that knows which dolfinx is installed: 0.5.2, 0.9, 0.10 or 0.11.

`dealib.fem` imports it before anything else, since the order in which libraries load matters.
"""

from __future__ import annotations

import fcntl
import functools
import importlib.metadata
import inspect
import logging
import os
import sys
import types
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

# dealib answers signals; newer versions of PETSc would end the process on SIGTERM
if "-no_signal_handler" not in (_options := os.environ.get("PETSC_OPTIONS", "")):
    os.environ["PETSC_OPTIONS"] = f"{_options} -no_signal_handler".strip()

from mpi4py import MPI as _MPI  # noqa: F401 - finds the MPI that dolfinx's wheel needs


def _look_up(name: str) -> Any:
    """What a module asks of `pkg_resources` besides versions."""
    sys.modules.pop("pkg_resources", None)
    return getattr(importlib.import_module("pkg_resources"), name)


# ufl and ffcx 2022 ask it for their versions alone, and it takes 0.2 s to import
_versions = types.ModuleType("pkg_resources")
vars(_versions).update(get_distribution=importlib.metadata.distribution, __getattr__=_look_up)
_stands_in = sys.modules.setdefault("pkg_resources", _versions) is _versions
_setdlopenflags = sys.setdlopenflags
sys.setdlopenflags = lambda flags: None  # dolfinx 0.5 asks for RTLD_GLOBAL: VTK would abort
_root = logging.getLogger()
_root_level, _root_handlers = _root.level, list(_root.handlers)
import dolfinx  # noqa: E402

if _stands_in and sys.modules.get("pkg_resources") is _versions:
    del sys.modules["pkg_resources"]
sys.setdlopenflags = _setdlopenflags
_root.setLevel(_root_level)  # ffcx 0.5 configures the root logger at import
_root.handlers[:] = _root_handlers

from petsc4py import PETSc  # noqa: E402

import numpy as np  # noqa: E402
import numpy.typing as npt  # noqa: E402
import ufl  # noqa: E402
from dolfinx import fem  # noqa: E402
from dolfinx import mesh as _mesh  # noqa: E402
from ufl.corealg.map_dag import map_expr_dag  # noqa: E402

from dealib.errors import PlatformError  # noqa: E402
from dealib.patience import patience  # noqa: E402
from dealib.processor import features  # noqa: E402

VERSION: str = dolfinx.__version__
LEGACY = not hasattr(fem, "functionspace")  # Debian 12's 0.5.2: elements live in UFL, not in Basix

if LEGACY:
    _functionspace = fem.FunctionSpace

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

    def quadrature_element(mesh: Any, degree: int, size: int) -> Any:
        """Element of vectors at the quadrature points of a degree."""
        cell = mesh.ufl_cell()
        return ufl.VectorElement("Quadrature", cell, degree, dim=size, quad_scheme="default")
else:
    import basix.ufl

    _functionspace = fem.functionspace

    def element(mesh: Any, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
        """Lagrange-type element of a value shape: () scalar, (n,) vector, (m, n) tensor."""
        return basix.ufl.element(family, mesh.basix_cell(), degree, shape=shape)

    def mixed_element(elements: list[Any]) -> Any:
        """Element of a monolithic space."""
        return basix.ufl.mixed_element(list(elements))

    def quadrature_element(mesh: Any, degree: int, size: int) -> Any:
        """Element of vectors at the quadrature points of a degree."""
        return basix.ufl.quadrature_element(
            mesh.topology.cell_name(), value_shape=(size,), degree=degree
        )


HAS_HYPRE = bool(PETSc.Sys.hasExternalPackage("hypre"))  # not every PETSc was built with it
PETSc.Log.begin()  # here and not later: collective on the world in PETSc 3.22 and newer

_reasons = vars(PETSc.SNES.ConvergedReason)
DIVERGED_NAN: int = next(
    _reasons[name]
    for name in ("DIVERGED_FNORM_NAN", "DIVERGED_FUNCTION_NANORINF")  # PETSc renamed it
    if name in _reasons
)

_COMPILING = "compiling the equations of this kind of problem, which is done once"
_JIT = "jit_params" if LEGACY else "jit_options"


def cache_folder() -> Path:
    """Where dealib's forms are compiled: a folder for each dolfinx in the cache of all.

    So that programs with different ones do not wait for each other.
    """
    from dolfinx import jit

    known = jit.get_parameters() if LEGACY else jit.get_options()
    return Path(str(known["cache_dir"])).expanduser() / "dealib" / dolfinx.__version__


def tabulate(ufl_element: Any, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Basis functions of a scalar element at reference points, (points, functions)."""
    if LEGACY:
        from ffcx.element_interface import create_element

        ufl_element = create_element(ufl_element)
    return np.asarray(ufl_element.tabulate(0, points)[0])


def quadrature(mesh: Any, degree: int) -> tuple[Any, Any]:
    """Reference points (points, 2) and weights of the forms' quadrature of a degree."""
    import basix

    points, weights = basix.make_quadrature(getattr(basix.CellType, cell_name(mesh)), degree)
    return np.asarray(points), np.asarray(weights)


def facet_quadrature(mesh: Any, side: int, degree: int) -> tuple[Any, Any, Any]:
    """Quadrature of a facet in the reference cell: points, weights, and the facet's tangents.

    Args:
        mesh: The mesh.
        side: Number of the facet in its cell.
        degree: Of the quadrature.
    """
    import basix

    kind = getattr(basix.CellType, cell_name(mesh))
    dim = mesh.topology.dim
    corners = basix.geometry(kind)[basix.topology(kind)[dim - 1][side]]
    facet = {2: "interval", 3: {3: "triangle", 4: "quadrilateral"}.get(len(corners), "")}[dim]
    points, weights = basix.make_quadrature(getattr(basix.CellType, facet), degree)
    tangents = corners[1:dim] - corners[0]  # Basix's corners 1 and 2 lie along the facet's axes
    return corners[0] + np.asarray(points) @ tangents, np.asarray(weights), tangents


@contextmanager
def _jit(comm: Any, kind: str) -> Iterator[dict[str, Any]]:
    """Options for just-in-time compilation of a kind, by one process at a time, without chatter.

    FFCx marks a module that is being compiled by its C file, and waits for whoever does it. A run
    that is killed then leaves a mark that nobody will lift. So each kind is compiled under a file
    lock, which the kernel lifts when its holder dies: marks found under it are stale. It has a
    folder of its own, since FFCx lists the folder whenever it loads a module.
    """
    folder = cache_folder() / kind
    options = {_JIT: {"cache_dir": str(folder), "timeout": 600}}
    logging.disable(logging.INFO)
    _metadata.entry_points = _entry_points
    try:
        with patience(_COMPILING), _locked(folder) if comm.rank == 0 else nullcontext():
            yield options
    except OSError as error:
        raise PlatformError(f"cannot compile into {folder}: {error.strerror or error}") from None
    finally:
        _metadata.entry_points = _find_entry_points
        logging.disable(logging.NOTSET)


# setuptools asks for those of all packages six times a form: a tenth of the time that it takes
_metadata: Any = importlib.metadata
_find_entry_points = _metadata.entry_points
_entry_points = functools.cache(_find_entry_points)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError:  # some network file systems have no locks
            yield
            return
        if _seen.get(folder) != folder.stat().st_mtime_ns:
            names = set(os.listdir(folder))
            sources = (n for n in names if n.startswith("libffcx_") and n.endswith(".c"))
            for name in (n for n in sources if f"{n}.cached" not in names):
                (folder / name).unlink()
            _seen[folder] = folder.stat().st_mtime_ns
        yield


_seen: dict[Path, int] = {}  # when a folder had changed last before it was looked through


def functionspace(mesh: Any, element: Any) -> Any:
    """The finite element space of an element on a mesh."""
    known = inspect.signature(_functionspace).parameters
    with _jit(mesh.comm, "elements") as options:
        return _functionspace(mesh, element, **{k: v for k, v in options.items() if k in known})


@functools.cache
def _compiler_flags() -> tuple[str, ...]:
    """Flags for the forms' C code (DEALIB_CFLAGS), with a mark of this processor.

    The code is compiled for the machine that runs it; the mark keeps apart what different machines
    compile into one shared cache. Not-a-number must stay: it shows an inverted element. Debugging
    information, which Python's own flags ask for, takes a fifth of the compiler's time.
    """
    mark = zlib.crc32(features().encode())
    fast = "-O3 -march=native -ffast-math -fno-finite-math-only"
    return (*os.environ.get("DEALIB_CFLAGS", fast).split(), "-g0", f"-DDEALIB_PROCESSOR={mark}")


def form(expression: Any) -> Any:
    """Compile a UFL form (collective)."""
    kind = expression.signature()[:2]  # FFCx needs it, too
    with _jit(expression.ufl_domain().ufl_cargo().comm, kind) as options:
        options[_JIT]["cffi_extra_compile_args"] = list(_compiler_flags())
        return fem.form(expression, **options)


class _Numbered(ufl.corealg.multifunction.MultiFunction):
    """Numbers the variables of an expression from zero."""

    expr = ufl.corealg.multifunction.MultiFunction.reuse_if_untouched

    def __init__(self) -> None:
        super().__init__()
        self._known: dict[Any, Any] = {}

    def label(self, label: Any) -> Any:
        """Another label for each."""
        return self._known.setdefault(label, ufl.classes.Label(len(self._known)))


def expression(ufl_expression: Any, points: npt.NDArray[np.float64]) -> Any:
    """Compile an expression for evaluation at reference points (collective)."""
    if not LEGACY:  # these versions of FFCx compile it anew for other numbers, which only count up
        ufl_expression = map_expr_dag(_Numbered(), ufl_expression)
    comm = ufl.domain.extract_unique_domain(ufl_expression).ufl_cargo().comm
    size = int(np.prod(ufl_expression.ufl_shape, dtype=int))
    with _jit(comm, f"expressions-{size}-{len(points)}") as options:
        return fem.Expression(ufl_expression, points, **options)


def evaluate(compiled: Any, mesh: Any, cells: npt.NDArray[np.int32], points: int) -> Any:
    """Values of a compiled expression, of shape (cells, points, components)."""
    if len(cells) == 0:
        size = int(np.prod(compiled.ufl_expression.ufl_shape, dtype=int))
        return np.empty((0, points, size))
    values = compiled.eval(*((cells,) if LEGACY else (mesh, cells)))
    return np.asarray(values).reshape(len(cells), points, -1)


def create_vector(space: Any, comm: Any) -> Any:
    """A ghosted PETSc vector with the layout of a space, on a communicator that outlives it."""
    index_map, size = space.dofmap.index_map, space.dofmap.index_map_bs
    sizes = (size * index_map.size_local, size * index_map.size_global)
    ghosts = np.asarray(index_map.ghosts, dtype=PETSc.IntType)
    return PETSc.Vec().createGhost(ghosts, sizes, size, comm=comm)


def free(comm: Any) -> None:
    """Destroy the PETSc objects that Python has dropped on all ranks (collective).

    petsc4py leaves them until somebody asks, since collectors run at different times on the ranks.

    Args:
        comm: Communicator that the objects were made with, or what it was copied from.
    """
    PETSc.garbage_cleanup(comm)


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


def from_gmsh(model: Any, comm: Any, gdim: int) -> tuple[Any, Any, Any, dict[str, tuple[int, int]]]:
    """Distribute rank 0's Gmsh model: mesh, cell tags, facet tags, {name: (dim, tag)}.

    Args:
        model: The model; None on other ranks.
        comm: MPI communicator.
        gdim: Number of coordinates.
    """
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
    mesh, cells, facets = reader.model_to_mesh(model, comm, 0, gdim=gdim, **kw)[:3]
    return mesh, cells, facets, names


def geometry_order(mesh: Any) -> int:
    """Polynomial order of the cells' shape."""
    g = mesh.geometry
    return int(g.cmaps[0].degree if hasattr(g, "cmaps") else g.cmap.degree)


def cell_nodes(mesh: Any) -> npt.NDArray[np.int32]:
    """Geometry nodes of each local cell, ghosts included."""
    g = mesh.geometry
    return np.asarray(g.dofmaps[0] if hasattr(g, "dofmaps") else _table(g.dofmap))
