"""The meshed device in dolfinx: regions and boundaries by name, and the spaces on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

from dealib.arrays import Indices
from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.gmsh_model import gmsh_model
from dealib.device.gmsh_model import save as write_mesh
from dealib.device.laminate import JOIN
from dealib.device.records import Sizes
from dealib.device.sheet_kinematics import SheetKinematics
from dealib.errors import ConfigError, DealibError
from dealib.fem import compat
from dealib.fem.energies import constant
from dealib.results.elements import Cell, determinant

Groups = tuple[tuple[str, ...], ...]  # of regions that share an energy


@dataclass
class Domain:
    """A distributed mesh with the names of a device.

    Attributes:
        device: The device whose names it has.
        mesh: The dolfinx mesh, coordinates in mm.
        cell_tags: Region tags.
        facet_tags: Boundary tags.
        groups: {name: (dim, tag)}.
        comm: The caller's communicator. The mesh has a copy that ends with it; objects that PETSc
            frees later (`compat.free`) need one that lasts.
    """

    device: Device
    mesh: Any
    cell_tags: Any
    facet_tags: Any
    groups: dict[str, tuple[int, int]]
    comm: Any

    @classmethod
    def from_gmsh(cls, model: Any, comm: MPI.Comm, device: Device) -> Domain:
        """Distribute a meshed Gmsh model from rank 0 (None elsewhere)."""
        domain = cls(device, *compat.from_gmsh(model, comm, len(device.kinematics.lies)), comm)
        for dim in (domain.dim - 1, domain.dim):
            domain.mesh.topology.create_connectivity(dim, domain.dim)
        return domain

    @property
    def dim(self) -> int:
        """Topological dimension."""
        return int(self.mesh.topology.dim)

    @property
    def drawn_nodes(self) -> Indices:
        """Number that each local node of the mesh has in the mesh as it was drawn."""
        return np.asarray(self.mesh.geometry.input_global_indices)

    def has(self, name: str) -> bool:
        """Whether the mesh has a region or boundary."""
        return bool(self.tags(name))

    def tags(self, name: str) -> list[tuple[int, int]]:
        """Dimensions and tags of the parts of a region or boundary."""
        return [
            found for group, found in self.groups.items() if name in (group, *group.split(JOIN))
        ]

    def entities(self, name: str) -> tuple[int, Indices]:
        """Dimension and local cells or facets of a named region or boundary (ghosts included)."""
        parts = self.tags(name)
        dim = parts[0][0]
        tags = self.cell_tags if dim == self.dim else self.facet_tags
        wanted = np.isin(tags.values, [tag for _, tag in parts])
        return dim, np.asarray(tags.indices[wanted], dtype=np.int32)

    def cells(self, *regions: str) -> Indices:
        """Local cells of regions, sorted; regions that the mesh lacks count as empty."""
        found = [self.entities(r)[1] for r in regions if self.has(r)]
        return np.sort(np.concatenate([np.empty(0, np.int32), *found])).astype(np.int32)

    @property
    def all_cells(self) -> Indices:
        """All local cells."""
        return np.arange(len(compat.original_cells(self.mesh)), dtype=np.int32)

    def owned(self, cells: Indices) -> Indices:
        """Those of the cells that this rank owns."""
        return cells[cells < compat.local_cells(self.mesh)]

    @cached_property
    def solids(self) -> Indices:
        """Local cells of all materials."""
        return self.cells(*(r.name for r in self.device.solids))

    @cached_property
    def air(self) -> Indices:
        """Local cells of air."""
        return self.cells(*(r.name for r in self.device.regions if r.air))

    def tagged(self, groups: Groups) -> Any:
        """Cell tags by group of regions, for the integrals: the first group has tag 1."""
        cells = [self.cells(*group) for group in groups]
        indices = np.concatenate(cells)
        values = np.concatenate([np.full(len(c), k) for k, c in enumerate(cells, start=1)])
        order = np.argsort(indices)
        return dmesh.meshtags(self.mesh, self.dim, indices[order], values[order].astype(np.int32))

    @cached_property
    def region_of_cell(self) -> Indices:
        """Index among the device's regions of each local cell."""
        ids = np.full(len(self.all_cells), -1, dtype=np.int32)
        for k, region in enumerate(self.device.regions):
            ids[self.cells(region.name)] = k
        return ids

    @cached_property
    def symbolic(self) -> Any:
        """The device's space for UFL, with constants for its numbers.

        Forms then need not be compiled anew for other numbers.
        """
        k: Any = self.device.kinematics
        numbers = ["multiple"] + ["offset"] * isinstance(k, SheetKinematics)
        return replace(k, **{name: constant(self.mesh, getattr(k, name)) for name in numbers})

    @cached_property
    def sizes(self) -> Sizes:
        """Characteristic sizes of the shape, or of a mesh file (collective)."""
        return self.device.sizes or self._measured()

    def _measured(self) -> Sizes:
        """Sizes from the box around the solids, and from their volume over its largest face.

        That is the thickness of a wall too, which may be curved.
        """
        x = self.mesh.geometry.x[np.unique(compat.cell_nodes(self.mesh)[self.solids])]
        ends = np.array([x.max(axis=0), -x.min(axis=0)]) if len(x) else np.full((2, 3), -np.inf)
        self.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        high, low = ends * np.array([[1], [-1]])
        sides = np.sort((high - low)[: self.dim])
        thickness = self._volume() / float(np.prod(sides[1:]))
        device = self.device.kinematics
        width = device.multiple * (high[0] if device.revolved else 1.0)
        if self.dim == 3:
            width *= sides[1]
        return Sizes(thickness, sides[-1], float(width), sides[-1] * width, float(width))

    def _volume(self) -> float:
        """Volume of the solids, or their area in a plane (collective)."""
        cell = Cell(compat.cell_name(self.mesh), compat.geometry_order(self.mesh))
        nodes = compat.cell_nodes(self.mesh)[self.owned(self.solids)][:, cell.basix_order]
        places = np.swapaxes(self.mesh.geometry.x[nodes, : self.dim], 1, 2)
        sizes = np.abs(determinant(places[:, None] @ cell.shape(cell.gauss)[1]))
        return float(self.comm.allreduce(sizes.sum() * cell.gauss_weight))


