"""Two parallel strips (width w, gap h, no thickness) in the plane: capacitance a unit of depth.

In a homogeneous medium it is exact: Love, Proc. London Math. Soc. 22 (1923) 337, by the
Schwarz-Christoffel map of a quarter of the plane, with complete and incomplete elliptic integrals,

    w/h = (2/pi) [K' E(t|m') - E' F(t|m')],  sin^2 t = (1 - E'/K')/m',  C/eps = K'/K.

An infinite sheet of er between the strips: the potential of the upper strip's charge and its
mirrored negative is a sum of images. With rho = (er - 1)/(er + 1) and distances n h,

    G(x) = 1/(pi (1 + er)) [-ln|x| + (1 + rho)/2 sum_n (-rho)^(n-1) ln(x^2 + n^2 h^2)],

and the integral equation int G(x - x') s(x') dx' = V/2 is solved by s = g(t)/sqrt(1 - t^2) at
Chebyshev's points.

A slab of er that just fills the gap: single layers of all charge (free and bound) on the strips and
on the slab's sides, where s = 2 rho E_n. Piecewise Legendre polynomials on panels that become
smaller towards the slab's corner, integrated against the logarithm exactly by Legendre functions
of the second kind. The free charge is all charge above the middle plane plus (er - 1) times the
flux through the slab there.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc, ellipkm1

_ORDER = 12
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(_ORDER)


def homogeneous(width: float, gap: float) -> float:
    """C/eps of strips in a homogeneous medium; w/h up to 200."""

    def ratio(log: float) -> float:
        m = np.exp(log)
        K, E = ellipkm1(m), ellipe(1 - m)
        t = np.arcsin(np.sqrt((1 - E / K) / (1 - m)))
        return float(2 / np.pi * (K * ellipeinc(t, 1 - m) - E * ellipkinc(t, 1 - m)))

    log = brentq(lambda x: ratio(x) - width / gap, -690.0, -1e-8, xtol=1e-13)
    m = np.exp(log)
    return float(ellipkm1(m) / ellipk(m))


def love_asymptote(width: float, gap: float) -> float:
    """C/eps of wide strips: w/h + (1 + ln(2 pi w/h))/pi (Kirchhoff 1877)."""
    x = width / gap
    return float(x + (1 + np.log(2 * np.pi * x)) / np.pi)


def infinite_sheet(width: float, gap: float, er: float) -> float:
    """C/eps0 with an infinite sheet of relative permittivity er between the strips."""
    return float(np.pi * sheet_coefficients(width, gap, er)[0] * width / 2)


def sheet_coefficients(width: float, gap: float, er: float) -> np.ndarray:
    """Free charge on the upper strip at 1 V between the strips, over eps0 and a unit of length.

    With t = 2x/w it is sum_k a_k T_2k(t)/sqrt(1 - t^2); this gives a_k.
    """
    n = int(40 + 5 * width / gap)
    half = width / 2
    t = np.cos(np.pi * (np.arange(n) + 0.5) / (2 * n))  # Chebyshev's points of 2n in t > 0
    rho = (er - 1) / (er + 1)
    terms = 1 if rho == 0 else int(np.ceil(np.log(1e-14) / np.log(abs(rho))))
    degrees = 2 * np.arange(n)
    T = np.cos(np.multiply.outer(np.arccos(t), degrees))
    # int -ln|t - s| T_k(s)/sqrt(1 - s^2) ds = pi ln 2 (k = 0), pi/k T_k(t)
    own = np.pi * np.append(np.log(2), 1 / degrees[1:])
    minus, plus = (np.subtract.outer(t, sign * t) ** 2 for sign in (1, -1))
    images = np.zeros((n, n))
    for k in range(1, terms + 1):
        far = (k * gap / half) ** 2
        images += (1 + rho) * (-rho) ** (k - 1) * np.log((minus + far) * (plus + far)) / 2
    # Gauss's rule for 1/sqrt(1 - s^2); ln(w/2) cancels, as the weights of the images sum to 1
    matrix = T * own + np.pi / (2 * n) * images @ T
    return np.linalg.solve(matrix * half / (np.pi * (1 + er)), np.full(n, 0.5))


def finite_slab(width: float, gap: float, er: float) -> float:
    """C/eps0 with a slab of relative permittivity er that just fills the gap."""
    half = width / (2 * gap)
    rho = (er - 1) / (er + 1)
    # complex coordinates from the upper right corner, in units of the gap: the strip runs to -x,
    # the side to -y; each panel is its middle and its half length along its direction
    strip, side = _panels(half), _panels(0.5)
    middles = np.concatenate([-strip[0], -1j * side[0]])
    halves = np.concatenate([strip[1], 1j * side[1]])
    z = (middles[:, None] + halves[:, None] * _NODES).ravel()
    lengths = np.repeat(np.abs(halves), _ORDER) * np.tile(_WEIGHTS, len(halves))
    n = len(strip[0]) * _ORDER
    corner = half + 0.5j

    potential = np.zeros((n, len(z)))
    field = np.zeros((len(z) - n, len(z)))
    for mirror_x in (False, True):
        for mirror_y in (False, True):
            # the mirrored sources at the target are the sources at the mirrored target
            target = z
            if mirror_x:
                target = -target.conj() - 2 * corner.real
            if mirror_y:
                target = target.conj() - 2j * corner.imag
            sign = -1.0 if mirror_y else 1.0
            potential += sign * _integrals(target[:n], middles, halves, logarithm=True)
            normal = _integrals(target[n:], middles, halves, logarithm=False)
            if not mirror_x:
                normal[:, n:] = 0.0  # the side is straight: it has no field across itself
            field += sign * (-1.0 if mirror_x else 1.0) * normal
    matrix = np.vstack([-potential / (2 * np.pi), -rho / np.pi * field])
    matrix[np.arange(n, len(z)), np.arange(n, len(z))] += 1.0
    charge = lengths * np.linalg.solve(matrix, np.repeat([0.5, 0.0], [n, len(z) - n]))
    # a charge and its mirrored negative send the share angle/pi through the slab's middle
    x, y = z.real + half, z.imag + 0.5
    angle = np.arctan2(half - x, y) + np.arctan2(half + x, y)
    return float(2 * (charge.sum() + (er - 1) * (charge @ angle) / np.pi))


def _panels(length: float) -> tuple[np.ndarray, np.ndarray]:
    """Middles and half lengths of panels that become smaller towards 0."""
    count = max(1, int(np.ceil(length)))
    edges = np.append(
        length / count * 3.0 ** np.arange(-30, 0), length / count * np.arange(1, count + 1)
    )
    edges = np.append(0.0, edges)
    return (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2


def _integrals(
    targets: np.ndarray, middles: np.ndarray, halves: np.ndarray, *, logarithm: bool
) -> np.ndarray:
    """Of ln|z - z'|, or of Re 1/(z - z'), times densities by their nodal values.

    Shape (targets, nodes of all panels). Near panels by Legendre's Q, far ones by Gauss's rule.
    """
    t = (targets[:, None] - middles) / halves
    size = np.abs(halves)
    nodes = t[:, :, None] - _NODES
    with np.errstate(divide="ignore", invalid="ignore"):
        if logarithm:
            far = _WEIGHTS * np.log(np.abs(nodes))
        else:
            far = _WEIGHTS * (1 / (nodes * halves[:, None])).real * size[:, None]
    near = np.abs(t + np.sqrt(t - 1) * np.sqrt(t + 1)) < 2.5
    if not logarithm:
        near &= ~((np.abs(t.imag) < 1e-12) & (np.abs(t.real) < 1))
    s = t[near]
    Q = [np.log(_nonzero(s + 1)) / 2 - np.log(_nonzero(s - 1)) / 2]
    Q.append(s * Q[0] - 1)
    for k in range(1, _ORDER + 1):
        Q.append(((2 * k + 1) * s * Q[k] - k * Q[k - 1]) / (k + 1))
    # Legendre coefficients of the polynomial through nodal values
    legendre = np.polynomial.legendre.legvander(_NODES, _ORDER - 1).T
    to_coefficients = (np.arange(_ORDER) + 0.5)[:, None] * legendre * _WEIGHTS
    if logarithm:
        first = (s + 1) * np.log(_nonzero(s + 1)) - (s - 1) * np.log(_nonzero(s - 1)) - 2
        rest = [2 * (Q[j + 1] - Q[j - 1]) / (2 * j + 1) for j in range(1, _ORDER)]
        moments = np.array([first, *rest]).real
        far[near] = moments.T @ to_coefficients
        # ln|z| = ln|t| + ln(half length)
        values = (far + _WEIGHTS * np.log(size)[:, None]) * size[:, None]
    else:
        direction = np.broadcast_to(halves / size, t.shape)[near]
        moments = np.array([2 * q / direction for q in Q[:_ORDER]]).real
        far[near] = moments.T @ to_coefficients
        values = far
    return values.reshape(len(targets), -1)


def _nonzero(z: np.ndarray) -> np.ndarray:
    return np.where(z == 0, 1e-300, z)
