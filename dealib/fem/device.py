"""The meshed device in dolfinx: regions and boundaries by name, and the spaces on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx import mesh as dmesh

from dealib.config.schema import Config
from dealib.errors import ConfigError, DealibError
from dealib.fem import compat
from dealib.geometry import names
from dealib.geometry.model import gmsh_model
from dealib.geometry.model import save as write_mesh

# Regions that share one energy share one integral, so that it is compiled once.
KINDS = {
    "film": (names.FILM,),
    "electrodes": (names.TOP_ELECTRODE, names.BOTTOM_ELECTRODE),
    "blocks": (names.MOUNT_BLOCK, names.FRAME_BLOCK),
    "air": (names.AIR,),
}
KIND_TAGS = {kind: tag for tag, kind in enumerate(KINDS, start=1)}
REGION_IDS = {region: i for i, region in enumerate(r for rs in KINDS.values() for r in rs)}

Ints = npt.NDArray[np.int32]


@dataclass
class Device:
    """A distributed mesh with names.

    Attributes:
        mesh: The dolfinx mesh, coordinates (R, Z) in mm.
        cell_tags: Region tags.
        facet_tags: Boundary tags.
        groups: {name: (dim, tag)}.
        comm: The caller's communicator. The mesh has a copy, which ends with it; what PETSc is to
            free later (`compat.free`) needs one that lasts.
    """

    mesh: Any
    cell_tags: Any
    facet_tags: Any
    groups: dict[str, tuple[int, int]]
    comm: Any

    @classmethod
    def from_gmsh(cls, model: Any, comm: MPI.Comm) -> Device:
        """Distribute a meshed Gmsh model from rank 0 (None elsewhere)."""
        device = cls(*compat.from_gmsh(model, comm), comm)
        for dim in (1, 2):
            device.mesh.topology.create_connectivity(dim, 2)
        return device

    def entities(self, name: str) -> Ints:
        """Local cells or facets of a named region or boundary (ghosts included)."""
        dim, tag = self.groups[name]
        tags = self.cell_tags if dim == 2 else self.facet_tags
        return np.asarray(tags.indices[tags.values == tag], dtype=np.int32)

    def cells(self, *regions: str) -> Ints:
        """Local cells of regions, sorted; regions that the device lacks count as empty."""
        found = [self.entities(r) for r in regions if r in self.groups]
        return np.sort(np.concatenate([np.empty(0, np.int32), *found])).astype(np.int32)

    @property
    def all_cells(self) -> Ints:
        """All local cells."""
        return np.arange(len(compat.original_cells(self.mesh)), dtype=np.int32)

    def owned(self, cells: Ints) -> Ints:
        """Those of the cells that this rank owns."""
        return cells[cells < compat.local_cells(self.mesh)]

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions, in a fixed order."""
        return tuple(r for r in REGION_IDS if r in self.groups)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of region that the device has."""
        return tuple(k for k, rs in KINDS.items() if any(r in self.groups for r in rs))

    @cached_property
    def kind_tags(self) -> Any:
        """Cell tags by kind of region, for the integrals."""
        cells = {k: self.cells(*KINDS[k]) for k in self.kinds}
        indices = np.concatenate(list(cells.values()))
        values = np.concatenate([np.full(len(c), KIND_TAGS[k]) for k, c in cells.items()])
        order = np.argsort(indices)
        return dmesh.meshtags(self.mesh, 2, indices[order], values[order].astype(np.int32))

    @cached_property
    def region_of_cell(self) -> Ints:
        """Region id of each local cell (`REGION_IDS`)."""
        ids = np.full(len(self.all_cells), -1, dtype=np.int32)
        for region in self.regions:
            ids[self.entities(region)] = REGION_IDS[region]
        return ids


@dataclass
class Spaces:
    """The monolithic space of displacement, potential and perhaps pressure, and its state.

    Attributes:
        W: Mixed space; sub-space 0 is u = (u_R, u_Z) in mm, 1 is phi in kV, 2 is p in MPa.
        w: The current state.
        order: Polynomial order of u and phi.
        pressure_element: Element of p in the mixed form, else None.
    """

    W: Any
    w: Any
    order: int
    pressure_element: Any = None


def build_device(config: Config, comm: MPI.Comm, save: Path | None = None) -> Device:
    """Mesh the geometry on rank 0 and distribute it.

    Args:
        config: The config.
        comm: MPI communicator.
        save: Write the mesh there, in Gmsh's format.

    Raises:
        ConfigError: On every rank, if the mesh cannot be built or read.
    """
    error: DealibError | None = None
    result: Device | None = None
    if comm.rank == 0:
        try:
            with gmsh_model(config) as gmsh:
                if save is not None:
                    write_mesh(gmsh, save)
                comm.bcast(None, root=0)
                result = Device.from_gmsh(gmsh.model, comm)
        except DealibError as caught:
            error = comm.bcast(caught, root=0)
    else:
        error = comm.bcast(None, root=0)
        if error is None:
            result = Device.from_gmsh(None, comm)
    if error is not None:
        raise error
    assert result is not None
    cells = comm.allgather(compat.local_cells(result.mesh))
    if min(cells) == 0:
        raise ConfigError(
            f"{comm.size} ranks are too many for {sum(cells)} cells, some get none; use fewer"
        )
    return result


def build_spaces(device: Device, order: int, mixed: bool = False) -> Spaces:
    """Continuous displacement and potential of one order, and a pressure, in one space.

    The pressure jumps from cell to cell, since it does so from film to electrode. With second-order
    displacements it is linear in each quadrilateral (the inf-sup stable pair of best order), but
    constant in each triangle, where the linear one would lock.

    Args:
        device: The device.
        order: Order of displacement and potential.
        mixed: Whether there is a pressure.
    """
    mesh = device.mesh
    elements = [
        compat.element(mesh, "Lagrange", order, (2,)),
        compat.element(mesh, "Lagrange", order),
    ]
    pressure = None
    if mixed:
        quadrilateral = compat.cell_name(mesh) == "quadrilateral"
        pressure = compat.element(mesh, *(("DPC", 1) if quadrilateral else ("DG", 0)))
        elements.append(pressure)
    W = compat.functionspace(mesh, compat.mixed_element(elements))
    return Spaces(W, fem.Function(W, name="w"), order, pressure)
