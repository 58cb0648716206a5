"""Residual and tangent in the reduced unknowns, which are assembled directly."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.fem import petsc as fem_petsc

from dealib.device.records import MOUNT, TERMINAL, TURN
from dealib.fem import compat
from dealib.fem.charging import Charging
from dealib.fem.constraints import FIELDS
from dealib.fem.inertia import Inertia
from dealib.fem.pattern import create_matrix
from dealib.fem.platform import Platform
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem

_NOISE = 1e-14  # entry of a port's column over its largest one below which it is rounding


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
        values: Value of each port at the last residual.
        internal: dPi/dq at each port at the last residual; in motion with the forces of inertia.
        inertia: Inertia and damping in a dynamic stage; None in a quasi-static one.
        charging: Charges of electrodes that charge in time; None without resistance.
        timings: Seconds spent by phase.
        tangents: Number of tangents that have been assembled.
    """

    values: dict[str, float]

    def __init__(self, problem: Problem, timings: Timings) -> None:
        self.problem, self.map = problem, problem.constraints
        self.charging = Charging(problem) if problem.charging else None
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
            if problem.sheet is None and problem.device.of(TERMINAL):
                assembled.append("field")
            for name in ("elastic", "electric", *assembled):
                problem.form(name)
            self._local = compat.create_vector(problem.spaces.W, self.map.comm)
        self.restart(timings)
        self._columns = self.map.lgmap(self.map.columns)
        self._rows = [self.map.lgmap(rows) for _, _, rows in self._parts]
        with timings("matrix"):
            self.values = {port: 0.1 * (k + 3) for k, port in enumerate(self.map.ports)}  # generic
            self.matrix = create_matrix(problem, self._pattern)
            self.values = dict.fromkeys(self.map.ports, 0.0)

    def restart(self, timings: Timings) -> None:
        """Set the state to zero and all ports to prescribed zeros; numbers are the problem's."""
        self.timings = timings
        self.ports = {name: PortLaw(value=0.0) for name in self.map.ports}
        self.values = dict.fromkeys(self.map.ports, 0.0)
        self.internal = dict.fromkeys(self.map.ports, 0.0)
        self.inertia: Inertia | None = None
        self.tangents = 0
        self._eliminated: dict[str, Any] = {}
        self.q.set(0.0)
        self.residual_vector.set(0.0)
        with self._local.localForm() as local:
            local.set(0.0)
        self._forces = self._on_platforms()

    # --- residual --------------------------------------------------------------------------------

    def residual(self, q: Any, out: Any) -> None:
        """Assemble r(q), with the port equations in their rows."""
        with self.timings("assembly"):
            self.expand(q)
            self.values = self.map.port_values(q)
            out.set(0.0)
            for form, _, rows in reversed(self._parts[1:]):
                self._add_vector(out, [form], rows)
            moved, forms = self.inertia, ["residual"]
            if moved is not None:
                forms += moved.accelerate(self.values)
            self._add_vector(out, forms, self.map.physical)
            self._forces = self._on_platforms()
            if self.charging is not None:
                self.charging.add(out, q, self.matrix)
            if moved is not None:
                moved.add_damping(out)
            self.internal = self.map.port_values(out)
            for platform, forces in zip(self.map.platforms, self._forces, strict=True):
                duals = self._summed(platform.directions(self.values) @ forces)
                self.internal |= dict(zip(platform.ports, duals.tolist(), strict=True))
            for name in self.problem.values:
                self.internal[name] = self.problem.integrate(f"dual {name}")
            if moved is not None:
                for name in self.ports:
                    self.internal[name] += moved.push(name)
            for name, law in self.ports.items():
                self.map.set_port(out, name, law.residual(name, self.values, self.internal[name]))

    @contextmanager
    def elsewhere(self) -> Iterator[None]:
        """A context for residuals of other states, after which q is expanded again (collective)."""
        kept = self.values, self.internal, self._forces
        try:
            yield
        finally:
            self.values, self.internal, self._forces = kept
            self.expand(self.q)

    def expand(self, q: Any) -> None:
        """Set the problem's state from reduced unknowns."""
        self.map.expand(q, self.problem.spaces.w)
        if self.problem.values:
            self.problem.set_values(self.map.port_values(q))
        self.problem.settle()

    def _add_vector(self, out: Any, forms: Iterable[str], rows: Any) -> None:
        """Assemble a sum of linear forms into reduced rows."""
        with self._local.localForm() as local:
            local.set(0.0)
        for form in forms:
            fem_petsc.assemble_vector(self._local, self.problem.form(form))
        with self._local.localForm() as local:
            used = rows >= 0
            out.setValues(rows[used], local.array_r[used], addv=PETSc.InsertMode.ADD_VALUES)
        out.assemble()

    def _on_platforms(self) -> list[Any]:
        """Last assembled linear form at the degrees of freedom of each rigid mount, locally."""
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

    @contextmanager
    def still(self) -> Iterator[None]:
        """A context without inertia, for properties of a state as an equilibrium (collective)."""
        kept, self.inertia = self.inertia, None
        try:
            yield
        finally:
            self.inertia = kept
            if kept is not None:
                self.residual(self.q, self.residual_vector)

    def tangent(self, matrix: Any) -> None:
        """Assemble dr/dq at the state of the last residual.

        Row and column of a prescribed port are those of the identity, which keeps a symmetric
        tangent symmetric. The port's step is known, and `eliminate` moves its part to the
        right-hand side.
        """
        self.tangents += 1
        with self.timings("assembly"):
            moved, summed = self.inertia, []
            matrix.zeroEntries()
            self._assemble(matrix, moved is not None)
            for name, law in self.ports.items():
                if law.value is None:
                    slope = law.balance(self.values[name])[1]
                    if moved is not None:
                        slope -= moved.push_rate(name)
                    self._add(matrix, name, [(name, -slope), *law.weights])
                elif law.weights:
                    summed.append(name)
            matrix.assemble()
            if self.charging is not None:
                self.charging.add_tangent(matrix)
            if moved is not None:
                moved.add_tangent(matrix)
            if summed:
                mine = [self.map.ports[n] for n in summed] if self.map.comm.rank == 0 else []
                matrix.zeroRows(mine, 0.0)
                for name in summed:
                    self._add(matrix, name, self.ports[name].weights)
                matrix.assemble()
            self._eliminated = self.take(matrix, 1.0)

    def _add(self, matrix: Any, name: str, weights: Iterable[tuple[str, float]]) -> None:
        """Add weights to the row of a port, in the columns of other ports."""
        for port, weight in weights if self.map.comm.rank == 0 else ():
            row, column = self.map.ports[name], self.map.ports[port]
            matrix.setValue(row, column, weight, addv=PETSc.InsertMode.ADD_VALUES)

    def column(self, port: str) -> Any:
        """Column of a prescribed port, eliminated from the last tangent."""
        return self._eliminated[port]

    def take(self, matrix: Any, diagonal: float = 0.0) -> dict[str, Any]:
        """Eliminate rows and columns of the prescribed ports from a matrix (collective).

        Args:
            matrix: Symmetric matrix of the reduced unknowns.
            diagonal: Value on its diagonal there afterwards.

        Returns:
            The columns by port.
        """
        columns, rows = {}, []
        for name, law in self.ports.items():
            if law.fixed:
                unit, columns[name] = self.q.duplicate(), self.q.duplicate()
                unit.set(0.0)
                self.map.set_port(unit, name, 1.0)
                unit.assemble()
                matrix.mult(unit, columns[name])
                rows.append(self.map.ports[name])
        matrix.zeroRowsColumns(rows if self.map.comm.rank == 0 else [], diagonal)
        return columns

    def eliminate(self, right: Any) -> None:
        """Move the known steps of prescribed ports to a right-hand side of the last tangent.

        Args:
            right: Right-hand side of dr/dq x = right, with x itself in the prescribed ports' rows.
        """
        steps = self.map.port_values(right)
        for name, column in self._eliminated.items():
            right.axpy(-steps[name], column)
        for name in self._eliminated:
            self.map.set_port(right, name, steps[name])
        right.assemble()

    def _pattern(self, matrix: Any) -> None:
        """Add all entries that the tangent can have."""
        self._assemble(matrix)
        if self.charging is not None:
            self.charging.assemble(matrix)

    def _assemble(self, matrix: Any, moving: bool = False) -> None:
        for (_, form, _), rows in zip(self._parts, self._rows, strict=True):
            matrix.setLGMap(rows, self._columns)
            fem_petsc.assemble_matrix(matrix, self.problem.form(form))
        matrix.assemblyBegin(PETSc.Mat.AssemblyType.FLUSH)
        matrix.assemblyEnd(PETSc.Mat.AssemblyType.FLUSH)
        for port in self.problem.values:
            self._add_border(matrix, port, [f"column {port}"], _NOISE)
            for names, shares in self._on_ports():
                for name, share in zip(names, shares.tolist(), strict=True):
                    self._add(matrix, port, [(name, share)])
                    self._add(matrix, name, [(port, share)])
            for other in self.problem.values:
                if self.problem.form(f"corner {port} {other}") is not None:
                    corner = self.problem.integrate(f"corner {port} {other}")
                    self._add(matrix, port, [(other, corner)])
        along = ["along", "mass along"] if moving else ["along"]
        for platform, forces in zip(self.map.platforms, self._forces, strict=True):
            self._add_platform(matrix, platform, along)
            bends = self._summed(platform.curvature(self.values, forces))
            for name, bend in zip(platform.ports, bends.tolist(), strict=True):
                self._add(matrix, name, zip(platform.ports, bend, strict=True))
        matrix.assemblyBegin(PETSc.Mat.AssemblyType.FLUSH)
        matrix.assemblyEnd(PETSc.Mat.AssemblyType.FLUSH)

    def mass(self) -> Any:
        """Mass matrix of the current state (collective), t.

        Potentials, pressures, and ports without displacements have rows of zeros.
        """
        inertia, map_ = Inertia(self.problem, self.ports), self.map
        matrix = inertia.matrix(self.matrix)
        self.problem.rate_factor.value = 1.0
        for platform in map_.platforms:
            self._add_platform(matrix, platform, ["mass along"])
        for port in self.problem.device.ports:
            self._add(matrix, port.name, [(port.name, inertia.own_mass(port.name))])
        matrix.assemble()
        return matrix

    def begin(self, duration: float) -> None:
        """Prepare a step of a duration in s of a device in motion."""
        moved = self.inertia
        assert moved is not None
        moved.begin(duration)
        if not moved.stiffness_time:
            return
        self.values = moved.predict()
        self.problem.set_values(self.values)
        self.problem.settle()
        moved.damp(self.stiffness())
        self.expand(self.q)

    def stiffness(self) -> Any:
        """Second derivatives of the potential by displacements only, at the problem's state."""
        matrix = self.matrix.copy()
        matrix.zeroEntries()
        self._assemble(matrix)
        matrix.assemble()
        still = [self.map.numbers(f) for f in FIELDS if f != "displacement"]
        others = [p.name for p in self.problem.device.ports if p.kind not in (MOUNT, TURN)]
        ports = [self.map.ports[n] for n in (others if self.map.comm.rank == 0 else [])]
        matrix.zeroRowsColumns(np.concatenate([*still, ports]).astype(np.int32), 0.0)
        return matrix

    def _add_platform(self, matrix: Any, platform: Platform, forms: Iterable[str]) -> None:
        """Add the rows and the columns of a rigid mount.

        Args:
            matrix: The matrix.
            platform: The mount.
            forms: Bilinear forms in the direction of `Problem.direction`.
        """
        along = self.problem.direction.x.array
        for name, direction in zip(platform.ports, platform.directions(self.values), strict=True):
            along[:] = 0.0
            along[platform.dofs] = direction
            self._add_border(matrix, name, forms)
            for names, shares in self._on_ports():
                self._add(matrix, name, zip(names, shares.tolist(), strict=True))

    def _on_ports(self) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Last assembled linear form along each port of the rigid mounts (collective)."""
        for platform, values in zip(self.map.platforms, self._on_platforms(), strict=True):
            yield platform.ports, self._summed(platform.directions(self.values) @ values)

    def _add_border(self, matrix: Any, port: str, forms: Iterable[str], noise: float = 0.0) -> None:
        """Add row and column of a port from linear forms; relative `noise` is left out."""
        column = self.q.duplicate()
        column.set(0.0)
        self._add_vector(column, forms, self.map.physical)
        start, _ = column.getOwnershipRange()
        # a follower pressure's entries of inner nodes are rounding, outside the matrix's pattern
        least = noise * column.norm(PETSc.NormType.NORM_INFINITY)
        mine = np.flatnonzero(np.abs(column.array_r) > least)
        rows, index = (start + mine).astype(np.int32), np.array([self.map.ports[port]], np.int32)
        values, add = column.array_r[mine], PETSc.InsertMode.ADD_VALUES
        matrix.setValues(rows, index, values, addv=add)
        matrix.setValues(index, rows, values, addv=add)
