"""Self-sensing: the capacitance over displacement and voltage, and back from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.errors import ConfigError
from dealib.results.elements import Array

if TYPE_CHECKING:
    import pandas

_FEWEST = 6  # displacements at one voltage that make a curve


@dataclass(frozen=True)
class Sweep:
    """Capacitances at one voltage.

    Attributes:
        voltage: kV.
        displacement: Of the mount, mm, ascending.
        capacitance: pF.
    """

    voltage: float
    displacement: Array
    capacitance: Array

    def at(self, displacement: Any) -> Any:
        """Capacitance at displacements, by a cubic spline."""
        return self._spline(displacement)

    def sensitivity(self, displacement: Any) -> Any:
        """DC/du at displacements, pF/mm."""
        return self._spline(displacement, 1)

    @property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.displacement, self.capacitance)


class CapacitanceMap:
    """C(u, V) from sweeps of the displacement at several voltages.

    Over the displacement a cubic spline; over the voltage the polynomial in V^2 through all sweeps,
    since no quantity of the device knows the voltage's sign.

    Attributes:
        sweeps: By voltage, ascending.
        low: Smallest displacement that all sweeps share, mm.
        high: Largest one.
    """

    def __init__(self, sweeps: Sequence[Sweep]) -> None:
        self.sweeps = sorted(sweeps, key=lambda s: s.voltage)
        self.low = max(float(s.displacement[0]) for s in self.sweeps)
        self.high = min(float(s.displacement[-1]) for s in self.sweeps)

    @classmethod
    def of(
        cls, histories: Sequence[pandas.DataFrame], column: str = "capacitance_pF"
    ) -> CapacitanceMap:
        """All sweeps in histories: at least six displacements at one voltage.

        Raises:
            ConfigError: If there is none, or they share no displacements.
        """
        found: dict[float, dict[float, float]] = {}
        for h in histories:
            for u, V, C in h[["displacement_mm", "voltage_kV", column]].to_numpy():
                found.setdefault(round(abs(V), 9), {})[round(u, 9)] = C
        sweeps = [
            Sweep(V, *np.array(sorted(points.items())).T)
            for V, points in found.items()
            if len(points) >= _FEWEST
        ]
        if not sweeps:
            raise ConfigError(
                f"no map: it takes at least {_FEWEST} displacements at one voltage, such as in "
                "configs/sensing.yaml"
            )
        made = cls(sweeps)
        if made.low >= made.high:
            raise ConfigError("no map: the sweeps at different voltages share no displacements")
        return made

    def capacitance(self, displacement: Any, voltage: float) -> Any:
        """C(u, V), pF."""
        return self._over_voltage([s.at(displacement) for s in self.sweeps], voltage)

    def sensitivity(self, displacement: Any, voltage: float) -> Any:
        """DC/du at constant voltage, pF/mm."""
        return self._over_voltage([s.sensitivity(displacement) for s in self.sweeps], voltage)

    def _over_voltage(self, values: list[Any], voltage: float) -> Any:
        from scipy.interpolate import barycentric_interpolate

        squares = [s.voltage**2 for s in self.sweeps]
        found = barycentric_interpolate(squares, np.asarray(values), voltage**2)
        return np.asarray(found).reshape(np.shape(values[0]))

    def displacement(self, capacitance: float, voltage: float) -> float:
        """Displacement from the capacitance and the voltage, mm: of the shared range, lowest first.

        Raises:
            ValueError: If the map knows no such capacitance at this voltage.
        """
        from scipy.optimize import brentq

        u = np.linspace(self.low, self.high, 201)
        off = self.capacitance(u, voltage) - capacitance
        rounding = 1e-9 * abs(capacitance)
        off[np.abs(off) < rounding] = 0.0
        where = np.flatnonzero(off[1:] * off[:-1] <= 0)
        if len(where) == 0:
            raise ValueError(
                f"no displacement from {self.low:g} to {self.high:g} mm has {capacitance:g} pF at "
                f"{voltage:g} kV"
            )
        if off[where[0]] == 0:
            return float(u[where[0]])

        def difference(x: float) -> float:
            return float(self.capacitance(x, voltage)) - capacitance

        return float(brentq(difference, u[where[0]], u[where[0] + 1], xtol=1e-12))

    def errors(self) -> list[tuple[float, float]]:
        """Voltage (kV) and largest error of `displacement` (mm), by leaving points out.

        Every second displacement of all sweeps makes a map of its own, which is asked for the
        others.
        """
        half = CapacitanceMap(
            [Sweep(s.voltage, s.displacement[::2], s.capacitance[::2]) for s in self.sweeps]
        )
        found = []
        for s in self.sweeps:
            inside = (s.displacement > half.low) & (s.displacement < half.high)
            inside[::2] = False
            points = zip(s.displacement[inside], s.capacitance[inside], strict=True)
            off = [abs(half.displacement(C, s.voltage) - u) for u, C in points]
            found.append((s.voltage, max(off, default=np.nan)))
        return found
