"""Statistics of fits: errors in x and y, correlated noise, undetermined parameters.

Residuals r, (points,), are in assumed standard deviations; J, (points, parameters), is their
derivative by the parameters. A block holds the points of one curve, in the order of measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.signal import lfilter

from dealib.arrays import Array

_SOLID = 1e-9  # singular values of J below this share of the largest one are rounding


def distances(curve: Array, x: Array, y: Array, sigma_x: float, sigma_y: float) -> Array:
    """Orthogonal distances of points to a curve, in standard deviations; positive below it.

    Their squares are the minima of ((t - x)/sigma_x)^2 + ((f(t) - y)/sigma_y)^2 over t.

    Args:
        curve: Points of the curve, (2, any), joined by straight lines and continued straight.
        x: Measured abscissae, (points,).
        y: Measured values, (points,).
        sigma_x: Standard deviation of x.
        sigma_y: Standard deviation of y.
    """
    lines = 1_000_000 // curve.shape[1] + 1
    if len(x) > lines:  # in bounded memory
        parts = [slice(i, i + lines) for i in range(0, len(x), lines)]
        found = [distances(curve, x[p], y[p], sigma_x, sigma_y) for p in parts]
        return np.concatenate(found)
    c = curve / np.array([[sigma_x], [sigma_y]])
    first, last = c[:, 0] - c[:, 1], c[:, -1] - c[:, -2]
    far = [1e6 * end / max(np.hypot(*end), 1e-300) for end in (first, last)]
    c = np.column_stack([c[:, 0] + far[0], c, c[:, -1] + far[1]])
    starts, along = c[:, :-1], np.diff(c, axis=1)
    off = np.stack([x / sigma_x, y / sigma_y])[:, :, None] - starts[:, None]  # (2, points, lines)
    length2 = np.maximum((along**2).sum(axis=0), 1e-300)
    share = np.clip((off * along[:, None]).sum(axis=0) / length2, 0, 1)
    off = off - share * along[:, None]
    nearest = np.argmin((off**2).sum(axis=0), axis=1)[None, :, None]
    dx, dy = np.take_along_axis(off, nearest, axis=2)[..., 0]
    return np.asarray(np.copysign(np.hypot(dx, dy), -dy))


@dataclass(frozen=True)
class Noise:
    """The noise of one curve, estimated from its residuals.

    Attributes:
        scale: Standard deviation over the assumed one.
        correlation: Correlation of neighbouring points as AR(1); 0 if it is not significant.
        points: Effective number of independent points.
    """

    scale: float
    correlation: float
    points: float


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the parameters.

    Attributes:
        covariance: Covariance, (parameters, parameters); infinite for undetermined parameters.
        freedom: Degrees of freedom of each parameter's variance, (parameters,).
        inflation: Variance over that for white noise of the assumed size, (parameters,).
        noise: Noise of each curve.
    """

    covariance: Array
    freedom: Array
    inflation: Array
    noise: tuple[Noise, ...]


