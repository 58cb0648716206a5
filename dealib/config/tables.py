"""The grid of the tables that `dealib export` makes."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Length, Voltage

Points = Annotated[int, Field(ge=3)]


class Tables(Section):
    """Tables F(u, V), Q(u, V), C(u, V) for system simulation, made by `dealib export`."""

    displacement: tuple[Length, Length] = Field(description="of the mount: first and last")
    voltage: tuple[Voltage, Voltage] = Field(description="of the terminal: first and last")
    points: tuple[Points, Points] = Field(
        (13, 9), description="numbers of displacements and of voltages, equally spaced"
    )

    @property
    def axes(self) -> dict[str, tuple[float, ...]]:
        """First and last value of each variable."""
        return {"displacement": self.displacement, "voltage": self.voltage}

    def check(self, config: Any) -> None:
        """Raise `ValueAt` if the device has no such tables."""
        if config.physics.coupling != "energy":
            raise ValueAt(("physics", "coupling"), "tables come from one potential: energy only")
        for name, law in config.solids.items():
            if law.branches:
                where = f"materials.{name} has branches"
                raise ValueAt(("tables",), f"{where}: its force depends on time, which tables lack")
        for name in self.axes:
            if name not in config.device.variables:
                known = ", ".join(config.device.variables)
                raise ValueAt(("tables", name), f"the device has no {name}; it has {known}")

    @property
    def grid(self) -> tuple[Any, Any]:
        """Displacements and voltages from the first to the last, as arrays."""
        ends = (self.displacement, self.voltage)
        return tuple(np.linspace(*e, n) for e, n in zip(ends, self.points, strict=True))  # type: ignore[return-value]

    @model_validator(mode="after")
    def _ranges(self) -> Tables:
        for axis in ("displacement", "voltage"):
            first, last = getattr(self, axis)
            if first == last:
                raise ValueAt((axis,), "the first and the last value must differ")
        return self
