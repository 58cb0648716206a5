"""Regions that share their energies, and the layers of sheets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.driven import check_apart
from dealib.device.laminate import JOIN, Laminate, Layer
from dealib.device.records import PHI, Region
from dealib.errors import ValueAt
from dealib.fem.domain import Domain
from dealib.fem.energies import constant


@dataclass
class Group:
    """Regions of one material and direction, which share their energies.

    In a sheet a group is one layer on one part of the base.

    Attributes:
        name: Name, made of material and direction, or of layer and part.
        material: Key of `materials`; empty for air and rigid blocks.
        regions: Names of the regions.
        normal: Component across the layer.
        prestretch: Stretches along the components, as a constant; None without pre-stretch.
        sheet: Data of a layer of a sheet; None for a solid.
        slot: Number of the layer, its place in functions that hold values of all layers.
    """

    name: str
    material: str
    regions: tuple[str, ...]
    normal: int
    prestretch: Any = None
    sheet: Sheet | None = None
    slot: int = 0


@dataclass
class Sheet:
    """A layer on a part of the base of a sheet.

    Attributes:
        area: Name of the part in the mesh.
        thickness: Thickness as mounted, mm.
        between: Terminals below and above; '' for ground; None where there is no electrode.
        stretch: Thickness stretch since mounting, a function at the quadrature points.
        excess: Excess metric of wrinkles, a function at the quadrature points.
        field: Nominal field across, a constant, kV/mm.
        variables: UFL variables on which the energy depends: the metric's components, the field if
            there can be one, and the thickness stretch.
        point: A point of the layer as a function of `variables`.
    """

    area: str
    thickness: float
    between: tuple[str | None, str | None]
    stretch: Any = None
    excess: Any = None
    field: Any = None
    variables: tuple[Any, ...] = ()
    point: Any = None

    @property
    def driven(self) -> bool:
        """Whether there can be a voltage across it."""
        return None not in self.between and self.between != ("", "")


def solid_groups(config: Config, domain: Domain) -> tuple[Group, ...]:
    """Regions by material and direction, in the order of the device; dielectrics first."""
    found: dict[str, list[Region]] = {}
    for region in domain.device.regions:
        if not domain.has(region.name):
            continue
        if region.material is None:
            name = "air" if region.air else f"rigid {region.permittivity:g}"
        else:
            name = region.material
            others = found.get(name, [])
            if others and others[0].normal != region.normal:
                name = f"{name} across {region.normal}"
        found.setdefault(name, []).append(region)
    groups = []
    for name, regions in found.items():
        normal = regions[0].normal
        if normal is None:  # in a mesh file, films lie across Z for the pre-stretch
            normal = domain.device.kinematics.components.index("Z")
        stretched = None
        if (key := regions[0].material) is not None:
            material = config.materials[key]
            if not config.conducts(key) or material.prestretch != (1.0, 1.0):
                stretched = constant(domain.mesh, [1.0, 1.0, 1.0])
        key = key or ""
        groups.append(Group(name, key, tuple(r.name for r in regions), normal, stretched))

    def rank(group: Group) -> int:
        return int(config.conducts(group.material)) if group.material else 2

    return tuple(sorted(groups, key=rank))


def sheet_groups(domain: Domain) -> tuple[Group, ...]:
    """A group for each layer on each part of the base."""
    laminate, found = domain.device.laminate, []
    assert laminate is not None
    shared: dict[str, Any] = {}
    for k, area in enumerate(areas(domain)):
        names = area.split(JOIN)
        for layer in laminate.layers:
            if layer.name not in names:
                continue
            between = _between(domain.device, laminate, layer, names)
            if layer.conducts:
                between = (None, None)
            if layer.material not in shared:
                shared[layer.material] = constant(domain.mesh, [1.0, 1.0, 1.0])
            found.append(
                Group(
                    f"{layer.name} {k}",
                    layer.material,
                    (layer.name,),
                    laminate.normal,
                    shared[layer.material],
                    Sheet(area, layer.thickness, between),
                    laminate.layers.index(layer),
                )
            )
    return tuple(found)


def areas(domain: Domain) -> list[str]:
    """Names in the mesh of the parts of the base."""
    return [name for name, (dim, _) in domain.groups.items() if dim == domain.dim]


def _between(
    device: Device, laminate: Laminate, layer: Layer, names: list[str]
) -> tuple[str | None, str | None]:
    """Terminals below and above a layer, on the part of the base that has these names."""
    port_of = {s.where: s.port for s in device.supports if s.quantity == PHI}
    here = [x for x in laminate.layers if x.name in names]
    k = here.index(layer)
    found: list[str | None] = []
    for side, beside in (("bottom", k - 1), ("top", k + 1)):
        neighbour = here[beside] if 0 <= beside < len(here) else None
        face = laminate.face.format(layer=layer.name, side=side)
        on = [face, *(p for p, (of, _) in laminate.patches.items() if of == face and p in names)]
        if neighbour is not None:
            other = laminate.face.format(
                layer=neighbour.name, side="top" if side == "bottom" else "bottom"
            )
            on += [other, *([neighbour.name] if neighbour.conducts else [])]
            on += [p for p, (of, _) in laminate.patches.items() if of == other and p in names]
        ports = [port_of[name] for name in on if name in port_of]
        for port in ports[1:]:
            check_apart(port, ports[0])
        found.append(ports[0] if ports else None)
    if None in found and found != [None, None] and _floats(here, k, found):
        raise ValueAt(
            ("physics", "model"),
            f"a membrane needs an electrode on both sides of the layer {layer.name!r}; give its "
            "inner face a terminal, or solve it as a solid",
        )
    return found[0], found[1]


def _floats(here: list[Layer], k: int, found: list[str | None]) -> bool:
    """Whether the side without an electrode touches another dielectric."""
    beside = k - 1 if found[0] is None else k + 1
    return 0 <= beside < len(here) and not here[beside].conducts
