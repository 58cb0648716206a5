"""The load program in the config: stages and what drives the ports in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from pydantic import Field, model_validator

from dealib.config.section import Section
from dealib.errors import ValueAt
from dealib.units import Charge, Force, Length, Mass, Stiffness, Time, Voltage, list_of

if TYPE_CHECKING:
    Lengths: TypeAlias = tuple[float, ...]
    Forces: TypeAlias = tuple[float, ...]
    Masses: TypeAlias = tuple[float, ...]
    Voltages: TypeAlias = tuple[float, ...]
    Charges: TypeAlias = tuple[float, ...]
else:
    Lengths, Forces, Masses = list_of(Length), list_of(Force), list_of(Mass)
    Voltages, Charges = list_of(Voltage), list_of(Charge)


class Spring(Section):
    """Linear spring between the mount and an anchor that moves to its given position."""

    stiffness: Stiffness = Field(gt=0)
    anchor: Lengths = Field(description="where the anchor moves, as a displacement")


class _Port(Section):
    @model_validator(mode="after")
    def _one_of(self) -> _Port:
        names = list(type(self).model_fields)
        given = [n for n in names if getattr(self, n) is not None]
        if len(given) > 1:
            raise ValueAt((given[1],), f"{' and '.join(given)} exclude each other; give one")
        if not given:
            raise ValueError(f"give one of {', '.join(names)}")
        return self

    @property
    def polyline(self) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """Path and values of the input that is given."""
        for name in type(self).model_fields:
            given = getattr(self, name)
            if isinstance(given, Spring):
                return (name, "anchor"), given.anchor
            if given is not None:
                return (name,), given
        raise AssertionError("a port has one input")


class MountInput(_Port):
    """What drives the mount, one of: a value to ramp to, or a list: a polyline over the stage."""

    displacement: Lengths | None = Field(None, description="prescribed; negative is down")
    force: Forces | None = Field(None, description="prescribed; negative is down")
    mass: Masses | None = Field(None, description="suspended: force -m g")
    spring: Spring | None = Field(None, description="linear spring to a moving anchor")


class TerminalInput(_Port):
    """What drives the top electrode, one of: a value to ramp to, or a list over the stage."""

    voltage: Voltages | None = Field(None, description="prescribed against the bottom electrode")
    charge: Charges | None = Field(None, description="prescribed")


class Stage(Section):
    """One stage: what changes at the ports, over how long, in how many steps."""

    stage: str = Field(
        min_length=1, description="name; `prestrain` ramps the film's pre-stretch from 1"
    )
    duration: Time = Field(1.0, gt=0, description="of one cycle")
    steps: int = Field(1, ge=1, description="equal increments a cycle; cut where Newton fails")
    cycles: int = Field(1, ge=1, description="repetitions")
    mount: MountInput | None = Field(None, description="unchanged if not given")
    terminal: TerminalInput | None = Field(None, description="unchanged if not given")

    @model_validator(mode="after")
    def _cycles_close(self) -> Stage:
        """A cycle begins where the one before ended, or the input would jump."""
        if self.cycles == 1:
            return self
        driven = [
            (port, *found)
            for port in ("mount", "terminal")
            if (given := getattr(self, port)) is not None and (found := given.polyline)
        ]
        if not driven:
            raise ValueAt(("cycles",), "only an input of this stage can be repeated; it has none")
        for port, name, values in driven:
            if len(values) == 1:
                where, need = (port, *name), "a list, such as [0, peak, 0] with units"
            elif values[0] != values[-1]:
                where, need = (port, *name), "a list that ends where it begins"
            else:
                continue
            raise ValueAt(where, f"{self.cycles} cycles need {need}")
        return self
