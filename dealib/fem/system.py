"""Residual and tangent in the reduced unknowns, assembled without lifting."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.fem import petsc as fem_petsc

from dealib.fem import compat
from dealib.fem.constraints import FIELDS
from dealib.fem.platform import Platform
from dealib.fem.problem import Problem


class Element(Protocol):
    """What loads a port by its value, such as a spring."""

    def load(self, x: float) -> tuple[float, float]:
        """Load and its slope at a value x, counted from the anchor; the slope continuous."""


@dataclass
class PortLaw:
    """The equation of one port: its value is given, or its dual balances what loads it.

    Attributes:
        value: Prescribed value of the port; None if it is loaded instead.
        load: Load that does not depend on the port's value.
        elements: What else loads it, each with the value that is its anchor.
        weights: Weights of the ports' values. In place of the port's own value their sum is
            prescribed; of a loaded port the sum is taken from the load.
    """

    value: float | None = None
    load: float = 0.0
    elements: tuple[tuple[Element, float], ...] = ()
    weights: tuple[tuple[str, float], ...] = ()

    @property
    def fixed(self) -> bool:
        """Whether the port's own value is given, so that its row and column can be left out."""
        return self.value is not None and not self.weights

    def balance(self, q: float) -> tuple[float, float]:
        """The whole load at a value of the port, and its slope."""
        found = [element.load(q - anchor) for element, anchor in self.elements]
        return self.load + sum(load for load, _ in found), sum(slope for _, slope in found)

    def residual(self, name: str, values: dict[str, float], internal: float) -> float:
        """Zero in equilibrium.

        Args:
            name: Of the port.
            values: Of all ports.
            internal: dPi/dq of the body at this port.
        """
        weighted = sum(weight * values[port] for port, weight in self.weights)
        if self.value is not None:
            return (weighted if self.weights else values[name]) - self.value
        return internal - self.balance(values[name])[0] + weighted


_NOISE = 1e-14  # of a port's column, of its largest entry
_CHUNK = 10_000  # nodes whose neighbours are counted at a time


