"""Work done through the ports, and whether the energy balance closes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass
class Work:
    """Accumulates the work of mount and terminal by the trapezoidal rule.

    The balance compares it with the stored energy, elastic plus electric, and with what Maxwell
    branches have dissipated; what remains is the error of the rule between the recorded states, of
    second order in the increments.

    Attributes:
        mount: Work of the mount so far, mJ.
        terminal: Work of the terminal so far, mJ.
        stored: Energy stored in the first state, mJ.
    """

    mount: float = 0.0
    terminal: float = 0.0
    stored: float = 0.0

    def add(self, last: dict[str, Any] | None, row: dict[str, Any]) -> dict[str, float]:
        """Columns for a new row of the history, which follows the last one."""
        stored = row["elastic_energy_mJ"] + row["electric_energy_mJ"]
        if last is None:
            self.stored = stored
        else:
            force = (last["force_N"] + row["force_N"]) / 2
            self.mount += force * (row["displacement_mm"] - last["displacement_mm"])
            voltage = (last["voltage_kV"] + row["voltage_kV"]) / 2
            self.terminal += voltage * (row["charge_uC"] - last["charge_uC"])
        used = stored + row.get("dissipated_energy_mJ", 0.0)
        return {
            "mount_work_mJ": self.mount,
            "terminal_work_mJ": self.terminal,
            "energy_residual_mJ": used - self.stored - self.mount - self.terminal,
        }
