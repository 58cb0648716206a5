"""The constraint map w = T q: free unknowns, ports and fixed degrees of freedom.

Every degree of freedom equals a free unknown or the value of a port, or is zero; those of a rigid
mount depend on several ports. The map is the local-to-global map of the reduced matrix, so that
dolfinx assembles straight into the reduced system: PETSc drops negative indices and sums tied rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx import mesh as dmesh

from dealib.arrays import Array, Indices
from dealib.device.driven import check_apart
from dealib.device.records import MOUNT, PHI, RIGID, Support
from dealib.fem import compat
from dealib.fem.domain import Domain, Spaces, node_positions
from dealib.fem.platform import Platform
from dealib.results.elements import Cell

FIELDS = ("displacement", "potential", "air mesh", "pressure")
_FREE, _ZERO, _FIRST_PORT = 0, 1, 2
_FIRST_RIGID = -1  # the first rigid mount; others are below


@dataclass
class ConstraintMap:
    """Numbering of the reduced unknowns.

    Attributes:
        comm: MPI communicator.
        columns: Reduced index of each local degree of freedom (ghosts included), -1 if fixed.
        physical: Reduced row of each local degree of freedom for the physical energies.
        mesh_rows: The same for the air's fictitious elasticity, which acts on displacements that
            belong to air alone.
        field: Index into `FIELDS` of each owned free unknown.
        ports: Global reduced index of each port.
        free: Local degrees of freedom of the free unknowns, in order.
        platforms: Rigid mounts, whose degrees of freedom have no column.
        owned: Number of reduced unknowns on this rank; the ports are the last ones of rank 0.
        contacted: Electrodes that have a prescribed potential at the contact, on this rank.
    """

    comm: MPI.Comm
    columns: Indices
    physical: Indices
    mesh_rows: Indices
    field: Indices
    ports: dict[str, int]
    owned: int
    free: Indices
    _port_of: dict[str, Indices]
    platforms: tuple[Platform, ...] = ()
    contacted: frozenset[str] = frozenset()

    def expand(self, q: Any, w: Any, at: dict[str, float] | None = None) -> None:
        """Set the function w = T q, ghosts included.

        Args:
            q: The reduced vector.
            w: The function.
            at: If q is a rate or a mode, the values of the ports in its state.
        """
        ports = self.port_values(q)
        w.x.array[self.free] = q.array_r[: len(self.free)]
        for name, dofs in self._port_of.items():
            w.x.array[dofs] = ports[name]
        for platform in self.platforms:
            if at is None:
                moved = platform.displacements(ports)
            else:
                rates = np.array([ports[name] for name in platform.ports])
                moved = rates @ platform.directions(at)
            w.x.array[platform.dofs] = moved
        w.x.scatter_forward()

    def restrict(self, w: Any, q: Any, ports: dict[str, float]) -> None:
        """Set q so that w = T q, from a function that satisfies the constraints.

        Args:
            w: The function.
            q: The reduced vector.
            ports: Values of ports without degrees of freedom, such as pressures.
        """
        q.array[: len(self.free)] = w.x.array[self.free]
        mine = {n: float(w.x.array[d[0]]) for n, d in self._port_of.items() if len(d)}
        for part in self.comm.allgather(mine):
            ports = ports | part
        for name in self.ports:
            self.set_port(q, name, ports.get(name, 0.0))

    def port_values(self, q: Any) -> dict[str, float]:
        """Values of the ports in a reduced vector, on every rank."""
        mine = None
        if self.comm.rank == 0:
            mine = q.array_r[self.owned - len(self.ports) : self.owned].tolist()
        values = self.comm.bcast(mine, root=0)
        return dict(zip(self.ports, values, strict=True))

    def set_port(self, q: Any, name: str, value: float) -> None:
        """Set one port's entry of a reduced vector."""
        if self.comm.rank == 0:
            q.array[self.owned - len(self.ports) + list(self.ports).index(name)] = value

    def summed(self, mine: Array) -> Array:
        """Sum of arrays of all ranks (collective)."""
        total = np.empty_like(mine)
        self.comm.Allreduce(mine, total)
        return total

    def numbers(self, field: str) -> Indices:
        """Global numbers of this rank's free unknowns of a field."""
        first = sum(self.comm.allgather(self.owned)[: self.comm.rank])
        return np.asarray(first + np.flatnonzero(self.field == FIELDS.index(field)), dtype=np.int32)

    def create_vector(self) -> Any:
        """An empty reduced vector."""
        return PETSc.Vec().createMPI((self.owned, None), comm=self.comm)

    def lgmap(self, rows: Indices) -> Any:
        """PETSc local-to-global map of reduced rows or columns."""
        return PETSc.LGMap().create(rows, comm=self.comm)


