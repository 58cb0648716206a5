"""What a stage prescribes: port inputs as polylines in the stage's time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dealib.config.program import MountInput, Stage, TerminalInput
from dealib.fem.system import PortLaw
from dealib.units import GRAVITY

Kind = Literal["value", "load", "spring"]


@dataclass(frozen=True)
class Drive:
    """How a port is driven through a stage.

    Attributes:
        label: What the user prescribes, such as 'mount.force'.
        unit: Its unit, for messages.
        kind: The port's value, its dual, or a spring's anchor is prescribed.
        knots: Values at equal distances in time over one cycle.
        sign: From the user's dual to dPi/dq.
        stiffness: Of the spring, N/mm.
    """

    label: str
    unit: str
    kind: Kind
    knots: tuple[float, ...]
    sign: float = 1.0
    stiffness: float = 0.0

    def at(self, cycle_fraction: float) -> float:
        """The input at a time, in cycles since the stage began."""
        cycle = max(int(np.ceil(cycle_fraction)) - 1, 0)
        knots = self.in_cycle(cycle)
        return float(np.interp(cycle_fraction - cycle, np.linspace(0, 1, len(knots)), knots))

    def in_cycle(self, cycle: int) -> tuple[float, ...]:
        """The knots of a cycle, counted from 0: only the first one has to come to the list."""
        return self.knots[1:] if cycle and self.knots[0] != self.knots[-1] else self.knots

    def law(self, cycle_fraction: float) -> PortLaw:
        """The port's equation at a time."""
        value = self.at(cycle_fraction)
        if self.kind == "value":
            return PortLaw(value=value)
        if self.kind == "load":
            return PortLaw(load=self.sign * value)
        return PortLaw(stiffness=self.stiffness, origin=value)

    def held(self) -> Drive:
        """The same drive, staying at its last value."""
        return Drive(
            self.label, self.unit, self.kind, (self.knots[-1],) * 2, self.sign, self.stiffness
        )


REST = {
    "mount": Drive("mount.displacement", "mm", "value", (0.0, 0.0)),
    "terminal": Drive("terminal.voltage", "kV", "value", (0.0, 0.0)),
}


def mount_drive(given: MountInput, displacement: float, force: float) -> Drive:
    """The mount's drive in a stage that starts at a displacement (mm) and a force (N)."""
    if given.displacement is not None:
        knots = _from(displacement, given.displacement)
        return Drive("mount.displacement", "mm", "value", knots)
    if given.force is not None:
        return Drive("mount.force", "N", "load", _from(force, given.force))
    if given.mass is not None:
        weights = tuple(-m * GRAVITY for m in given.mass)
        return Drive("mount.mass (as force)", "N", "load", _from(force, weights))
    assert given.spring is not None
    k = given.spring.stiffness
    knots = _from(displacement + force / k, given.spring.anchor)
    return Drive("mount.spring.anchor", "mm", "spring", knots, stiffness=k)


def terminal_drive(given: TerminalInput, voltage: float, charge: float) -> Drive:
    """The terminal's drive in a stage that starts at a voltage (kV) and a charge (uC)."""
    if given.voltage is not None:
        return Drive("terminal.voltage", "kV", "value", _from(voltage, given.voltage))
    assert given.charge is not None
    return Drive("terminal.charge", "uC", "load", _from(charge, given.charge), sign=-1.0)


def _from(start: float, knots: tuple[float, ...]) -> tuple[float, ...]:
    """Knots that begin where the port is: a list that does not is reached from there first."""
    if len(knots) > 1 and abs(knots[0] - start) <= 1e-9 * max(map(abs, (*knots, start))):
        return knots
    return (start, *knots)


def milestones(stage: Stage, drives: list[Drive]) -> tuple[list[float], set[float]]:
    """Times of a stage, in cycles, at which a state is wanted.

    Args:
        stage: The stage.
        drives: Its drives.

    Returns:
        All times in order, and those among them where an input has a corner.
    """
    corners = {
        round(c + k / (len(d.in_cycle(c)) - 1), 12)
        for d in drives
        for c in range(stage.cycles)
        for k in range(1, len(d.in_cycle(c)))
    }
    grid = {
        round(c + k / stage.steps, 12)
        for c in range(stage.cycles)
        for k in range(1, stage.steps + 1)
    }
    return sorted(grid | corners), corners
