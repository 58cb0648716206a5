"""One Gmsh session: build or read the mesh of a config, check its names, write it."""

from __future__ import annotations

import errno
import signal
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dealib.device import msh, own_mesh, own_strips, sheet, solid, sound
from dealib.device.laminate import JOIN
from dealib.device.plane_grid import grid
from dealib.device.shapes import AnnularStrips, MeshShape
from dealib.errors import ConfigError
from dealib.files import whole
from dealib.patience import patience

if TYPE_CHECKING:
    from dealib.config.schema import Config


@contextmanager
def gmsh_model(config: Config) -> Iterator[Any]:
    """The meshed Gmsh model of a config; Gmsh is closed on leaving.

    Raises:
        ConfigError: If a mesh file lacks names, or does not fit the geometry.
    """
    laminate = config.device.laminate
    with session() as gmsh:
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        if config.mesh.file is None and laminate is not None:
            gmsh.model.add(config.name)
            with patience("meshing"):
                if laminate.sheet:
                    sheet.build(gmsh, laminate, config.mesh)
                elif laminate.solid:
                    solid.build(gmsh, laminate, config.mesh)
                else:
                    grid(laminate, config.mesh).build(gmsh)
        else:
            _read(gmsh, config)
        yield gmsh


@contextmanager
def session() -> Iterator[Any]:
    """A session of Gmsh without its output, which restores the handlers of signals."""
    import gmsh

    # the user's own option files of Gmsh would change the mesh
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    if threading.current_thread() is threading.main_thread():
        # Gmsh resets SIGINT and SIGTERM; PETSc would end the process on a closed pipe
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.getsignal(number))
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
    finally:
        gmsh.finalize()


def save(gmsh: Any, path: Path) -> None:
    """Write the open model in Gmsh's format, whole or not at all.

    Raises:
        PlatformError: If the disk refuses; Gmsh itself does not report that.
    """
    with whole(path) as temporary:
        gmsh.write(str(temporary))
        if not temporary.read_bytes().rstrip().endswith(b"$EndElements"):
            raise OSError(errno.ENOSPC, "the disk is full, or a limit on file size is reached")


def write(config: Config, path: Path) -> dict[str, int]:
    """Write the mesh of a config in Gmsh's format 4.1; returns the number of cells by region."""
    with gmsh_model(config) as gmsh:
        save(gmsh, path)
        return cells_by_region(gmsh.model, {region.name for region in config.device.regions})


def check(config: Config) -> None:
    """Check the mesh file of a config.

    Raises:
        ConfigError: If it is damaged, lacks names, or does not fit the geometry.
    """
    with gmsh_model(config):
        pass


def cells_by_region(model: Any, regions: set[str]) -> dict[str, int]:
    """Number of cells in each region; cells of a sheet may lie in several, such as 'film&patch'."""
    dim, found = model.getDimension(), Counter[str]()
    for _, tag in model.getPhysicalGroups(dim):
        names = model.getPhysicalName(dim, tag).split(JOIN)
        for entity in model.getEntitiesForPhysicalGroup(dim, tag):
            cells = sum(map(len, model.mesh.getElements(dim, entity)[1]))
            found[JOIN.join(n for n in names if n in regions)] += cells
    return dict(found)


def _read(gmsh: Any, config: Config) -> None:
    geometry, path = config.geometry, config.mesh_file
    assert path is not None
    found = msh.read(Path(path))
    try:
        found.into(gmsh.model)
    except Exception as error:  # gmsh raises plain Exception
        raise ConfigError(f"{path}: Gmsh refuses this mesh: {error}") from None
    if isinstance(geometry, AnnularStrips):
        own_strips.check(gmsh.model, path, geometry)
    if fault := sound.fault(found, config.device.kinematics.dim):
        raise ConfigError(f"{path}: {fault}")
    if isinstance(geometry, MeshShape):
        own_mesh.prepare(gmsh, config, geometry)
