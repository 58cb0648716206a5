"""The records of a device: regions, supports, and the ports through which it is driven."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

PHI = "phi"  # the potential, beside the axes' names of displacements
AIR = "air"
_PERMITTIVITY_OF_AIR = 1.0


@dataclass(frozen=True)
class PortQuantity:
    """A quantity at a port.

    Attributes:
        name: Such as 'displacement'.
        unit: Of its column in the history.
        dimension: Key of `dealib.units.DIMENSIONS`.
        factor: From the internal unit to that of the column.
    """

    name: str
    unit: str
    dimension: str
    factor: float = 1.0

    @property
    def column(self) -> str:
        """Stem of its column, such as 'displacement_mm'."""
        return f"{self.name}_{self.unit}"


@dataclass(frozen=True)
class PortKind:
    """One way to drive a device: a value and its work-conjugate dual.

    Attributes:
        name: In the config and in messages.
        primal: The value that the port's unknowns share.
        dual: Its dual, `sign` times the derivative of the potential by the primal.
        sign: 1 if work is dual d(primal), -1 if it is primal d(dual).
    """

    name: str
    primal: PortQuantity
    dual: PortQuantity
    sign: float

    @property
    def variables(self) -> tuple[PortQuantity, PortQuantity]:
        """Primal and dual."""
        return self.primal, self.dual


MOUNT = PortKind(
    "mount", PortQuantity("displacement", "mm", "length"), PortQuantity("force", "N", "force"), 1.0
)
TERMINAL = PortKind(
    "terminal",
    PortQuantity("voltage", "kV", "voltage"),
    PortQuantity("charge", "uC", "charge"),
    -1.0,
)
CHAMBER = PortKind(
    "chamber",
    PortQuantity("pressure", "kPa", "stress", 1e3),
    PortQuantity("volume", "mm3", "volume"),
    -1.0,
)
TURN = PortKind(
    "turn",
    PortQuantity("rotation", "deg", "angle", 180 / math.pi),
    PortQuantity("moment", "Nmm", "moment"),
    1.0,
)
RIGID = "rigid"  # kind of a support that follows a rigid mount
KINDS = {kind.name: kind for kind in (MOUNT, TERMINAL, CHAMBER, TURN)}
KIND_OF = {variable.name: kind for kind in KINDS.values() for variable in kind.variables}


@dataclass(frozen=True)
class Port:
    """One port of a device.

    Attributes:
        kind: Its kind.
        name: Its name.
        on: Regions and boundaries that belong to it.
        suffix: Suffix of its columns: '.NAME' where a device has several ports of its kind.
        along: Axis of a mount's motion, of a turn, or of a chamber's walls.
        mass: Mass of a mount, kg.
        floating: Whether it is a conductor without charge that is connected to nothing.
        rigid: Name of the rigid mount that it belongs to; empty if it belongs to none.
        centre: Centre of the rigid mount, mm; empty: the middle of the box around it.
        openings: Openings of a chamber with their names (see `device.ports.Opening`).
    """

    kind: PortKind
    name: str
    on: tuple[str, ...]
    suffix: str = ""
    along: str = ""
    mass: float = 0.0
    floating: bool = False
    rigid: str = ""
    centre: tuple[float, ...] = ()
    openings: tuple[tuple[str, Any], ...] = ()

    def column(self, variable: PortQuantity) -> str:
        """Column of one of its variables in the history."""
        return variable.column + self.suffix

    def named(self, text: str) -> str:
        """A column of this port's own, such as 'mount_work_mJ'."""
        return text + self.suffix


@dataclass(frozen=True)
class Region:
    """A named part of the mesh.

    Attributes:
        name: As in the mesh.
        material: Key of `materials`; None for air and rigid blocks.
        permittivity: Relative one of air and rigid blocks.
        normal: Component across the layer (see `Kinematics.components`); None if it is no layer.
        air: Whether it is air, which only carries the field.
    """

    name: str
    material: str | None
    permittivity: float | None = None
    normal: int | None = None
    air: bool = False


def air(name: str = AIR) -> Region:
    """A region of air."""
    return Region(name, None, _PERMITTIVITY_OF_AIR, air=True)


@dataclass(frozen=True)
class Support:
    """Prescribes all degrees of freedom of one quantity on a named region or boundary.

    Attributes:
        quantity: Axis of a displacement, such as 'Z', or `PHI`.
        where: Name of the region or boundary.
        port: Name of the port whose value they take, or of a rigid mount; empty: they are zero.
        kind: Name of the port's kind, or `RIGID`.
    """

    quantity: str
    where: str
    port: str = ""
    kind: str = ""


def not_held(motion: str) -> str:
    """What is wrong where nothing holds the device against a motion, such as 'along X'."""
    return (
        f"nothing holds the device against motion {motion}; fix a part of it here, or drive a "
        "mount by its displacement or a spring"
    )


@dataclass(frozen=True)
class Sizes:
    """Characteristic sizes, with which residuals and path lengths are compared.

    Attributes:
        thickness: Thickness of the film, mm.
        span: Length along which it is stretched, mm.
        width: Width of the cross-section that carries the force, mm.
        area: Area of the electrodes, mm^2.
        around: Length of the outer edge, along which the air ends, mm.
        height: Height of the air, mm; 0 without air.
    """

    thickness: float
    span: float
    width: float
    area: float
    around: float
    height: float = 0.0

    @property
    def volume(self) -> float:
        """Volume of the film, mm^3."""
        return self.area * self.thickness
