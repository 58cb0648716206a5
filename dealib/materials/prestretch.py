"""The thickness stretch of a film that is stretched in its plane and free across."""

from __future__ import annotations

from types import SimpleNamespace

from dealib.materials.laws import Law, invariants_of_stretches


def thickness_stretch(law: Law, radial: float, hoop: float) -> float:
    """Stretch across the film at zero thickness stress: dW/d(lz) = 0 at fixed in-plane stretches.

    Args:
        law: Law with its parameters.
        radial: Radial stretch.
        hoop: Hoop stretch.

    Raises:
        ValueError: If the law has no such state between half and twice the isochoric stretch.
    """
    from scipy.optimize import brentq

    p = SimpleNamespace(**law.parameters)

    def stress(lz: float) -> float:
        h = 1e-30  # complex step: exact to rounding
        return float(law.energy(invariants_of_stretches(radial, hoop, lz + 1j * h), p).imag / h)

    isochoric = 1 / (radial * hoop)
    if radial == hoop == 1:
        return 1.0  # exactly: every law is stress-free at rest
    try:
        return float(brentq(stress, isochoric / 2, isochoric * 2, xtol=1e-15, rtol=1e-14))
    except ValueError:
        raise ValueError(
            f"{law.__class__.__name__}: no thickness stretch without thickness stress at the "
            f"pre-stretch ({radial:g}, {hoop:g})"
        ) from None
