"""Layers in the config, and the parts of the base that layers and terminals cover."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag

from dealib.device.bases import Base, Rectangle
from dealib.device.part import Part
from dealib.device.plan import SQUARE
from dealib.errors import Place, ValueAt
from dealib.section import Section
from dealib.units import Length

Span = tuple[Length, Length]


class Within(Section):
    """A part of the base: [from, to] along it, intervals by axis, or a circle."""

    along: Span | None = Field(None, description="[from, to] along the base")
    R: Span | None = Field(None, description="the same, by the name of the axis")
    X: Span | None = Field(None, description="the same")
    Y: Span | None = Field(None, description="the same, across it")
    Z: Span | None = Field(None, description="the same, of a tube")
    centre: tuple[Length, Length] | None = Field(
        None, description="centre of a circle; default 0, 0"
    )
    radius: Length | None = Field(None, gt=0, description="radius of a circle on a rectangle")

    def part(self, base: Base, solid: bool, where: Place) -> Part:
        """The part of a base that this section means.

        Args:
            base: The base.
            solid: Whether it is solved in three dimensions.
            where: Place of the section in the config, for errors.

        Raises:
            ValueAt: If the part does not lie on the base.
        """
        axes = {base.along: base.limits}
        if solid and base.along == "X":
            axes["Y"] = (-base.girth / 2, base.girth / 2)
        spans = {base.along: self.along} if self.along is not None else {}
        spans |= {a: getattr(self, a) for a in "RXYZ" if getattr(self, a) is not None}
        for axis, (a, b) in spans.items():
            if axis not in axes:
                known = ", ".join(axes)
                raise ValueAt(where, f"the base has no axis {axis}; it has {known}")
            low, high = axes[axis]
            if not low <= a < b <= high:
                raise ValueAt(
                    where,
                    f"{a:g} to {b:g} mm is no part of the base, which goes from {low:g} to "
                    f"{high:g} mm along {axis}",
                )
        if self.radius is None:
            if not spans or self.centre is not None:
                raise ValueAt(where, "expected [from, to], or a circle's centre and radius")
            return Part(spans)
        if not isinstance(base, Rectangle) or spans:
            problem = "a circle needs a rectangle as base, and no intervals beside it"
            raise ValueAt((*where, "radius"), problem)
        x, y = self.centre or (0.0, 0.0)
        reach = SQUARE * self.radius
        if abs(x) + reach >= base.length / 2 or abs(y) + reach >= base.width / 2:
            raise ValueAt(
                (*where, "radius"),
                f"the circle is too near to the rectangle's sides: its centre must be more than "
                f"{reach:g} mm away from each",
            )
        return Part(circle=(x, y, self.radius))


def _along(given: object) -> object:
    return {"along": given} if isinstance(given, (list, tuple)) else given


if TYPE_CHECKING:
    Covered: TypeAlias = Within
else:
    Covered = Annotated[Within, BeforeValidator(_along, json_schema_input_type=Within | Span)]


class LayerSection(Section):
    """One layer."""

    name: str = Field(
        pattern=r"^[A-Za-z_][\w-]*$", description="name of the layer; its region is called the same"
    )
    thickness: Length = Field(gt=0, description="thickness as mounted, that is pre-stretched")
    material: str | None = Field(None, description="key of `materials`; default: its name")
    rows: int | None = Field(
        None,
        ge=1,
        le=1000,
        description="cells through the thickness; default mesh.film_rows or electrode_rows",
    )
    within: Covered | None = Field(
        None, description="part of the base that it covers, such as [from, to]; default all of it"
    )


class Repeat(Section):
    """A group of layers that is repeated; the names of layers get the suffixes .1, .2 and so on."""

    repeat: int = Field(ge=1, le=1000, description="number of repetitions")
    layers: tuple[LayerSection, ...] = Field(
        min_length=1, description="layers of one repetition, from the bottom up"
    )


def _form(given: object) -> str:
    """Whether an item of a list of layers is a single layer or a repeated group."""
    many = isinstance(given, dict) and not {"repeat", "layers"}.isdisjoint(given)
    return "repeated" if many or isinstance(given, Repeat) else "single"


if TYPE_CHECKING:
    AnyLayer: TypeAlias = LayerSection | Repeat
else:
    AnyLayer = Annotated[
        Annotated[LayerSection, Tag("single")] | Annotated[Repeat, Tag("repeated")],
        Discriminator(_form),
    ]
