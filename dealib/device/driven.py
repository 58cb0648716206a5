"""Supports and ports of a device, from the sections mounts, holds, terminals and chambers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from dealib.device.kinematics import Kinematics
from dealib.device.ports import Chamber, Hold, Mount, Terminal
from dealib.device.records import (
    CHAMBER,
    MOUNT,
    PHI,
    RIGID,
    TERMINAL,
    TURN,
    Port,
    Region,
    Support,
)
from dealib.errors import Place, ValueAt, did_you_mean


@dataclass(frozen=True)
class Parts:
    """The parts of a device that sections may name.

    Attributes:
        kinematics: The space.
        regions: All regions.
        boundaries: Names of boundaries.
        conductors: Names of conducting regions.
        across: Axis across the layers.
    """

    kinematics: Kinematics
    regions: tuple[Region, ...]
    boundaries: tuple[str, ...]
    conductors: tuple[str, ...]
    across: str = "Z"

    def check(self, names: Iterable[str], where: Place) -> None:
        """Raise `ValueAt` for a name that the device lacks."""
        known = [*(r.name for r in self.regions), *self.boundaries]
        for name in names:
            if name not in known:
                problem = f"the device has no {name!r}{did_you_mean(name, known)}"
                raise ValueAt(where, problem)

    def check_axes(self, axes: Iterable[str], where: Place) -> None:
        """Raise `ValueAt` for an axis that the space lacks."""
        for axis in axes:
            if axis not in self.kinematics.axes:
                known = ", ".join(self.kinematics.axes)
                raise ValueAt(where, f"there is no axis {axis!r} here; known: {known}")

    def check_rigid(self, mount: Mount, where: Place) -> None:
        """Raise `ValueAt` if a mount cannot be rigid here."""
        problem = ""
        if self.kinematics.revolved:
            problem = "an axisymmetric device moves along Z only; give `along: Z`, or space: 3d"
        elif self.kinematics.multiple != 1 and self.kinematics.dim == 3:
            problem = "it would turn out of the planes of symmetry; leave geometry.symmetry out"
        elif any(region.air for region in self.regions):
            problem = "a rigid mount needs a device without air around it; set its air_height to 0"
        if problem:
            raise ValueAt((*where, "rigid"), problem)
        if mount.centre is not None and len(mount.centre) != self.kinematics.dim:
            axes = ", ".join(self.kinematics.axes)
            raise ValueAt((*where, "centre"), f"expected one coordinate for each of {axes}")


class Driven:
    """Collects supports and ports while the sections are read one after the other.

    Attributes:
        supports: In order; where two meet, the later one applies.

    Args:
        parts: The parts that sections may name.
    """

    def __init__(self, parts: Parts) -> None:
        self._parts, self.supports = parts, list[Support]()
        self._ports, self._moved = list[Port](), dict[tuple[str, str], str]()

    @property
    def ports(self) -> tuple[Port, ...]:
        """The ports, with the suffixes of their columns.

        Raises:
            ValueAt: If two have the same name.
        """
        return tuple(_numbered(self._ports))

    def mounts(self, mounts: Mapping[str, Mount]) -> None:
        """Read the mounts.

        Raises:
            ValueAt: If a name or an axis is unknown, or two mounts move one part.
        """
        for name, mount in mounts.items():
            where = ("mounts", name)
            self._parts.check(mount.on, (*where, "on"))
            if mount.along is None:
                self._parts.check_rigid(mount, where)
            else:
                self._parts.check_axes([mount.along], (*where, "along"))
            self._parts.check_axes(mount.free, (*where, "free"))
            for part in mount.on:
                self._move(name, mount, part)
            if mount.along is None:
                self._ports += _rigid_ports(name, mount, self._parts.kinematics)
            else:
                self._ports.append(Port(MOUNT, name, mount.on, along=mount.along, mass=mount.mass))

    def _move(self, name: str, mount: Mount, part: str) -> None:
        axes, moved = self._parts.kinematics.axes, self._moved
        other = next((moved[part, a] for a in axes if (part, a) in moved), None)
        if other is not None:
            problem = f"{part!r} is a part of mount {other!r} already"
            raise ValueAt(("mounts", name, "on"), problem)
        if mount.along is None:
            moved |= {(part, axis): name for axis in axes}
            self.supports += [Support(axis, part, name, RIGID) for axis in axes]
            return
        moved[part, mount.along] = name
        held = [a for a in axes if a != mount.along and a not in mount.free]
        self.supports += [Support(axis, part) for axis in held]
        self.supports.append(Support(mount.along, part, name, MOUNT.name))

    def holds(self, holds: Sequence[Hold], default: bool) -> None:
        """Read the holds.

        Args:
            holds: In order.
            default: Whether they are the base's default, as the config gives none.

        Raises:
            ValueAt: If a name or an axis is unknown, or a mount moves a held part.
        """
        for k, hold in enumerate(holds):
            self._parts.check(hold.on, ("holds", k, "on"))
            self._parts.check_axes(hold.fix, ("holds", k, "fix"))
            pairs = [(part, axis) for part in hold.on for axis in hold.fix]
            for part, axis in (pair for pair in pairs if pair in self._moved):
                mount = self._moved[part, axis]
                if default:
                    problem = f"the base holds {part!r} by default; give `holds` with other parts"
                    raise ValueAt(("mounts", mount, "on"), problem)
                problem = f"the mount {mount!r} moves {part!r} along {axis}; remove one of the two"
                raise ValueAt(("holds", k, "fix"), problem)
            self.supports += [Support(axis, part) for part, axis in pairs]

    def terminals(self, terminals: Mapping[str, Terminal]) -> None:
        """Read the terminals; conductors that belong to no terminal float.

        Raises:
            ValueAt: If a name is unknown, two terminals share a part, or none is ground.
        """
        taken: dict[str, str] = {}
        for name, terminal in terminals.items():
            where = ("terminals", name, "on")
            self._parts.check(terminal.on, where)
            for part in terminal.on:
                if part in taken:
                    raise ValueAt(where, f"{part!r} is a part of terminal {taken[part]!r} already")
                taken[part] = name
                port = "" if terminal.ground else name
                self.supports.append(Support(PHI, part, port, TERMINAL.name))
            if not terminal.ground:
                self._ports.append(Port(TERMINAL, name, terminal.on))
        if not any(terminal.ground for terminal in terminals.values()):
            raise ValueAt(("terminals",), "no terminal is ground; give one of them `ground: true`")
        for name in self._parts.conductors:
            if name not in taken:
                self.supports.append(Support(PHI, name, name, TERMINAL.name))
                self._ports.append(Port(TERMINAL, name, (name,), floating=True))

    def chambers(self, chambers: Mapping[str, Chamber]) -> None:
        """Read the chambers.

        Raises:
            ValueAt: If a name or an axis is unknown, or two chambers share a wall or the name of
                an opening.
        """
        walls: dict[str, str] = {}
        opened: dict[str, str] = {}
        for name, chamber in chambers.items():
            self._parts.check(chamber.on, ("chambers", name, "on"))
            for part in chamber.on:
                if part not in self._parts.boundaries:
                    known = ", ".join(self._parts.boundaries)
                    problem = f"{part!r} is no boundary; known: {known}"
                    raise ValueAt(("chambers", name, "on"), problem)
                if part in walls:
                    problem = f"{part!r} is a face of chamber {walls[part]!r} already"
                    raise ValueAt(("chambers", name, "on"), problem)
                walls[part] = name
            along = chamber.along or self._parts.across
            self._parts.check_axes([along], ("chambers", name, "along"))
            openings = tuple((chamber.openings or {}).items())
            for opening, _ in openings:
                if (other := opened.setdefault(opening, name)) != name:
                    problem = f"chamber {other!r} has an opening of this name; choose another name"
                    raise ValueAt(("chambers", name, "openings", opening), problem)
            self._ports.append(Port(CHAMBER, name, chamber.on, along=along, openings=openings))


def _rigid_ports(name: str, mount: Mount, kinematics: Kinematics) -> Iterator[Port]:
    """Ports of a rigid mount: six in three dimensions; in a plane three, with one turn about Y."""
    turns = kinematics.axes if kinematics.dim == 3 else ("Y",)
    named = [(MOUNT, f"{name}.{axis}", axis) for axis in kinematics.axes]
    named += [(TURN, f"{name}.about_{axis}", axis) for axis in turns]
    for kind, port, axis in named:
        mass = mount.mass if kind == MOUNT else 0.0
        centre = mount.centre or ()
        yield Port(kind, port, mount.on, along=axis, mass=mass, rigid=name, centre=centre)


def _numbered(ports: list[Port]) -> Iterator[Port]:
    """Ports with the suffixes of their columns."""
    for k, port in enumerate(ports):
        twin = next((p for p in ports[:k] if p.name == port.name), None)
        if twin is not None:
            problem = f"there is a {twin.kind.name} {port.name!r} too; give them different names"
            raise ValueAt((f"{port.kind.name}s", port.name), problem)
        several = sum(p.kind == port.kind for p in ports) > 1
        yield replace(port, suffix=f".{port.name}" if several else "")


def check_apart(port: str, other: str) -> None:
    """Raise `ValueAt` for two terminals that share a point, unless both are the same port.

    Args:
        port: Name of a port; empty for ground.
        other: Likewise.
    """
    if port == other:
        return
    name, beside = (port, other or "ground") if port else (other, "ground")
    problem = f"it touches {beside!r}; leave a gap between them, or make them one"
    raise ValueAt((f"{TERMINAL.name}s", name), problem)
