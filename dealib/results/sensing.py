"""Self-sensing: capacitance as a function of displacement and voltage, and its inverse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.arrays import Array
from dealib.errors import ConfigError
from dealib.results.bias import crossings
from dealib.section import leaves

if TYPE_CHECKING:
    import pandas

    from dealib.config.schema import Config
    from dealib.results.reader import Run

_FEWEST = 6  # displacements at one voltage that make a curve
_APART = 1e-4  # of the range of displacements: closer states are one
_PARTS = {"geometry", "mesh", "materials", "physics"}  # the rest is how it is driven and solved
_TOLD = 4  # differing keys


@dataclass(frozen=True)
class Sweep:
    """Capacitances at one voltage.

    Attributes:
        voltage: Voltage, kV.
        displacement: Displacements of the mount, ascending, (points,), mm.
        capacitance: Capacitances, (points,), pF.
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

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.displacement, self.capacitance)

    @classmethod
    def of(cls, voltage: float, states: Array, apart: float) -> Sweep:
        """The sweep of all states at a voltage.

        Args:
            voltage: Voltage, kV.
            states: Displacements (mm) and capacitances (pF), (states, 2).
            apart: States whose displacements are closer than this are averaged, mm.

        Raises:
            ConfigError: If there are two capacitances at one displacement.
        """
        u, C = states[np.argsort(states[:, 0], kind="stable")].T
        steepest = 10 * np.ptp(C) / (np.ptp(u) or 1.0)  # steeper than any curve of capacitance
        groups = np.flatnonzero(np.diff(u) > apart) + 1
        means = []
        for here, there in zip(np.split(u, groups), np.split(C, groups), strict=True):
            if np.ptp(there) > 1e-6 * there.max() + steepest * np.ptp(here):
                raise ConfigError(
                    f"no map: at {here[0]:.6g} mm and {voltage:g} kV there are both "
                    f"{there.min():.7g} and {there.max():.7g} pF"
                )
            means.append((here.mean(), there.mean()))
        return cls(voltage, *np.array(means).T)


