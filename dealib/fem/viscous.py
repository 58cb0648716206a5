"""The internal state of Maxwell branches at the quadrature points, advanced step by step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.fem import compat
from dealib.fem.layout import Layout
from dealib.fem.problem import Problem
from dealib.materials import evolution
from dealib.materials.branches import Branch
from dealib.results import local
from dealib.results.elements import Array, Cell, determinant

_INSTANT = 1e-12  # s, in which nothing relaxes


class _Part:
    """The branches of one kind of region on this rank, ghosts included.

    Attributes:
        cells: Rows in the layout, ghosts included.
        points: Their quadrature points.
        branches: The branches.
        fresh: Whether they carry the pre-stretch at the start.
        volume: Mesh volume of each quadrature point, (cells, points), mm^3; 0 in ghosts.
        prestretch: Constant of the solid, or None.
        C: Isochoric metric at the last converged state, (cells, points, size).
        internal: C_i there, (branches, cells, points, size).
        terms: History and weight of the step, for each branch.
        first: Where its values begin among those of a quadrature point.
    """

    fresh = False

    def __init__(
        self,
        cells: Any,
        points: local.Points,
        branches: tuple[Branch, ...],
        volume: Array,
        prestretch: Any,
        first: int,
        size: int,
    ) -> None:
        self.cells, self.points, self.volume, self.prestretch = cells, points, volume, prestretch
        self.first = first
        self.branches = branches
        self.C = np.tile(evolution.identity(size), (*volume.shape, 1))
        self.internal = np.tile(self.C, (len(branches), 1, 1, 1))
        self.terms: list[tuple[Array, Array]] = []

    @property
    def weights(self) -> Array:
        """Unstretched volume of each quadrature point."""
        p = self.prestretch
        return self.volume if p is None else self.volume / float(np.prod(p.value))

    def begin(self, duration: float) -> Array:
        """Prepare a step; returns its terms, packed, (cells, points, branches, size + 1)."""
        self.terms = [
            rule.step(self.C, self.internal[k], duration / b.relaxation_time)
            for k, b, rule in self._rules()
        ]
        return np.stack([np.concatenate([h, w[..., None]], -1) for h, w in self.terms], axis=2)

    def end(self, C: Array) -> Array:
        """C_i at the end of the step for a metric there."""
        return np.stack([rule.end(*self.terms[k], C) for k, _, rule in self._rules()])

    def error(self, duration: float, C: Array, end: Array) -> tuple[float, float]:
        """Square of how far implicit Euler ends from C_i = `end`, and its weight, as integrals.

        It bounds the error of the step's second-order rule where steps are small.
        """
        square = weight = 0.0
        for k, b, rule in self._rules():
            first = rule.implicit(C, self.internal[k], duration / b.relaxation_time)
            volume = b.shear_modulus * self.weights
            square += float((volume * evolution.distance(first, end[k]) ** 2).sum())
            weight += float(volume.sum())
        return square, weight

    def stored(self, C: Array, internal: Array) -> float:
        """Energy stored in this rank's branches, mJ."""
        return sum(
            float((b.shear_modulus * self.weights * rule.stored(C, internal[k])).sum())
            for k, b, rule in self._rules()
        )

    @property
    def power(self) -> float:
        """Power dissipated in them, mW."""
        return sum(
            float(
                (self.weights * rule.power(self.C, self.internal[k])).sum()
                * (b.shear_modulus / b.relaxation_time)
            )
            for k, b, rule in self._rules()
        )

    def _rules(self) -> Iterator[tuple[int, Branch, evolution.Evolution]]:
        for k, branch in enumerate(self.branches):
            yield k, branch, evolution.EVOLUTIONS[branch.evolution]


