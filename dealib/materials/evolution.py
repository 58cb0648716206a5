"""How the internal metric C_i of a Maxwell branch evolves at a point, in numpy.

Symmetric tensors are packed on the last axis: the diagonal and the shear of the first two
components, (11, 22, 33, 12); in solids of three dimensions also (13, 23). C is the isochoric part
of F^T F.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dealib.arrays import Array

INDICES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
PLANE, FULL = 4, 6  # numbers of packed components
_TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # an off-diagonal one stands for two


def identity(size: int = PLANE) -> Array:
    """The packed unit tensor, (size,)."""
    return np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])[:size]


def pack(T: Any, size: int = PLANE) -> Array:
    """Packed components, (..., size), of symmetric tensors (..., 3, 3)."""
    return np.stack([T[..., i, j] for i, j in INDICES[:size]], axis=-1)


def unpack(t: Any) -> Array:
    """Inverse of `pack`."""
    T = np.zeros((*t.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(INDICES[: t.shape[-1]]):
        T[..., i, j] = T[..., j, i] = t[..., k]
    return T


def determinant(t: Any) -> Array:
    """Determinants of packed tensors, shape (...)."""
    plane = (t[..., 0] * t[..., 1] - t[..., 3] ** 2) * t[..., 2]
    if t.shape[-1] == PLANE:
        return np.asarray(plane)
    a, b, _, xy, xz, yz = np.moveaxis(t, -1, 0)
    return np.asarray(plane + 2 * xy * xz * yz - a * yz**2 - b * xz**2)


def unimodular(t: Any) -> Array:
    """Packed tensors scaled to determinant 1."""
    return np.asarray(t * determinant(t)[..., None] ** (-1 / 3))


def inverted(t: Any) -> Array:
    """Inverses of packed tensors, packed."""
    if t.shape[-1] == PLANE:
        d = t[..., 0] * t[..., 1] - t[..., 3] ** 2
        out = np.empty(t.shape)
        out[..., 0], out[..., 1] = t[..., 1] / d, t[..., 0] / d
        out[..., 2], out[..., 3] = 1 / t[..., 2], -t[..., 3] / d
        return out
    a, b, c, xy, xz, yz = np.moveaxis(t, -1, 0)
    cofactors = [b * c - yz**2, a * c - xz**2, a * b - xy**2]
    cofactors += [xz * yz - xy * c, xy * yz - xz * b, xy * xz - a * yz]
    return np.asarray(np.stack(cofactors, axis=-1) / determinant(t)[..., None])


def contract(a: Any, b: Any) -> Array:
    """tr(A B) of packed tensors, shape (...)."""
    return np.asarray((a * b) @ _TWICE[: a.shape[-1]])


def isochoric(F: Any, size: int = PLANE) -> Array:
    """Packed isochoric part of F^T F from deformation gradients (..., 3, 3)."""
    return unimodular(pack(np.swapaxes(F, -1, -2) @ F, size))


class Evolution(Protocol):
    """An evolution law of C_i, with its energy and its dissipation.

    A time step is of second order and unconditionally stable. At small strain it is exact for
    strains that change linearly within each step.
    """

    def step(self, C: Array, internal: Array, ratio: float | Array) -> tuple[Array, Array]:
        """Terms of a time step that are fixed at its start; `end` takes them.

        Args:
            C: Isochoric metric at the start, packed.
            internal: C_i at the start.
            ratio: Time step over relaxation time, a number or (...).

        Returns:
            The history term, packed, and the weight of the metric at the end, (...).
        """

    def end(self, history: Array, weight: Array, C: Array) -> Array:
        """C_i at the end of the step.

        Args:
            history: From `step`.
            weight: From `step`.
            C: Isochoric metric at the end, packed.
        """

    def implicit(self, C: Array, internal: Array, ratio: float) -> Array:
        """C_i after an implicit Euler step, of first order, to a metric C at its end."""

    def stored(self, C: Array, internal: Array) -> Array:
        """Stored energy density over the shear modulus, (...)."""

    def power(self, C: Array, internal: Array) -> Array:
        """Dissipated power density times relaxation time over shear modulus, (...)."""


def weights(k: Array) -> tuple[Array, Array, Array]:
    """Decay over a step of k relaxation times, and the weights of a load at its start and end."""
    decay = np.exp(-k)
    with np.errstate(invalid="ignore"):
        mean = -np.expm1(-k) / k  # of the decay over the step
    old, new, small = mean - decay, 1 - mean, k < 1e-4
    if small.any():  # differences of nearly equal numbers
        old = np.where(small, k / 2 - k**2 / 3 + k**3 / 8, old)
        new = np.where(small, k / 2 - k**2 / 6 + k**3 / 24, new)
    return decay, old, new


class Multiplicative:
    """Multiplicative: dC_i/dt = (C - l C_i) / tau with l = tr(C C_i^-1) / 3, so that det C_i = 1.

    With C linear in time and l constant over a step the solution is closed up to a factor, which
    follows from det C_i = 1. The rule of first order is that of Shutov, Landgraf and Ihlemann
    (Comput. Methods Appl. Mech. Engrg. 265 (2013) 213): implicit Euler is
    (1 + ratio l) C_i(n+1) = C_i(n) + ratio C(n+1), where det C_i = 1 again gives the factor.
    """

    def step(self, C: Array, internal: Array, ratio: float | Array) -> tuple[Array, Array]:
        """See `Evolution`."""
        rate = contract(C, inverted(internal)) / 3
        decay, old, new = weights(rate * ratio)
        return decay[..., None] * internal + (old / rate)[..., None] * C, new / rate

    def end(self, history: Array, weight: Array, C: Array) -> Array:
        """See `Evolution`."""
        return unimodular(history + weight[..., None] * C)

    def implicit(self, C: Array, internal: Array, ratio: float) -> Array:
        """See `Evolution`."""
        return unimodular(internal + ratio * C)

    def stored(self, C: Array, internal: Array) -> Array:
        """See `Evolution`: (tr(C C_i^-1) - 3) / 2."""
        return np.asarray((contract(C, inverted(internal)) - 3) / 2)

    def power(self, C: Array, internal: Array) -> Array:
        """See `Evolution`: tr(B dev B) / 2 with B = C C_i^-1, from dC_i/dt."""
        B = unpack(C) @ unpack(inverted(internal))
        square = np.einsum("...ij,...ji", B, B)
        return np.asarray((square - np.trace(B, axis1=-2, axis2=-1) ** 2 / 3) / 2)


class Network:
    """Transient network: d(C_i^-1)/dt = (C^-1 - C_i^-1) / tau.

    Linder, Tkachuk and Miehe, J. Mech. Phys. Solids 59 (2011) 2134. The history term is one of
    C_i^-1.
    """

    def step(self, C: Array, internal: Array, ratio: float | Array) -> tuple[Array, Array]:
        """See `Evolution`."""
        decay, old, new = weights(np.full(C.shape[:-1], ratio))
        history = decay[..., None] * inverted(internal) + old[..., None] * inverted(C)
        return history, new

    def end(self, history: Array, weight: Array, C: Array) -> Array:
        """See `Evolution`."""
        return inverted(history + weight[..., None] * inverted(C))

    def implicit(self, C: Array, internal: Array, ratio: float) -> Array:
        """See `Evolution`."""
        return inverted((inverted(internal) + ratio * inverted(C)) / (1 + ratio))

    def stored(self, C: Array, internal: Array) -> Array:
        """See `Evolution`: (tr(C C_i^-1) - 3 + ln det C_i) / 2."""
        return np.asarray((contract(C, inverted(internal)) - 3 + np.log(determinant(internal))) / 2)

    def power(self, C: Array, internal: Array) -> Array:
        """See `Evolution`: (tr(C C_i^-1) + tr(C_i C^-1) - 6) / 2, from d(C_i^-1)/dt."""
        return np.asarray(
            (contract(C, inverted(internal)) + contract(internal, inverted(C)) - 6) / 2
        )


EVOLUTIONS: dict[str, Evolution] = {"multiplicative": Multiplicative(), "network": Network()}


def distance(one: Array, other: Array) -> Array:
    """Norm of the strain between two internal metrics, shape (...)."""
    X = unpack(inverted(other)) @ unpack(one - other)
    return np.asarray(np.sqrt(np.abs(np.einsum("...ij,...ji", X, X))) / 2)