def build(domain: Domain, spaces: Spaces, contact: str | None = None) -> ConstraintMap:
    """Number the reduced unknowns of a device (collective).

    Args:
        domain: The mesh.
        spaces: The spaces on it.
        contact: Boundary on which alone the potential of electrodes is prescribed.

    Raises:
        ValueAt: If two terminals touch.
    """
    W, comm, device = spaces.W, domain.comm, domain.device
    index_map = W.dofmap.index_map
    owned, total = index_map.size_local, index_map.size_local + index_map.num_ghosts
    names = [port.name for port in device.ports]
    rigid = list(dict.fromkeys(port.rigid for port in device.ports if port.rigid))

    kind = np.full(total, _FREE, dtype=np.int32)
    supports = [s for s in device.supports if s.quantity != PHI or not device.kinematics.sheet]
    contacted = set()
    for support in supports:
        dofs = support_dofs(domain, spaces, support)
        if contact is not None and support.quantity == PHI:
            dofs = np.intersect1d(dofs, _dofs(spaces.W, (1,), *domain.entities(contact)))
            contacted |= {support.where} if len(dofs) else set()
        target = _ZERO
        if support.kind == RIGID:
            target = _FIRST_RIGID - rigid.index(support.port)
        elif support.port:
            target = _FIRST_PORT + names.index(support.port)
        if support.quantity == PHI:
            _check_apart(domain, kind[dofs], target)
        kind[dofs] = target
    if device.kinematics.revolved and device.kinematics.lies[0] == 0:
        kind[_on_axis(domain, spaces)] = _ZERO
    pressure = np.zeros(total, bool)
    if spaces.pressure_element is not None:  # it lives in the solids only
        pressure[_dofs(W, (2,), domain.dim, domain.all_cells)] = True
        kind[pressure] = _ZERO
        kind[_dofs(W, (2,), domain.dim, domain.solids)] = _FREE
    solid, in_air = np.zeros(total, bool), np.zeros(total, bool)
    for region in device.regions:
        where = in_air if region.air else solid
        for k in range(device.kinematics.dim):
            where[_dofs(W, (0, k), domain.dim, domain.cells(region.name))] = True
    for array in (kind, solid, in_air):
        owners_decide(W, array)
    potential = np.zeros(total, bool)
    if not device.kinematics.sheet:
        potential[_dofs(W, (1,), domain.dim, domain.all_cells)] = True
    mesh_only = in_air & ~solid

    free = np.flatnonzero(kind[:owned] == _FREE).astype(np.int32)
    # the air's mesh first: where a block's numbers follow each other, PETSc takes it out quickly
    free = free[np.argsort(~mesh_only[free], kind="stable")]
    count = len(free) + (len(names) if comm.rank == 0 else 0)
    offset = comm.exscan(count) or 0
    first_port = comm.bcast(offset + len(free), root=0)
    numbers = np.full(total, -1, dtype=np.int64)
    numbers[free] = offset + np.arange(len(free))
    for i in range(len(names)):
        numbers[np.flatnonzero(kind == _FIRST_PORT + i)] = first_port + i
    columns = owners_decide(W, numbers).astype(np.int32)

    which = [potential[free], mesh_only[free], pressure[free]]
    field = np.select(which, [1, 2, 3]).astype(np.int32)
    return ConstraintMap(
        comm=comm,
        columns=columns,
        physical=np.where(mesh_only, -1, columns).astype(np.int32),
        mesh_rows=np.where(mesh_only, columns, -1).astype(np.int32),
        field=field,
        ports={name: first_port + i for i, name in enumerate(names)},
        owned=count,
        free=free,
        _port_of={
            name: np.flatnonzero(kind[:owned] == _FIRST_PORT + i).astype(np.int32)
            for i, name in enumerate(names)
        },
        platforms=tuple(
            _platform(domain, spaces, name, kind == _FIRST_RIGID - k)
            for k, name in enumerate(rigid)
        ),
        contacted=frozenset(contacted),
    )


