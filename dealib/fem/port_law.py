"""The equation of a port: a prescribed value, or the balance of its dual with what loads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class Element(Protocol):
    """A load that depends on the port's value, such as a spring."""

    def load(self, x: float) -> tuple[float, float]:
        """Load and its slope, which must be continuous, at a value x counted from the anchor."""


@dataclass
class PortLaw:
    """The equation of one port: its value is prescribed, or its dual balances the loads.

    Attributes:
        value: Prescribed value of the port; None if it is loaded instead.
        load: Load that does not depend on the port's value.
        elements: Elements that load it, each with the value of its anchor.
        mass: Mass that hangs on it and moves with it, kg.
        weights: Names and weights of ports. If there are any, the weighted sum of their values is
            prescribed instead of the port's own value, or is added to the dual of a loaded port.
    """

    value: float | None = None
    load: float = 0.0
    elements: tuple[tuple[Element, float], ...] = ()
    mass: float = 0.0
    weights: tuple[tuple[str, float], ...] = ()

    @property
    def fixed(self) -> bool:
        """Whether the port's own value is prescribed, so that its row and column are eliminated."""
        return self.value is not None and not self.weights

    def balance(self, q: float) -> tuple[float, float]:
        """Total load at a value of the port, and its slope."""
        found = [element.load(q - anchor) for element, anchor in self.elements]
        return self.load + sum(load for load, _ in found), sum(slope for _, slope in found)

    def residual(self, name: str, values: dict[str, float], internal: float) -> float:
        """Residual of the equation.

        Args:
            name: Name of the port.
            values: Values of all ports.
            internal: dPi/dq of the body at this port.
        """
        weighted = sum(weight * values[port] for port, weight in self.weights)
        if self.value is not None:
            return (weighted if self.weights else values[name]) - self.value
        return internal - self.balance(values[name])[0] + weighted
