"""Residual and tangent in the reduced unknowns, which are assembled directly."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.records import MOUNT, TURN
from dealib.fem.assembly import Assembler
from dealib.fem.charging import Charging
from dealib.fem.constraints import FIELDS
from dealib.fem.inertia import Inertia
from dealib.fem.pattern import create_matrix
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem
from dealib.fem.timings import Timings


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
        with timings("forms"):
            self._assembler = Assembler(problem)
        self.restart(timings)
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
        self._assembler.restart()

    # --- residual --------------------------------------------------------------------------------

    def residual(self, q: Any, out: Any) -> None:
        """Assemble r(q), with the port equations in their rows."""
        with self.timings("assembly"):
            self.expand(q)
            self.values = self.map.port_values(q)
            moved = self.inertia
            self._assembler.residual(out, () if moved is None else moved.accelerate(self.values))
            if self.charging is not None:
                self.charging.add(out, q, self.matrix)
            if moved is not None:
                moved.add_damping(out)
            self.internal = self.map.port_values(out) | self._assembler.duals(self.values)
            if moved is not None:
                for name in self.ports:
                    self.internal[name] += moved.push(name)
            for name, law in self.ports.items():
                self.map.set_port(out, name, law.residual(name, self.values, self.internal[name]))

    @contextmanager
    def elsewhere(self) -> Iterator[None]:
        """A context for residuals of other states, after which q is expanded again (collective)."""
        kept = self.values, self.internal, self._assembler.forces
        try:
            yield
        finally:
            self.values, self.internal, self._assembler.forces = kept
            self.expand(self.q)

    def expand(self, q: Any) -> None:
        """Set the problem's state from reduced unknowns."""
        self.map.expand(q, self.problem.spaces.w)
        if self.problem.values:
            self.problem.set_values(self.map.port_values(q))
        self.problem.settle()

    def field_norms(self, vector: Any) -> Array:
        """Euclidean norm of a reduced vector by field, without the ports."""
        mine = vector.array_r[: len(self.map.field)]
        sums = np.bincount(self.map.field, weights=mine**2, minlength=len(FIELDS))
        return np.sqrt(self.map.summed(sums.astype(float)))

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
            self._assembler.tangent(matrix, self.values, moved is not None)
            for name, law in self.ports.items():
                if law.value is None:
                    slope = law.balance(self.values[name])[1]
                    if moved is not None:
                        slope -= moved.push_rate(name)
                    self._assembler.add(matrix, name, [(name, -slope), *law.weights])
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
                    self._assembler.add(matrix, name, self.ports[name].weights)
                matrix.assemble()
            self._eliminated = self.take(matrix, 1.0)

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
        self._assembler.tangent(matrix, self.values)
        if self.charging is not None:
            self.charging.assemble(matrix)

    def mass(self) -> Any:
        """Mass matrix of the current state (collective), t.

        Potentials, pressures, and ports without displacements have rows of zeros.
        """
        inertia = Inertia(self.problem, self.ports)
        matrix = inertia.matrix(self.matrix)
        self._assembler.add_carried(matrix, self.values)
        for port in self.problem.device.ports:
            self._assembler.add(matrix, port.name, [(port.name, inertia.own_mass(port.name))])
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
        self._assembler.tangent(matrix, self.values)
        matrix.assemble()
        still = [self.map.numbers(f) for f in FIELDS if f != "displacement"]
        others = [p.name for p in self.problem.device.ports if p.kind not in (MOUNT, TURN)]
        ports = [self.map.ports[n] for n in (others if self.map.comm.rank == 0 else [])]
        matrix.zeroRowsColumns(np.concatenate([*still, ports]).astype(np.int32), 0.0)
        return matrix
