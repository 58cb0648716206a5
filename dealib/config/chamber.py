"""The content of a chamber: a closed gas, or a gas or a liquid that flows through openings."""

from __future__ import annotations

from pydantic import Field

from dealib.device.ports import Opening
from dealib.section import Section
from dealib.units import Density, Stress, Volume

_AIR = 1.2e-12  # density of air, t/mm^3
_LEAST = 1e-6  # least absolute pressure, as a share of that at rest


class Gas(Section):
    """Isothermal gas in a chamber; volume and pressure at rest give its amount."""

    volume: Volume = Field(gt=0, description="volume of the chamber at rest")
    pressure: Stress = Field(gt=0, description="absolute pressure at rest, such as 101.325 kPa")
    outside: Stress | None = Field(
        None, gt=0, description="absolute pressure outside; default that at rest"
    )

    def absolute(self, x: float) -> float:
        """Absolute pressure (MPa) at a pressure x (MPa) above that outside."""
        return max((self.outside or self.pressure) + x, _LEAST * self.pressure)

    def load(self, x: float) -> tuple[float, float]:
        """Displaced volume with a minus sign, as the load of the chamber.

        Args:
            x: Pressure above that outside, MPa.

        Returns:
            The load in mm^3, and its derivative by x in mm^3/MPa.
        """
        absolute = self.absolute(x)
        now = self.pressure * self.volume / absolute
        return self.volume - now, now / absolute


class Liquid(Section):
    """Incompressible liquid that flows through a chamber's openings."""

    density: Density = Field(gt=0, description="density of the liquid, such as 1000 kg/m^3")


class Filled(Section):
    """The content of a chamber with openings, over a step by the implicit Euler method.

    Attributes:
        openings: By name.
        gas: The gas; None: a liquid.
        density: Density of the gas or liquid that flows, t/mm^3.
        amount: Amount at the start of the step: displaced volume of a liquid, mm^3; pressure
            times volume of a gas, mJ.
        pressure: Pressure at the start of the step, above that outside, MPa.
        step: Length of the step, s; 0: nothing flows.
    """

    openings: dict[str, Opening]
    gas: Gas | None = None
    density: float = Field(_AIR, gt=0)
    amount: float
    pressure: float = 0.0
    step: float = 0.0

    @classmethod
    def of(
        cls,
        openings: dict[str, Opening],
        gas: Gas | None,
        liquid: Liquid | None,
        volume: float,
        pressure: float,
    ) -> Filled:
        """The content at the start of a stage.

        Args:
            openings: By name.
            gas: The gas; None: a liquid, or air without an effect of its own on the pressure.
            liquid: The liquid, if it is one.
            volume: Displaced volume, mm^3.
            pressure: Pressure above that outside, MPa.
        """
        amount, density = volume, _AIR
        if gas is not None:
            amount = gas.pressure * gas.volume
        elif liquid is not None:
            density = liquid.density
        return cls.model_construct(
            openings=openings, gas=gas, density=density, amount=amount, pressure=pressure, step=0.0
        )

    def flows(self, x: float) -> dict[str, tuple[float, float]]:
        """Volume flow into the chamber through each opening.

        Args:
            x: Pressure in the chamber above that outside, MPa.

        Returns:
            Flow in mm^3/s and its derivative by x in mm^3/s/MPa, by name.
        """
        return {name: o.inflow(x, self.density) for name, o in self.openings.items()}

    def held(self, x: float) -> tuple[float, float]:
        """The amount at the end of the step and its derivative by the pressure x (MPa)."""
        amount, slope = self.amount, 0.0
        for name, (flow, change) in self.flows(x).items():
            if self.gas is None:
                amount, slope = amount + self.step * flow, slope + self.step * change
                continue
            leaves = flow < 0  # gas has the pressure of the side from which it flows
            absolute = self.gas.absolute(x if leaves else self.openings[name].pressure)
            amount += self.step * flow * absolute
            slope += self.step * (change * absolute + flow * leaves)
        return amount, slope

    def load(self, x: float) -> tuple[float, float]:
        """See `Gas.load`."""
        amount, slope = self.held(x)
        if self.gas is None:
            return -amount, -slope
        absolute = self.gas.absolute(x)
        return self.gas.volume - amount / absolute, (amount / absolute - slope) / absolute

    def leak(self, x: float) -> float:
        """Derivative of the volume flow out of all openings by the pressure, mm^3/s/MPa.

        Args:
            x: Pressure in the chamber above that outside, MPa.
        """
        held = self.model_copy(update={"step": 1.0}).held(x)[1]
        return -held if self.gas is None else -held / self.gas.absolute(x)

    def after(self, x: float) -> Filled:
        """The content at the end of the step, at a pressure x (MPa) above that outside."""
        return self.model_copy(update={"amount": self.held(x)[0], "pressure": x, "step": 0.0})
