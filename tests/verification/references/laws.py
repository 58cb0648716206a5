"""Incompressible laws as energies W(l1, l2) per unstretched volume, l3 = 1/(l1 l2), and films.

The stretches may be complex: first derivatives are taken by complex steps, which are exact to
rounding. A law of one's own is any such function, of analytic operations, that is symmetric in l1
and l2 (isotropic).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Energy = Callable[[Any, Any], Any]

_STEP = 1e-30


def neo_hooke(shear_modulus: float) -> Energy:
    """W = G/2 (I1 - 3)."""
    return lambda l1, l2: shear_modulus / 2 * (_first(l1, l2) - 3)


def mooney_rivlin(c10: float, c01: float) -> Energy:
    """W = C10 (I1 - 3) + C01 (I2 - 3)."""
    return lambda l1, l2: c10 * (_first(l1, l2) - 3) + c01 * (_first(1 / l1, 1 / l2) - 3)


def gent(shear_modulus: float, j_lim: float) -> Energy:
    """W = -G J/2 ln(1 - (I1 - 3)/J); NaN beyond the limit I1 = J + 3."""

    def energy(l1: Any, l2: Any) -> Any:
        left = 1 - (_first(l1, l2) - 3) / j_lim
        if isinstance(left, np.ndarray):
            left = np.where(left.real > 0, left, np.nan)
        elif left.real <= 0:
            return np.nan * left
        return -shear_modulus * j_lim / 2 * np.log(left)

    return energy


def ogden(mu: Sequence[float], alpha: Sequence[float]) -> Energy:
    """W = sum mu/alpha (l1^alpha + l2^alpha + l3^alpha - 3), modulus sum mu alpha/2."""
    terms = tuple(zip(mu, alpha, strict=True))
    return lambda l1, l2: sum(m / a * (l1**a + l2**a + (l1 * l2) ** -a - 3) for m, a in terms)


def _first(l1: Any, l2: Any) -> Any:
    return l1 * l1 + l2 * l2 + 1 / (l1 * l2) ** 2


def slope(law: Energy, l1: Any, l2: Any) -> Any:
    """dW/dl1: the elastic nominal stress along 1 of a film without traction on its faces."""
    return law(l1 + 1j * _STEP, l2).imag / _STEP


def slopes(law: Energy, l1: Any, l2: Any) -> tuple[Any, Any]:
    """dW/dl1 and dW/dl2."""
    return slope(law, l1, l2), law(l1, l2 + 1j * _STEP).imag / _STEP


def biaxial_slope(law: Energy, l: Any) -> Any:
    """Derivative by l of W(l, l)."""
    return law(l + 1j * _STEP, l + 1j * _STEP).imag / _STEP


def derivative(function: Callable[[float], Any], at: float, step: float = 1e-3) -> Any:
    """Central difference of sixth order."""
    f, h = function, step
    near, mid, far = (f(at + n * h) - f(at - n * h) for n in (1, 2, 3))
    return (45 * near - 9 * mid + far) / (60 * h)


def shear_modulus(law: Energy) -> float:
    """At no strain: W(l, l) is 6 G (l - 1)^2 there."""
    return float(derivative(lambda l: biaxial_slope(law, l), 1.0) / 12)


def in_range(law: Energy, l1: Any, l2: Any) -> bool:
    """Whether the law holds here and a little (2 %) farther out."""
    return bool(np.isfinite(law(1.02 * l1, 1.02 * l2)))


def unit_voltage(law: Energy, permittivity: float, thickness: float) -> float:
    """H sqrt(G/eps), kV: the scale of voltages."""
    return float(thickness * (shear_modulus(law) / permittivity) ** 0.5)


@dataclass(frozen=True)
class Film:
    """A film as it is mounted, stretched equally in its plane.

    Attributes:
        law: Its energy, MPa.
        thickness: Mounted, mm.
        prestretch: lp.
        permittivity: N/kV^2.
    """

    law: Energy
    thickness: float = 1.0
    prestretch: float = 1.0
    permittivity: float = 1.0

    @property
    def unstretched(self) -> float:
        """Thickness before pre-stretch, mm."""
        return self.thickness * self.prestretch**2

    def pull(self, voltage: float) -> float:
        """eps (V/H0)^2, MPa, with the unstretched thickness H0."""
        return self.permittivity * (voltage / self.unstretched) ** 2

    def stress(self, l1: Any, l2: Any, voltage: float = 0.0) -> Any:
        """Total nominal stress along 1, MPa, at stretches since the unstretched state."""
        return slope(self.law, l1, l2) - self.pull(voltage) * l1 * l2**2

    def tension(self, voltage: float = 0.0) -> float:
        """Total force a mounted length of the flat, mounted film, N/mm."""
        lp = self.prestretch
        return float(self.stress(lp, lp, voltage) * lp * self.thickness)
