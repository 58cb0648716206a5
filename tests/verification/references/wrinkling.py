"""Loss of tension, natural width, and the tension field of a sheared strip.

A film held at l1 >= l2 wrinkles where its smaller total stress, W2 - e2 l2 l1^2 with
e2 = eps (V/H0)^2, becomes zero. Beyond, tension-field theory (Reissner 1938; Pipkin, IMA J. Appl.
Math. 36 (1986) 85) relaxes the energy: W - e2/2 (l1 l2)^2 is taken at the natural width l2*, at
which that stress is zero, wherever l2 < l2*.

A long strip between two rails, stretched by `along` and `across` and sheared by
gamma, has the homogeneous F = [[along, gamma], [0, across]], taut or not. It is also the exact
state of a film of any shape whose whole edge is displaced by this F. Near zero strain the wrinkled
strip has the shear modulus Y/4 of Wagner's web (NACA TM 604, 1931), 3/4 of the taut one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from verification.references.laws import Energy, biaxial_slope, slope, slopes


def onset(law: Energy, l1: float, l2: float, permittivity: float = 1.0) -> float:
    """Field V/H0 (kV/mm) at which a film held at these stretches loses its smaller tension."""
    minor, major = sorted((l1, l2))
    pull = slope(law, minor, major) / (minor * major**2)
    return float(np.sqrt(pull / permittivity))


def onset_equal(law: Energy, l: float, permittivity: float = 1.0) -> float:
    """The same for a film that is stretched equally, such as a disc electroded to its clamp."""
    return float(np.sqrt(biaxial_slope(law, l) / (2 * l**3) / permittivity))


def natural_width(law: Energy, l1: float, pull: float = 0.0) -> float:
    """l2* at a stretch l1 and e2 = eps (V/H0)^2 (MPa); NaN if the field is too high for one.

    For neo-Hooke l2*^4 = G/(l1^2 (G - e2 l1^2)).
    """

    def stress(l2: float) -> float:
        value = float(slope(law, l2, l1) - pull * l2 * l1**2)
        return value if np.isfinite(value) else 1e9 * abs(first)  # beyond the limit of the law

    first = 1.0
    low = high = l1**-0.5
    first = stress(low)
    if first == 0:
        return low
    while stress(low) > 0:
        low *= 0.9
    while stress(high) < 0:
        high *= 1.1
        if high > 1e3 * low:
            return np.nan
    return float(brentq(stress, low, high, xtol=1e-16, rtol=1e-14))


@dataclass(frozen=True)
class Strip:
    """The state of a sheared strip.

    Attributes:
        l1: Larger stretch.
        l2: Smaller stretch of its geometry; that of the wrinkled film itself is `natural`.
        natural: l2*.
        taut: Whether there are no wrinkles.
        angle: Of the larger tension, from the rails, degrees.
        nominal: Total nominal stress P, MPa: `P[0, 1]` is the shear force on a rail and `P[1, 1]`
            the force that parts the rails, both over the rail's unstretched length and thickness.
        energy: W - e2/2 (l1 l2)^2, relaxed, MPa.
    """

    l1: float
    l2: float
    natural: float
    taut: bool
    angle: float
    nominal: np.ndarray
    energy: float


def sheared_strip(
    law: Energy, shear: float, along: float = 1.0, across: float = 1.0, pull: float = 0.0
) -> Strip:
    """Tension field of a long strip, or of a film whose whole edge is displaced by F.

    Args:
        law: MPa.
        shear: gamma = displacement of a rail over the strip's unstretched width.
        along: Stretch along the rails.
        across: Distance of the rails over the unstretched width.
        pull: e2 = eps (V/H0)^2, MPa.
    """
    u, (l1, l2), v = np.linalg.svd(np.array([[along, shear], [0.0, across]]))
    natural = natural_width(law, l1, pull)
    taut = bool(l2 >= natural)
    inside = l2 if taut else natural
    first, second = slopes(law, l1, inside)
    T = np.array([first - pull * l1 * inside**2, second - pull * inside * l1**2 if taut else 0.0])
    return Strip(
        float(l1),
        float(l2),
        natural,
        taut,
        angle=float(np.degrees(np.arctan(u[1, 0] / u[0, 0]))) if u[0, 0] else 90.0,
        nominal=u * T @ v,
        energy=float(law(l1, inside) - pull / 2 * (l1 * inside) ** 2),
    )
