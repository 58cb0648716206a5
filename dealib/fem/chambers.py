"""The displaced volume of a chamber, whose dual is the pressure on its faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

from dealib.device.kinematics import Kinematics
from dealib.device.records import Port
from dealib.errors import ValueAt
from dealib.fem.domain import Domain
from dealib.fem.energies import Point


@dataclass(frozen=True)
class ChamberPressure:
    """The potential of the pressure P on one face: -P times the displaced volume.

    The volume is the flux through the face of a vector field of divergence 1 along an axis, z e_Z
    or (r/2) e_R. Walls parallel to that axis, which close the chamber at the rim of the face, do
    not contribute: the pressure on them does no work where the rim moves along the axis.

    Attributes:
        on: The boundary.
        pressure: The pressure, MPa, a UFL variable.
        axis: Number of the axis.
        kinematics: The space.
    """

    on: str
    pressure: Any
    axis: int
    kinematics: Kinematics

    def density(self, point: Point) -> Any:
        """See `Energy`; the normal points out of the solid, into the chamber."""
        share = 2 if self.kinematics.revolved and self.axis == 0 else 1
        x = point.x[self.axis] + point.u[self.axis]
        flux = x * point.area[self.axis] - point.x[self.axis] * point.N[self.axis]
        return self.pressure * flux / share


def chamber_energies(domain: Domain, port: Port, pressure: Any) -> list[ChamberPressure]:
    """The potentials of a chamber's faces (collective).

    Raises:
        ValueAt: If solids are on both sides of a face.
    """
    kinematics = domain.device.kinematics
    for name in port.on:
        if _between_solids(domain, name):
            raise ValueAt(
                ("chambers", port.name, "on"),
                f"the face {name!r} lies between two solids, so that no chamber can be there; "
                "choose a face of the outer surface",
            )
    axis = kinematics.axes.index(port.along)
    return [ChamberPressure(name, pressure, axis, kinematics) for name in port.on]


def sides(domain: Domain, name: str) -> int:
    """Largest number of cells at a boundary's facets (collective)."""
    dim, facets = domain.entities(name)
    cells = domain.mesh.topology.connectivity(dim, domain.dim)
    found = max((len(cells.links(f)) for f in facets), default=0)
    return int(domain.comm.allreduce(found, op=MPI.MAX))


def _between_solids(domain: Domain, name: str) -> bool:
    if domain.device.kinematics.sheet:
        return False
    dim, facets = domain.entities(name)
    cells, air = domain.mesh.topology.connectivity(dim, domain.dim), set(domain.air.tolist())
    found = any(len(c) > 1 and not air.intersection(c) for c in map(cells.links, facets))
    return bool(domain.comm.allreduce(int(found), op=MPI.MAX))
