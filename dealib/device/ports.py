"""Terminals, mounts, holds and chambers in the config."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from dealib.device.shapes import Covered
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Length, Mass


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


if TYPE_CHECKING:
    Some: TypeAlias = tuple[str, ...]
    Names: TypeAlias = tuple[str, ...]
else:
    Some = Annotated[
        tuple[str, ...], BeforeValidator(_listed, json_schema_input_type=str | tuple[str, ...])
    ]
    Names = Annotated[Some, Field(min_length=1)]


class Terminal(Section):
    """An electrode: a conducting region, or a face that carries one without thickness."""

    on: Names = Field(description="regions and faces that it consists of")
    within: Covered | None = Field(
        None, description="part of the face, [from, to] along the base; default all of it"
    )
    ground: bool = Field(False, description="it is at 0 V, and no port")


class Mount(Section):
    """A rigid part that moves along one axis, the others held; or that moves and turns freely.

    A rigid mount PLATE has six ports, in plane strain three: the mounts PLATE.X, PLATE.Y, PLATE.Z
    are displacements of its centre, the turns PLATE.about_X, .. a rotation vector about it; of one
    turn alone that is its angle. All are held at zero unless a stage drives them.
    """

    on: Names = Field(description="regions and boundaries that are fixed to it")
    along: str | None = Field(None, description="axis of its motion, such as Z")
    rigid: bool = Field(False, description="it moves along all axes, and turns about them")
    centre: tuple[Length, ...] | None = Field(
        None,
        min_length=2,
        max_length=3,
        description="of a rigid mount, in the mesh; default the middle of the box around it",
    )
    mass: Mass = Field(0.0, ge=0, description="of the rigid part, for motion in time")
    free: Some = Field((), description="axes along which it does not hold the body")

    @model_validator(mode="after")
    def _one_kind(self) -> Mount:
        if self.rigid == (self.along is not None):
            raise ValueAt(("along",), "give the axis of its motion, or `rigid: true`")
        if self.rigid and self.free:
            raise ValueAt(("free",), "a rigid mount holds its part along all axes")
        if self.centre is not None and not self.rigid:
            raise ValueAt(("centre",), "only of a rigid mount, which turns about it")
        return self


class Hold(Section):
    """A part that does not move along some axes."""

    on: Names = Field(description="regions and boundaries")
    fix: Names = Field(description="axes, such as [R, Z]")


class Chamber(Section):
    """A closed space on one side of faces, whose pressure acts on them."""

    on: Names = Field(description="faces of solids on which the pressure acts, towards the solid")
    along: str | None = Field(
        None,
        description="axis of the walls that close it at the faces' rim; default that across the "
        "layers, or Z. The pressure on these walls acts on the rim, which may move along them: of "
        "a tube R, so that both ends are closed by rigid caps",
    )