@dataclass
class Spaces:
    """The monolithic space of displacement, potential and perhaps pressure, and its state.

    Attributes:
        W: Mixed space; sub-space 0 is u in mm, 1 is phi in kV, 2 is p in MPa.
        w: The current state.
        order: Polynomial order of u and phi.
        pressure_element: Element of p in the mixed form, else None.
    """

    W: Any
    w: Any
    order: int
    pressure_element: Any = None

    @property
    def degree(self) -> int:
        """Quadrature degree: 3 x 3 Gauss points on second-order cells, 2 x 2 on first-order."""
        return 2 * self.order

    @cached_property
    def potential(self) -> tuple[Any, Any]:
        """The space of the potential by itself, and its degrees of freedom in the mixed one."""
        space, dofs = self.W.sub(1).collapse()
        return space, np.asarray(dofs)


def node_positions(domain: Domain, cell: Cell) -> Any:
    """Coordinates of the nodes of each local cell in the space's axes, (cells, nodes, axes), mm."""
    mesh, kinematics = domain.mesh, domain.device.kinematics
    shape = Cell(cell.name, compat.geometry_order(mesh))
    at = mesh.geometry.x[compat.cell_nodes(mesh)[:, shape.basix_order]]
    nodes = np.asarray(shape.shape(cell.nodes)[0] @ at[..., : len(kinematics.lies)])
    return kinematics.positions(nodes) if isinstance(kinematics, SheetKinematics) else nodes


def build_domain(config: Config, comm: MPI.Comm, save: Path | None) -> Domain:
    """Mesh the geometry on rank 0 and distribute it.

    Args:
        config: The config.
        comm: MPI communicator.
        save: Where to write the mesh in Gmsh's format, if anywhere.

    Raises:
        ConfigError: On every rank, if the mesh cannot be built or read.
    """
    error: DealibError | None = None
    result: Domain | None = None
    if comm.rank == 0:
        try:
            with gmsh_model(config) as gmsh:
                if save is not None:
                    write_mesh(gmsh, save)
                comm.bcast(None, root=0)
                result = Domain.from_gmsh(gmsh.model, comm, config.device)
        except DealibError as caught:
            error = comm.bcast(caught, root=0)
    else:
        error = comm.bcast(None, root=0)
        if error is None:
            result = Domain.from_gmsh(None, comm, config.device)
    if error is not None:
        raise error
    assert result is not None
    cells = comm.allgather(compat.local_cells(result.mesh))
    if min(cells) == 0:
        raise ConfigError(
            f"{comm.size} ranks are too many for {sum(cells)} cells, some get none; use fewer"
        )
    return result


def build_spaces(domain: Domain, order: int, mixed: bool = False) -> Spaces:
    """Continuous displacement and potential of one order, and a pressure, in one space.

    The pressure is discontinuous between cells, as it is between film and electrode. With
    second-order displacements it is linear in each quadrilateral (the inf-sup stable pair of best
    order), but constant in each triangle, where a linear one would lock.

    Args:
        domain: The mesh.
        order: Order of displacement and potential.
        mixed: Whether there is a pressure.
    """
    mesh = domain.mesh
    elements = [
        compat.element(mesh, "Lagrange", order, (domain.device.kinematics.dim,)),
        compat.element(mesh, "Lagrange", order),
    ]
    if domain.device.kinematics.sheet:  # the potential is constant on each electrode
        del elements[1]
    pressure = None
    if mixed:
        straight = compat.cell_name(mesh) in ("quadrilateral", "hexahedron")
        pressure = compat.element(mesh, *(("DPC", 1) if straight else ("DG", 0)))
        elements.append(pressure)
    W = compat.functionspace(mesh, compat.mixed_element(elements))
    return Spaces(W, fem.Function(W, name="w"), order, pressure)
