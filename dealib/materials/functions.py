"""Functions that laws need beyond arithmetic, for UFL expressions and for numbers alike."""

from __future__ import annotations

from typing import Any

import numpy as np


def ln(x: Any) -> Any:
    """Natural logarithm of a UFL expression, or of (complex) numbers whose real part is positive.

    Elsewhere numbers give NaN: a complex step would take the jump of arg(x) for a derivative.
    """
    if hasattr(x, "ufl_shape"):
        import ufl

        return ufl.ln(x)
    x = np.asarray(x)
    valid = x.real > 0
    return np.where(valid, np.log(np.where(valid, x, 1.0)), np.nan * x)


def erf(x: Any) -> Any:
    """Error function of a UFL expression or of real numbers."""
    if hasattr(x, "ufl_shape"):
        import ufl

        return ufl.erf(x)
    from scipy.special import erf

    return erf(x)


NEAR, TERMS = 0.05, 12  # the series is used up to x = 1 + NEAR; there it is exact to rounding


def chebyshev(x: Any, degree: Any) -> Any:
    """T_n(x) = cosh(n arcosh x) of any real degree n, for x >= 1, as a smooth function of x.

    With x = (a + b) / (2 sqrt(a b)) it gives a^n + b^n = 2 (a b)^(n/2) T_n(x): the sum of powers of
    two squared stretches from their sum and product, without their difference, which has no
    derivative where they coincide. There, at x = 1, T_n is analytic; its series is the
    hypergeometric 2F1(-n, n; 1/2; (1 - x)/2) (NIST DLMF 15.9.5).

    Args:
        x: UFL expression, or (complex) numbers.
        degree: Number or constant.
    """
    tau = x - 1
    if hasattr(x, "ufl_shape"):
        import ufl

        def choose(near: Any, far: Any) -> Any:
            return ufl.conditional(ufl.lt(tau, NEAR), near, far)
    else:
        tau = np.asarray(tau)

        def choose(near: Any, far: Any) -> Any:
            return np.where(tau.real < NEAR, near, far)

    # each branch stays finite where the other one counts: UFL's derivatives multiply them by 0 or 1
    series: Any = 1.0
    for k in reversed(range(TERMS)):
        series = 1 + series * choose(tau, NEAR) * (degree**2 - k**2) / ((k + 1) * (2 * k + 1))
    far = choose(NEAR, tau)
    y = 1 + far + (far * (2 + far)) ** 0.5
    return choose(series, (y**degree + y ** (-degree)) / 2)
