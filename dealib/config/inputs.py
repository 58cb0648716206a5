"""Inputs of the ports in a stage of the program."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, TypeAlias

from pydantic import Field, TypeAdapter

from dealib.config.bias import BiasElement, Element, Masses, Spring
from dealib.config.chamber import Filled, Gas, Liquid
from dealib.config.wave import Wave, course
from dealib.errors import Place
from dealib.section import OneOf
from dealib.units import Angle, Charge, Force, Length, Moment, Stress, Voltage, Volume

Course: TypeAlias = tuple[float, ...] | Wave

if TYPE_CHECKING:
    Displacements: TypeAlias = Course
    Forces: TypeAlias = Course
    Voltages: TypeAlias = Course
    Charges: TypeAlias = Course
    Pressures: TypeAlias = Course
    Volumes: TypeAlias = Course
    Angles: TypeAlias = Course
    Moments: TypeAlias = Course
else:
    Displacements, Forces = course(Length, "displacement"), course(Force, "force")
    Voltages, Charges = course(Voltage, "voltage"), course(Charge, "charge")
    Pressures, Volumes = course(Stress, "pressure"), course(Volume, "volume")
    Angles, Moments = course(Angle, "rotation"), course(Moment, "moment")


class _Port(OneOf):
    @property
    def courses(self) -> list[tuple[Place, Course]]:
        """Path and course of the given input."""
        name, given = self.given
        if isinstance(given, Spring):
            return [((name, "anchor"), given.anchor)]
        return [((name,), given)]


class MountInput(_Port):
    """Input of the mount, one of these: a value to ramp to, or a list for a polyline in time."""

    displacement: Displacements | None = Field(
        None, description="prescribed displacement; negative is down"
    )
    force: Forces | None = Field(None, description="prescribed force; negative is down")
    mass: Masses | None = Field(None, description="suspended mass: force -m g")
    spring: Spring | None = Field(None, description="linear spring to a moving anchor")
    bias: tuple[BiasElement, ...] | None = Field(
        None,
        min_length=1,
        description="list of springs, masses and a second film; their forces add up",
    )

    @property
    def courses(self) -> list[tuple[Place, Course]]:
        """See `_Port`."""
        if self.bias is None:
            return super().courses
        found = [element.course for element in self.bias]
        return [(("bias", i, *path), values) for i, (path, values) in enumerate(found)]


class TerminalInput(_Port):
    """Input of a terminal, one of these: a value to ramp to, or a list for a polyline in time."""

    voltage: Voltages | None = Field(None, description="prescribed voltage against ground")
    charge: Charges | None = Field(None, description="prescribed charge")


class ChamberInput(_Port):
    """Input of a chamber, one of these: a value to ramp to, or a list for a polyline in time."""

    pressure: Pressures | None = Field(None, description="prescribed pressure above that outside")
    volume: Volumes | None = Field(None, description="prescribed displaced volume, 0 at rest")
    gas: Gas | None = Field(
        None,
        description="enclosed gas: the pressure follows from its volume and the flow through "
        "openings",
    )
    liquid: Liquid | None = Field(
        None, description="liquid: the volume follows from the flow through openings"
    )

    @property
    def courses(self) -> list[tuple[Place, Course]]:
        """See `_Port`."""
        return [] if self.gas or self.liquid else super().courses


class TurnInput(_Port):
    """Rotation of a rigid mount, one of these: a value to ramp to, or a list as a polyline."""

    rotation: Angles | None = Field(None, description="prescribed component of the rotation vector")
    moment: Moments | None = Field(None, description="prescribed moment about the centre")


@functools.cache
def elements() -> TypeAdapter[Element | Gas | Filled]:
    """Reads an element from its plain values; made when it is needed, since that takes 40 ms."""
    return TypeAdapter(Element | Gas | Filled)


Input: TypeAlias = MountInput | TerminalInput | ChamberInput | TurnInput