class CapacitanceMap:
    """C(u, V) from sweeps of the displacement at several voltages.

    The map is a cubic spline over the displacement, and over the voltage the polynomial in V^2
    through all sweeps, since the capacitance does not depend on the sign of the voltage.

    Attributes:
        sweeps: Sweeps by ascending voltage.
        left_out: Voltages with too few states for a sweep, kV, ascending.
        low: Smallest displacement that all sweeps share, mm.
        high: Largest one.
    """

    def __init__(self, sweeps: Sequence[Sweep], left_out: Sequence[float] = ()) -> None:
        self.sweeps = sorted(sweeps, key=lambda s: s.voltage)
        self.left_out = sorted(left_out)
        self.low = max(float(s.displacement[0]) for s in self.sweeps)
        self.high = min(float(s.displacement[-1]) for s in self.sweeps)

    def __repr__(self) -> str:
        volts = ", ".join(f"{s.voltage:g}" for s in self.sweeps)
        return f"<CapacitanceMap {self.low:.4g} .. {self.high:.4g} mm at {volts} kV>"

    @classmethod
    def of(
        cls, histories: Sequence[pandas.DataFrame], column: str = "capacitance_pF"
    ) -> CapacitanceMap:
        """The map of all sweeps in histories; a sweep has at least six displacements.

        Raises:
            ConfigError: If there is no sweep, the sweeps share no range of displacements, or two
                states contradict each other.
        """
        wanted = ["displacement_mm", column, "voltage_kV"]
        missing = [c for c in wanted if not all(c in h for h in histories)]
        if missing:
            raise ConfigError(
                "no map: it needs a device with one mount and one terminal, and the history has no "
                f"{' and no '.join(missing)}"
            )
        states = [h[wanted].to_numpy() for h in histories]
        u_C, voltage = np.split(np.concatenate(states), [2], axis=1)
        voltage = np.round(np.abs(voltage[:, 0]), 9)
        apart = _APART * float(np.ptp(u_C[:, 0]))
        all_sweeps = [Sweep.of(float(V), u_C[voltage == V], apart) for V in np.unique(voltage)]
        sweeps = [s for s in all_sweeps if len(s.displacement) >= _FEWEST]
        if not sweeps:
            raise ConfigError(
                f"no map: it needs at least {_FEWEST} displacements at one voltage, as in "
                "configs/sensing.yaml"
            )
        made = cls(sweeps, [s.voltage for s in all_sweeps if s not in sweeps])
        if made.low >= made.high:
            raise ConfigError("no map: the sweeps at different voltages share no displacements")
        return made

    def capacitance(self, displacement: Any, voltage: float) -> Any:
        """C(u, V), pF.

        Raises:
            ValueError: If the voltage is outside the range of the sweeps.
        """
        return self._over_voltage([s.at(displacement) for s in self.sweeps], voltage)

    def sensitivity(self, displacement: Any, voltage: float) -> Any:
        """DC/du at constant voltage, pF/mm.

        Raises:
            ValueError: If the voltage is outside the range of the sweeps.
        """
        return self._over_voltage([s.sensitivity(displacement) for s in self.sweeps], voltage)

    def _over_voltage(self, values: list[Any], voltage: float) -> Any:
        from scipy.interpolate import barycentric_interpolate

        first, last = self.sweeps[0].voltage, self.sweeps[-1].voltage
        if not first - 1e-9 <= abs(voltage) <= last + 1e-9:
            place = f"ends at {last:g}" if abs(voltage) > last else f"begins at {first:g}"
            raise ValueError(f"{voltage:g} kV is not on the map, which {place} kV")
        if len(values) == 1:
            return values[0]
        squares = [s.voltage**2 for s in self.sweeps]
        found = barycentric_interpolate(squares, np.asarray(values), voltage**2)
        return np.asarray(found).reshape(np.shape(values[0]))

    def displacement(self, capacitance: float, voltage: float) -> float:
        """Lowest displacement in the shared range that has this capacitance at this voltage, mm.

        Raises:
            ValueError: If no displacement has it.
        """
        found = self._displacements(capacitance, voltage)
        if not found:
            raise ValueError(
                f"no displacement from {self.low:g} to {self.high:g} mm has {capacitance:g} pF at "
                f"{voltage:g} kV"
            )
        return found[0]

    def _displacements(self, capacitance: float, voltage: float) -> list[float]:
        def off(u: Array) -> Array:
            found = np.asarray(self.capacitance(u, voltage) - capacitance)
            return np.where(np.abs(found) < 1e-9 * abs(capacitance), 0.0, found)

        return crossings(self._grid, off)

    @property
    def _grid(self) -> Array:
        return np.linspace(self.low, self.high, 201)

    @property
    def turns(self) -> bool:
        """Whether the capacitance is not monotonic: two displacements then have the same one."""
        steps = np.array([np.diff(s.at(self._grid)) for s in self.sweeps])
        rise, fall = steps.clip(min=0).sum(axis=1), -steps.clip(max=0).sum(axis=1)
        return bool((np.minimum(rise, fall) > 1e-3 * np.maximum(rise, fall)).any())

    def errors(self) -> list[tuple[float, float]]:
        """Voltage (kV) and largest error of `displacement` (mm), estimated by cross-validation.

        A map of every second displacement is inverted at the other ones. If a capacitance is
        outside that map, the nearest one in it is taken, and if several displacements have it, the
        nearest displacement.
        """
        half = CapacitanceMap(
            [Sweep(s.voltage, s.displacement[::2], s.capacitance[::2]) for s in self.sweeps]
        )
        found = []
        for s in self.sweeps:
            inside = (s.displacement > half.low) & (s.displacement < half.high)
            inside[::2] = False
            points = zip(s.displacement[inside], s.capacitance[inside], strict=True)
            known = half.capacitance(half._grid, s.voltage)
            ends = known.min(), known.max()
            back = [(u, half._displacements(np.clip(C, *ends), s.voltage)) for u, C in points]
            off = [np.abs(np.array(ways) - u).min() for u, ways in back]
            found.append((s.voltage, float(max(off, default=np.nan))))
        return found


def check_device(runs: Sequence[Run]) -> None:
    """Check that runs are of one device whose state depends on displacement and voltage alone.

    Raises:
        ConfigError: If the devices differ (the message names the keys), or if a material depends on
            its history.
    """
    first, *others = devices = [_device(run.config) for run in runs]
    for run, device in zip(runs[1:], others, strict=True):
        keys = [k for k in {**first, **device} if first.get(k) != device.get(k)]
        if keys:
            told = [
                f"{k} ({first.get(k, 'not given')}, {device.get(k, 'not given')})"
                for k in keys[:_TOLD]
            ]
            told += [f"{len(keys) - _TOLD} keys more"] if len(keys) > _TOLD else []
            raise ConfigError(
                f"no map: {runs[0].directory} and {run.directory} differ in {', '.join(told)}"
            )
    for key in devices[0]:
        if key.endswith((".branches.0.shear_modulus", ".mullins.r", ".permanent_set.energy")):
            key = key.removesuffix(".0.shear_modulus").removesuffix(".r").removesuffix(".energy")
            raise ConfigError(
                f"{runs[0].directory}: no map: {key} make the capacitance depend on what came "
                "before; run it without them"
            )


def _device(config: Config) -> dict[str, Any]:
    """Dotted keys and values, without the names of materials' entries in the library."""
    found = leaves(config.model_dump(include=_PARTS, exclude_none=True))
    return {key: value for key, value in found if not key.endswith(".library")}
