"""Electrodes as thin resistive sheets: resistance under stretch, and how fast they charge.

Current flows along the strips, from the edge of contact to the other one. Each ring of the film of
a radial length dl carries a share of the capacitance and a resistance rho dl / (2 pi r) in each
electrode. The sheet resistance rho is in Gohm per square, so that rho times nF is in s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.results.elements import Array


@dataclass(frozen=True)
class Rings:
    """The film in rings, inwards to outwards.

    Attributes:
        edges: Radii in the mesh that bound them, (rings + 1,), mm.
        along: Radial stretch of each since the electrodes were made, that is since mounting.
        around: Hoop stretch.
        capacitance: Of each, nF.
    """

    edges: Array
    along: Array
    around: Array
    capacitance: Array

    def resistances(self, sheet: float, exponent: float) -> Array:
        """Resistance of one electrode's rings, Gohm: rho l1 dR / (2 pi l2 R), integrated over R.

        Args:
            sheet: Sheet resistance of the mounted electrode.
            exponent: It grows with the area as (l1 l2)^exponent: 1 for a layer of constant volume
                and resistivity, 0 for one whose sheet resistance does not change.
        """
        rho = sheet * (self.along * self.around) ** exponent
        lengths = np.log(self.edges[1:] / self.edges[:-1]) * self.along / self.around
        return np.asarray(rho * lengths / (2 * np.pi))

    def time_constant(self, resistances: Array, contact: str) -> float:
        """Slowest time constant of the ladder, s.

        Both electrodes are contacted at the same edge and their resistances are in series, so
        that each ring stands between two of them. Of a uniform line it is 4 / pi^2 R C.

        Args:
            resistances: Of one electrode's rings, Gohm.
            contact: 'inner' or 'outer'.
        """
        from scipy.linalg import eigvalsh_tridiagonal

        R, C = 2 * resistances, self.capacitance
        if contact == "outer":
            R, C = R[::-1], C[::-1]
        between = np.append(R[0] / 2, (R[1:] + R[:-1]) / 2)  # from each ring's middle to the last's
        g = 1 / between
        diagonal = (g + np.append(g[1:], 0.0)) / C
        beside = -g[1:] / np.sqrt(C[1:] * C[:-1])
        slowest = eigvalsh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))
        return float(1 / slowest[0])
