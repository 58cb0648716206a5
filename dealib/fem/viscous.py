"""What materials remember at the quadrature points, advanced step by step.

It is C_i of each network, and the largest energy so far of a law that softens.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np

from dealib.fem import compat
from dealib.fem.groups import Group
from dealib.fem.layout import Layout
from dealib.fem.problem import Problem
from dealib.materials import evolution, softening
from dealib.materials.branches import Branch
from dealib.results import local
from dealib.results.elements import Array, Cell, determinant

_INSTANT = 1e-12  # s, in which nothing relaxes


class _State(NamedTuple):
    """What a part remembers.

    Attributes:
        C: Isochoric metric, (cells, points, size).
        internal: C_i, (networks, cells, points, size).
        peak: Largest energy density of the law so far, (cells, points), MPa.
    """

    C: Array
    internal: Array
    peak: Array


class _Part:
    """The solids of one kind of region on this rank, ghosts included.

    Attributes:
        group: The regions.
        cells: Rows in the layout, ghosts included.
        points: Their quadrature points.
        material: What they are made of.
        volume: Mesh volume of each quadrature point, (cells, points), mm^3; 0 in ghosts.
        prestretch: Constant of the solid, or None.
        now: The last converged state.
        terms: History and weight of the step, for each network.
    """

    def __init__(
        self, group: Group, cells: Any, points: local.Points, material: Any, volume: Array
    ) -> None:
        self.group, self.cells, self.points, self.volume = group, cells, points, volume
        self.prestretch = group.prestretch
        self.material, self.networks = material, material.networks
        C = np.tile(evolution.identity(points.kinematics.packed), (*volume.shape, 1))
        self.now = _State(C, np.tile(C, (len(self.networks), 1, 1, 1)), np.zeros(volume.shape))
        relaxed = (np.zeros_like(C), np.ones(volume.shape))
        self.terms = [relaxed] * len(self.networks)

    @property
    def weights(self) -> Array:
        """Unstretched volume of each quadrature point."""
        p = self.prestretch
        return self.volume if p is None else self.volume / float(np.prod(p.value))

    def begin(self, duration: float) -> None:
        """Prepare a step of the branches."""
        C, internal, _ = self.now
        for k, b, rule in self._rules():
            self.terms[k] = rule.step(C, internal[k], duration / b.relaxation_time)

    def reform(self, C: Array) -> None:
        """Prepare a step that ends at a metric, for the network whose clock is the energy."""
        inner = self._path(C)[1]
        self.terms[-1] = (evolution.inverted(inner), np.ones(inner.shape[:-1]))

    def _path(self, C: Array) -> tuple[Array, Array]:
        """Largest energy and C_i of the second network at the end of a step."""
        start, internal, peak = self.now
        given = self.material.permanent_set
        inner = start if given is None else internal[-1]
        return softening.path(self.material, given, start, C, inner, peak)

    @property
    def packed(self) -> Array:
        """The terms, (cells, points, networks, size + 1)."""
        return np.stack([np.concatenate([h, w[..., None]], -1) for h, w in self.terms], axis=2)

    def end(self, C: Array) -> _State:
        """State at the end of the step for a metric there."""
        internal = self.now.internal.copy()
        for k, _, rule in self._rules():
            internal[k] = rule.end(*self.terms[k], C)
        peak = self.now.peak
        if self.material.softens:
            peak, inner = self._path(C)
            if self.material.permanent_set is not None:
                internal[-1] = inner
        return _State(C, internal, peak)

    def mount(self, end: _State) -> None:
        """Take the end of the pre-stretch as the mounted state, where branches are at rest.

        They are relaxed, unless the material is mounted fresh; it softens on the way.
        """
        at_rest = end.C if self.material.mounted == "relaxed" else self.now.C
        for k, _, _ in self._rules():
            end.internal[k] = at_rest
        self.now = end

    def error(self, duration: float, C: Array, end: Array) -> tuple[float, float]:
        """Square of how far implicit Euler ends from C_i = `end`, and its weight, as integrals.

        It bounds the error of the step's second-order rule where steps are small.
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
        """Energy that the law has lost by softening, mJ."""
        p = self.material.mullins
        return 0.0 if p is None else float((softening.withheld(peak, peak, p) * self.weights).sum())

    @property
    def power(self) -> float:
        """Power dissipated in the branches, mW."""
        C, internal, _ = self.now
        return sum(
            float(
                (self.weights * rule.power(C, internal[k])).sum()
                * (b.shear_modulus / b.relaxation_time)
            )
            for k, b, rule in self._rules()
        )

    def _rules(self) -> Iterator[tuple[int, Branch, evolution.Evolution]]:
        for k, branch in enumerate(self.material.branches):
            yield k, branch, evolution.EVOLUTIONS[branch.evolution]


