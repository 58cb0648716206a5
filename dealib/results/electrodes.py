"""Electrodes as thin resistive sheets: resistance under stretch, and how fast they charge.

Current flows along the layers, from the edge of contact to the other one. Each ring of the film of
a length dl along it carries a share of the capacitance and a resistance rho dl / width in each
electrode. The sheet resistance rho is in Gohm per square, so that rho times nF is in s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.device.bases import Base
from dealib.results.elements import Array


@dataclass(frozen=True)
class Rings:
    """The film in rings, inwards to outwards.

    Attributes:
        edges: Coordinates along the base that bound them, (rings + 1,), mm.
        along: Stretch of each along the base since the electrodes were made, that is since
            mounting.
        around: Stretch across that, in the plane of the layer.
        capacitance: Of each, nF.
    """

    edges: Array
    along: Array
    around: Array
    capacitance: Array

    def resistances(self, sheet: float, exponent: float, base: Base) -> Array:
        """Resistance of one electrode's rings, Gohm: rho l1 dS / (l2 width), integrated.

        Args:
            sheet: Sheet resistance of the mounted electrode.
            exponent: It grows with the area as (l1 l2)^exponent: 1 for a layer of constant volume
                and resistivity, 0 for one whose sheet resistance does not change.
            base: What the layers lie on.
        """
        rho = sheet * (self.along * self.around) ** exponent
        if base.along == "R":
            with np.errstate(divide="ignore", invalid="ignore"):
                squares = np.log(self.edges[1:] / self.edges[:-1]) / (2 * np.pi)
            if (
                self.edges[0] < 1e-9 * self.edges[-1]
            ):  # a disc fed at its rim has rho / (8 pi), half of this
                squares[0] = 1 / (4 * np.pi)
        else:
            squares = np.diff(self.edges) / base.girth
        return np.asarray(rho * squares * self.along / self.around)

    def time_constant(self, resistances: Array, at_start: bool) -> float:
        """Slowest time constant of the ladder, s.

        Both electrodes are contacted at the same edge and their resistances are in series, so
        that each ring stands between two of them. Of a uniform line it is 4 / pi^2 R C.

        Args:
            resistances: Of one electrode's rings, Gohm.
            at_start: Whether they are contacted where the base begins.
        """
        from scipy.linalg import eigvalsh_tridiagonal

        R, C = 2 * resistances, self.capacitance
        if not at_start:
            R, C = R[::-1], C[::-1]
        between = np.append(R[0] / 2, (R[1:] + R[:-1]) / 2)  # from each ring's middle to the last's
        g = 1 / between
        diagonal = (g + np.append(g[1:], 0.0)) / C
        beside = -g[1:] / np.sqrt(C[1:] * C[:-1])
        slowest = eigvalsh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))
        return float(1 / slowest[0])