def _platform(domain: Domain, spaces: Spaces, name: str, mine: Any) -> Platform:
    """The rigid mount of a name; `mine` masks its local degrees of freedom (collective)."""
    kinematics, W = domain.device.kinematics, spaces.W
    ports = [port for port in domain.device.ports if port.rigid == name]
    cell = Cell(compat.cell_name(domain.mesh), spaces.order)
    nodes = node_positions(domain, cell).reshape(-1, kinematics.dim)
    space = ["XYZ".index(axis) for axis in kinematics.axes]
    dofs, component, at = [], [], []
    for k, axis in enumerate(space):
        every = compat.cell_dofs(W.sub(0).sub(k))[:, cell.basix_order].ravel()
        found, first = np.unique(every, return_index=True)
        chosen = mine[found]
        dofs.append(found[chosen])
        component.append(np.full(chosen.sum(), axis))
        at.append(nodes[first[chosen]])
    x = np.concatenate(at)
    centre = np.array(ports[0].centre)
    if not len(centre):
        ends = np.full((2, len(space)), -np.inf)
        if len(x):
            ends[:] = x.max(axis=0), -x.min(axis=0)
        domain.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        centre = (ends[0] - ends[1]) / 2
    arms = np.zeros((len(x), 3))
    arms[:, space] = x - centre
    shifts = [port for port in ports if port.kind == MOUNT]
    return Platform(
        tuple(port.name for port in ports),
        tuple("XYZ".index(port.along) for port in ports),
        len(shifts),
        np.concatenate(dofs),
        np.concatenate(component),
        arms,
        centre,
    )


def support_dofs(domain: Domain, spaces: Spaces, support: Support) -> Indices:
    """Local degrees of freedom that a support prescribes, ghosts included."""
    axes = domain.device.kinematics.axes
    path = (1,) if support.quantity == PHI else (0, axes.index(support.quantity))
    if not domain.has(support.where):
        return np.empty(0, np.int32)
    return _dofs(spaces.W, path, *domain.entities(support.where))


def _on_axis(domain: Domain, spaces: Spaces) -> Indices:
    """Degrees of freedom of the radial displacement on the axis, where it is zero."""
    near, dim = 1e-9 * domain.sizes.span, domain.dim - 1
    facets = dmesh.locate_entities_boundary(domain.mesh, dim, lambda x: np.abs(x[0]) < near)
    return _dofs(spaces.W, (0, 0), dim, facets)


def _check_apart(domain: Domain, before: Indices, target: int) -> None:
    """Refuse a terminal that shares a node with another one."""
    others = np.unique(before[(before != _FREE) & (before != target)])
    other = domain.comm.allreduce(int(others[0]) if len(others) else -1, op=MPI.MAX)
    if other < 0:
        return
    names = [port.name for port in domain.device.ports]
    check_apart(*(names[k - _FIRST_PORT] if k >= _FIRST_PORT else "" for k in (target, other)))


def _dofs(W: Any, path: tuple[int, ...], dim: int, entities: Indices) -> Indices:
    for k in path:
        W = W.sub(k)
    return np.asarray(fem.locate_dofs_topological(W, dim, entities))


def owners_decide(W: Any, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Overwrite ghost entries by their owners'; the integers are exact as floats."""
    carrier = fem.Function(W)
    carrier.x.array[:] = values
    carrier.x.scatter_forward()
    values[:] = np.rint(carrier.x.array).astype(values.dtype)
    return values
