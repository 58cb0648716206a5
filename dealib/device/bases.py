"""Bases of laminates: the surfaces on which layers are stacked. A new base is a new class here.

In a plane space a base is a line, and layers are stacked across it. A base knows its extent, the
space in which it is solved, and how such a device is usually held.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Protocol, TypeAlias, Union

import numpy as np
from pydantic import Field, model_validator

from dealib.arrays import Array
from dealib.device import plan as plans
from dealib.device.kinematics import AXISYMMETRIC, PLANE_STRAIN, SOLID, Kinematics
from dealib.device.plan import Plan
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Length

Held = tuple[str, tuple[str, ...]]  # boundary and axes
Span = tuple[float, float]
THINNEST = 1e-6  # smallest ratio of a thickness to a length; below it the unit must be wrong
_CORE = 0.5  # radius of a disc's core over the first radius at which a layer or patch ends


class Draft(Protocol):
    """What the plane mesh of a base (its plan) is made from.

    Attributes:
        sectors: Cells in a quarter of a turn, or across the width.
        symmetry: Axes across which the device is cut in half: '', 'X', 'Y' or 'XY'.
        circle: Centre and radius of a circular part, if there is one.
    """

    @property
    def sectors(self) -> int:
        """See above."""

    @property
    def symmetry(self) -> str:
        """See above."""

    @property
    def circle(self) -> tuple[float, float, float] | None:
        """See above."""

    def lines(self, axis: str, limits: Span, fine: tuple[bool, bool] = (True, True)) -> Array:
        """Grid lines along an axis, fine where a layer or patch begins or ends, mm.

        Args:
            axis: The axis.
            limits: The first and the last line, mm.
            fine: Whether they are fine at the first and at the last line too.
        """

    def parts(self, axis: str, limits: Span) -> list[float]:
        """Coordinates at which a layer or patch begins or ends, and both limits, ascending, mm."""


class Base(Section):
    """A base of a laminate.

    Attributes:
        along: Name of the axis along the base.
        across: Name of the axis along which layers are stacked.
        ends: Boundaries at its beginning and its end; None where there is none.
        holds: Boundaries and axes that are held by default.
        mount: Boundary that the mount moves by default; None for no mount.
        mirrors: Axes across which symmetry may halve it in three dimensions.
    """

    kind: str
    along: ClassVar[str] = "R"
    across: ClassVar[str] = "Z"
    ends: ClassVar[tuple[str | None, ...]]
    holds: ClassVar[tuple[Held, ...]]
    mount: ClassVar[str | None] = None
    mirrors: ClassVar[str] = ""

    @property
    def kinematics(self) -> Kinematics:
        """Its space."""
        return AXISYMMETRIC

    @property
    def limits(self) -> tuple[float, float]:
        """Where it begins and ends along its axis, mm."""
        raise AssertionError

    def plan(self, draft: Draft) -> Plan:
        """Its mesh in its own plane, for three dimensions; only bases with `mirrors` have one."""
        raise AssertionError

    def bottom(self, thickness: float) -> float:
        """Coordinate of the lowest face across the base, mm; the middle of the laminate is at 0.

        Args:
            thickness: Of all layers together, mm.
        """
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

    ends: ClassVar[tuple[str | None, ...]] = ("inner", "outer")
    holds: ClassVar[tuple[Held, ...]] = (("outer", ("R", "Z")),)
    mount: ClassVar[str | None] = "inner"
    mirrors: ClassVar[str] = "XY"

    kind: Literal["annulus"]
    inner_radius: Length = Field(gt=0, description="radius of the inner end")
    outer_radius: Length = Field(gt=0, description="radius of the outer end")

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return self.inner_radius, self.outer_radius

    def plan(self, draft: Draft) -> Plan:
        """See `Base`."""
        lines = draft.lines("R", self.limits)
        return plans.polar(lines, draft.sectors, draft.symmetry, ("inner", "outer"))

    @model_validator(mode="after")
    def _ring(self) -> Annulus:
        check_radii(self.inner_radius, self.outer_radius)
        return self


def check_radii(inner: float, outer: float) -> None:
    """Raise `ValueAt` if the outer radius is not above the inner one."""
    if outer <= inner:
        where, above = ("outer_radius",), f"inner_radius ({inner:g} mm)"
        raise ValueAt(where, f"{outer:g} mm must exceed {above}")
    if outer - inner < THINNEST * inner:
        problem = "the ring is narrower than a millionth of inner_radius; check the unit"
        raise ValueAt(("outer_radius",), problem)


def check_thickness(thickness: float, length: float, what: str, *where: str | int) -> None:
    """Raise `ValueAt` if a layer is too thin for what it lies on."""
    if 0 < thickness < THINNEST * length:
        problem = f"{thickness:g} mm are less than a millionth of the {what} length ({length:g} mm)"
        raise ValueAt(where, f"{problem}; check the unit")


class Disc(Base):
    """Full disc; its axis of symmetry needs no condition."""

    ends: ClassVar[tuple[str | None, ...]] = (None, "outer")
    holds: ClassVar[tuple[Held, ...]] = (("outer", ("R", "Z")),)
    mirrors: ClassVar[str] = "XY"

    kind: Literal["disc"]
    radius: Length = Field(gt=0, description="radius of the edge")

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return 0.0, self.radius

    def plan(self, draft: Draft) -> Plan:
        """See `Base`."""
        core = _CORE * draft.parts("R", self.limits)[1]
        lines = draft.lines("R", self.limits, (False, True))
        return plans.disc(lines, core, draft.sectors, draft.symmetry, "outer")


class Tube(Base):
    """Tube; its layers are stacked outwards, its first face lies on the inner radius."""

    along: ClassVar[str] = "Z"
    across: ClassVar[str] = "R"
    ends: ClassVar[tuple[str | None, ...]] = ("low", "high")
    holds: ClassVar[tuple[Held, ...]] = (("low", ("R", "Z")),)
    mount: ClassVar[str | None] = "high"

    kind: Literal["tube"]
    inner_radius: Length = Field(gt=0, description="radius of the bore")
    length: Length = Field(gt=0, description="length along the axis, from Z = 0")

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
    """Strip in plane strain, from X = 0; forces and charges are those of its whole width."""

    along: ClassVar[str] = "X"
    ends: ClassVar[tuple[str | None, ...]] = ("left", "right")
    holds: ClassVar[tuple[Held, ...]] = (("left", ("X", "Z")),)
    mirrors: ClassVar[str] = "Y"

    kind: Literal["strip"]
    length: Length = Field(gt=0, description="length along X, from X = 0")
    width: Length = Field(gt=0, description="width along Y, out of the plane")

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

    def plan(self, draft: Draft) -> Plan:
        """See `Base`: from -width/2 to width/2 along Y."""
        half = self.width / 2
        low = 0.0 if draft.symmetry else -half
        names = ("left", "right", None if draft.symmetry else "front", "back")
        lines = draft.lines("X", self.limits), draft.lines("Y", (low, half), (low != 0, True))
        return plans.symmetric(plans.tensor(*lines, sides=names), draft.symmetry)


class Rectangle(Base):
    """Rectangle about the origin, in three dimensions."""

    along: ClassVar[str] = "X"
    ends: ClassVar[tuple[str | None, ...]] = ("left", "right", "front", "back")
    holds: ClassVar[tuple[Held, ...]] = tuple(
        (end, ("X", "Y", "Z")) for end in ("left", "right", "front", "back")
    )
    mirrors: ClassVar[str] = "XY"

    kind: Literal["rectangle"]
    length: Length = Field(gt=0, description="length along X, from -length/2 to length/2")
    width: Length = Field(gt=0, description="width along Y, from -width/2 to width/2")

    @property
    def kinematics(self) -> Kinematics:
        """See `Base`."""
        return SOLID

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return -self.length / 2, self.length / 2

    @property
    def area(self) -> float:
        """See `Base`."""
        return self.length * self.width

    @property
    def girth(self) -> float:
        """See `Base`."""
        return self.width

    def plan(self, draft: Draft) -> Plan:
        """See `Base`."""
        spans = [("X", self.length / 2), ("Y", self.width / 2)]
        limits = [(0.0 if axis in draft.symmetry else -half, half) for axis, half in spans]
        x, y = (
            draft.lines(axis, limit, (axis not in draft.symmetry, True))
            for (axis, _), limit in zip(spans, limits, strict=True)
        )
        plan = plans.tensor(x, y) if draft.circle is None else plans.with_circle(draft, [x, y])
        ends = ("left", "right", "front", "back")
        names = dict(zip(ends, zip((0, 0, 1, 1), np.ravel(limits), strict=True), strict=True))
        cut = {"XY".index(axis): axis for axis in draft.symmetry}
        sides = {n: at for n, at in names.items() if not (at[0] in cut and at[1] == 0)}
        return plans.symmetric(plans.bordered(plan, sides), draft.symmetry)


if TYPE_CHECKING:
    AnyBase: TypeAlias = Base
else:
    _bases = Union[tuple(Base.__subclasses__())]  # noqa: UP007 - built at run time
    AnyBase = Annotated[_bases, Field(discriminator="kind")]
