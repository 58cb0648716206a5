"""Work done through the ports, and whether the energy balance closes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from dealib.device.device import Device

Two = tuple[float, float]
STORED = ("elastic_energy_mJ", "electric_energy_mJ", "kinetic_energy_mJ")
LOST = ("dissipated_energy_mJ", "damped_energy_mJ", "numerical_dissipation_mJ", "electrode_loss_mJ")


@dataclass
class Work:
    """Accumulates the work of all ports by the trapezoidal rule.

    The balance compares it with the stored and the dissipated energy. The residual is the error of
    the rule between the recorded states, of second order in the increments.

    Attributes:
        done: Work of each port so far, mJ.
        stored: Energy stored in the first state, mJ.
    """

    done: dict[str, float] = field(default_factory=dict)
    stored: float = 0.0

    def add(
        self,
        device: Device,
        last: Mapping[str, Two] | None,
        now: Mapping[str, Two],
        stored: float,
        dissipated: float,
    ) -> dict[str, float]:
        """Columns for a new row of the history, which follows the last one.

        Args:
            device: The device.
            last: Value and dual of each port in the last state; None before the first.
            now: The same now.
            stored: Elastic, electric and kinetic energy, mJ.
            dissipated: Energy dissipated so far, mJ.
        """
        if last is None:
            self.stored, self.done = stored, {port.name: 0.0 for port in device.ports}
        else:
            for port in device.ports:
                one, other = last[port.name], now[port.name]
                k = 0 if port.kind.sign > 0 else 1  # the variable whose change does the work
                mean = (one[1 - k] + other[1 - k]) / 2
                self.done[port.name] += mean * (other[k] - one[k])
        columns = {
            port.named(f"{port.kind.name}_work_mJ"): self.done[port.name] for port in device.ports
        }
        residual = stored + dissipated - self.stored - sum(self.done.values())
        return columns | {"energy_residual_mJ": residual}