class Viscosity:
    """The internal state of all branches, advanced step by step.

    Attributes:
        dissipated: Energy dissipated so far, mJ.

    Args:
        problem: A problem with branches.
        layout: Its layout.
    """

    def __init__(self, problem: Problem, layout: Layout) -> None:
        self._problem, self._layout = problem, layout
        self._mesh, self._terms = problem.domain.mesh, problem.terms
        self._points, weights = compat.quadrature(self._mesh, problem.degree)
        self._size = problem.kinematics.packed
        self._count = max(len(m.branches) for m in problem.config.solids.values())
        materials = local.region_materials(problem.config)
        self._parts: dict[str, _Part] = {}
        for group in problem.groups:
            material = problem.config.materials.get(group.material)
            if material is None or not material.branches:
                continue
            rows = layout.rows(group)
            nodes = layout.nodes[rows]
            volume = _volumes(problem, nodes, layout.cell, self._points, weights)
            volume *= 1.0 if group.sheet is None else group.sheet.thickness
            volume[~np.isin(rows, layout.owned(rows))] = 0  # ghosts
            points = local.Points.of(
                problem.kinematics,
                materials[group.regions[0]],
                layout.cell,
                nodes,
                self._points,
            )
            first = group.slot * self._count * (self._size + 1)
            part = _Part(
                rows, points, material.branches, volume, group.prestretch, first, self._size
            )
            self._parts[group.name] = part
            if material.mounted == "fresh":
                part.fresh = True
                self._write(part, _INSTANT)
        self._dt = 0.0
        self._ends: list[tuple[_Part, Array, Array]] | None = None
        self.dissipated = 0.0

    # --- steps -----------------------------------------------------------------------------------

    def rest(self) -> None:
        """Take the current state as the mounted one, in which branches are relaxed unless fresh."""
        for part, C in self._metrics():
            part.C, part.internal[:] = C, evolution.identity(self._size) if part.fresh else C
        self.dissipated = 0.0

    def begin(self, duration: float) -> None:
        """Prepare a step from the last converged state, in s."""
        self._dt, self._ends = duration, None
        for part in self._parts.values():
            self._write(part, duration)

    def _write(self, part: _Part, duration: float) -> None:
        """Prepare a step of one part."""
        dofs = compat.cell_dofs(self._terms.function_space)
        size = self._terms.function_space.dofmap.index_map_bs
        values = self._terms.x.array.reshape(-1, size)
        packed = part.begin(duration)
        count = packed.shape[2] * (self._size + 1)
        at = slice(part.first, part.first + count)
        values[dofs[self._layout.cells(part.cells)], at] = packed.reshape(*packed.shape[:2], count)

    def error(self) -> float:
        """Error of the branches' strain in the step just solved, of the order of its square.

        Root mean square over the volume and, weighted by the moduli, over the branches, of what
        implicit Euler would do otherwise (collective).
        """
        sums = np.zeros(2)
        for part, C, end in self._reached():
            sums += part.error(self._dt, C, end)
        total = self._mesh.comm.allreduce(sums, op=MPI.SUM)
        return float(np.sqrt(total[0] / total[1]))

    def commit(self) -> None:
        """Accept the current state as the end of the step (collective).

        What C_i releases at fixed C, the mean of that at the start and at the end, is dissipated:
        with the trapezoidal work of the branches' stress it balances what they store exactly.
        """
        lost = 0.0
        for part, C, internal in self._reached():
            for at in (part.C, C):
                lost += (part.stored(at, part.internal) - part.stored(at, internal)) / 2
            part.C, part.internal = C, internal
        self._ends = None
        self.dissipated += self._total(lost)

    @contextmanager
    def tentative(self) -> Iterator[None]:
        """Accept the current state for a while, to look at it (collective)."""
        kept = [(part, part.C, part.internal) for part in self._parts.values()]
        reached, dissipated = self._reached(), self.dissipated
        self.commit()
        try:
            yield
        finally:
            for part, C, internal in kept:
                part.C, part.internal = C, internal
            self._ends, self.dissipated = reached, dissipated

    # --- results ---------------------------------------------------------------------------------

    @property
    def stored(self) -> float:
        """Energy stored in the branches, mJ (collective)."""
        return self._total(sum(p.stored(p.C, p.internal) for p in self._parts.values()))

    @property
    def power(self) -> float:
        """Dissipated power, mW (collective)."""
        return self._total(sum(p.power for p in self._parts.values()))

    def gather(self) -> Array | None:
        """C_i of the whole mesh on rank 0, (cells, points, branches, size) (collective).

        Cells are those of `local.branch_cells`, points those of the quadrature; what a cell has
        fewer branches than others is 1.
        """
        count = max(len(p.branches) for p in self._parts.values())
        shape = (len(self._layout.nodes), len(self._points), count, self._size)
        values = np.tile(evolution.identity(self._size), (*shape[:-1], 1))
        for part in self._parts.values():
            values[part.cells, :, : len(part.branches)] = np.moveaxis(part.internal, 0, 2)
        whole = self._layout.gather_cells(values)
        if whole is None or self._layout.mesh is None:
            return None
        return np.asarray(whole[local.branch_cells(self._problem.config, self._layout.mesh)])

    def of_cells(self, group: str, cells: Any, points: Array | None = None) -> Array | None:
        """C_i at points of local cells, (cells, points, branches, size).

        Args:
            group: Their group of regions; None is returned if it has no branches.
            cells: The cells.
            points: Reference points; default the cells' Gauss points.
        """
        if group not in self._parts:
            return None
        part = self._parts[group]
        order = np.argsort(part.cells)
        index = order[np.searchsorted(part.cells, cells, sorter=order)]
        return self.at_points(np.moveaxis(part.internal[:, index], 0, 2), points)

    def at_points(self, gathered: Array, points: Array | None = None) -> Array:
        """The same at other points; default the Gauss points, at which fields are derived."""
        cell: Cell = self._layout.cell
        here = cell.shape(self._points)[0]
        there = cell.shape(cell.gauss if points is None else points)[0]
        return np.einsum("gq,cq...->cg...", there @ np.linalg.pinv(here), gathered)

    def restore(self, gathered: Array | None, dissipated: float) -> None:
        """Inverse of `gather`, with the metric of the current state (collective)."""
        mesh, whole = self._layout.mesh, None
        if mesh is not None and gathered is not None:
            whole = np.empty((len(mesh.cells), *gathered.shape[1:]))
            whole[local.branch_cells(self._problem.config, mesh)] = gathered
        whole = self._mesh.comm.bcast(whole, root=0)
        mine = self._layout.mine(whole)
        for part, C in self._metrics():
            kept = mine[part.cells][:, :, : len(part.branches)]
            part.C, part.internal = C, np.moveaxis(kept, 2, 0).copy()
        self.dissipated = dissipated

    # --- parts -----------------------------------------------------------------------------------

    def _metrics(self) -> Iterator[tuple[_Part, Array]]:
        """Each part with the isochoric metric of the current state."""
        nodal = self._layout.local()
        for part in self._parts.values():
            F = self._deformation(part, nodal[part.cells])
            total = F if part.prestretch is None else F * part.prestretch.value
            yield part, evolution.isochoric(total, self._size)

    def _deformation(self, part: _Part, nodal: Array) -> Array:
        """Deformation gradients from the mesh; of sheets with the solver's thickness stretch."""
        F = part.points.deformation(nodal, np.moveaxis(part.internal, 0, 2)).F
        return F

    def _reached(self) -> list[tuple[_Part, Array, Array]]:
        """Each part with its metric and C_i at the current state, found once a step."""
        if self._ends is None:
            self._ends = [(part, C, part.end(C)) for part, C in self._metrics()]
        return self._ends

    def _total(self, mine: float) -> float:
        return float(self._mesh.comm.allreduce(mine, op=MPI.SUM))


def _volumes(problem: Problem, nodes: Array, cell: Cell, points: Array, weights: Array) -> Array:
    """Size of the device's mesh at the points of cells, (cells, points)."""
    N, dN = cell.shape(points)
    mesh = nodes[..., list(problem.kinematics.lies)]
    size = np.abs(determinant(np.swapaxes(mesh, 1, 2)[:, None] @ dN))
    return np.asarray(problem.kinematics.volumes(N @ nodes) * size * weights)
