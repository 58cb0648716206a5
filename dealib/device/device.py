"""The whole device: its space, regions, supports and ports."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from dealib.device.kinematics import Kinematics
from dealib.device.laminate import Laminate
from dealib.device.records import PHI, TERMINAL, Port, PortKind, Region, Sizes, Support


@dataclass(frozen=True)
class Device:
    """Regions, supports and ports of a device, and the laminate of which its mesh is made.

    Attributes:
        kinematics: Its space.
        regions: In a fixed order.
        supports: In order; where two meet, the later one applies.
        ports: In order.
        boundaries: Names of boundaries that the user may refer to.
        sizes: Characteristic sizes; None: those of its mesh.
        laminate: Layers on a base; None if the mesh comes from a file.
    """

    kinematics: Kinematics
    regions: tuple[Region, ...]
    supports: tuple[Support, ...]
    ports: tuple[Port, ...]
    boundaries: tuple[str, ...] = ()
    sizes: Sizes | None = None
    laminate: Laminate | None = None

    def region(self, name: str) -> Region:
        """A region by name."""
        return next(r for r in self.regions if r.name == name)

    def of(self, kind: PortKind) -> tuple[Port, ...]:
        """Its ports of one kind."""
        return tuple(port for port in self.ports if port.kind == kind)

    def lacks(self, kind: PortKind) -> str:
        """What to say if nothing of a kind can be driven."""
        grounded = any(s.quantity == PHI and not s.port for s in self.supports)
        if kind == TERMINAL and grounded:
            return (
                "all terminals are ground, at 0 V; to drive one, take `ground: true` away from it, "
                "or add a terminal on the other side of the film"
            )
        return f"the device has no {kind.name}"

    @cached_property
    def by_name(self) -> dict[str, Port]:
        """Its ports by name."""
        return {port.name: port for port in self.ports}

    @cached_property
    def variables(self) -> dict[str, Port]:
        """Port of each variable, such as 'voltage', or 'voltage.NAME' where there are several."""
        return {
            variable.name + port.suffix: port
            for port in self.ports
            for variable in port.kind.variables
        }

    def column(self, name: str) -> str:
        """Column in the history of a variable such as 'voltage.NAME'."""
        port = self.variables[name]
        stem = name.partition(".")[0]
        return next(port.column(v) for v in port.kind.variables if v.name == stem)

    @property
    def solids(self) -> tuple[Region, ...]:
        """Regions with a material."""
        return tuple(r for r in self.regions if r.material is not None)

    @property
    def ladder(self) -> bool:
        """Whether electrodes of one terminal conduct along a line, like a ladder of resistors."""
        plane = self.kinematics.dim == 2 and not self.kinematics.sheet
        return self.laminate is not None and plane and len(self.of(TERMINAL)) == 1
