"""Internal variables of all materials with branches or softening, advanced step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.fem import compat
from dealib.fem.inner import CellGroup, InternalState
from dealib.fem.layout import Layout
from dealib.fem.problem import Problem
from dealib.materials import evolution
from dealib.materials.branches import Branch
from dealib.results import local
from dealib.results.elements import Cell
from dealib.results.rows import Rows, Stream, Transferred

_INSTANT, _LONG = 1e-12, 1e12  # step over relaxation time: nothing relaxes, everything does


class Viscosity:
    """Internal variables of all materials with branches or softening.

    Attributes:
        dissipated: Energy dissipated so far, mJ.

    Args:
        problem: A problem with such materials.
        layout: Its layout.
    """

    def __init__(self, problem: Problem, layout: Layout) -> None:
        self._problem, self._layout = problem, layout
        self._mesh, self._terms = problem.domain.mesh, problem.terms
        self._points, weights = compat.quadrature(self._mesh, problem.spaces.degree)
        self._size = problem.kinematics.packed
        self._count = max(len(m.networks) for m in problem.config.solids.values())
        materials = local.region_materials(problem.config)
        self._parts: dict[str, CellGroup] = {}
        for group in problem.groups:
            material = problem.config.materials.get(group.material)
            if material is None or not material.memory:
                continue
            rows = layout.rows(group)
            nodes = layout.nodes[rows]
            volume = local.volumes(problem.kinematics, layout.cell, nodes, self._points, weights)
            volume *= 1.0 if group.sheet is None else group.sheet.thickness
            volume[~np.isin(rows, layout.owned(rows))] = 0  # ghosts
            points = local.CellPoints.of(
                problem.kinematics,
                materials[group.regions[0]],
                layout.cell,
                nodes,
                self._points,
            )
            self._parts[group.name] = part = CellGroup(group, rows, points, material, volume)
            if material.mounted == "fresh" and material.branches:
                part.begin(lambda branch: _INSTANT)
                self._write(part)
        if any(part.material.permanent_set for part in self._parts.values()):
            problem.reform = self._reform
        self._dt = 0.0
        self._ends: list[tuple[CellGroup, InternalState]] | None = None
        self.dissipated = 0.0

    # --- steps -----------------------------------------------------------------------------------

    def rest(self) -> None:
        """Take the current state as the mounted one (collective)."""
        for part, end in self._reached():
            part.mount(end)
        self._ends, self.dissipated = None, 0.0
        self._remember()

    def begin(self, duration: float) -> None:
        """Prepare a step of a duration in s from the last converged state."""
        self._dt, self._ends = duration, None
        for part in self._parts.values():
            if part.material.branches:
                part.begin(lambda branch: duration / branch.relaxation_time)
                self._write(part)

    @contextmanager
    def held(self, stiff: Callable[[Branch], bool]) -> Iterator[None]:
        """A context in which small changes hold C_i of some branches, and the others relax at once.

        Args:
            stiff: Whether C_i of a branch is held.
        """
        values = np.empty(0) if self._terms is None else self._terms.x.array
        kept, before = values.copy(), [list(part.terms) for part in self._parts.values()]
        for part in self._parts.values():
            if part.material.branches:
                part.begin(lambda branch: _INSTANT if stiff(branch) else _LONG)
                self._write(part)
        try:
            yield
        finally:
            values[:] = kept
            for part, terms in zip(self._parts.values(), before, strict=True):
                part.terms = terms

    @contextmanager
    def relaxed(self) -> Iterator[None]:
        """A context in which all branches have relaxed in the current state (collective)."""
        kept = [(part, part.now) for part in self._parts.values()]
        for part, C in self._metrics():
            internal = part.now.internal.copy()
            internal[: len(part.material.branches)] = C
            part.now = part.now._replace(C=C, internal=internal)
        try:
            yield
        finally:
            for part, now in kept:
                part.now = now

    def _reform(self) -> None:
        """Update the networks of permanent sets to a step that ends at the current state."""
        for part, C in self._metrics():
            if part.material.permanent_set is not None:
                part.reform(C)
                self._write(part)

    def _write(self, part: CellGroup) -> None:
        """Write the terms of a part's networks where the forms read them."""
        dofs = compat.cell_dofs(self._terms.function_space)
        bs = self._terms.function_space.dofmap.index_map_bs
        values, packed = self._terms.x.array.reshape(-1, bs), part.step
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
            self._problem.settle()  # a sheet's stored energies depend on the peaks

    def error(self) -> float:
        """Error of the branches' strain in the last step, of second order; 0 without branches.

        It is the difference from implicit Euler, as the root mean square over the volume and, with
        the moduli as weights, over the branches (collective).
        """
        sums = np.zeros(2)
        for part, end in self._reached():
            sums += part.error(self._dt, end.C, end.internal)
        total = self._mesh.comm.allreduce(sums, op=MPI.SUM)
        return float(np.sqrt(total[0] / total[1])) if total[1] else 0.0

    def commit(self) -> None:
        """Accept the current state as the end of the step (collective).

        The branches dissipate the energy that the change of C_i releases at constant C, taken as
        the mean of C at the start and at the end. It balances the stored energy exactly with the
        trapezoidal work of the branches' stress. Softening dissipates the reduction of the law's
        energy.
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
        """A context in which the current state is accepted tentatively (collective)."""
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
        """Internal variables in the whole mesh on rank 0, (cells, points, entries, size).

        Entries are C_i of each network, packed, then for a law that softens the largest energy in
        the first component. Cells are those of `local.cells_with_memory`, points are quadrature
        points. Cells with fewer entries than others are filled with unit tensors (collective).
        """
        found = self.stream()
        return None if found is None else found.whole()

    def stream(self) -> Stream | None:
        """The same, some cells at a time (collective: other ranks return after rank 0 has read)."""
        count = max(len(p.networks) + p.material.softens for p in self._parts.values())
        shape, layout = (len(self._points), count, self._size), self._layout
        place = np.full((2, len(layout.nodes)), -1)  # part of each row, and its place there
        parts = list(self._parts.values())
        for k, part in enumerate(parts):
            place[0, part.cells], place[1, part.cells] = k, np.arange(len(part.cells))

        def of(rows: Any) -> Array:
            values = np.tile(evolution.identity(self._size), (len(rows), *shape[:-1], 1))
            for k, part in enumerate(parts):
                here = np.flatnonzero(place[0, rows] == k)
                packed = part.packed(place[1, rows[here]])
                values[here, :, : packed.shape[2]] = packed
            return values

        every = layout.exchange.stream(shape, of)
        if layout.mesh is None:
            for _ in every:
                pass
            return None
        cells = local.cells_with_memory(self._problem.config, layout.mesh)

        def remembered() -> Iterator[Array]:
            first = 0
            for values in every:
                low, high = np.searchsorted(cells, (first, first + len(values)))
                yield values[cells[low:high] - first]
                first += len(values)

        return Stream((len(cells), *shape), remembered())

    def of_cells(self, group: str, cells: Any, points: Array | None = None) -> Array | None:
        """Internal variables at points of local cells, (cells, points, entries, size).

        Args:
            group: Their group of regions; None is returned if it has no internal variables.
            cells: The cells.
            points: Reference points; default the cells' Gauss points.
        """
        if group not in self._parts:
            return None
        part = self._parts[group]
        order = np.argsort(part.cells)
        index = order[np.searchsorted(part.cells, cells, sorter=order)]
        return Transferred(part.packed(index), self.weights(points))[:]

    def weights(self, points: Array | None = None) -> Array:
        """Matrix that extrapolates from quadrature to other points, (others, points).

        Args:
            points: Reference points; default the cells' Gauss points.
        """
        cell: Cell = self._layout.cell
        here = cell.shape(self._points)[0]
        there = cell.shape(cell.gauss if points is None else points)[0]
        return np.asarray(there @ np.linalg.pinv(here))

    def restore(self, gathered: Rows | None, dissipated: float) -> None:
        """Inverse of `gather`, with the metric of the current state (collective)."""
        mesh = self._layout.mesh
        cells = None if mesh is None else local.cells_with_memory(self._problem.config, mesh)
        mine = self._layout.exchange.mine(gathered, cells)
        for part in self._parts.values():
            n, kept = len(part.networks), mine[part.cells]
            peak = kept[:, :, n, 0] if part.material.softens else part.now.peak
            part.now = InternalState(part.now.C, np.moveaxis(kept[:, :, :n], 2, 0).copy(), peak)
        self._remember()
        for part, C in self._metrics():
            part.now = part.now._replace(C=C)
        self.dissipated = dissipated

    # --- parts -----------------------------------------------------------------------------------

    def _metrics(self) -> Iterator[tuple[CellGroup, Array]]:
        """Each part with the isochoric metric of the current state."""
        nodal = self._layout.local()
        for part in self._parts.values():
            across, sheet = None, part.group.sheet
            if sheet is not None:  # the stretch that the solver has found
                V = sheet.stretch.function_space
                across = sheet.stretch.x.array[compat.cell_dofs(V)[self._layout.cells(part.cells)]]
            F = part.points.gradient(nodal[part.cells], across)
            total = F if part.prestretch is None else F * part.prestretch.value
            yield part, evolution.isochoric(total, self._size)

    def _reached(self) -> list[tuple[CellGroup, InternalState]]:
        """Each part with its state at the end of the step, which is found once for each step."""
        if self._ends is None:
            self._ends = [(part, part.end(C)) for part, C in self._metrics()]
        return self._ends

    def _total(self, mine: float) -> float:
        return float(self._mesh.comm.allreduce(mine, op=MPI.SUM))
