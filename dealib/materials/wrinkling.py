"""Tension fields: the excess metric by which fine wrinkles relieve a thin film of compression.

A film without bending stiffness wrinkles finely where it would be compressed. Its relaxed energy is
the minimum of its energy over all metrics C + N with N positive semidefinite (A. C. Pipkin, IMA J.
Appl. Math. 36 (1986) 85); N is the excess length in the wrinkles. With N = M^2 the minimum has no
constraints. Where the film is taut, M is 0. Where it wrinkles in one direction, M has rank 1 and
the stress across the wrinkles vanishes. Where it is slack, all stress vanishes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array

Evaluate = Callable[[Array], tuple[Array, Array]]

# plane metrics: 1 component in plane strain, 2 with known principal directions, 3 in general
BASES = {
    1: np.array([[[1.0, 0], [0, 0]]]),
    2: np.array([[[1.0, 0], [0, 0]], [[0, 0], [0, 1.0]]]),
    3: np.array([[[1.0, 0], [0, 0]], [[0, 0], [0, 1.0]], [[0, 1.0], [1.0, 0]]]),
}
_ENOUGH, _MOST = 1e-11, 60  # step of M at which Newton's method has converged; most steps
_PRESSED = 1e-9  # compression over the curvature's size at which a film wrinkles
_FLAT = 1e-7  # M below which a film counts as flat
_LONGEST = 0.3  # largest step of M


def matrices(components: Array) -> Array:
    """Symmetric 2 x 2 matrices, (..., 2, 2), from their components, (..., count)."""
    return np.einsum("...i,iab->...ab", components, BASES[components.shape[-1]])


def components(matrices: Array, count: int) -> Array:
    """Inverse of `matrices`: the components 11, 22, 12 as far as there are."""
    return np.stack([matrices[..., a, b] for a, b in ((0, 0), (1, 1), (0, 1))[:count]], axis=-1)


class Wrinkles:
    """The root M of the excess metric at many points, found by minimising the energy.

    Attributes:
        root: M, (points, 2, 2), positive semidefinite.

    Args:
        points: Number of points.
        count: Number of components of the metric.
    """

    def __init__(self, points: int, count: int) -> None:
        self.root = np.zeros((points, 2, 2))
        self._basis = BASES[count]

    @property
    def excess(self) -> Array:
        """The excess metric N, (points, count)."""
        return components(self.root @ self.root, len(self._basis))

    @property
    def wrinkled(self) -> Array:
        """Whether each point is wrinkled or slack, as 1 or 0, (points,)."""
        return np.asarray(np.abs(self.root).max(axis=(-1, -2)) > _FLAT, dtype=float)

    def set_excess(self, excess: Array) -> None:
        """Start from another N."""
        values, vectors = np.linalg.eigh(matrices(excess))
        roots = np.sqrt(values.clip(min=0.0))
        self.root = (vectors * roots[..., None, :]) @ np.swapaxes(vectors, -1, -2)

    def relax(self, evaluate: Evaluate) -> Array:
        """Find M by Newton's method; returns whether each point converged, (points,).

        Args:
            evaluate: Gives the first (points, count) and the second derivatives (points, count,
                count) of the energy by the components of C, at an excess N.
        """
        self.root[~np.isfinite(self.root).all(axis=(-1, -2))] = 0.0  # left by a failed step
        for _ in range(_MOST):
            slope, curvature, known = _known(*evaluate(self.excess))
            if self._kick(slope, curvature):
                slope, curvature, known = _known(*evaluate(self.excess))
            gradient, hessian, _ = self._in_root(slope, curvature)
            values, vectors = np.linalg.eigh(hessian)
            size = np.abs(values).max(axis=-1, keepdims=True)
            values = np.maximum(np.abs(values), 1e-12 * size + 1e-300)
            step = np.einsum("pij,pj,pkj,pk->pi", vectors, 1 / values, vectors, gradient)
            length = np.abs(step).max(axis=-1, initial=0.0)
            step *= np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
            moved = self.root - np.einsum("pi,iab->pab", step, self._basis)
            eigen, frames = np.linalg.eigh(moved)
            self.root = (frames * np.abs(eigen)[:, None, :]) @ np.swapaxes(frames, -1, -2)
            if not length.max(initial=0.0) > _ENOUGH:
                break
        return np.asarray(known & (length <= 1e-8))

    def _kick(self, slope: Array, curvature: Array) -> bool:
        """Start wrinkles where a flat film is compressed; returns whether there are new ones.

        Their depth is that of a Newton step in N.
        """
        stress = self._stress(slope)
        values, vectors = np.linalg.eigh(stress)
        across = vectors[..., 0]
        square = across[..., :, None] * across[..., None, :]
        along = components(square, len(self._basis))
        stiff = np.einsum("pi,pij,pj->p", along, curvature, along)
        size = np.abs(curvature).max(axis=(-1, -2))
        flat = np.einsum("pa,pab,pb->p", across, self.root, across) < _FLAT
        pressed = flat & (values[..., 0] < -_PRESSED * size)
        excess = -values[:, 0] / np.maximum(stiff, 1e-3 * size)
        kick = np.sqrt(np.where(pressed, excess.clip(0.0, 1.0), 0.0))
        self.root = self.root + kick[:, None, None] * square
        return bool(pressed.any())

    def _stress(self, slope: Array) -> Array:
        """The derivative by C as a matrix; that by the component 12 holds two entries."""
        halves = np.array([1.0, 1.0, 0.5])[: slope.shape[-1]]
        return matrices(slope * halves)

    def _in_root(self, slope: Array, curvature: Array) -> tuple[Array, Array, Array]:
        """Gradient and Hessian of the energy by M, and dN/dM, (points, count, count)."""
        B, M, S = self._basis, self.root, self._stress(slope)
        moves = M[:, None] @ B + B @ M[:, None]
        J = np.moveaxis(components(moves, len(B)), 1, 2)
        second = B[:, None] @ B[None]
        second = second + np.swapaxes(second, 0, 1)
        hessian = np.swapaxes(J, 1, 2) @ curvature @ J + np.einsum("pab,ijab->pij", S, second)
        return np.einsum("pci,pc->pi", J, slope), hessian, J

    def condensed(self, slope: Array, hessian: Array) -> Array:
        """A Hessian with the wrinkles eliminated by static condensation, (points, n, n).

        Args:
            slope: Derivatives by the components of C, (points, count).
            hessian: Second derivatives by these and further variables, (points, n, n).
        """
        count = len(self._basis)
        _, inner, J = self._in_root(slope, hessian[:, :count, :count])
        wrinkled = np.abs(self.root).max(axis=(-1, -2)) > _FLAT
        wrinkled &= np.isfinite(inner).all(axis=(-1, -2))
        inner = np.where(wrinkled[:, None, None], inner, np.eye(count))
        J = np.where(wrinkled[:, None, None], J, 0.0)
        mixed = hessian[:, :, :count] @ J
        back = np.linalg.pinv(inner, hermitian=True) @ np.swapaxes(mixed, 1, 2)
        return np.asarray(hessian - mixed @ back)


def _known(slope: Array, curvature: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Derivatives with zeros where they are not finite, and where they are finite, (points,).

    LAPACK may not return on input that is not a number.
    """
    known = np.asarray(np.isfinite(slope).all(axis=-1) & np.isfinite(curvature).all(axis=(-1, -2)))
    slope, curvature = slope.copy(), curvature.copy()
    slope[~known], curvature[~known] = 0.0, 0.0
    return slope, curvature, known


