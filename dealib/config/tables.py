"""The grid of the tables that `dealib export` makes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from dealib.arrays import Array
from dealib.device.records import KINDS
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Angle, Length, Stress, Voltage

Points = Annotated[int, Field(ge=3)]
_POINTS = (13, 9, 7)  # default numbers of values of the first, second and third axis
_MOST = 3


class Tables(Section):
    """Tables over two or three port variables for system simulation, made by `dealib export`.

    {displacement: [0 mm, -2 mm], voltage: [0 V, 2 kV]} gives force, charge and capacitance over
    both. If there are several ports of a kind, name one or more: {voltage: {left: [0 V, 2 kV]}}.
    Ports that are not named keep their value at rest.
    """

    displacement: tuple[Length, Length] | dict[str, tuple[Length, Length]] | None = Field(
        None, description="first and last displacement of the mount, or of mounts by name"
    )
    voltage: tuple[Voltage, Voltage] | dict[str, tuple[Voltage, Voltage]] | None = Field(
        None, description="first and last voltage of the terminal, or of terminals by name"
    )
    pressure: tuple[Stress, Stress] | dict[str, tuple[Stress, Stress]] | None = Field(
        None, description="first and last pressure of the chamber, or of chambers by name"
    )
    rotation: tuple[Angle, Angle] | dict[str, tuple[Angle, Angle]] | None = Field(
        None, description="first and last rotation of the turn, or of turns by name"
    )
    points: tuple[Points, ...] | None = Field(
        None,
        min_length=2,
        max_length=_MOST,
        description="number of equally spaced values of each variable, in the order of the keys "
        "above; default 13, 9 and 7",
    )

    @property
    def axes(self) -> dict[str, tuple[float, float]]:
        """First and last value of each variable, such as 'displacement' or 'voltage.left'."""
        found: dict[str, tuple[float, float]] = {}
        for kind in KINDS.values():
            name = kind.primal.name
            given = getattr(self, name)
            if isinstance(given, Mapping):
                found |= {f"{name}.{port}": ends for port, ends in given.items()}
            elif given is not None:
                found[name] = given
        return found

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of values of each variable."""
        return (self.points or _POINTS)[: len(self.axes)]

    @property
    def grids(self) -> dict[str, Array]:
        """Values of each variable, from the first to the last."""
        pairs = zip(self.axes.items(), self.counts, strict=True)
        return {name: np.linspace(*ends, count) for (name, ends), count in pairs}

    def check(self, config: Any) -> None:
        """Raise `ValueAt` if tables of the device cannot be made.

        Args:
            config: A `Config`.
        """
        if config.physics.coupling != "energy":
            raise ValueAt(("physics", "coupling"), "tables need coupling: energy")
        for name, law in config.solids.items():
            if keys := [key for key in law.memory if key != "branches"]:
                where = f"materials.{name} has {' and '.join(keys)}"
                problem = f"{where}: tables cannot hold forces that depend on the load history"
                raise ValueAt(("tables",), problem)
        for name in self.axes:
            if name not in config.device.variables:
                known = ", ".join(config.device.variables)
                problem = f"the device has no {name}; it has {known}"
                raise ValueAt(("tables", *name.split(".", 1)), problem)

    @model_validator(mode="after")
    def _ranges(self) -> Tables:
        axes = self.axes
        for name, (first, last) in axes.items():
            if first == last:
                raise ValueAt(tuple(name.split(".", 1)), "the first and the last value must differ")
        if not 2 <= len(axes) <= _MOST:
            raise ValueAt((), f"tables need two or three variables, not {len(axes)}")
        if self.points is not None and len(self.points) != len(axes):
            expected = f"expected a number for each of {', '.join(axes)}"
            raise ValueAt(("points",), f"{expected}, not {len(self.points)} numbers")
        return self
