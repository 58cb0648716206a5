"""The chart of a biased film: force over displacement of film and bias, and their equilibria."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.arrays import Array
from dealib.files import write_text

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Equilibrium:
    """A state in which film and bias are in equilibrium.

    Attributes:
        voltage: Voltage of the film, kV.
        displacement: Displacement of the mount, mm.
        force: Force on the mount, N.
        stiffness: Slope of the film's force minus that of the bias, N/mm.
    """

    voltage: float
    displacement: float
    force: float
    stiffness: float

    @property
    def stable(self) -> bool:
        """Whether the equilibrium is stable at constant voltage."""
        return self.stiffness > 0


@dataclass(frozen=True)
class Stroke:
    """The quasi-static stroke of a biased film when the voltage is switched on and off.

    Attributes:
        start: Equilibrium without voltage.
        end: Equilibrium that the film reaches under voltage.
        back: Equilibrium that it reaches when the voltage is switched off again.
    """

    start: Equilibrium
    end: Equilibrium
    back: Equilibrium

    @property
    def length(self) -> float:
        """Distance by which the voltage moves the mount, mm."""
        return abs(self.end.displacement - self.start.displacement)

    @property
    def returns(self) -> bool:
        """Whether the mount returns to its start."""
        return self.back == self.start


@dataclass(frozen=True, repr=False)
class BiasChart:
    """Curves over one displacement, and their equilibria.

    Attributes:
        name: Name of the config.
        displacement: Displacements of the mount, mm, ascending, (points,).
        film: Force on the film's mount, N, (points,), by voltage (kV); the first one is at 0 kV.
        bias: Force of the bias, N, (points,).
        equilibria: Equilibria by voltage, by ascending displacement.
    """

    name: str
    displacement: Array
    film: dict[float, Array]
    bias: Array
    equilibria: dict[float, list[Equilibrium]]

    def __repr__(self) -> str:
        reach = f"{self.displacement[0]:.4g} .. {self.displacement[-1]:.4g} mm"
        counts = ", ".join(f"{len(e)} at {v:g} kV" for v, e in self.equilibria.items())
        return f"<BiasChart {self.name}: {reach}, equilibria: {counts}>"

    @property
    def frame(self) -> pandas.DataFrame:
        """The curves over the displacement as a table."""
        import pandas as pd

        film = {f"film_at_{volts:g}_kV_N": force for volts, force in self.film.items()}
        return pd.DataFrame({"displacement_mm": self.displacement, **film, "bias_N": self.bias})

    def strokes(self) -> list[Stroke]:
        """Strokes from each stable state without voltage to the state that it reaches under it."""
        rest, full = self.film
        found = []
        for start in self.equilibria[rest]:
            if start.stable:
                end = self._settle(start.displacement, full)
                back = end and self._settle(end.displacement, rest)
                if end and back:
                    found.append(Stroke(start, end, back))
        return found

    def notes(self) -> list[str]:
        """Notes on equilibria and ends of strokes that lie outside the chart."""
        reach = f"within {self.displacement[0]:g} .. {self.displacement[-1]:g} mm"
        found = [
            f"{volts:g} kV: film and bias do not meet {reach}"
            for volts, equilibria in self.equilibria.items()
            if not equilibria
        ]
        starts = [s.start for s in self.strokes()]
        rest, full = self.film
        return found + [
            f"the stroke from {e.displacement:.6f} mm at {full:g} kV does not end {reach}"
            for e in self.equilibria[rest]
            if e.stable and e not in starts and self.equilibria[full]
        ]

    def _settle(self, displacement: float, voltage: float) -> Equilibrium | None:
        """The stable state into which the forces at a displacement push the mount, if any."""
        film = np.interp(displacement, self.displacement, self.film[voltage])
        up = np.interp(displacement, self.displacement, self.bias) > film
        candidates = [e for e in self.equilibria[voltage] if e.stable]
        near = [e for e in candidates if abs(e.displacement - displacement) < 1e-9]
        above = [e for e in candidates if e.displacement > displacement]
        below = [e for e in candidates if e.displacement < displacement]
        ways = near or (above[:1] if up else below[-1:])
        return ways[0] if ways else None

    def write(self, curves: Path, equilibria: Path) -> None:
        """Write both as CSV files."""
        table = self.frame
        _write(curves, list(map(str, table)), table.to_numpy().tolist())
        points = [e for of_voltage in self.equilibria.values() for e in of_voltage]
        _write(
            equilibria,
            ["voltage_kV", "displacement_mm", "force_N", "stiffness_N_per_mm", "stable"],
            [
                [e.voltage, e.displacement, e.force, e.stiffness, float(e.stable)]
                for e in points
            ],
        )  # fmt: skip


def _write(path: Path, header: list[str], rows: list[list[float]]) -> None:
    lines = [",".join(header), *(",".join(f"{v:.10g}" for v in row) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def crossings(x: Array, net: Callable[[Array], Any]) -> list[float]:
    """Zeros of a continuous function: one between any two neighbouring points of different sign."""
    from scipy.optimize import brentq

    values = net(x)
    found = [
        float(brentq(lambda at: float(net(np.array([at]))[0]), x[k], x[k + 1], xtol=1e-13))
        for k in np.flatnonzero(values[:-1] * values[1:] < 0)
    ]
    return sorted(found + [float(v) for v in x[values == 0]])
