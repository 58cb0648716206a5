"""What a stage prescribes: port inputs as polylines in the stage's time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from dealib.config.bias import ELEMENT, BiasElement, Element, SecondFilm
from dealib.config.program import MountInput, Stage, TerminalInput
from dealib.fem.system import PortLaw
from dealib.units import GRAVITY

Kind = Literal["value", "load", "device"]


@dataclass(frozen=True)
class Drive:
    """One thing that drives a port through a stage.

    Attributes:
        label: What the user prescribes, such as 'mount.force'.
        unit: Its unit, for messages.
        kind: The port's value, its dual, or the anchor of a device is prescribed.
        knots: Values at equal distances in time over one cycle.
        sign: From the user's dual to dPi/dq.
        element: The device.
    """

    label: str
    unit: str
    kind: Kind
    knots: tuple[float, ...]
    sign: float = 1.0
    element: Element | None = None

    def at(self, cycle_fraction: float) -> float:
        """The input at a time, in cycles since the stage began."""
        cycle = max(int(np.ceil(cycle_fraction)) - 1, 0)
        knots = self.in_cycle(cycle)
        return float(np.interp(cycle_fraction - cycle, np.linspace(0, 1, len(knots)), knots))

    def in_cycle(self, cycle: int) -> tuple[float, ...]:
        """The knots of a cycle, counted from 0: only the first one has to come to the list."""
        return self.knots[1:] if cycle and self.knots[0] != self.knots[-1] else self.knots

    def held(self, cycle_fraction: float) -> Drive:
        """The same drive, staying at its value at a time."""
        return replace(self, knots=(self.at(cycle_fraction),) * 2)

    def plain(self) -> dict[str, Any]:
        """As numbers, texts, lists and dicts."""
        found = {f.name: getattr(self, f.name) for f in fields(self)}
        return found | {"element": self.element and self.element.model_dump()}

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Drive:
        """Inverse of `plain`, also after a round trip through JSON."""
        element = plain["element"] and ELEMENT.validate_python(plain["element"])
        return cls(**{**plain, "knots": tuple(plain["knots"]), "element": element})


Drives = tuple[Drive, ...]  # of one port: a value, or loads and devices that add up


def law(drives: Drives, cycle_fraction: float) -> PortLaw:
    """The equation at a time of a port that some drives act on."""
    if drives[0].kind == "value":
        return PortLaw(value=drives[0].at(cycle_fraction))
    return PortLaw(
        load=sum(d.sign * d.at(cycle_fraction) for d in drives if d.element is None),
        devices=tuple((d.element, d.at(cycle_fraction)) for d in drives if d.element is not None),
    )


_PLAIN: dict[str, tuple[str, str, Kind, float]] = {
    "displacement": ("mount.displacement", "mm", "value", 1.0),
    "force": ("mount.force", "N", "load", 1.0),
    "voltage": ("terminal.voltage", "kV", "value", 1.0),
    "charge": ("terminal.charge", "uC", "load", -1.0),
}


def plain_drive(variable: str, knots: tuple[float, ...]) -> Drive:
    """A port variable that is prescribed."""
    label, unit, kind, sign = _PLAIN[variable]
    return Drive(label, unit, kind, knots, sign)


REST = {
    "mount": (plain_drive("displacement", (0.0, 0.0)),),
    "terminal": (plain_drive("voltage", (0.0, 0.0)),),
}


def mount_drives(
    given: MountInput,
    displacement: float,
    force: float,
    before: Drives = (),
    sample: Callable[[SecondFilm], Element] | None = None,
) -> Drives:
    """The mount's drives in a stage.

    Args:
        given: The stage's input.
        displacement: Of the mount when the stage starts, mm.
        force: On it then, N.
        before: What drove it before, held.
        sample: Measures a second film.
    """
    force = _prescribed(before, force)
    if given.displacement is not None:
        return (plain_drive("displacement", _from(displacement, given.displacement)),)
    if given.force is not None:
        return (plain_drive("force", _from(force, given.force)),)
    if given.mass is not None:
        return (Drive("mount.mass (as force)", "N", "load", _from(force, _weights(given.mass))),)
    if given.spring is not None:
        anchor = displacement + force / given.spring.stiffness
        new = Drive("mount.spring.anchor", "mm", "device", (), element=given.spring)
        if before and _same(before[0], new):
            anchor = before[0].knots[-1]
        return (replace(new, knots=_from(anchor, given.spring.anchor)),)
    assert given.bias is not None
    drives = tuple(_bias(i, part, before, sample) for i, part in enumerate(given.bias))
    # what holds the mount when the stage starts lets go of it over the stage
    hand = force - law(drives, 0.0).balance(displacement)[0]
    if abs(hand) <= 1e-9 * abs(force):
        return drives
    return (*drives, Drive(_HAND, "N", "load", (hand, 0.0)))


_HAND = "mount.bias (not yet released)"


def _bias(
    index: int,
    part: BiasElement,
    before: Drives,
    sample: Callable[[SecondFilm], Element] | None,
) -> Drive:
    """One element; it moves on from where it was if it was there before."""
    (path, knots), (_, given) = part.polyline, part.given
    label = ".".join(("mount.bias", str(index), *path))
    if isinstance(given, tuple):
        new = Drive(f"{label} (as force)", "N", "load", _weights(given))
    else:
        if isinstance(given, SecondFilm):
            assert sample is not None
            knots, label = given.anchor, f"mount.bias.{index}.film (its frame)"
            given = sample(given)
        new = Drive(label, "mm", "device", knots, element=given)
    same = index < len(before) and _same(before[index], new)
    start = before[index].knots[-1] if same else new.knots[0]
    return replace(new, knots=_from(start, new.knots))


def _same(old: Drive, new: Drive) -> bool:
    """Whether a drive goes on moving what another one has moved."""
    return (old.label, _fixed(old.element)) == (new.label, _fixed(new.element))


def _fixed(element: Element | None) -> Any:
    """What identifies an element wherever its anchor is."""
    return element and element.model_dump(exclude={"anchor"})


def _weights(masses: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(-m * GRAVITY for m in masses)


def _prescribed(before: Drives, measured: float) -> float:
    """The dual at which a stage starts: what was prescribed, which is met to a tolerance only."""
    loads = bool(before) and all(d.kind == "load" for d in before)
    return sum(d.knots[-1] for d in before) if loads else measured


def terminal_drives(
    given: TerminalInput, voltage: float, charge: float, before: Drives = ()
) -> Drives:
    """The terminal's drives in a stage.

    Args:
        given: The stage's input.
        voltage: When the stage starts, kV.
        charge: Then, uC.
        before: What drove it before, held.
    """
    if given.voltage is not None:
        return (plain_drive("voltage", _from(voltage, given.voltage)),)
    assert given.charge is not None
    return (plain_drive("charge", _from(_prescribed(before, charge), given.charge)),)


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