class Timings(defaultdict[str, float]):
    """Seconds by phase."""

    def __init__(self) -> None:
        super().__init__(float)

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        """Add the time of a block to a phase."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self[phase] += time.perf_counter() - start


class System:
    """The nonlinear system r(q) = 0 and its tangent.

    Attributes:
        ports: The equation of each port.
        values: q at each port, of the last residual.
        internal: dPi/dq at each port, of the last residual.
        timings: Seconds spent by phase.
    """

    def __init__(self, problem: Problem, timings: Timings) -> None:
        self.problem, self.map, self.timings = problem, problem.constraints, timings
        self.ports = {name: PortLaw(value=0.0) for name in self.map.ports}
        self.values = dict.fromkeys(self.map.ports, 0.0)
        self.internal = dict.fromkeys(self.map.ports, 0.0)
        self._eliminated: dict[str, Any] = {}
        self.q = self.map.create_vector()
        self.residual_vector = self.map.create_vector()
        self._parts = [("residual", "tangent", self.map.physical)]
        if problem.mesh_motion:
            self._parts.append(("mesh_residual", "mesh_tangent", self.map.mesh_rows))
        with timings("forms"):
            assembled = [name for part in self._parts for name in part[:2]]
            for port in problem.values:
                assembled += [f"dual {port}", f"column {port}"]
                assembled += [f"corner {port} {other}" for other in problem.values]
            assembled += ["along"] if self.map.platforms else []
            for name in ("elastic", "electric", *assembled):
                problem.form(name)
            self._local = compat.create_vector(problem.spaces.W, self.map.comm)
        self._forces = self._on_platforms()
        self._columns = self.map.lgmap(self.map.columns)
        self._rows = [self.map.lgmap(rows) for _, _, rows in self._parts]
        with timings("matrix"):
            self.matrix = self._create_matrix()

    # --- residual --------------------------------------------------------------------------------

    def residual(self, q: Any, out: Any) -> None:
        """Assemble r(q), with the port equations in their rows."""
        with self.timings("assembly"):
            self.expand(q)
            out.set(0.0)
            for form, _, rows in reversed(self._parts):
                self._add_vector(out, form, rows)
            self._forces = self._on_platforms()  # of the last part, the physical one
            self.internal, self.values = self.map.port_values(out), self.map.port_values(q)
            for platform, forces in zip(self.map.platforms, self._forces, strict=True):
                duals = self._summed(platform.directions(self.values) @ forces)
                self.internal |= dict(zip(platform.ports, duals.tolist(), strict=True))
            for name in self.problem.values:
                self.internal[name] = self.problem.integrate(f"dual {name}")
            for name, law in self.ports.items():
                self.map.set_port(out, name, law.residual(name, self.values, self.internal[name]))

    def expand(self, q: Any) -> None:
        """Set the problem's state from reduced unknowns."""
        self.map.expand(q, self.problem.spaces.w)
        if self.problem.values:
            self.problem.set_values(self.map.port_values(q))
        self.problem.settle()

    def _add_vector(self, out: Any, form: str, rows: Any) -> None:
        """Assemble a linear form into reduced rows."""
        with self._local.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._local, self.problem.form(form))
        with self._local.localForm() as local:
            used = rows >= 0
            out.setValues(rows[used], local.array_r[used], addv=PETSc.InsertMode.ADD_VALUES)
        out.assemble()

    def _on_platforms(self) -> list[Any]:
        """The last linear form at the degrees of freedom of each rigid mount, this rank's share."""
        return [self._local_values()[platform.dofs] for platform in self.map.platforms]

    def _local_values(self) -> Any:
        with self._local.localForm() as local:
            return local.array_r.copy()

    def _summed(self, mine: Any) -> Any:
        total = np.empty_like(mine)
        self.map.comm.Allreduce(mine, total)
        return total

    def field_norms(self, vector: Any) -> npt.NDArray[np.float64]:
        """Euclidean norm of a reduced vector by field, without the ports."""
        mine = vector.array_r[: len(self.map.field)]
        sums = np.bincount(self.map.field, weights=mine**2, minlength=len(FIELDS))
        return np.asarray(np.sqrt(self._summed(sums)))

    # --- tangent ---------------------------------------------------------------------------------

    def tangent(self, matrix: Any) -> None:
        """Assemble dr/dq at the state of the last residual.

        A prescribed port loses its column with its row, which keeps the tangent symmetric where the
        problem is: its step is known, and `eliminate` takes it out of a right-hand side.
        """
        with self.timings("assembly"):
            matrix.zeroEntries()
            self._assemble(matrix)
            summed = []
            for name, law in self.ports.items():
                if law.value is None:
                    slope = law.balance(self.values[name])[1]
                    self._add(matrix, name, [(name, -slope), *law.weights])
                elif law.weights:
                    summed.append(name)
            matrix.assemble()
            if summed:
                mine = [self.map.ports[n] for n in summed] if self.map.comm.rank == 0 else []
                matrix.zeroRows(mine, 0.0)
                for name in summed:
                    self._add(matrix, name, self.ports[name].weights)
                matrix.assemble()
            rows = {n: self.map.ports[n] for n, p in self.ports.items() if p.fixed}
            self._eliminated = {name: self._column(matrix, name) for name in rows}
            matrix.zeroRowsColumns(list(rows.values()) if self.map.comm.rank == 0 else [], 1.0)

    def _add(self, matrix: Any, name: str, weights: Iterable[tuple[str, float]]) -> None:
        """Add to the row of a port, in the columns of ports."""
        for port, weight in weights if self.map.comm.rank == 0 else ():
            row, column = self.map.ports[name], self.map.ports[port]
            matrix.setValue(row, column, weight, addv=PETSc.InsertMode.ADD_VALUES)

    def column(self, port: str) -> Any:
        """Column of a prescribed port that the last tangent has lost."""
        return self._eliminated[port]

    def _column(self, matrix: Any, port: str) -> Any:
        unit, column = self.q.duplicate(), self.q.duplicate()
        unit.set(0.0)
        self.map.set_port(unit, port, 1.0)
        unit.assemble()
        matrix.mult(unit, column)
        return column

    def eliminate(self, right: Any) -> None:
        """Make a right-hand side fit the last tangent: take the prescribed ports' steps out of it.

        Args:
            right: Of the equations dr/dq x = right, with x itself in the prescribed ports' rows.
        """
        steps = self.map.port_values(right)
        for name, column in self._eliminated.items():
            right.axpy(-steps[name], column)
        for name in self._eliminated:
            self.map.set_port(right, name, steps[name])
        right.assemble()

    def _assemble(self, matrix: Any) -> None:
        for (_, form, _), rows in zip(self._parts, self._rows, strict=True):
            matrix.setLGMap(rows, self._columns)
            fem_petsc.assemble_matrix(matrix, self.problem.form(form))
        matrix.assemblyBegin(PETSc.Mat.AssemblyType.FLUSH)
        matrix.assemblyEnd(PETSc.Mat.AssemblyType.FLUSH)
        for port in self.problem.values:
            self._add_border(matrix, port, f"column {port}")
            for names, shares in self._on_ports():
                for name, share in zip(names, shares.tolist(), strict=True):
                    self._add(matrix, port, [(name, share)])
                    self._add(matrix, name, [(port, share)])
            for other in self.problem.values:
                if self.problem.form(f"corner {port} {other}") is not None:
                    corner = self.problem.integrate(f"corner {port} {other}")
                    self._add(matrix, port, [(other, corner)])
        for platform, forces in zip(self.map.platforms, self._forces, strict=True):
            self._add_platform(matrix, platform, forces)
        matrix.assemblyBegin(PETSc.Mat.AssemblyType.FLUSH)
        matrix.assemblyEnd(PETSc.Mat.AssemblyType.FLUSH)

    def _add_platform(self, matrix: Any, platform: Platform, forces: Any) -> None:
        """Add the rows and the columns of a rigid mount."""
        along = self.problem.direction.x.array
        bends = self._summed(platform.curvature(self.values, forces))
        for name, direction, bend in zip(
            platform.ports, platform.directions(self.values), bends.tolist(), strict=True
        ):
            along[:] = 0.0
            along[platform.dofs] = direction
            self._add_border(matrix, name, "along")
            for names, shares in self._on_ports():
                self._add(matrix, name, zip(names, shares.tolist(), strict=True))
            self._add(matrix, name, zip(platform.ports, bend, strict=True))

    def _on_ports(self) -> Iterator[tuple[tuple[str, ...], Any]]:
        """What the last linear form is along each port of the rigid mounts (collective)."""
        for platform, values in zip(self.map.platforms, self._on_platforms(), strict=True):
            yield platform.ports, self._summed(platform.directions(self.values) @ values)

    def _add_border(self, matrix: Any, port: str, form: str) -> None:
        """Add the row and the column of a port that no degree of freedom follows."""
        column = self.q.duplicate()
        column.set(0.0)
        self._add_vector(column, form, self.map.physical)
        start, _ = column.getOwnershipRange()
        # a follower pressure's part of nodes inside is rounding, which would miss the pattern
        noise = _NOISE if form.startswith("column") else 0.0
        least = noise * column.norm(PETSc.NormType.NORM_INFINITY)
        mine = np.flatnonzero(np.abs(column.array_r) > least)
        rows, index = (start + mine).astype(np.int32), np.array([self.map.ports[port]], np.int32)
        values, add = column.array_r[mine], PETSc.InsertMode.ADD_VALUES
        matrix.setValues(rows, index, values, addv=add)
        matrix.setValues(index, rows, values, addv=add)

    def _create_matrix(self) -> Any:
        """The reduced matrix with just the entries that can be other than zero.

        The pattern comes from a tangent at a generic state, at which no entry vanishes by chance.
        Later assemblies skip exact zeros, which lie outside it.
        """
        w = self.problem.spaces.w
        saved = w.x.array.copy()
        index_map = self.problem.spaces.W.dofmap.index_map
        local = np.concatenate([np.arange(*index_map.local_range), index_map.ghosts])
        size = 1e-9 * self.problem.domain.sizes.thickness
        w.x.array[:] = size * (1 + np.sin(1e3 * local))
        given = {port: self.problem.value(port) for port in self.problem.values}
        self.problem.set_values(dict.fromkeys(given, size))
        self.problem.settle()
        self.values = {port: 0.1 * (k + 3) for k, port in enumerate(self.values)}
        owned = self.map.owned
        loose = PETSc.Mat().createAIJ(((owned, None), (owned, None)), comm=self.map.comm)
        loose.setPreallocationNNZ(self._row_bounds())
        loose.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        loose.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        for port in self.map.ports:
            self._add(loose, port, [(other, 1.0) for other in self.map.ports])
        self._assemble(loose)
        loose.assemble()
        matrix = loose.duplicate(copy=False)
        matrix.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        w.x.array[:] = saved
        self.values = dict.fromkeys(self.values, 0.0)
        self.problem.set_values(given)
        self.problem.settle()
        return matrix

    def _row_bounds(self) -> tuple[Any, Any]:
        """Entries that a row can have, in this rank's columns and elsewhere; a port's may be full.

        A row that outgrows its bound makes PETSc copy the whole matrix, again and again.
        """
        owned, ports = self.map.owned, len(self.map.ports)
        here = np.full(owned, 16, dtype=np.int32)
        if self.problem.domain.dim == 2:
            here[:] = 96 if self.problem.spaces.order == 2 else 48
        elif self.problem.domain.dim == 3:
            counted = self._neighbours()[self.map.free]
            here[: len(counted)] = counted
        here += ports
        elsewhere = here.copy()
        if self.map.comm.rank == 0:
            here[owned - ports :] = owned
            elsewhere[owned - ports :] = self.q.size - owned
        return np.minimum(here, owned), np.minimum(elsewhere, self.q.size - owned)

    def _neighbours(self) -> Any:
        """Number of degrees of freedom that share a cell with each local one."""
        from scipy.sparse import csr_matrix

        W, dim = self.problem.spaces.W, self.problem.kinematics.dim
        every = compat.cell_dofs(W)
        parts = [compat.cell_dofs(W.sub(0).sub(k)) for k in range(dim)]
        parts += [compat.cell_dofs(W.sub(1))] if not self.problem.kinematics.sheet else []
        first, cells = parts[0], np.arange(len(every)).repeat(parts[0].shape[1])
        nodes, index = np.unique(first, return_inverse=True)
        ones = np.ones(index.size, dtype=np.int8)
        shared = csr_matrix((ones, (index.ravel(), cells)), (len(nodes), len(every)))
        counts = np.empty(len(nodes), dtype=np.int32)
        for k in range(0, len(nodes), _CHUNK):
            counts[k : k + _CHUNK] = np.diff((shared[k : k + _CHUNK] @ shared.T).indptr)
        mine = np.diff(shared.indptr)  # cells, each with its own pressures
        pressures = every.shape[1] - sum(part.shape[1] for part in parts)
        bound = counts * len(parts) + mine * pressures
        found = np.full(int(every.max()) + 1, every.shape[1], dtype=np.int32)
        for part in parts:
            found[part.ravel()] = bound[index.ravel()]
        return found
