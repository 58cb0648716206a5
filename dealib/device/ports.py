"""Terminals, mounts, holds and chambers in the config."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from dealib.device.layers import Covered
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import FlowConductance, Length, Mass, Stress

_SMOOTH = 1e-6  # MPa, pressure below which the flow through an orifice is linear


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

    on: Names = Field(description="regions and faces that form the electrode")
    within: Covered | None = Field(
        None, description="part of the face, [from, to] along the base; default all of it"
    )
    ground: bool = Field(False, description="the electrode is grounded (0 V) and is not a port")


class Mount(Section):
    """A rigid part that moves along one axis only, or (`rigid: true`) moves and turns freely.

    A rigid mount PLATE has six ports, in plane strain three. The mounts PLATE.X, PLATE.Y, PLATE.Z
    are displacements of its centre. The turns PLATE.about_X, .. are components of its rotation
    vector about the centre. All are held at zero unless a stage drives them.
    """

    on: Names = Field(description="regions and boundaries that are fixed to it")
    along: str | None = Field(None, description="axis of its motion, such as Z")
    rigid: bool = Field(False, description="the mount moves along all axes and turns about them")
    centre: tuple[Length, ...] | None = Field(
        None,
        min_length=2,
        max_length=3,
        description="centre of a rigid mount in the mesh; default the middle of the box around it",
    )
    mass: Mass = Field(0.0, ge=0, description="mass of the rigid part, for motion in time")
    free: Some = Field((), description="axes along which the body may slide")

    @model_validator(mode="after")
    def _one_kind(self) -> Mount:
        if self.rigid == (self.along is not None):
            raise ValueAt(("along",), "give the axis of its motion, or `rigid: true`")
        if self.rigid and self.free:
            raise ValueAt(("free",), "a rigid mount holds its part along all axes")
        if self.centre is not None and not self.rigid:
            raise ValueAt(("centre",), "only for a rigid mount, which turns about it")
        return self


class Hold(Section):
    """A part that does not move along some axes."""

    on: Names = Field(description="regions and boundaries that are held")
    fix: Names = Field(description="axes along which they do not move, such as [R, Z]")


class Opening(Section):
    """Where a chamber's gas or liquid flows in and out: an orifice, or a narrow channel."""

    diameter: Length | None = Field(None, gt=0, description="diameter of an orifice")
    discharge: float = Field(0.6, gt=0, le=1, description="discharge coefficient of an orifice")
    conductance: FlowConductance | None = Field(
        None, gt=0, description="flow through a channel per pressure, such as 10 mm^3/s/kPa"
    )
    valve: Literal["in", "out"] | None = Field(
        None, description="check valve: flow only into the chamber, or only out of it"
    )
    pressure: Stress = Field(
        0.0, description="pressure on the other side of the opening, relative to the outside"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Opening:
        if (self.diameter is None) == (self.conductance is None):
            raise ValueError("give the diameter of an orifice, or the conductance of a channel")
        return self

    def inflow(self, x: float, density: float) -> tuple[float, float]:
        """Inflow at a pressure x in the chamber, mm^3/s, and its derivative by x.

        The inflow through an orifice is C A sqrt(2 p / density) with the discharge coefficient C
        and the area A. It is linear for pressures below about 1 Pa; a valve opens and closes over
        such a difference.

        Args:
            x: Pressure in the chamber relative to the outside, MPa.
            density: Of the gas or liquid, t/mm^3.
        """
        p = self.pressure - x
        square = p * p + _SMOOTH**2
        if self.conductance is not None:
            flow, slope = self.conductance * p, self.conductance
        else:
            assert self.diameter is not None
            area = self.discharge * math.pi / 4 * self.diameter**2 * math.sqrt(2 / density)
            flow = area * p / square**0.25
            slope = area * (1 - p * p / (2 * square)) / square**0.25
        if self.valve is not None:
            sign, root = 1.0 if self.valve == "in" else -1.0, math.sqrt(square)
            opened, opening = (1 + sign * p / root) / 2, sign * (1 - p * p / square) / root / 2
            flow, slope = flow * opened, slope * opened + flow * opening
        return flow, -slope


class Chamber(Section):
    """A closed space on one side of faces, whose pressure acts on them."""

    on: Names = Field(description="faces of solids on which the pressure acts, towards the solid")
    along: str | None = Field(
        None,
        description="axis along which the walls run that close the chamber at the rim of its "
        "faces, and along which the rim may move; default the axis across the layers (for a tube "
        "R: rigid caps close both ends), or Z",
    )
    openings: dict[str, Opening] | None = Field(
        None, description="openings through which gas or liquid flows, by name"
    )
