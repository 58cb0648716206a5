"""What a stage prescribes: port inputs as polylines in the stage's time."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from dealib.config.bias import BiasElement, Element, SecondFilm
from dealib.config.chamber import Filled, Gas
from dealib.config.inputs import ChamberInput, Course, Input, MountInput, elements
from dealib.config.program import Stage
from dealib.config.wave import Wave
from dealib.device.device import Device
from dealib.device.records import Port, PortKind
from dealib.fem.port_law import PortLaw
from dealib.program.waves import Waveform
from dealib.units import DIMENSIONS, GRAVITY

Kind = Literal["value", "load", "element"]
Sample = Callable[[SecondFilm], Element]


@dataclass(frozen=True)
class Drive:
    """One input of a port during a stage.

    Attributes:
        label: Name of the input, such as 'mount.force'.
        unit: Its unit, for messages.
        kind: Whether the port's value, its dual (load), or the anchor of an element is prescribed.
        knots: Values at equal distances in time over one cycle.
        shape: A wave instead; the first knot is its value at the start.
        sign: Factor from the prescribed dual to dPi/dq.
        element: The element, if `kind` is 'element'.
        weighs: Whether it is the weight of a mass, which moves with the port.
    """

    label: str
    unit: str
    kind: Kind
    knots: tuple[float, ...]
    sign: float = 1.0
    element: Element | Gas | Filled | None = None
    shape: Waveform | None = None
    weighs: bool = False

    def at(self, cycle_fraction: float) -> float:
        """The input at a time, in cycles since the stage began."""
        if self.shape is not None:
            return self.shape.at(cycle_fraction, self.knots[0])
        cycle = max(int(np.ceil(cycle_fraction)) - 1, 0)
        knots = self.in_cycle(cycle)
        return float(np.interp(cycle_fraction - cycle, _times(len(knots)), knots))

    def in_cycle(self, cycle: int) -> tuple[float, ...]:
        """Knots of a cycle, counted from 0.

        The first knot is the value before the stage, and is left out of later cycles unless the
        course returns to it.
        """
        return self.knots[1:] if cycle and self.knots[0] != self.knots[-1] else self.knots

    def held(self, cycle_fraction: float) -> Drive:
        """The same drive, held at its value at a time."""
        return replace(self, knots=(self.at(cycle_fraction),) * 2, shape=None)

    def plain(self) -> dict[str, Any]:
        """As numbers, texts, lists and dicts."""
        found = {f.name: getattr(self, f.name) for f in fields(self)}
        element, shape = self.element, self.shape
        return found | {
            "element": element and element.model_dump(),
            "shape": shape and shape.plain(),
        }

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Drive:
        """Inverse of `plain`, also after a round trip through JSON."""
        element = plain["element"] and elements().validate_python(plain["element"])
        shape = plain["shape"] and Waveform.restored(plain["shape"])
        knots = tuple(plain["knots"])
        return cls(**{**plain, "knots": knots, "element": element, "shape": shape})


@functools.cache
def _times(count: int) -> Any:
    return np.linspace(0, 1, count)


Drives = tuple[Drive, ...]  # of one port: a value, or loads and elements that add up


def law(drives: Drives, cycle_fraction: float) -> PortLaw:
    """The equation of a port at a time in the stage, from the drives that act on it."""
    if drives[0].kind == "value":
        return PortLaw(value=drives[0].at(cycle_fraction))
    return PortLaw(
        load=sum(d.sign * d.at(cycle_fraction) for d in drives if d.element is None),
        elements=tuple((d.element, d.at(cycle_fraction)) for d in drives if d.element is not None),
        mass=sum(max(0.0, *(-k for k in d.knots[1:])) / GRAVITY for d in drives if d.weighs),
    )


def _label(port: Port, text: str) -> str:
    """A label such as 'mount.force', or 'mounts.plate.force' where there are several mounts."""
    head = f"{port.kind.name}s.{port.name}" if port.suffix else port.kind.name
    return f"{head}.{text}"


def plain_drive(port: Port, name: str, knots: tuple[float, ...]) -> Drive:
    """The drive of a prescribed port variable."""
    label, (primal, dual) = _label(port, name), port.kind.variables
    if name == primal.name:
        return Drive(label, DIMENSIONS[primal.dimension][0], "value", knots)
    return Drive(label, DIMENSIONS[dual.dimension][0], "load", knots, port.kind.sign)


def rest(device: Device) -> dict[str, Drives]:
    """Drives at rest: the values of all ports are zero, of floating conductors the charge."""
    found: dict[str, Drives] = {}
    for port in device.ports:
        name = (port.kind.dual if port.floating else port.kind.primal).name
        found[port.name] = (plain_drive(port, name, (0.0, 0.0)),)
    return found


def drives(
    port: Port,
    given: Input,
    primal: float,
    dual: float,
    before: Drives = (),
    sample: Sample | None = None,
    stage: Stage | None = None,
) -> Drives:
    """The drives of a port in a stage.

    Args:
        port: The port.
        given: The stage's input.
        primal: Value of the port when the stage starts.
        dual: Its dual then.
        before: Its drives in the stage before, held.
        sample: Computes the force curve of a second film.
        stage: The stage, for a wave.
    """
    dual = _prescribed(before, dual)
    name, value = given.given
    for variable, start in zip(port.kind.variables, (primal, dual), strict=True):
        if name == variable.name:
            drive = plain_drive(port, name, (start, start))
            return (_moved(drive, start, value, (stage, name, variable.dimension)),)
    if isinstance(given, MountInput):
        return _loaded(port, given, primal, dual, before, sample, stage)
    assert isinstance(given, ChamberInput)
    inside: Gas | Filled | None = given.gas
    if port.openings:
        inside = Filled.of(dict(port.openings), given.gas, given.liquid, dual, primal)
    drive = Drive(_label(port, name), "MPa", "element", (0.0, 0.0), element=inside)
    return _released(port, (drive,), primal, dual)


def _loaded(
    port: Port,
    given: MountInput,
    displacement: float,
    force: float,
    before: Drives,
    sample: Sample | None,
    stage: Stage | None,
) -> Drives:
    """Drives of a mount that masses, springs or other elements load."""
    if given.mass is not None:
        drive = Drive(_label(port, "mass (as force)"), "N", "load", (), weighs=True)
        return (_moved(drive, force, _weights(given.mass)),)
    if given.spring is not None:
        anchor = displacement + force / given.spring.stiffness
        label = _label(port, "spring.anchor")
        new = Drive(label, "mm", "element", (), element=given.spring)
        if before and _same(before[0], new):
            anchor = before[0].knots[-1]
        return (_moved(new, anchor, given.spring.anchor, (stage, "anchor", "length")),)
    assert given.bias is not None
    parts = enumerate(given.bias)
    found = tuple(_bias(port, i, part, before, sample, stage) for i, part in parts)
    return _released(port, found, displacement, force)


def _released(port: Port, new: Drives, primal: float, dual: float) -> Drives:
    """Add the load that balances the port at the start; it is ramped to zero during the stage."""
    internal = port.kind.sign * dual
    previous = internal - law(new, 0.0).balance(primal)[0]
    if abs(previous) <= 1e-9 * abs(internal):
        return new
    label = _label(port, "previous load (ramped to zero)")
    return (*new, Drive(label, DIMENSIONS[port.kind.dual.dimension][0], "load", (previous, 0.0)))


def _bias(
    port: Port,
    index: int,
    part: BiasElement,
    before: Drives,
    sample: Sample | None,
    stage: Stage | None,
) -> Drive:
    """The drive of one bias element; its anchor moves on if the element was there before."""
    (path, course), (_, given) = part.course, part.given
    label = _label(port, ".".join(("bias", str(index), *path)))
    if isinstance(given, tuple):
        course = _weights(given)
        new = Drive(f"{label} (as force)", "N", "load", course, weighs=True)
    else:
        if isinstance(given, SecondFilm):
            assert sample is not None
            course, label = given.anchor, _label(port, f"bias.{index}.film (its frame)")
            given = sample(given)
        new = Drive(label, "mm", "element", (), element=given)
    same = index < len(before) and _same(before[index], new)
    of = (stage, "anchor", "length")
    start = before[index].knots[-1] if same else None
    return _moved(new, start, course, of)


def _moved(
    drive: Drive,
    start: float | None,
    course: Course,
    of: tuple[Stage | None, str, str] | None = None,
) -> Drive:
    """A drive with its course over a stage.

    Args:
        drive: The drive.
        start: Value at the start; None: the first value of the course.
        course: The course.
        of: For a wave the stage, the quantity, and its dimension.
    """
    if not isinstance(course, Wave):
        return replace(drive, knots=_from(course[0] if start is None else start, course))
    assert of is not None
    stage, quantity, dimension = of
    assert stage is not None
    shape = Waveform.of(course, stage, quantity, dimension)
    return replace(drive, knots=(shape.begin() if start is None else start,), shape=shape)


def _same(old: Drive, new: Drive) -> bool:
    """Whether two drives have the same label and element, so that one continues the other."""
    return (old.label, _fixed(old.element)) == (new.label, _fixed(new.element))


def _fixed(element: Element | Gas | Filled | None) -> Any:
    """The values of an element without its anchor."""
    return element and element.model_dump(exclude={"anchor"})


def _weights(masses: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(-m * GRAVITY for m in masses)


def _prescribed(before: Drives, measured: float) -> float:
    """The dual at the start of a stage: the prescribed one if there was one, else the measured."""
    loads = bool(before) and all(d.kind == "load" for d in before)
    return sum(d.knots[-1] for d in before) if loads else measured


def _from(start: float, knots: tuple[float, ...]) -> tuple[float, ...]:
    """Knots of a list; the start is put first unless the list begins with it."""
    if len(knots) > 1 and abs(knots[0] - start) <= 1e-9 * max(map(abs, (*knots, start))):
        return knots
    return (start, *knots)


def driven_by(device: Device, kind: PortKind, found: dict[str, Drives], at: float) -> bool:
    """Whether a kind's primal, such as a voltage, is prescribed at a time, other than zero."""
    ports = (found[port.name] for port in device.of(kind))
    return any(d.kind == "value" and d.at(at) != 0 for drives in ports for d in drives)


def milestones(stage: Stage, drives: list[Drive]) -> tuple[list[float], set[float]]:
    """Times of a stage, in cycles, at which a state is wanted.

    Args:
        stage: The stage.
        drives: Its drives.

    Returns:
        All times in order, and those among them where an input has a corner.
    """
    corners = [
        c + k / (len(d.in_cycle(c)) - 1)
        for d in drives
        for c in range(stage.cycles)
        for k in range(1, len(d.in_cycle(c)))
        if d.shape is None
    ]
    grid = [c + k / stage.count for c in range(stage.cycles) for k in range(1, stage.count + 1)]
    exact = {round(t, 12): t for t in [*corners, *grid]}  # times that differ by rounding are one
    return sorted(exact.values()), {exact[round(t, 12)] for t in corners}
