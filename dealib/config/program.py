"""The load program in the config: stages and what drives the ports in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from pydantic import Field, model_validator

from dealib.config.bias import BiasElement, Forces, Lengths, Masses, Spring
from dealib.config.follow import Follow
from dealib.config.names import Cell
from dealib.config.section import OneOf, Section
from dealib.config.stop import Condition
from dealib.errors import ValueAt
from dealib.units import Charge, Time, Voltage, list_of

if TYPE_CHECKING:
    Voltages: TypeAlias = tuple[float, ...]
    Charges: TypeAlias = tuple[float, ...]
else:
    Voltages, Charges = list_of(Voltage), list_of(Charge)

Path_: TypeAlias = tuple[str | int, ...]


class _Port(OneOf):
    @property
    def polylines(self) -> list[tuple[Path_, tuple[float, ...]]]:
        """Path and values of each input that is given."""
        name, given = self.given
        if isinstance(given, Spring):
            return [((name, "anchor"), given.anchor)]
        return [((name,), given)]


class MountInput(_Port):
    """What drives the mount, one of: a value to ramp to, or a list: a polyline over the stage."""

    displacement: Lengths | None = Field(None, description="prescribed; negative is down")
    force: Forces | None = Field(None, description="prescribed; negative is down")
    mass: Masses | None = Field(None, description="suspended: force -m g")
    spring: Spring | None = Field(None, description="linear spring to a moving anchor")
    bias: tuple[BiasElement, ...] | None = Field(
        None, min_length=1, description="springs, masses, a second film, side by side"
    )

    @property
    def polylines(self) -> list[tuple[Path_, tuple[float, ...]]]:
        """See `_Port`."""
        if self.bias is None:
            return super().polylines
        found = [element.polyline for element in self.bias]
        return [(("bias", i, *path), values) for i, (path, values) in enumerate(found)]


class TerminalInput(_Port):
    """What drives the top electrode, one of: a value to ramp to, or a list over the stage."""

    voltage: Voltages | None = Field(None, description="prescribed against the bottom electrode")
    charge: Charges | None = Field(None, description="prescribed")


class Stage(Section):
    """One stage: what changes at the ports, over how long, in how many steps."""

    stage: Cell = Field(
        min_length=1, description="name; `prestrain` ramps the film's pre-stretch from 1"
    )
    duration: Time = Field(1.0, gt=0, description="of one cycle")
    steps: int = Field(1, ge=1, description="equal increments a cycle; cut where Newton fails")
    cycles: int = Field(1, ge=1, description="repetitions")
    mount: MountInput | None = Field(None, description="unchanged if not given")
    terminal: TerminalInput | None = Field(None, description="unchanged if not given")
    stop_when: tuple[Condition, ...] = Field(
        (), description="ends the stage at a state that meets one"
    )

    follow: Follow | None = Field(
        None, description="follow the branch of equilibria instead, past limit points"
    )

    @model_validator(mode="after")
    def _follows_alone(self) -> Stage:
        if self.follow is None:
            return self
        for port in ("mount", "terminal"):
            if getattr(self, port) is not None:
                raise ValueAt(
                    (port,), "a stage that follows a branch takes no input; give it a stage before"
                )
        if self.cycles > 1:
            raise ValueAt(("cycles",), "a branch is followed once")
        if self.stage == "prestrain":
            raise ValueAt(("follow",), "a prestrain stage takes no input")
        return self

    @model_validator(mode="after")
    def _cycles_close(self) -> Stage:
        """A cycle begins where the one before ended, or the input would jump."""
        if self.cycles == 1:
            return self
        driven = [
            (port, *found)
            for port in ("mount", "terminal")
            if (given := getattr(self, port)) is not None
            for found in given.polylines
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
