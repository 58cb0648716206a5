"""Electrical quantities for drivers and sensors, in the config."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from dealib.errors import ValueAt, did_you_mean
from dealib.section import Section
from dealib.units import Resistance


class Sensing(Section):
    """Electrical quantities for drivers and sensors: additional columns of the history."""

    differential: bool = Field(
        False,
        description="small-signal capacitances and stiffness; costs one more tangent per step",
    )
    sheet_resistance: Resistance | None = Field(
        None,
        gt=0,
        description="sheet resistance of each electrode as mounted, per square; default: the "
        "resistance is not computed",
    )
    area_exponent: float = Field(
        1.0,
        ge=0,
        description="n: the sheet resistance grows as (area ratio)^n; 1: constant volume and "
        "resistivity",
    )
    charging: bool = Field(
        False,
        description="charge the electrodes in time through their resistance, from the contact; "
        "needs sheet_resistance",
    )
    contact: str | None = Field(
        None,
        description="end of the base at which the electrodes are contacted, by default the last; "
        "for a mesh file, one of its boundaries",
    )


def check_sensing(config: Any) -> None:
    """Raise `ValueAt` if the device cannot have resistive electrodes.

    Args:
        config: A `Config`.
    """
    sensing, charging = config.sensing, ("sensing", "charging")
    if sensing.sheet_resistance is None:
        if sensing.charging:
            raise ValueAt(charging, "needs sensing.sheet_resistance")
        return
    for other, there in {
        "sensing.differential": sensing.differential,
        "output.modes": config.output.modes > 0,
        "a stage with follow": any(s.follow is not None for s in config.program),
        "another coupling than energy": config.physics.coupling != "energy",
    }.items():
        if sensing.charging and there:
            raise ValueAt(charging, f"cannot be combined with {other}, which needs equilibria")
    where, contact = ("sensing", "sheet_resistance"), ("sensing", "contact")
    if config.device.kinematics.sheet:
        problem = "not for membranes, where each electrode has one potential; use model: solid"
        raise ValueAt(where, problem)
    laminate = config.device.laminate
    if laminate is None:
        if any(map(config.conducts, config.solids)):
            problem = "for a mesh file, only electrodes on boundaries can be resistive"
            raise ValueAt(where, problem)
        if sensing.contact is None:
            problem = "name the boundary of the mesh at which the electrodes are contacted"
            raise ValueAt(contact, problem)
        return
    ends = [end for end in laminate.base.ends if end is not None]
    if sensing.contact is not None and sensing.contact not in ends:
        hint = did_you_mean(sensing.contact, ends)
        raise ValueAt(contact, f"the base has no end {sensing.contact!r}{hint}")