def extended(F: Array, excess: Array, plane: tuple[int, int]) -> Array:
    """Deformation gradients of the wrinkled film itself, whose metric is F^T F + N.

    Args:
        F: Of the smooth middle surface, (..., 3, 3); its columns in the plane are the tangents.
        excess: N, (..., count).
        plane: Numbers of the columns that N belongs to.
    """
    columns = list(plane)
    values, vectors = np.linalg.eigh(matrices(excess))  # interpolation may make it negative
    N = (vectors * values.clip(min=0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    flat = F[..., columns]
    C = np.swapaxes(flat, -1, -2) @ flat
    found = F.copy()
    found[..., columns] = flat @ _root(C, -0.5) @ _root(C + N, 0.5)
    return found


def crests(F: Array, excess: Array, plane: tuple[int, int]) -> tuple[Array, Array]:
    """Depth and direction of the wrinkles.

    Args:
        F: Of the smooth middle surface, (..., 3, 3).
        excess: N, (..., count).
        plane: Numbers of the columns that N belongs to.

    Returns:
        Excess length of the film across the crests over that of the middle surface, (...); and this
        share times the dyad of the crests' direction in the deformed film, (..., 3, 3). A crest has
        no sign, so that only dyads can be averaged.
    """
    flat = F[..., list(plane)]
    C = np.swapaxes(flat, -1, -2) @ flat
    values, vectors = np.linalg.eigh(matrices(excess))
    across = vectors[..., 1]
    length = np.einsum("...a,...ab,...b", across, C, across)
    share = np.sqrt(1 + values[..., 1].clip(min=0.0) / length) - 1
    turned = np.stack([-across[..., 1], across[..., 0]], axis=-1)
    crest = np.einsum("...ia,...a", flat, turned)
    crest /= np.linalg.norm(crest, axis=-1, keepdims=True)
    return share, np.einsum("...,...i,...j->...ij", share, crest, crest)


def _root(A: Array, power: float) -> Any:
    values, vectors = np.linalg.eigh(A)
    return (vectors * values[..., None, :] ** power) @ np.swapaxes(vectors, -1, -2)
