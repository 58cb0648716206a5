"""The columns that the history of a config's device can have, probes included."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from dealib.device.device import Device
from dealib.device.records import CHAMBER, Port
from dealib.errors import ValueAt
from dealib.observe.local_quantities import local_quantities
from dealib.observe.quantities import QUANTITIES, Quantity, Snapshot


@dataclass(frozen=True)
class Column:
    """A column of one device.

    Attributes:
        name: In the history.
        quantity: Its quantity.
        ports: Its port, or pair of ports.
        probe: Whether a probe of the config measures it.
    """

    name: str
    quantity: Quantity
    ports: tuple[Port, ...] = ()
    probe: bool = False

    @property
    def unit(self) -> str:
        """Its unit."""
        return self.quantity.unit

    @property
    def label(self) -> str:
        """Name in pictures and tables, such as 'displacement of plate'."""
        names = dict.fromkeys(port.name for port in self.ports if port.suffix)
        return f"{self.quantity.label} of {' and '.join(names)}" if names else self.quantity.label

    def measure(self, s: Snapshot) -> float:
        """Its value in a state (collective)."""
        assert self.quantity.measure is not None
        return self.quantity.measure(s, *self.ports)


def columns(config: Any) -> dict[str, Column]:
    """All columns that the history of a config's device can have, in order."""
    found = [c for quantity in QUANTITIES for c in _columns(quantity, config.device)]
    for opening in (name for port in config.device.of(CHAMBER) for name, _ in port.openings):
        told = f"inflow through {opening}"
        quantity = Quantity(
            f"inflow_mm3.{opening}", "mm3", told, lambda s, name=opening: s.through.get(name, 0.0)
        )
        found.append(Column(quantity.name, quantity))
    known = local_quantities(config.device.kinematics)
    for name, probe in (config.probes or {}).items():
        of = known[probe.measured]
        unit, suffix = of.unit, of.suffix
        if probe.take == "integral":
            unit, suffix = "", ""
        extreme = probe.on is not None and probe.take in ("max", "min")
        measure = lambda s, name=name: s.probe(name)  # noqa: E731
        quantity = Quantity(name + suffix, unit, name, measure, extreme=extreme)
        if any(quantity.name == column.name for column in found):
            problem = f"the history has a column {quantity.name} already; choose another name"
            raise ValueAt(("probes", name), problem)
        found.append(Column(quantity.name, quantity, probe=True))
    return {column.name: column for column in found}


def _columns(quantity: Quantity, device: Device) -> Iterator[Column]:
    if quantity.kind is None:
        yield Column(quantity.name, quantity)
        return
    ports = device.of(quantity.kind)
    if quantity.pairs and len(ports) > 1:
        for a in ports:
            for b in ports:
                yield Column(f"{quantity.name}.{a.name}.{b.name}", quantity, (a, b))
        return
    for port in ports:
        yield Column(quantity.name + port.suffix, quantity, (port,))


def measured(config: Any) -> list[Column]:
    """Columns that are measured in each state of a run."""
    return [
        column
        for column in columns(config).values()
        if column.quantity.measure is not None and column.quantity.needs.has(config)
    ]
