"""Rigid mounts: displacements of the parts that are fixed to them, from the values of their ports.

A part moves to x = c + d + R (X - c), with the finite rotation R = exp [r] by the rotation vector r
about the centre c. The duals of d are forces. Those of r are moments about c if the part turns
about one axis only, and otherwise the work conjugates of the components of r.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from dealib.arrays import Array

_TERMS = 30  # of series in the squared angle, exact to rounding up to two turns
_SINE, _COSINE = (
    Polynomial([(-1) ** k / factorial(2 * k + n) for k in range(_TERMS)]) for n in (1, 2)
)  # sin t / t and (1 - cos t) / t^2
_SPIN = np.array([np.cross(axis, np.eye(3)).T for axis in np.eye(3)])  # [e_i], of each axis


def rotation(r: Array) -> tuple[Array, Array, Array]:
    """R of a rotation vector, and its first and second derivatives by its components.

    R = 1 + a W + b W^2 with W = [r], a = sin t / t, b = (1 - cos t) / t^2 and t = |r| (Rodrigues).
    The series of a and b in t^2 are regular where t vanishes.

    Returns:
        Of shapes (3, 3), (3, 3, 3) and (3, 3, 3, 3), components of r first.
    """
    s, W = float(r @ r), np.einsum("i,ijk", r, _SPIN)
    V, square = _SPIN @ W + W @ _SPIN, W @ W
    pairs = np.einsum("iab,jbc->ijac", _SPIN, _SPIN)
    pairs = pairs + pairs.swapaxes(0, 1)
    R, first, second = np.eye(3), np.zeros((3, 3, 3)), np.zeros((3, 3, 3, 3))
    for series, power, slopes, bends in (
        (_SINE, W, _SPIN, np.zeros_like(second)),
        (_COSINE, square, V, pairs),
    ):
        f, f1, f2 = series(s), 2 * series.deriv()(s), 4 * series.deriv(2)(s)
        R = R + f * power
        first += f1 * r[:, None, None] * power + f * slopes
        crossed = np.einsum("i,jab->ijab", f1 * r, slopes)
        second += (f2 * np.outer(r, r) + f1 * np.eye(3))[..., None, None] * power
        second += crossed + crossed.swapaxes(0, 1) + f * bends
    return R, first, second


@dataclass(frozen=True)
class Platform:
    """A rigid mount and the degrees of freedom on this rank that follow it.

    Attributes:
        ports: Names of its ports: displacements along the axes of the space, then turns.
        axes: Axis of each port in space, 0 to 2.
        shifts: Number of ports that are displacements.
        dofs: Degrees of freedom of displacements, ghosts included.
        component: Axis in space of each degree of freedom.
        arms: X - c at each degree of freedom, mm, (dofs, 3).
        centre: c in the space's axes, mm.
    """

    ports: tuple[str, ...]
    axes: tuple[int, ...]
    shifts: int
    dofs: Any
    component: Any
    arms: Array
    centre: Array

    def _turn(self, values: Mapping[str, float]) -> Array:
        r = np.zeros(3)
        for port, axis in list(zip(self.ports, self.axes, strict=True))[self.shifts :]:
            r[axis] = values[port]
        return r

    def _own(self, moved: Array) -> Array:
        """The component of each degree of freedom, of (..., dofs, 3)."""
        return np.asarray(moved[..., np.arange(len(self.component)), self.component])

    def displacements(self, values: Mapping[str, float]) -> Array:
        """Displacements of its degrees of freedom at values of the ports, mm, (dofs,)."""
        d = np.zeros(3)
        for port, axis in list(zip(self.ports, self.axes, strict=True))[: self.shifts]:
            d[axis] = values[port]
        R = rotation(self._turn(values))[0]
        return self._own(d + self.arms @ (R - np.eye(3)).T)

    def directions(self, values: Mapping[str, float]) -> Array:
        """Derivatives of `displacements` by each port, (ports, dofs)."""
        shifts = np.eye(3)[list(self.axes[: self.shifts])]
        slopes = rotation(self._turn(values))[1][list(self.axes[self.shifts :])]
        turned = np.einsum("iab,nb->ina", slopes, self.arms)
        still = np.broadcast_to(shifts[:, None], (len(shifts), *self.arms.shape))
        return self._own(np.concatenate([still, turned]))

    def curvature(self, values: Mapping[str, float], forces: Array) -> Array:
        """Second derivatives by the ports of the work of constant forces, (ports, ports).

        Args:
            values: Values of the ports.
            forces: Forces on its degrees of freedom, this rank's share, N.
        """
        turns = list(self.axes[self.shifts :])
        bends = rotation(self._turn(values))[2][np.ix_(turns, turns)]
        moment = np.zeros((3, 3))
        np.add.at(moment, self.component, forces[:, None] * self.arms)
        found = np.zeros((len(self.ports),) * 2)
        found[self.shifts :, self.shifts :] = np.einsum("ijab,ab->ij", bends, moment)
        return found
