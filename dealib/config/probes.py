"""Probes in the config: quantities at a point, or taken over a region or boundary."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from dealib.errors import ValueAt, did_you_mean
from dealib.observe.local_quantities import local_quantities
from dealib.section import Section
from dealib.units import Length

Position = tuple[Length, ...]


class Probe(Section):
    """A quantity at a point of the mesh, or taken over a part of the device."""

    displacement: str | None = Field(None, description="axis whose displacement is measured")
    quantity: str | None = Field(
        None, description="any other quantity: E, phi, stretch_R, thickness_stretch, stress_RR, ..."
    )
    at: Position | None = Field(
        None, min_length=2, max_length=3, description="point of the undeformed mesh"
    )
    on: str | None = Field(None, description="region or boundary over which it is taken")
    take: Literal["mean", "max", "min", "integral"] = Field(
        "mean", description="how it is taken over the region or boundary"
    )

    @model_validator(mode="after")
    def _possible(self) -> Probe:
        if (self.displacement is None) == (self.quantity is None):
            raise ValueError("give one of displacement and quantity")
        if (self.at is None) == (self.on is None):
            raise ValueError("give one of `at`, a point, and `on`, a region or boundary")
        return self

    @property
    def measured(self) -> str:
        """Name of the local quantity."""
        return self.quantity or f"u_{self.displacement}"


def check_probes(config: Any) -> None:
    """Raise `ValueAt` if the device lacks the quantity or the place of a probe."""
    device = config.device
    known = local_quantities(device.kinematics)
    for name, probe in (config.probes or {}).items():
        where = ("probes", name)
        if probe.displacement is not None and probe.displacement not in device.kinematics.axes:
            axes = ", ".join(device.kinematics.axes)
            raise ValueAt((*where, "displacement"), f"not an axis of the device; it has {axes}")
        if probe.measured not in known:
            hint = did_you_mean(probe.measured, known)
            raise ValueAt((*where, "quantity"), f"unknown quantity {probe.measured!r}{hint}")
        if probe.at is not None and len(probe.at) != device.kinematics.dim:
            axes = ", ".join(device.kinematics.axes)
            raise ValueAt((*where, "at"), f"expected a coordinate along each of {axes}")
        parts = [*(r.name for r in device.regions), *device.boundaries]
        if probe.on is not None and probe.on not in parts:
            hint = did_you_mean(probe.on, parts)
            raise ValueAt((*where, "on"), f"the device has no {probe.on!r}{hint}")
