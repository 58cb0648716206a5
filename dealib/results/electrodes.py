"""Electrodes as thin resistive sheets: resistance under stretch, and time constant of charging.

Current flows along the layers, from the edge of contact to the opposite one. The film is divided
into rings. A ring of length dl has a share of the capacitance, and the resistance rho dl / width in
each electrode. The sheet resistance rho is in Gohm per square, so that rho times nF is in s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array
from dealib.device.bases import Base


@dataclass(frozen=True)
class Rings:
    """The film in rings, inwards to outwards.

    Attributes:
        edges: Coordinates along the base that bound the rings, (rings + 1,), mm.
        along: Stretch of each ring along the base since mounting, when the electrodes were made,
            (rings,).
        around: Stretch perpendicular to that, in the plane of the layer, (rings,).
        capacitance: Capacitance of each ring, (rings,), nF.
    """

    edges: Array
    along: Array
    around: Array
    capacitance: Array

    def resistances(self, sheet: float, exponent: float, base: Base) -> Array:
        """Resistance of one electrode's rings, Gohm: rho l1 dS / (l2 width), integrated.

        Args:
            sheet: Sheet resistance of the mounted electrode.
            exponent: The sheet resistance grows as (l1 l2)^exponent with the stretches l1 and l2: 1
                for a layer of constant volume and resistivity, 0 for a constant sheet resistance.
            base: Base of the laminate.
        """
        rho = sheet * (self.along * self.around) ** exponent
        if base.along == "R":
            with np.errstate(divide="ignore", invalid="ignore"):
                squares = np.log(self.edges[1:] / self.edges[:-1]) / (2 * np.pi)
            if self.edges[0] < 1e-9 * self.edges[-1]:
                squares[0] = 1 / (4 * np.pi)  # twice the rho / (8 pi) of a disc fed at its rim
        else:
            squares = np.diff(self.edges) / base.girth
        return np.asarray(rho * squares * self.along / self.around)

    def time_constant(self, resistances: Array, at_start: bool) -> float:
        """Slowest time constant of the ladder, s.

        Both electrodes are contacted at the same edge, and their resistances are in series. For a
        uniform line the time constant is 4 / pi^2 R C.

        Args:
            resistances: Resistances of one electrode's rings, (rings,), Gohm.
            at_start: Whether the contact is where the base begins.
        """
        from scipy.linalg import eigvalsh_tridiagonal

        R, C = 2 * resistances, self.capacitance
        if not at_start:
            R, C = R[::-1], C[::-1]
        between = np.append(R[0] / 2, (R[1:] + R[:-1]) / 2)  # between the middles of neighbours
        g = 1 / between
        diagonal = (g + np.append(g[1:], 0.0)) / C
        beside = -g[1:] / np.sqrt(C[1:] * C[:-1])
        slowest = eigvalsh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))
        return float(1 / slowest[0])