def uncertainty(J: Array, r: Array, blocks: Sequence[slice]) -> Uncertainty:
    """Covariance of least squares with noise of its own size and correlation in each curve.

    It is A (sum_k s_k^2 J_k^T R_k J_k) A with A = (J^T J)^-1 and the AR(1) correlation R_k; for one
    curve of white noise that is the usual s^2 A. Size s_k and correlation are estimated from the
    residuals, corrected for the fitted parameters: E[r r^T] = s^2 M R M with M = 1 - J A J^T.
    Degrees of freedom are Satterthwaite's.

    Args:
        J: Derivatives of the residuals, (points, parameters).
        r: Residuals, (points,).
        blocks: Rows of each curve.
    """
    A, unseen = _inverse(J)
    parts, noise, freedom = [], [], []
    total = max(len(r) - J.shape[1], 1)
    pooled = float(r @ r) / total
    for block in blocks:
        rho, inner, expected = _correlation(J[block], r[block], A)
        scale2 = float(r[block] @ r[block]) / expected if expected > 9 else pooled
        worth = len(r[block]) * (1 - rho) / (1 + rho)
        noise.append(Noise(float(np.sqrt(scale2)), rho, worth))
        parts.append(np.einsum("ij,jk,ki->i", A, scale2 * inner, A))
        used = float(np.trace(A @ J[block].T @ J[block]))
        own = max(worth - used, 1.0) if expected > 9 else float(total)
        if rho > 0:  # the error of rho, sqrt((1 - rho^2) / n), adds to that of the variance
            own = 2 / (2 / own + 4 / ((1 - rho**2) * len(r[block])))
        freedom.append(max(own, 1.0))
    meat = sum(
        n.scale**2 * _correlated(J[b], n.correlation).T @ J[b]
        for n, b in zip(noise, blocks, strict=True)
    )
    covariance = A @ meat @ A
    variance = np.diag(covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        degrees = variance**2 / sum(v**2 / f for v, f in zip(parts, freedom, strict=True))
        inflation = variance / np.diag(A)
    covariance[unseen, unseen] = np.inf
    return Uncertainty(covariance, degrees, inflation, tuple(noise))


def _inverse(J: Array) -> tuple[Array, npt.NDArray[np.intp]]:
    """The inverse (or pseudoinverse) of J^T J, and the numbers of undetermined parameters."""
    size = np.linalg.norm(J, axis=0)
    size[size == 0] = 1.0
    _, s, V = np.linalg.svd(J / size, full_matrices=False)
    seen = s > _SOLID * s[0] if s[0] > 0 else s > 0
    A = (V[seen].T / s[seen] ** 2) @ V[seen]
    blind = (V[~seen] ** 2).sum(axis=0) > 1e-6
    return A / np.outer(size, size), np.flatnonzero(blind)


def _correlated(J: Array, rho: float) -> Array:
    """R J with the AR(1) correlation R_ij = rho^|i - j|, in O(n)."""
    if rho == 0:
        return J
    ahead = lfilter([1.0], [1.0, -rho], J, axis=0)
    behind = lfilter([1.0], [1.0, -rho], J[::-1], axis=0)[::-1]
    return np.asarray(ahead + behind - J)


def _correlation(J: Array, r: Array, A: Array) -> tuple[float, Array, float]:
    """Correlation of neighbours, J^T R J, and the expected sum of squares for noise of size 1.

    The correlation is taken from the lag at which it falls to a half, because at lag 1 a smooth
    misfit does not look like AR(1) noise.
    """
    n, Q, lag, size = len(r), J @ A, 1, max(float(r @ r), 1e-300)
    while (found := float(r[:-lag] @ r[lag:]) / size) > 0.5 and lag < n // 4:
        lag += 1

    def moments(rho: float) -> tuple[float, float, Array]:
        """Expected sums of products at the lag and of squares, and J^T R J."""
        K = _correlated(J, rho)
        B = J.T @ K
        QB = Q @ B
        squares = n - 2 * np.sum(Q * K) + np.sum(QB * Q)
        ahead, behind = slice(lag, None), slice(None, -lag)
        less = np.sum(Q[behind] * K[ahead]) + np.sum(K[behind] * Q[ahead])
        products = (n - lag) * rho**lag - less + np.sum(QB[behind] * Q[ahead])
        return float(products), float(squares), B

    def excess(rho: float) -> float:
        products, squares, _ = moments(rho)
        return products / squares - found

    white = moments(0.0)
    if n < 8 or white[1] < 4 or -excess(0.0) * np.sqrt(n) < 1.28:  # not significant at 10 %
        return 0.0, white[2], white[1]
    least = float(np.sum(Q * J)) + 3  # least effective points: more than the parameters it gives
    top = max((n - least) / (n + least), 0.0)
    rho = top if excess(top) < 0 else float(brentq(excess, 0.0, top, xtol=1e-4))
    _, squares, B = moments(rho)
    return rho, B, squares


def directions(J: Array, scale: Array) -> list[tuple[float, Array]]:
    """Combinations of parameters, from the least to the best determined one.

    Args:
        J: Derivatives of the residuals, (points, parameters).
        scale: Change of each parameter that counts as 1, (parameters,).

    Returns:
        For each combination its standard error for noise of size 1 (infinite if undetermined), and
        the changes of the parameters in their scales, (parameters,), the largest being 1.
    """
    _, s, V = np.linalg.svd(J * scale, full_matrices=False)
    found = []
    for size, v in zip(s[::-1], V[::-1], strict=True):
        largest = v[np.argmax(np.abs(v))]
        error = np.inf if size <= _SOLID * s[0] else abs(largest) / size
        found.append((float(error), v / largest))
    return found
