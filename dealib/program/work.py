"""Work done through the ports, and whether the energy balance closes."""

from __future__ import annotations

from typing import Any


class Work:
    """Accumulates the work of mount and terminal by the trapezoidal rule.

    The balance compares it with the stored energy, elastic plus electric; what remains is the
    error of the rule between the recorded states, of second order in the increments.
    """

    def __init__(self) -> None:
        self.mount = self.terminal = 0.0
        self._last: dict[str, Any] | None = None
        self._stored = 0.0

    def add(self, row: dict[str, Any]) -> dict[str, float]:
        """Columns for a new row of the history."""
        stored = row["elastic_energy_mJ"] + row["electric_energy_mJ"]
        if self._last is None:
            self._stored = stored
        else:
            a, b = self._last, row
            self.mount += (
                (a["force_N"] + b["force_N"]) / 2 * (b["displacement_mm"] - a["displacement_mm"])
            )
            self.terminal += (
                (a["voltage_kV"] + b["voltage_kV"]) / 2 * (b["charge_uC"] - a["charge_uC"])
            )
        self._last = row
        return {
            "mount_work_mJ": self.mount,
            "terminal_work_mJ": self.terminal,
            "energy_residual_mJ": stored - self._stored - self.mount - self.terminal,
        }
