"""Functions that laws need beyond arithmetic, for UFL expressions and for numbers alike."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np


def ln(x: Any) -> Any:
    """Natural logarithm of a UFL expression, or of (complex) numbers whose real part is positive.

    Other numbers give NaN: a complex step would mistake the jump of arg(x) for a derivative.
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


def exp(x: Any) -> Any:
    """Exponential of a UFL expression or of numbers."""
    if hasattr(x, "ufl_shape"):
        import ufl

        return ufl.exp(x)
    return np.exp(x)


def positive(x: Any) -> Any:
    """The larger one of 0 and a UFL expression or real numbers."""
    if hasattr(x, "ufl_shape"):
        import ufl

        return ufl.conditional(ufl.gt(x, 0.0), x, 0.0)
    return np.maximum(x, 0.0)


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

    # each branch must stay finite where it is not chosen, since UFL multiplies its derivative by 0
    series: Any = 1.0
    for k in reversed(range(TERMS)):
        series = 1 + series * choose(tau, NEAR) * (degree**2 - k**2) / ((k + 1) * (2 * k + 1))
    far = choose(NEAR, tau)
    y = 1 + far + (far * (2 + far)) ** 0.5
    return choose(series, (y**degree + y ** (-degree)) / 2)


POLES = np.geomspace(1e-4, 1e4, 24)  # of the rational functions that approximate powers
_RANGE = np.geomspace(1e-2, 1e2, 2001)  # squared stretches for which they are fitted


@functools.cache
def residues(exponent: float) -> tuple[float, ...]:
    """Weights w_k of x^f = sum of w_k x / (x + t_k) with the poles -t_k, f the exponent's fraction.

    For stretches from 0.1 to 10 the relative error of the power is 1e-9, and that of its slope 1e-8
    (1e-6 at the ends).

    Args:
        exponent: As for `power_sum`.
    """
    fraction = _parts(exponent)[1]
    if fraction == 0:
        return (0.0,) * len(POLES)
    x = _RANGE[:, None]
    basis = x / (x + POLES) / x**fraction
    return tuple(np.linalg.lstsq(basis, np.ones(len(x)), rcond=1e-15)[0].tolist())


def _parts(exponent: float) -> tuple[int, float]:
    """Whole part and fraction of the absolute value of an exponent."""
    whole = int(abs(exponent))
    return whole, abs(exponent) - whole


def power_sum(first: Any, second: Any, exponent: float, weights: Any) -> Any:
    """Sum of powers of three positive numbers whose product is 1, as a smooth function.

    The sum of x_i^n is Newton's recursion in the first and second elementary symmetric polynomial;
    a fraction is a rational function (see `residues`), of which

        sum of x_i^(n+1) / (x_i + t) = (s_(n+1) t^2 + (b s_n - s_(n-1)) t + s_n) / P(t),

    P(t) = t^3 + a t^2 + b t + 1. Unlike a formula by eigenvalues it has all derivatives where some
    of them coincide.

    Args:
        first: Their sum a, a UFL expression or numbers.
        second: Their sum of pairwise products b.
        exponent: A number; negative ones are those of the reciprocals.
        weights: `residues` of it, numbers or constants.
    """
    a, b = (first, second) if exponent >= 0 else (second, first)
    whole, fraction = _parts(exponent)
    sums = [b, 3.0, a]  # of the powers -1, 0, 1
    for _ in range(whole):
        sums.append(a * sums[-1] - b * sums[-2] + sums[-3])
    before, now, after = sums[whole : whole + 3]
    if fraction == 0:
        return now
    total = 0.0
    for k, t in enumerate(POLES.tolist()):
        top = after * t**2 + (b * now - before) * t + now
        total = total + weights[k] * top / (t**3 + a * t**2 + b * t + 1)
    return total
