"""Shapes of devices in the config: each one gives a laminate, or names a mesh file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, Union

from pydantic import BeforeValidator, Field, field_validator, model_validator

from dealib.device.bases import Annulus, AnyBase, Rectangle, check_radii, check_thickness
from dealib.device.kinematics import SPACES, Kinematics
from dealib.device.laminate import Blocks, Laminate, Layer
from dealib.device.layers import AnyLayer, LayerSection, Repeat
from dealib.device.part import Part
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Length, factor

Conducts = Callable[[str], bool]  # whether a material is a conductor


class Clamps(Section):
    """Rigid dielectric blocks around both ends of the strips; the inner one is the mount."""

    width: Length = Field(gt=0, description="radial width of each block")
    height: Length = Field(gt=0, description="height above and below the middle plane")
    relative_permittivity: float = Field(
        3.0, ge=1, description="relative permittivity of the blocks"
    )


class AnnularStrips(Section):
    """Axisymmetric electrode - elastomer - electrode strip, as mounted, in air."""

    shape: Literal["annular_strips"] = "annular_strips"
    inner_radius: Length = Field(gt=0, description="radius of the rigid centre mount")
    outer_radius: Length = Field(gt=0, description="inner radius of the rigid frame")
    film_thickness: Length = Field(gt=0, description="thickness as mounted, that is pre-stretched")
    electrode_thickness: Length = Field(
        ge=0, description="0 um: no electrode bodies, the film's faces are the electrodes"
    )
    air_height: Length = Field(
        0.0, ge=0, description="air above and below, from the middle plane; 0 mm: no air"
    )
    clamps: Clamps | None = Field(None, description="rigid blocks: the mount and the frame")

    def laminate(self, conducts: Conducts) -> Laminate:
        """The laminate that it describes."""
        base = Annulus.model_construct(
            kind="annulus", inner_radius=self.inner_radius, outer_radius=self.outer_radius
        )
        film = Layer("film", "film", self.film_thickness, False)
        layers = [film]
        if self.electrode_thickness > 0:
            names = "bottom_electrode", "top_electrode"
            low, high = (Layer(n, "electrode", self.electrode_thickness, True) for n in names)
            layers = [low, film, high]
        c = self.clamps
        blocks = Blocks(c.width, c.height, c.relative_permittivity) if c is not None else None
        return Laminate(base, tuple(layers), self.air_height, blocks, face="{layer}_{side}")

    @model_validator(mode="after")
    def _possible(self) -> AnnularStrips:
        check_radii(self.inner_radius, self.outer_radius)
        for key in ("film_thickness", "electrode_thickness"):
            length = self.outer_radius - self.inner_radius
            check_thickness(getattr(self, key), length, "strips'", key)
        solid = self.film_thickness / 2 + self.electrode_thickness
        if self.clamps is not None:
            if self.clamps.width >= self.inner_radius:
                raise ValueAt(
                    ("clamps", "width"),
                    f"{self.clamps.width:g} mm must be below "
                    f"inner_radius ({self.inner_radius:g} mm)",
                )
            if self.clamps.height <= solid:
                raise ValueAt(
                    ("clamps", "height"),
                    f"{self.clamps.height:g} mm must exceed half the strips' "
                    f"thickness ({solid:g} mm)",
                )
            solid = self.clamps.height
        check_air(self.air_height, solid)
        return self


def check_air(height: float, solid: float) -> None:
    """Raise `ValueAt` if air does not reach beyond the solid in it."""
    if 0 < height <= solid:
        problem = f"{height:g} mm must exceed the solid below it ({solid:g} mm), or be 0 mm"
        raise ValueAt(("air_height",), problem)


# --- laminates -----------------------------------------------------------------------------------


class LaminateShape(Section):
    """Layers on a base, stacked from the bottom, or from the inside of a tube."""

    shape: Literal["laminate"]
    base: AnyBase = Field(description="shape that the layers lie on")
    layers: tuple[AnyLayer, ...] = Field(min_length=1, description="layers from the bottom up")
    air_height: Length = Field(
        0.0, ge=0, description="air on both sides, from the middle of the layers; 0 mm: no air"
    )

    space: Literal["3d"] | None = Field(
        None,
        description="3d: solve a flat base in three dimensions; default: the space of the base",
    )
    symmetry: tuple[Literal["X", "Y"], ...] = Field(
        (), description="in three dimensions: axes across which only one half is modelled"
    )

    @property
    def solid(self) -> bool:
        """Whether it is solved in three dimensions."""
        return self.space == "3d" or isinstance(self.base, Rectangle)

    def laminate(self, conducts: Conducts) -> Laminate:
        """The laminate."""
        symmetry = "".join(sorted(self.symmetry))
        layers = tuple(self._layers(conducts))
        return Laminate(self.base, layers, self.air_height, solid=self.solid, symmetry=symmetry)

    def _layers(self, conducts: Conducts) -> Iterator[Layer]:
        for item, suffix in self._items():
            material, part = item.material or item.name, None
            if item.within is not None:
                part = item.within.part(self.base, self.solid, ("layers", "within"))
            yield Layer(
                *(item.name + suffix, material, item.thickness, conducts(material)),
                *(item.rows, part),
            )

    def _items(self) -> Iterator[tuple[LayerSection, str]]:
        for given in self.layers:
            if isinstance(given, LayerSection):
                yield given, ""
                continue
            for k in range(given.repeat):
                yield from ((layer, f".{k + 1}") for layer in given.layers)

    @model_validator(mode="after")
    def _possible(self) -> LaminateShape:
        seen: set[str] = set()
        below: tuple[str, Part] | None = None
        first, last = self.base.limits
        for k, given in enumerate(self.layers):
            inner = given.layers if isinstance(given, Repeat) else [given]
            for i, layer in enumerate(inner):
                at = (k, "layers", i) if isinstance(given, Repeat) else (k,)
                check_thickness(layer.thickness, last - first, "base's", "layers", *at, "thickness")
                if layer.name in seen:
                    problem = f"there are two layers {layer.name!r}; give them different names"
                    raise ValueAt(("layers", k), problem)
                seen.add(layer.name)
                part = None
                if layer.within is not None:
                    part = layer.within.part(self.base, self.solid, ("layers", k, "within"))
                if part is not None and below is not None and not below[1].overlaps(part):
                    problem = f"{layer.name!r} lies on nothing: it and {below[0]!r}, the layer "
                    raise ValueAt(("layers", k, "within"), problem + "below, do not overlap")
                below = None if part is None else (layer.name, part)
        check_air(self.air_height, sum(x.thickness for x, _ in self._items()) / 2)
        if self.solid and not self.base.mirrors:
            raise ValueAt(("space",), f"a {self.base.kind} is not solved in three dimensions")
        for axis in self.symmetry:
            if not self.solid or axis not in self.base.mirrors:
                raise ValueAt(("symmetry",), f"it is not symmetric about the plane {axis} = 0 here")
        return self


# --- meshes --------------------------------------------------------------------------------------


class MeshShape(Section):
    """A Gmsh mesh; its physical names are the regions and boundaries."""

    shape: Literal["mesh"]
    file: str = Field(description="Gmsh file, relative to the config")
    space: Literal["axisymmetric", "plane_strain", "3d"] = Field(
        description="space in which the mesh lies"
    )
    unit: str = Field("mm", description="unit of the file's coordinates")
    width: Length | None = Field(None, gt=0, description="width along Y, in plane strain")

    @property
    def kinematics(self) -> Kinematics:
        """Its space."""
        space = SPACES[self.space]
        return space if self.width is None else space.times(self.width)

    @field_validator("unit")
    @classmethod
    def _length(cls, unit: str) -> str:
        factor(unit, "mm")
        return unit

    @model_validator(mode="after")
    def _wide(self) -> MeshShape:
        if (self.width is None) == (self.space == "plane_strain"):
            problem = "plane strain needs it" if self.width is None else "only plane strain has one"
            raise ValueAt(("width",), problem)
        return self


Shape: TypeAlias = AnnularStrips | LaminateShape | MeshShape


def _strips(value: object) -> object:
    """Without `shape` a geometry is annular strips."""
    return {"shape": "annular_strips"} | value if isinstance(value, dict) else value


if TYPE_CHECKING:
    Geometry: TypeAlias = Shape
else:
    Geometry = Annotated[
        Union[AnnularStrips, LaminateShape, MeshShape],  # noqa: UP007
        Field(discriminator="shape"),
        BeforeValidator(_strips),
    ]
