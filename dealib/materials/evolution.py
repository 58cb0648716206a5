"""How the internal metric of a Maxwell branch evolves at a point, in numpy.

A branch stores G/2 (tr(C C_i^-1) - 3), where C is the isochoric part of F^T F and C_i, det C_i = 1,
the metric that it would relax to, and relaxes by

    dC_i/dt = (C - l C_i) / tau,    l = tr(C C_i^-1) / 3.

Symmetric tensors without shear out of the meridian plane are packed: components (RR, ZZ, theta
theta, RZ) on the last axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
IDENTITY = np.array([1.0, 1.0, 1.0, 0.0])


def pack(T: Any) -> Array:
    """Components of symmetric tensors (..., 3, 3)."""
    return np.stack([T[..., 0, 0], T[..., 1, 1], T[..., 2, 2], T[..., 0, 1]], axis=-1)


def unpack(t: Any) -> Array:
    """Inverse of `pack`."""
    T = np.zeros((*t.shape[:-1], 3, 3))
    for i in range(3):
        T[..., i, i] = t[..., i]
    T[..., 0, 1] = T[..., 1, 0] = t[..., 3]
    return T


def determinant(t: Any) -> Array:
    """Determinants, shape (...)."""
    return np.asarray((t[..., 0] * t[..., 1] - t[..., 3] ** 2) * t[..., 2])


def unimodular(t: Any) -> Array:
    """The same tensors with determinant 1."""
    return np.asarray(t * determinant(t)[..., None] ** (-1 / 3))


def inverted(t: Any) -> Array:
    """Inverses."""
    d = t[..., 0] * t[..., 1] - t[..., 3] ** 2
    return np.stack([t[..., 1] / d, t[..., 0] / d, 1 / t[..., 2], -t[..., 3] / d], axis=-1)


def contract(a: Any, b: Any) -> Array:
    """tr(A B), shape (...)."""
    return np.asarray((a[..., :3] * b[..., :3]).sum(-1) + 2 * a[..., 3] * b[..., 3])


def isochoric(F: Any) -> Array:
    """Packed isochoric part of F^T F from deformation gradients (..., 3, 3)."""
    return unimodular(pack(np.swapaxes(F, -1, -2) @ F))


def step(C: Array, internal: Array, ratio: Any) -> tuple[Array, Array]:
    """The two terms of a time step: C_i at its end is unimodular(history + weight C at its end).

    With C linear in time and l constant over the step the equation above has a closed solution but
    for a factor, which det C_i = 1 gives: an exponential rule. It is of second order, exact at
    small strain for polylines of the strain, and unconditionally stable with a positive definite
    `history`. The rule of first order, unimodular(C_i + ratio C), is that of Shutov, Landgraf and
    Ihlemann (Comput. Methods Appl. Mech. Engrg. 265 (2013) 213): an implicit Euler step is
    (1 + ratio l) C_i(n+1) = C_i(n) + ratio C(n+1), where det C_i = 1 again gives the factor.

    Args:
        C: Isochoric metric at the start, (..., 4).
        internal: C_i at the start.
        ratio: Time step over relaxation time.

    Returns:
        History, (..., 4), and weight, (...).
    """
    rate = contract(C, inverted(internal)) / 3
    k = rate * ratio
    decay = np.exp(-k)
    mean = -np.expm1(-k) / k  # of the decay over the step
    small = k < 1e-4
    new = np.where(small, k / 2 - k**2 / 6 + k**3 / 24, 1 - mean)
    old = np.where(small, k / 2 - k**2 / 3 + k**3 / 8, mean - decay)
    history = decay[..., None] * internal + (old / rate)[..., None] * C
    return history, new / rate


def strain_error(C: Array, before: Array, after: Array, ratio: Any) -> Array:
    """How far the rule of first order ends from C_i = `after`: a strain, shape (...).

    It bounds the error of the step's second-order rule where steps are small.
    """
    first = unimodular(before + np.asarray(ratio)[..., None] * C)
    X = unpack(inverted(after)) @ unpack(first - after)
    return np.asarray(np.sqrt(np.abs(np.einsum("...ij,...ji", X, X))) / 2)


def stored(modulus: Any, C: Array, internal: Array) -> Array:
    """Energy density of a branch, MPa."""
    return np.asarray(modulus / 2 * (contract(C, inverted(internal)) - 3))


def power(modulus: Any, time: Any, C: Array, internal: Array) -> Array:
    """Dissipated power density, MPa/s: G/(2 tau) tr(B dev B) with B = C C_i^-1, from dC_i/dt."""
    B = unpack(C) @ unpack(inverted(internal))
    square = np.einsum("...ij,...ji", B, B)
    return np.asarray(modulus / (2 * time) * (square - np.trace(B, axis1=-2, axis2=-1) ** 2 / 3))
