"""From the sections of a config to a device: names looked up, ports and supports in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from dealib.device.device import Device
from dealib.device.kinematics import Kinematics
from dealib.device.laminate import FRAME_BLOCK, MOUNT_BLOCK, Laminate
from dealib.device.ports import Chamber, Hold, Mount, Terminal
from dealib.device.records import (
    AIR,
    CHAMBER,
    MOUNT,
    PHI,
    RIGID,
    TERMINAL,
    TURN,
    Port,
    Region,
    Support,
    air,
)
from dealib.device.shapes import MeshShape, Shape
from dealib.errors import ValueAt, did_you_mean

GROUND = "ground"
Path_ = tuple[str | int, ...]


@dataclass(frozen=True)
class Sections:
    """What a config says of its device; None where it says nothing.

    Attributes:
        terminals: By name.
        mounts: By name.
        holds: In order.
        chambers: By name.
        regions: Materials of regions by name.
    """

    terminals: Mapping[str, Terminal] | None = None
    mounts: Mapping[str, Mount] | None = None
    holds: Sequence[Hold] | None = None
    chambers: Mapping[str, Chamber] | None = None
    regions: Mapping[str, str] | None = None


@dataclass(frozen=True)
class _Parts:
    """What names can mean.

    Attributes:
        kinematics: The space.
        regions: All of them.
        boundaries: Names of boundaries.
        conductors: Names of conducting regions.
        across: Axis across the layers.
    """

    kinematics: Kinematics
    regions: tuple[Region, ...]
    boundaries: tuple[str, ...]
    conductors: tuple[str, ...]
    across: str = "Z"

    def check(self, names: Iterable[str], where: Path_) -> None:
        """Raise `ValueAt` for a name that the device lacks."""
        known = [*(r.name for r in self.regions), *self.boundaries]
        for name in names:
            if name not in known:
                problem = f"the device has no {name!r}{did_you_mean(name, known)}"
                raise ValueAt(where, problem)

    def check_axes(self, axes: Iterable[str], where: Path_) -> None:
        """Raise `ValueAt` for an axis that the space lacks."""
        for axis in axes:
            if axis not in self.kinematics.axes:
                known = ", ".join(self.kinematics.axes)
                raise ValueAt(where, f"there is no axis {axis!r} here; known: {known}")

    def check_rigid(self, mount: Mount, where: Path_) -> None:
        """Raise `ValueAt` if a mount cannot be rigid here."""
        problem = ""
        if self.kinematics.revolved:
            problem = "an axisymmetric device moves along Z only; give `along: Z`, or space: 3d"
        elif self.kinematics.multiple != 1 and self.kinematics.dim == 3:
            problem = "it would turn out of the planes of geometry.symmetry; leave these out"
        elif any(region.air for region in self.regions):
            problem = "only without air around the device"
        if problem:
            raise ValueAt((*where, "rigid"), problem)
        if mount.centre is not None and len(mount.centre) != self.kinematics.dim:
            axes = ", ".join(self.kinematics.axes)
            raise ValueAt((*where, "centre"), f"expected one coordinate for each of {axes}")


def device(
    geometry: Shape,
    conductors: Mapping[str, bool],
    given: Sections,
    names: Mapping[str, int] | None = None,
    sheet: bool = False,
) -> Device:
    """The device that a config describes.

    Args:
        geometry: Its shape.
        conductors: For each material whether it conducts.
        given: Ports, holds and regions of the config.
        names: Physical names of an own mesh and their dimensions.
        sheet: Whether a laminate is solved on its middle surface.

    Raises:
        ValueAt: With the place in the config, if a name means nothing or parts contradict.
    """
    if isinstance(geometry, MeshShape):
        return _of_mesh(geometry, conductors, given, names or {})
    laminate = geometry.laminate(lambda material: conductors.get(material, False))
    if sheet:
        laminate = _as_sheet(laminate)
    for layer in laminate.layers:
        if layer.material not in conductors:
            hint = did_you_mean(layer.material, list(conductors))
            problem = f"there is no {layer.material!r}, of which the layer {layer.name!r} is{hint}"
            raise ValueAt(("materials",), problem)
    if all(layer.conducts for layer in laminate.layers):
        problem = "all layers conduct: at least one needs a material with relative_permittivity"
        raise ValueAt(("geometry",), problem)
    laminate, on = _patches(laminate, given.terminals or {})
    parts = _Parts(
        laminate.kinematics,
        laminate.regions,
        laminate.boundaries,
        tuple(layer.name for layer in laminate.layers if layer.conducts),
        laminate.base.across,
    )
    terminals = _natural_terminals(laminate) if given.terminals is None else on
    end = laminate.base.mount
    mounts = given.mounts
    if mounts is None:
        blocks = [MOUNT_BLOCK] if laminate.blocks is not None else []
        mounts = {} if end is None else {"mount": Mount(on=(*blocks, end), along="Z")}
    holds = given.holds
    if holds is None:
        natural = laminate.held
        frame = [FRAME_BLOCK] if laminate.blocks is not None else []
        holds = [Hold(on=(*frame, name), fix=axes) for name, axes in natural]
    driven, ports = _driven(
        parts, mounts, holds, terminals, given.chambers or {}, natural=given.holds is None
    )
    held = _held_ends(mounts, holds, parts.kinematics)
    return Device(
        parts.kinematics,
        laminate.regions,
        (*laminate.supports(held), *driven),
        ports,
        laminate.boundaries,
        laminate.sizes,
        laminate,
    )


def _as_sheet(laminate: Laminate) -> Laminate:
    """The same on its middle surface."""
    if laminate.air_height > 0 or laminate.blocks is not None:
        what = "air_height" if laminate.air_height > 0 else "clamps"
        raise ValueAt(("geometry", what), "a membrane has none: its field stays between electrodes")
    return replace(laminate, sheet=True)


def _patches(
    laminate: Laminate, terminals: Mapping[str, Terminal]
) -> tuple[Laminate, dict[str, Terminal]]:
    """Terminals on parts of faces get boundaries of their own."""
    patches, found = {}, {}
    for name, terminal in terminals.items():
        if terminal.within is None:
            found[name] = terminal
            continue
        where = ("terminals", name)
        part = terminal.within.part(laminate.base, laminate.solid, (*where, "within"))
        on = []
        for k, face in enumerate(terminal.on):
            if face not in laminate.faces:
                known = list(laminate.faces)
                problem = f"{face!r} is no face, of which a part could be taken"
                raise ValueAt((*where, "on"), problem + did_you_mean(face, known))
            patch = f"{name}.{k + 1}" if len(terminal.on) > 1 else f"{name}.part"
            patches[patch] = (face, part)
            on.append(patch)
        found[name] = terminal.model_copy(update={"on": tuple(on), "within": None})
    return replace(laminate, patches=patches), found


def _natural_terminals(laminate: Laminate) -> dict[str, Terminal]:
    """Every conducting layer, or the faces of the first dielectric one; the lowest is ground."""
    on = [layer.name for layer in laminate.layers if layer.conducts]
    if not on:
        film = laminate.film.name
        on = [laminate.face.format(layer=film, side=side) for side in ("bottom", "top")]
    low, *others = on
    names = ["terminal"] if len(others) == 1 else others
    found = {name: Terminal(on=(part,)) for name, part in zip(names, others, strict=True)}
    return {GROUND: Terminal(on=(low,), ground=True)} | found


def _held_ends(
    mounts: Mapping[str, Mount], holds: Sequence[Hold], kinematics: Kinematics
) -> dict[str, tuple[str, ...]]:
    """Axes that are held on each boundary."""
    found: dict[str, set[str]] = {}
    for mount in mounts.values():
        for name in mount.on:
            free = {mount.along, *mount.free}
            found.setdefault(name, set()).update(a for a in kinematics.axes if a not in free)
    for hold in holds:
        for name in hold.on:
            found.setdefault(name, set()).update(hold.fix)
    return {name: tuple(sorted(axes)) for name, axes in found.items()}


def _driven(
    parts: _Parts,
    mounts: Mapping[str, Mount],
    holds: Sequence[Hold],
    terminals: Mapping[str, Terminal],
    chambers: Mapping[str, Chamber],
    natural: bool = False,
) -> tuple[list[Support], tuple[Port, ...]]:
    """Supports in order, later ones hold where they meet earlier ones; and the ports.

    `natural` tells that the holds are those that the base brings.
    """
    supports: list[Support] = []
    taken: dict[str, Path_] = {}
    ports: list[Port] = []
    axes = parts.kinematics.axes
    moved: dict[tuple[str, str], str] = {}
    for name, mount in mounts.items():
        where = ("mounts", name)
        parts.check(mount.on, (*where, "on"))
        if mount.along is None:
            parts.check_rigid(mount, where)
        else:
            parts.check_axes([mount.along], (*where, "along"))
        parts.check_axes(mount.free, (*where, "free"))
        for part in mount.on:
            other = next((moved[part, a] for a in axes if (part, a) in moved), None)
            if other is not None:
                problem = f"{part!r} is a part of mount {other!r} already"
                raise ValueAt((*where, "on"), problem)
            if mount.along is None:
                moved |= {(part, axis): name for axis in axes}
                supports += [Support(axis, part, name, RIGID) for axis in axes]
                continue
            moved[part, mount.along] = name
            held = [a for a in axes if a != mount.along and a not in mount.free]
            supports += [Support(axis, part) for axis in held]
            supports.append(Support(mount.along, part, name, MOUNT.name))
        if mount.along is None:
            ports += _six(name, mount, parts.kinematics)
        else:
            ports.append(Port(MOUNT, name, mount.on, along=mount.along, mass=mount.mass))
    for k, hold in enumerate(holds):
        parts.check(hold.on, ("holds", k, "on"))
        parts.check_axes(hold.fix, ("holds", k, "fix"))
        for part, axis in ((p, a) for p in hold.on for a in hold.fix if (p, a) in moved):
            mount_name = moved[part, axis]
            if natural:
                problem = f"the base holds {part!r} by itself; say under `holds` what is held"
                raise ValueAt(("mounts", mount_name, "on"), f"{problem} instead")
            problem = f"the mount {mount_name!r} moves {part!r} along {axis}; drop one of both"
            raise ValueAt(("holds", k, "fix"), problem)
        supports += [Support(axis, part) for part in hold.on for axis in hold.fix]
    grounded = False
    for name, terminal in terminals.items():
        where = ("terminals", name)
        parts.check(terminal.on, (*where, "on"))
        grounded |= terminal.ground
        port = "" if terminal.ground else name
        for part in terminal.on:
            if part in taken:
                problem = f"{part!r} is a part of terminal {taken[part][1]!r} already"
                raise ValueAt((*where, "on"), problem)
            taken[part] = where
            supports.append(Support(PHI, part, port, TERMINAL.name))
        if not terminal.ground:
            ports.append(Port(TERMINAL, name, terminal.on))
    if not grounded:
        raise ValueAt(("terminals",), "no terminal is ground; give one of them `ground: true`")
    for name in parts.conductors:
        if name not in taken:
            supports.append(Support(PHI, name, name, TERMINAL.name))
            ports.append(Port(TERMINAL, name, (name,), floating=True))
    walls: dict[str, str] = {}
    opened: dict[str, str] = {}
    for name, chamber in chambers.items():
        parts.check(chamber.on, ("chambers", name, "on"))
        for part in chamber.on:
            if part not in parts.boundaries:
                problem = f"{part!r} is no boundary; known: {', '.join(parts.boundaries)}"
                raise ValueAt(("chambers", name, "on"), problem)
            if part in walls:
                problem = f"{part!r} is a face of chamber {walls[part]!r} already"
                raise ValueAt(("chambers", name, "on"), problem)
            walls[part] = name
        along = chamber.along or parts.across
        parts.check_axes([along], ("chambers", name, "along"))
        openings = tuple((chamber.openings or {}).items())
        for opening, _ in openings:
            if (other := opened.setdefault(opening, name)) != name:
                problem = f"chamber {other!r} has an opening of this name already"
                raise ValueAt(("chambers", name, "openings", opening), problem)
        ports.append(Port(CHAMBER, name, chamber.on, along=along, openings=openings))
    return supports, tuple(_numbered(ports))


def _six(name: str, mount: Mount, kinematics: Kinematics) -> Iterator[Port]:
    """The ports of a rigid mount; in a plane it turns about the axis across it."""
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


# --- own meshes ----------------------------------------------------------------------------------


def _of_mesh(
    shape: MeshShape,
    conductors: Mapping[str, bool],
    given: Sections,
    names: Mapping[str, int],
) -> Device:
    """A device whose parts are a mesh's physical names."""
    kinematics, top = shape.kinematics, shape.kinematics.dim
    regions, materials = [], dict(given.regions or {})
    for region, material in materials.items():
        if names.get(region) != top:
            known = [n for n, d in names.items() if d == top]
            problem = f"the mesh has no region {region!r}{did_you_mean(region, known)}"
            raise ValueAt(("regions", region), problem)
        if material not in conductors and material != AIR:
            problem = f"`materials` has no {material!r}{did_you_mean(material, list(conductors))}"
            raise ValueAt(("regions", region), problem)
    for name, dim in names.items():
        if dim != top:
            continue
        material = materials.get(name, name)
        if material == AIR:
            regions.append(air(name))
        elif material in conductors:
            regions.append(Region(name, material))
        else:
            problem = (
                f"the mesh has a region {name!r}, which `materials` lacks; name its material under "
                f"`regions`, such as regions: {{{name}: {next(iter(conductors), 'film')}}}"
            )
            raise ValueAt(("geometry", "file"), problem)
    if all(r.material is None or conductors[r.material] for r in regions):
        problem = "none of its regions is of a material with relative_permittivity"
        raise ValueAt(("geometry", "file"), problem)
    for part in ("terminals", "holds"):
        if getattr(given, part) is None:
            raise ValueAt(
                (part,), "this key is missing: a mesh does not say what is held and driven"
            )
    parts = _Parts(
        kinematics,
        tuple(regions),
        tuple(n for n, d in names.items() if d == top - 1),
        tuple(r.name for r in regions if r.material and conductors[r.material]),
    )
    for name, terminal in (given.terminals or {}).items():
        if terminal.within is not None:
            problem = "only faces of a laminate have parts; name the part in the mesh"
            raise ValueAt(("terminals", name, "within"), problem)
    driven, ports = _driven(
        parts, given.mounts or {}, given.holds or (), given.terminals or {}, given.chambers or {}
    )
    return Device(kinematics, parts.regions, tuple(driven), ports, boundaries=parts.boundaries)
