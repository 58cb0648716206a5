"""Bases of laminates: what the layers lie on. A new base is a new class here.

A base is a line in its plane: layers are stacked across it. It says where it begins and ends, in
which space it is solved, and how such a device is usually held.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeAlias, Union

from pydantic import Field, model_validator

from dealib.device.kinematics import AXISYMMETRIC, PLANE_STRAIN, Kinematics
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Length

Held = tuple[str, tuple[str, ...]]  # boundary and axes


class Base(Section):
    """What all bases have.

    Attributes:
        along: Name of the axis along the base.
        across: Name of the axis along which layers are stacked.
        ends: Boundaries at its beginning and its end; None where there is none.
        holds: What is held if the config does not say so.
        mount: Boundary of the mount that moves if the config does not say so; None for none.
    """

    along: ClassVar[str] = "R"
    across: ClassVar[str] = "Z"
    ends: ClassVar[tuple[str | None, str | None]]
    holds: ClassVar[tuple[Held, ...]]
    mount: ClassVar[str | None] = None

    @property
    def kinematics(self) -> Kinematics:
        """Its space."""
        return AXISYMMETRIC

    @property
    def limits(self) -> tuple[float, float]:
        """Where it begins and ends along its axis, mm."""
        raise AssertionError

    def bottom(self, thickness: float) -> float:
        """Where the lowest layer begins across it, mm; the middle of the laminate is at 0."""
        return -thickness / 2

    @property
    def area(self) -> float:
        """Its area, mm^2."""
        first, last = self.limits
        return math.pi * (last**2 - first**2)

    @property
    def girth(self) -> float:
        """Width of the cross-section that carries the force of the mount, mm."""
        return 2 * math.pi * (self.limits[0] or self.limits[1])


class Annulus(Base):
    """Ring between two radii; the mount is a rigid disc within it."""

    ends: ClassVar[tuple[str | None, str | None]] = ("inner", "outer")
    holds: ClassVar[tuple[Held, ...]] = (("outer", ("R", "Z")),)
    mount: ClassVar[str | None] = "inner"

    kind: Literal["annulus"]
    inner_radius: Length = Field(gt=0, description="where it begins")
    outer_radius: Length = Field(gt=0, description="where it ends")

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return self.inner_radius, self.outer_radius

    @model_validator(mode="after")
    def _ring(self) -> Annulus:
        check_radii(self.inner_radius, self.outer_radius)
        return self


def check_radii(inner: float, outer: float) -> None:
    """Raise `ValueAt` if the outer radius is not above the inner one."""
    if outer <= inner:
        where, above = ("outer_radius",), f"inner_radius ({inner:g} mm)"
        raise ValueAt(where, f"{outer:g} mm must exceed {above}")


class Disc(Base):
    """Full disc; its axis is found by itself."""

    ends: ClassVar[tuple[str | None, str | None]] = (None, "outer")
    holds: ClassVar[tuple[Held, ...]] = (("outer", ("R", "Z")),)

    kind: Literal["disc"]
    radius: Length = Field(gt=0, description="where it ends")

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return 0.0, self.radius


class Tube(Base):
    """Tube; its layers are stacked outwards, its first face lies on the inner radius."""

    along: ClassVar[str] = "Z"
    across: ClassVar[str] = "R"
    ends: ClassVar[tuple[str | None, str | None]] = ("low", "high")
    holds: ClassVar[tuple[Held, ...]] = (("low", ("R", "Z")),)
    mount: ClassVar[str | None] = "high"

    kind: Literal["tube"]
    inner_radius: Length = Field(gt=0, description="of the bore")
    length: Length = Field(gt=0, description="from Z = 0")

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return 0.0, self.length

    def bottom(self, thickness: float) -> float:
        """See `Base`."""
        return self.inner_radius

    @property
    def area(self) -> float:
        """See `Base`."""
        return self.girth * self.length

    @property
    def girth(self) -> float:
        """See `Base`."""
        return 2 * math.pi * self.inner_radius


class Strip(Base):
    """Strip in plane strain, from X = 0; forces and charges are of its whole width."""

    along: ClassVar[str] = "X"
    ends: ClassVar[tuple[str | None, str | None]] = ("left", "right")
    holds: ClassVar[tuple[Held, ...]] = (("left", ("X", "Z")),)

    kind: Literal["strip"]
    length: Length = Field(gt=0, description="along X")
    width: Length = Field(gt=0, description="out of the plane, along Y")

    @property
    def kinematics(self) -> Kinematics:
        """See `Base`."""
        return PLANE_STRAIN.times(self.width)

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return 0.0, self.length

    @property
    def area(self) -> float:
        """See `Base`."""
        return self.length * self.width

    @property
    def girth(self) -> float:
        """See `Base`."""
        return self.width


if TYPE_CHECKING:
    AnyBase: TypeAlias = Base
else:
    _bases = Union[tuple(Base.__subclasses__())]  # noqa: UP007 - built at run time
    AnyBase = Annotated[_bases, Field(discriminator="kind")]