class Viscosity:
    """The state of all materials with a memory, advanced step by step.

    Attributes:
        dissipated: Energy dissipated so far, mJ.

    Args:
        problem: A problem with such materials.
        layout: Its layout.
    """

    def __init__(self, problem: Problem, layout: Layout) -> None:
        self._problem, self._layout = problem, layout
        self._mesh, self._terms = problem.domain.mesh, problem.terms
        self._points, weights = compat.quadrature(self._mesh, problem.degree)
        self._size = problem.kinematics.packed
        self._count = max(len(m.networks) for m in problem.config.solids.values())
        materials = local.region_materials(problem.config)
        self._parts: dict[str, _Part] = {}
        for group in problem.groups:
            material = problem.config.materials.get(group.material)
            if material is None or not material.memory:
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
            self._parts[group.name] = part = _Part(group, rows, points, material, volume)
            if material.mounted == "fresh" and material.branches:
                part.begin(_INSTANT)
                self._write(part)
        if any(part.material.permanent_set for part in self._parts.values()):
            problem.reform = self._reform
        self._dt = 0.0
        self._ends: list[tuple[_Part, _State]] | None = None
        self.dissipated = 0.0

    # --- steps -----------------------------------------------------------------------------------

    def rest(self) -> None:
        """Take the current state as the mounted one (collective)."""
        for part, end in self._reached():
            part.mount(end)
        self._ends, self.dissipated = None, 0.0
        self._remember()

    def begin(self, duration: float) -> None:
        """Prepare a step from the last converged state, in s."""
        self._dt, self._ends = duration, None
        for part in self._parts.values():
            if part.material.branches:
                part.begin(duration)
                self._write(part)

    def _reform(self) -> None:
        """Prepare the current step of the networks whose clock is the energy, to this state."""
        for part, C in self._metrics():
            if part.material.permanent_set is not None:
                part.reform(C)
                self._write(part)

    def _write(self, part: _Part) -> None:
        """Write the terms of a part's networks where the forms read them."""
        dofs = compat.cell_dofs(self._terms.function_space)
        bs = self._terms.function_space.dofmap.index_map_bs
        values, packed = self._terms.x.array.reshape(-1, bs), part.packed
        first = part.group.slot * self._count * (self._size + 1)
        at = slice(first, first + packed.shape[2] * (self._size + 1))
        values[dofs[self._layout.cells(part.cells)], at] = packed.reshape(*packed.shape[:2], -1)

    def _remember(self) -> None:
        """Write the largest energies where the forms read them."""
        peaks = self._problem.peaks
        if peaks is None:
            return
        dofs = compat.cell_dofs(peaks.function_space)
        values = peaks.x.array.reshape(-1, peaks.function_space.dofmap.index_map_bs)
        for part in self._parts.values():
            if part.material.mullins is not None:
                values[dofs[self._layout.cells(part.cells)], part.group.slot] = part.now.peak
        if self._problem.sheet is not None:
            self._problem.settle()  # its energy is known at its points

    def error(self) -> float:
        """Error of the branches' strain in the step just solved, of the order of its square.

        0 without branches.

        Root mean square over the volume and, weighted by the moduli, over the branches, of what
        implicit Euler would do otherwise (collective).
        """
        sums = np.zeros(2)
        for part, end in self._reached():
            sums += part.error(self._dt, end.C, end.internal)
        total = self._mesh.comm.allreduce(sums, op=MPI.SUM)
        return float(np.sqrt(total[0] / total[1])) if total[1] else 0.0

    def commit(self) -> None:
        """Accept the current state as the end of the step (collective).

        What C_i releases at fixed C, the mean of that at the start and at the end, is dissipated:
        with the trapezoidal work of the networks' stress it balances what they store exactly. So is
        what softening takes off the law.
        """
        lost = 0.0
        for part, end in self._reached():
            now, part.now = part.now, end
            for C in (now.C, end.C):
                lost += (part.stored(C, now.internal) - part.stored(C, end.internal)) / 2
            lost += part.withheld(end.peak) - part.withheld(now.peak)
        self._ends = None
        self.dissipated += self._total(lost)
        self._remember()

    @contextmanager
    def tentative(self) -> Iterator[None]:
        """Accept the current state for a while, to look at it (collective)."""
        kept = [(part, part.now) for part in self._parts.values()]
        reached, dissipated = self._reached(), self.dissipated
        self.commit()
        try:
            yield
        finally:
            for part, now in kept:
                part.now = now
            self._ends, self.dissipated = reached, dissipated
            self._remember()

    # --- results ---------------------------------------------------------------------------------

    @property
    def stored(self) -> float:
        """Energy stored in the networks, mJ (collective)."""
        parts = self._parts.values()
        return self._total(sum(p.stored(p.now.C, p.now.internal) for p in parts))

    @property
    def power(self) -> float:
        """Dissipated power, mW (collective)."""
        return self._total(sum(p.power for p in self._parts.values()))

    def gather(self) -> Array | None:
        """What materials remember in the whole mesh on rank 0, packed (collective).

        Shape (cells, points, entries, size): C_i of each network, then the largest energy in the
        first component of a law that softens. Cells are those of `local.cells_with_memory`, points
        those of the quadrature; where a cell has fewer entries than others they are 1.
        """
        count = max(len(p.networks) + p.material.softens for p in self._parts.values())
        shape = (len(self._layout.nodes), len(self._points), count, self._size)
        values = np.tile(evolution.identity(self._size), (*shape[:-1], 1))
        for part in self._parts.values():
            packed = _packed(part)
            values[part.cells, :, : packed.shape[2]] = packed
        whole = self._layout.gather_cells(values)
        if whole is None or self._layout.mesh is None:
            return None
        return np.asarray(whole[local.cells_with_memory(self._problem.config, self._layout.mesh)])

    def of_cells(self, group: str, cells: Any, points: Array | None = None) -> Array | None:
        """The same at points of local cells, (cells, points, entries, size).

        Args:
            group: Their group of regions; None is returned if it remembers nothing.
            cells: The cells.
            points: Reference points; default the cells' Gauss points.
        """
        if group not in self._parts:
            return None
        part = self._parts[group]
        order = np.argsort(part.cells)
        index = order[np.searchsorted(part.cells, cells, sorter=order)]
        return self.at_points(_packed(part)[index], points)

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
            whole[local.cells_with_memory(self._problem.config, mesh)] = gathered
        whole = self._mesh.comm.bcast(whole, root=0)
        mine = self._layout.mine(whole)
        for part in self._parts.values():
            n, kept = len(part.networks), mine[part.cells]
            peak = kept[:, :, n, 0] if part.material.softens else part.now.peak
            part.now = _State(part.now.C, np.moveaxis(kept[:, :, :n], 2, 0).copy(), peak)
        self._remember()
        for part, C in self._metrics():
            part.now = part.now._replace(C=C)
        self.dissipated = dissipated

    # --- parts -----------------------------------------------------------------------------------

    def _metrics(self) -> Iterator[tuple[_Part, Array]]:
        """Each part with the isochoric metric of the current state."""
        nodal = self._layout.local()
        for part in self._parts.values():
            across, sheet = None, part.group.sheet
            if sheet is not None:  # the solver's
                V = sheet.stretch.function_space
                across = sheet.stretch.x.array[compat.cell_dofs(V)[self._layout.cells(part.cells)]]
            F = part.points.gradient(nodal[part.cells], across)
            total = F if part.prestretch is None else F * part.prestretch.value
            yield part, evolution.isochoric(total, self._size)

    def _reached(self) -> list[tuple[_Part, _State]]:
        """Each part with its state at the end of the step, found once a step."""
        if self._ends is None:
            self._ends = [(part, part.end(C)) for part, C in self._metrics()]
        return self._ends

    def _total(self, mine: float) -> float:
        return float(self._mesh.comm.allreduce(mine, op=MPI.SUM))


def _packed(part: _Part) -> Array:
    """What a part remembers, (cells, points, entries, size)."""
    found = np.moveaxis(part.now.internal, 0, 2)
    if not part.material.softens:
        return found
    peak = np.zeros((*found.shape[:2], 1, part.now.C.shape[-1]))
    peak[:, :, 0, 0] = part.now.peak
    return np.concatenate([found, peak], axis=2)


def _volumes(problem: Problem, nodes: Array, cell: Cell, points: Array, weights: Array) -> Array:
    """Size of the device's mesh at the points of cells, (cells, points)."""
    N, dN = cell.shape(points)
    mesh = nodes[..., list(problem.kinematics.lies)]
    size = np.abs(determinant(np.swapaxes(mesh, 1, 2)[:, None] @ dN))
    return np.asarray(problem.kinematics.volumes(N @ nodes) * size * weights)
