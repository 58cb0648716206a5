"""Makes a device from the sections of a config: looks up names, orders ports and supports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dealib.device.device import Device
from dealib.device.driven import Driven, Parts, check_apart
from dealib.device.kinematics import Kinematics
from dealib.device.laminate import FRAME_BLOCK, MOUNT_BLOCK, Laminate
from dealib.device.part import Part
from dealib.device.ports import Chamber, Hold, Mount, Terminal
from dealib.device.records import (
    AIR,
    Region,
    air,
)
from dealib.device.shapes import MeshShape, Shape
from dealib.errors import ValueAt, did_you_mean

GROUND = "ground"


@dataclass(frozen=True)
class Sections:
    """The sections of a config that describe its device; None for a section that is absent.

    Attributes:
        terminals: Electrodes by name.
        mounts: Moving parts by name.
        holds: Fixed parts, in order.
        chambers: Pressurised chambers by name.
        regions: Material of each region of a mesh file, by the region's name.
    """

    terminals: Mapping[str, Terminal] | None = None
    mounts: Mapping[str, Mount] | None = None
    holds: Sequence[Hold] | None = None
    chambers: Mapping[str, Chamber] | None = None
    regions: Mapping[str, str] | None = None


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
        ValueAt: With the place in the config, if a name is unknown or sections contradict each
            other.
    """
    if isinstance(geometry, MeshShape):
        return _of_mesh(geometry, conductors, given, names or {})
    laminate = geometry.laminate(lambda material: conductors.get(material, False))
    if sheet:
        laminate = _as_sheet(laminate)
    for layer in laminate.layers:
        if layer.material not in conductors:
            hint = did_you_mean(layer.material, list(conductors))
            problem = f"there is no {layer.material!r}, the material of layer {layer.name!r}{hint}"
            raise ValueAt(("materials",), problem)
    if all(layer.conducts for layer in laminate.layers):
        problem = "all layers conduct: at least one needs a material with relative_permittivity"
        raise ValueAt(("geometry",), problem)
    laminate, on = _patches(laminate, given.terminals or {})
    parts = Parts(
        laminate.kinematics,
        laminate.regions,
        laminate.boundaries,
        tuple(layer.name for layer in laminate.layers if layer.conducts),
        laminate.base.across,
    )
    terminals = _default_terminals(laminate) if given.terminals is None else on
    end = laminate.base.mount
    mounts = given.mounts
    if mounts is None:
        blocks = [MOUNT_BLOCK] if laminate.blocks is not None else []
        mounts = {} if end is None else {"mount": Mount(on=(*blocks, end), along="Z")}
    holds = given.holds
    if holds is None:
        frame = [FRAME_BLOCK] if laminate.blocks is not None else []
        holds = [Hold(on=(*frame, name), fix=axes) for name, axes in laminate.held]
    driven = Driven(parts)
    driven.mounts(mounts)
    driven.holds(holds, default=given.holds is None)
    driven.terminals(terminals)
    driven.chambers(given.chambers or {})
    held = _held_ends(mounts, holds, parts.kinematics)
    return Device(
        parts.kinematics,
        laminate.regions,
        (*laminate.supports(held), *driven.supports),
        driven.ports,
        laminate.boundaries,
        laminate.sizes,
        laminate,
    )


def _as_sheet(laminate: Laminate) -> Laminate:
    """The laminate as a membrane, which is solved on its middle surface."""
    if laminate.air_height > 0 or laminate.blocks is not None:
        what = "air_height" if laminate.air_height > 0 else "clamps"
        problem = "a membrane has no field outside its electrodes; leave this key out"
        raise ValueAt(("geometry", what), problem)
    return replace(laminate, sheet=True)


def _patches(
    laminate: Laminate, terminals: Mapping[str, Terminal]
) -> tuple[Laminate, dict[str, Terminal]]:
    """Give terminals on parts of faces boundaries of their own, the patches."""
    patches, found = {}, {}
    placed: list[tuple[str, str, Part]] = []
    for name, terminal in terminals.items():
        part = Part()
        where = ("terminals", name)
        if terminal.within is not None:
            part = terminal.within.part(laminate.base, laminate.solid, (*where, "within"))
        for face in terminal.on:
            for other, there, its in placed:
                apart = there != face or other == name or part == its == Part()
                if not apart and part.touches(its):
                    check_apart(*("" if terminals[k].ground else k for k in (name, other)))
            placed.append((name, face, part))
        if terminal.within is None:
            found[name] = terminal
            continue
        on = []
        for k, face in enumerate(terminal.on):
            if face not in laminate.faces:
                known = list(laminate.faces)
                problem = f"`within` needs faces of layers, and {face!r} is none"
                raise ValueAt((*where, "on"), problem + did_you_mean(face, known))
            patch = f"{name}.{k + 1}" if len(terminal.on) > 1 else f"{name}.part"
            patches[patch] = (face, part)
            on.append(patch)
        found[name] = terminal.model_copy(update={"on": tuple(on), "within": None})
    return replace(laminate, patches=patches), found


def _default_terminals(laminate: Laminate) -> dict[str, Terminal]:
    """Every conducting layer, or both faces of the first dielectric one; the lowest is ground."""
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
    """Axes along which mounts and holds fix each boundary."""
    found: dict[str, set[str]] = {}
    for mount in mounts.values():
        for name in mount.on:
            free = {mount.along, *mount.free}
            found.setdefault(name, set()).update(a for a in kinematics.axes if a not in free)
    for hold in holds:
        for name in hold.on:
            found.setdefault(name, set()).update(hold.fix)
    return {name: tuple(sorted(axes)) for name, axes in found.items()}


# --- own meshes ----------------------------------------------------------------------------------


def _of_mesh(
    shape: MeshShape,
    conductors: Mapping[str, bool],
    given: Sections,
    names: Mapping[str, int],
) -> Device:
    """A device whose regions and boundaries are the physical groups of a mesh file."""
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
    parts = Parts(
        kinematics,
        tuple(regions),
        tuple(n for n, d in names.items() if d == top - 1),
        tuple(r.name for r in regions if r.material and conductors[r.material]),
    )
    for name, terminal in (given.terminals or {}).items():
        if terminal.within is not None:
            problem = "only for faces of a laminate; give this part a physical name in the mesh"
            raise ValueAt(("terminals", name, "within"), problem)
    driven = Driven(parts)
    driven.mounts(given.mounts or {})
    driven.holds(given.holds or (), default=False)
    driven.terminals(given.terminals or {})
    driven.chambers(given.chambers or {})
    return Device(
        *(kinematics, parts.regions, tuple(driven.supports), driven.ports, parts.boundaries)
    )
