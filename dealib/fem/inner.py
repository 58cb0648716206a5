"""Internal variables of one group of regions at its quadrature points, advanced step by step.

They are C_i of each network, and the largest energy density so far of a law that softens.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from dealib.arrays import Array
from dealib.fem.groups import Group
from dealib.materials import evolution, softening
from dealib.materials.branches import Branch
from dealib.results import local


class InternalState(NamedTuple):
    """Internal variables of a part.

    Attributes:
        C: Isochoric metric, (cells, points, size).
        internal: C_i, (networks, cells, points, size).
        peak: Largest energy density of the law so far, (cells, points), MPa.
    """

    C: Array
    internal: Array
    peak: Array


class CellGroup:
    """The cells of one group of regions on this rank, ghosts included.

    Attributes:
        group: The regions.
        cells: Rows in the layout, ghosts included.
        points: Quadrature points of the cells.
        material: Their material.
        volume: Mesh volume of each quadrature point, (cells, points), mm^3; 0 in ghosts.
        prestretch: Pre-stretch of the group, a constant, or None.
        now: The last converged state.
        terms: History term and weight of the step for each network (see `Evolution.step`).
    """

    def __init__(
        self, group: Group, cells: Any, points: local.CellPoints, material: Any, volume: Array
    ) -> None:
        self.group, self.cells, self.points, self.volume = group, cells, points, volume
        self.prestretch = group.prestretch
        self.material, self.networks = material, material.networks
        C = np.tile(evolution.identity(points.kinematics.packed), (*volume.shape, 1))
        self.now = InternalState(
            C, np.tile(C, (len(self.networks), 1, 1, 1)), np.zeros(volume.shape)
        )
        relaxed = (np.zeros_like(C), np.ones(volume.shape))
        self.terms = [relaxed] * len(self.networks)

    @property
    def weights(self) -> Array:
        """Unstretched volume of each quadrature point."""
        p = self.prestretch
        return self.volume if p is None else self.volume / float(np.prod(p.value))

    def begin(self, ratio: Callable[[Branch], float]) -> None:
        """Prepare a step of the branches; `ratio` gives its duration over a relaxation time."""
        C, internal, _ = self.now
        for k, b, rule in self._rules():
            self.terms[k] = rule.step(C, internal[k], ratio(b))

    def reform(self, C: Array) -> None:
        """Prepare the network of the permanent set for a step that ends at the metric C."""
        inner = self._path(C)[1]
        self.terms[-1] = (evolution.inverted(inner), np.ones(inner.shape[:-1]))

    def _path(self, C: Array) -> tuple[Array, Array]:
        """Largest energy and C_i of the second network at the end of a step."""
        start, internal, peak = self.now
        given = self.material.permanent_set
        inner = start if given is None else internal[-1]
        return softening.path(self.material, given, start, C, inner, peak)

    @property
    def step(self) -> Array:
        """The terms in one array, (cells, points, networks, size + 1)."""
        return np.stack([np.concatenate([h, w[..., None]], -1) for h, w in self.terms], axis=2)

    def end(self, C: Array) -> InternalState:
        """State at the end of a step that ends at the metric C, (cells, points, size)."""
        internal = self.now.internal.copy()
        for k, _, rule in self._rules():
            internal[k] = rule.end(*self.terms[k], C)
        peak = self.now.peak
        if self.material.softens:
            peak, inner = self._path(C)
            if self.material.permanent_set is not None:
                internal[-1] = inner
        return InternalState(C, internal, peak)

    def mount(self, end: InternalState) -> None:
        """Take the end of the pre-stretch as the mounted state.

        Branches are relaxed there, or if the material is mounted fresh, C_i is that of the
        unstretched state. Softening by the pre-stretch remains.
        """
        at_rest = end.C if self.material.mounted == "relaxed" else self.now.C
        for k, _, _ in self._rules():
            end.internal[k] = at_rest
        self.now = end

    def error(self, duration: float, C: Array, end: Array) -> tuple[float, float]:
        """Squared distance between implicit Euler and C_i = `end`, and weight, as integrals.

        For small steps the distance bounds the error of the step's second-order rule.

        Args:
            duration: Of the step, s.
            C: Isochoric metric at its end.
            end: C_i at its end, (networks, cells, points, size).
        """
        square = weight = 0.0
        for k, b, rule in self._rules():
            first = rule.implicit(C, self.now.internal[k], duration / b.relaxation_time)
            volume = b.shear_modulus * self.weights
            square += float((volume * evolution.distance(first, end[k]) ** 2).sum())
            weight += float(volume.sum())
        return square, weight

    def stored(self, C: Array, internal: Array) -> float:
        """Energy stored in this rank's networks, mJ."""
        return sum(
            float((n.shear_modulus * self.weights * rule.stored(C, internal[k])).sum())
            for k, n in enumerate(self.networks)
            for rule in (evolution.EVOLUTIONS[n.evolution],)
        )

    def withheld(self, peak: Array) -> float:
        """Energy dissipated by softening up to a peak on this rank, mJ."""
        p = self.material.mullins
        return 0.0 if p is None else float((softening.withheld(peak, peak, p) * self.weights).sum())

    @property
    def power(self) -> float:
        """Power dissipated in this rank's branches, mW."""
        C, internal, _ = self.now
        return sum(
            float(
                (self.weights * rule.power(C, internal[k])).sum()
                * (b.shear_modulus / b.relaxation_time)
            )
            for k, b, rule in self._rules()
        )

    def packed(self, cells: Any) -> Array:
        """Internal variables of some cells in one array, (cells, points, entries, size).

        See `Viscosity.gather`.

        Args:
            cells: Their places in `cells`.
        """
        found = np.moveaxis(self.now.internal[:, cells], 0, 2)
        if not self.material.softens:
            return found
        peak = np.zeros((*found.shape[:2], 1, self.now.C.shape[-1]))
        peak[:, :, 0, 0] = self.now.peak[cells]
        return np.concatenate([found, peak], axis=2)

    def _rules(self) -> Iterator[tuple[int, Branch, evolution.Evolution]]:
        for k, branch in enumerate(self.material.branches):
            yield k, branch, evolution.EVOLUTIONS[branch.evolution]
