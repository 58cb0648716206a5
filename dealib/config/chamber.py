"""What is in a chamber: a closed gas, or a gas or a liquid that flows through openings."""

from __future__ import annotations

from pydantic import Field

from dealib.device.ports import Opening
from dealib.section import Section
from dealib.units import Density, Stress, Volume

_GAS, _LEAST = 1.2e-12, 1e-6  # density of air, t/mm^3; share of the rest pressure


class Gas(Section):
    """Gas in a closed chamber, isothermal: what it would have at rest says how much there is."""

    volume: Volume = Field(gt=0, description="volume of the chamber at rest")
    pressure: Stress = Field(gt=0, description="absolute pressure at rest, such as 101.325 kPa")
    outside: Stress | None = Field(
        None, gt=0, description="absolute pressure outside; default that at rest"
    )

    def load(self, x: float) -> tuple[float, float]:
        """Minus the displaced volume (mm^3) at a pressure x above that outside, and its slope."""
        absolute = max((self.outside or self.pressure) + x, 1e-6 * self.pressure)
        now = self.pressure * self.volume / absolute
        return self.volume - now, now / absolute


class Liquid(Section):
    """Liquid that flows through a chamber's openings; it does not expand."""

    density: Density = Field(gt=0, description="density of the liquid, such as 1000 kg/m^3")


class Filled(Section):
    """What is in a chamber with openings, over a step by implicit Euler.

    Attributes:
        openings: By name.
        gas: Its state at rest; None: a liquid.
        density: Of what flows, t/mm^3.
        amount: At the start of the step: of a liquid its displaced volume, mm^3; of a gas pressure
            times volume, mJ.
        pressure: Then, above that outside, MPa.
        step: Length of the step, s; 0: nothing flows.
    """

    openings: dict[str, Opening]
    gas: Gas | None = None
    density: float = Field(_GAS, gt=0)
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
        """At the start of a stage, at a displaced volume (mm^3) and a pressure (MPa)."""
        amount, density = volume, _GAS
        if gas is not None:
            amount = gas.pressure * gas.volume
        elif liquid is not None:
            density = liquid.density
        return cls.model_construct(
            openings=openings, gas=gas, density=density, amount=amount, pressure=pressure, step=0.0
        )

    def flows(self, x: float) -> dict[str, tuple[float, float]]:
        """Volume a time that flows in through each opening, mm^3/s, and its slope.

        Args:
            x: Pressure in the chamber above that outside, MPa.
        """
        return {name: o.inflow(x, self.density) for name, o in self.openings.items()}

    def _absolute(self, x: float) -> float:
        assert self.gas is not None
        outside = self.gas.outside or self.gas.pressure
        return max(outside + x, _LEAST * self.gas.pressure)

    def held(self, x: float) -> tuple[float, float]:
        """The amount at the end of the step, and its slope."""
        amount, slope = self.amount, 0.0
        for name, (flow, change) in self.flows(x).items():
            if self.gas is None:
                amount, slope = amount + self.step * flow, slope + self.step * change
                continue
            here = flow < 0  # it has the pressure of where it comes from
            absolute = self._absolute(x if here else self.openings[name].pressure)
            amount += self.step * flow * absolute
            slope += self.step * (change * absolute + flow * here)
        return amount, slope

    def load(self, x: float) -> tuple[float, float]:
        """Minus the displaced volume (mm^3) at a pressure x above that outside, and its slope."""
        amount, slope = self.held(x)
        if self.gas is None:
            return -amount, -slope
        absolute = self._absolute(x)
        return self.gas.volume - amount / absolute, (amount / absolute - slope) / absolute

    def leak(self, x: float) -> float:
        """What flows out a time and pressure, mm^3/s/MPa, as if nothing had flowed in the step.

        Args:
            x: Pressure in the chamber above that outside, MPa.
        """
        held = self.model_copy(update={"step": 1.0}).held(x)[1]
        return -held if self.gas is None else -held / self._absolute(x)

    def after(self, x: float) -> Filled:
        """The next state."""
        return self.model_copy(update={"amount": self.held(x)[0], "pressure": x, "step": 0.0})
