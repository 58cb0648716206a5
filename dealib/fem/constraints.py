"""The constraint map w = T q: free unknowns, ports and fixed degrees of freedom.

Every degree of freedom follows one free unknown, one port, or nothing (it stays zero). The map is
the local-to-global map of the reduced matrix, so that dolfinx assembles straight into the reduced
system: PETSc drops negative indices and adds up tied rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from dealib.fem.device import KINDS, Device, Spaces
from dealib.geometry import names
from dealib.geometry.supports import Support

PORTS = ("mount", "terminal")
FIELDS = ("displacement", "potential", "air mesh", "pressure")
_FREE, _ZERO, _FIRST_PORT = 0, 1, 2

Ints = npt.NDArray[np.int32]


@dataclass
class ConstraintMap:
    """Numbering of the reduced unknowns.

    Attributes:
        columns: Reduced index of each local degree of freedom (ghosts included), -1 if fixed.
        physical: Reduced row of each local degree of freedom for the physical energies.
        mesh_rows: The same for the air's fictitious elasticity (one-way): rows of displacements
            that touch no solid.
        field: Index into `FIELDS` of each owned free unknown.
        ports: Global reduced index of each port.
        owned: Number of reduced unknowns on this rank; the ports are the last of rank 0.
    """

    comm: MPI.Comm
    columns: Ints
    physical: Ints
    mesh_rows: Ints
    field: Ints
    ports: dict[str, int]
    owned: int
    _free: Ints
    _unknown: Ints
    _port_of: dict[str, Ints]

    def expand(self, q: Any, w: Any) -> None:
        """Set the function w = T q, ghosts included."""
        values = q.array_r
        ports = self.port_values(q)
        w.x.array[self._free] = values[self._unknown]
        for name, dofs in self._port_of.items():
            w.x.array[dofs] = ports[name]
        w.x.scatter_forward()

    def restrict(self, w: Any, q: Any) -> None:
        """Set q so that w = T q, from a function that satisfies the constraints."""
        q.array[self._unknown] = w.x.array[self._free]
        ports = np.array([np.nan] * len(PORTS))
        for i, name in enumerate(PORTS):
            if len(self._port_of[name]):
                ports[i] = w.x.array[self._port_of[name][0]]
        gathered = np.array(self.comm.allgather(ports))
        for i, name in enumerate(PORTS):
            known = gathered[~np.isnan(gathered[:, i]), i]
            self.set_port(q, name, float(known[0]) if len(known) else 0.0)

    def port_values(self, q: Any) -> dict[str, float]:
        """Values of the ports in a reduced vector, on every rank."""
        mine = None
        if self.comm.rank == 0:
            mine = q.array_r[self.owned - len(PORTS) :].tolist()
        values = self.comm.bcast(mine, root=0)
        return dict(zip(PORTS, values, strict=True))

    def set_port(self, q: Any, name: str, value: float) -> None:
        """Set one port's entry of a reduced vector."""
        if self.comm.rank == 0:
            q.array[self.owned - len(PORTS) + PORTS.index(name)] = value

    def numbers(self, field: str) -> Ints:
        """Global numbers of this rank's free unknowns of a field."""
        first = sum(self.comm.allgather(self.owned)[: self.comm.rank])
        return np.asarray(first + np.flatnonzero(self.field == FIELDS.index(field)), dtype=np.int32)

    def create_vector(self) -> Any:
        """An empty reduced vector."""
        return PETSc.Vec().createMPI((self.owned, None), comm=self.comm)

    def lgmap(self, rows: Ints) -> Any:
        """PETSc local-to-global map of reduced rows or columns."""
        return PETSc.LGMap().create(rows, comm=self.comm)


def build(device: Device, spaces: Spaces, supports: list[Support]) -> ConstraintMap:
    """Number the reduced unknowns of a device."""
    W, comm = spaces.W, device.comm
    index_map = W.dofmap.index_map
    owned, total = index_map.size_local, index_map.size_local + index_map.num_ghosts

    kind = np.full(total, _FREE, dtype=np.int32)
    for support in supports:
        dim, _ = device.groups[support.where]
        dofs = _dofs(W, support.quantity, dim, device.entities(support.where))
        kind[dofs] = {"zero": _ZERO, "mount": _FIRST_PORT, "terminal": _FIRST_PORT + 1}[
            support.target
        ]
    pressure = np.zeros(total, bool)
    if spaces.pressure_element is not None:  # it lives in the solids only
        pressure[_dofs(W, "p", 2, device.all_cells)] = True
        kind[pressure] = _ZERO
        kind[_dofs(W, "p", 2, device.cells(*KINDS["film"], *KINDS["electrodes"]))] = _FREE
    solid, in_air = np.zeros(total, bool), np.zeros(total, bool)
    for region in device.regions:
        for component in ("u_R", "u_Z"):
            where = in_air if region == names.AIR else solid
            where[_dofs(W, component, 2, device.entities(region))] = True
    for array in (kind, solid, in_air):
        _owners_decide(W, array)
    potential = np.zeros(total, bool)
    potential[_dofs(W, "phi", 2, device.all_cells)] = True
    mesh_only = in_air & ~solid

    free = np.flatnonzero(kind[:owned] == _FREE).astype(np.int32)
    count = len(free) + (len(PORTS) if comm.rank == 0 else 0)
    offset = comm.exscan(count) or 0
    first_port = comm.bcast(offset + len(free), root=0)
    numbers = np.full(total, -1, dtype=np.int64)
    numbers[free] = offset + np.arange(len(free))
    for i in range(len(PORTS)):
        numbers[np.flatnonzero(kind == _FIRST_PORT + i)] = first_port + i
    columns = _owners_decide(W, numbers).astype(np.int32)

    which = [potential[free], mesh_only[free], pressure[free]]
    field = np.select(which, [1, 2, 3]).astype(np.int32)
    return ConstraintMap(
        comm=comm,
        columns=columns,
        physical=np.where(mesh_only, -1, columns).astype(np.int32),
        mesh_rows=np.where(mesh_only, columns, -1).astype(np.int32),
        field=field,
        ports={name: first_port + i for i, name in enumerate(PORTS)},
        owned=count,
        _free=free,
        _unknown=np.arange(len(free), dtype=np.int32),
        _port_of={
            name: np.flatnonzero(kind[:owned] == _FIRST_PORT + i).astype(np.int32)
            for i, name in enumerate(PORTS)
        },
    )


def _dofs(W: Any, quantity: str, dim: int, entities: Ints) -> Ints:
    path = {"u_R": (0, 0), "u_Z": (0, 1), "phi": (1,), "p": (2,)}[quantity]
    for k in path:
        W = W.sub(k)
    return np.asarray(fem.locate_dofs_topological(W, dim, entities))


def _owners_decide(W: Any, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Overwrite ghost entries with their owners' (floats carry the integers exactly)."""
    carrier = fem.Function(W)
    carrier.x.array[:] = values
    carrier.x.scatter_forward()
    values[:] = np.rint(carrier.x.array).astype(values.dtype)
    return values
