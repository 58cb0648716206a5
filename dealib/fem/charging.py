"""Electrodes that charge through their resistance, so that the potential diffuses in them.

The charge Q at a point of an electrode changes by the current to it, dQ/dt = -G phi, with the
conductances G of `fem.electrodes`. A step is of second order and stiffly stable (BDF2; the first
step after rest is implicit Euler):

    Q' - Q* + h G phi' = 0,

with Q*, h and G fixed at its start. It adds -h/2 phi.G phi to the potential, so that the tangent
stays symmetric, and the charges Q* as loads.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.arrays import Array
from dealib.fem.electrodes import electrode_dofs
from dealib.fem.layout import Layout
from dealib.fem.pattern import add_form
from dealib.fem.potential import Problem

_LONG = 1e6  # s, in which any electrode is fully charged
_LEAST = 1e-3  # smallest charge with which errors are compared, of the flat film's at 1 kV


class Charging:
    """The charges on the electrodes, advanced step by step; arrays are of this rank's unknowns.

    Attributes:
        lost: Energy lost in the electrodes so far, mJ.

    Args:
        problem: The problem, whose electrodes have potentials of their own.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._map = problem, problem.constraints
        self._matrix: Any = None
        self._step = self._before = 0.0  # this step, and the one before it; 0: none
        self._h, self.lost, self._largest = 1.0, 0.0, 0.0
        self._charges = self._earlier = self._load = np.zeros(self._map.owned)
        self._flow, self._power = self._load, 0.0

    def assemble(self, matrix: Any) -> None:
        """Add the conductances of the problem's state to a reduced matrix."""
        add_form(self._problem, "conductance", matrix)

    # --- contributions to the equations ----------------------------------------------------------

    def _conductance(self, like: Any) -> Any:
        if self._matrix is None:
            self._matrix = like.duplicate(copy=False)
            self._matrix.zeroEntries()
            self.assemble(self._matrix)
            self._matrix.assemble()
        return self._matrix

    def add(self, out: Any, q: Any, like: Any) -> None:
        """Add its contribution to a reduced residual.

        Args:
            out: The residual of the potential.
            q: The reduced unknowns.
            like: A matrix with the tangent's pattern.
        """
        flow = out.duplicate()
        self._conductance(like).mult(q, flow)
        self._now = np.zeros(self._map.owned)
        self._now[self._mine] = -out.array_r[self._mine]
        self._flow_now = flow.array_r.copy()
        self._power_now = float(flow.dot(q))
        out.array[:] += self._load - self._h * flow.array_r

    def add_tangent(self, matrix: Any) -> None:
        """Add the derivative of that contribution to a tangent."""
        same = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        matrix.axpy(-self._h, self._conductance(matrix), structure=same)

    def add_long(self, matrix: Any, chosen: Any) -> None:
        """Add it to chosen rows and columns of a tangent, as if there had been long to charge."""
        assert self._matrix is not None  # since the first residual
        conductance = self._matrix.createSubMatrix(chosen, chosen)
        matrix.axpy(-_LONG, conductance, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)

    # --- steps -----------------------------------------------------------------------------------

    def rest(self) -> None:
        """Take the current charges as an equilibrium without currents."""
        self._charges, self._flow, self._power = self._now, np.zeros_like(self._now), 0.0
        self._step = self._before = 0.0

    def begin(self, duration: float) -> None:
        """Prepare a step of a duration in s from the last accepted state (collective)."""
        self._step, w = duration, duration / self._before if self._before else 0.0
        whole = (1 + 2 * w) / (1 + w)
        star = ((1 + w) * self._charges - w**2 / (1 + w) * self._earlier) / whole
        self._h, self._load = duration / whole, star
        if self._matrix is not None:
            self._matrix.zeroEntries()
            self.assemble(self._matrix)
            self._matrix.assemble()
        self._balance_ports()

    def _balance_ports(self) -> None:
        """Subtract each electrode's charge from its terminal's load, so that loads sum to zero."""
        map_, load = self._map, self._load.copy()
        ports = list(map_.ports)
        for name, mine in self._electrodes.items():
            total = map_.comm.allreduce(float(load[mine].sum()))
            if map_.comm.rank == 0 and name:
                load[map_.owned - len(ports) + ports.index(name)] -= total
        self._load = load

    def error(self) -> float:
        """Error of the charges in the last step over the largest charge so far (collective).

        The error of BDF2 is 2/9 h^3 d3Q/dt3; the derivative is that of the cubic through both ends
        and their rates.
        """
        ends = 12 * (self._charges - self._now) - 6 * self._step * (self._flow + self._flow_now)
        return self._total(2 / 9 * ends) / self._largest_now()

    def commit(self) -> None:
        """Accept the current state as the end of the step (collective)."""
        self.lost += self._step * (self._power + self._power_now) / 2
        self._largest = self._largest_now()
        self._earlier, self._charges = self._charges, self._now
        self._flow, self._power, self._before = self._flow_now, self._power_now, self._step

    @contextmanager
    def tentative(self) -> Iterator[None]:
        """A context in which the current state is accepted tentatively (collective)."""
        names = ("lost", "_largest", "_earlier", "_charges", "_flow", "_power", "_before")
        kept = {name: getattr(self, name) for name in names}
        self.commit()
        try:
            yield
        finally:
            vars(self).update(kept)

    def _total(self, charges: Array) -> float:
        mine = float(np.abs(charges[self._mine]).sum())
        return float(self._map.comm.allreduce(mine))

    def _largest_now(self) -> float:
        least = _LEAST * self._problem.charge_scale
        return max(self._largest, self._total(self._now), least)

    @cached_property
    def _electrodes(self) -> dict[str, Any]:
        """This rank's free potentials on the electrodes, by terminal; '' for ground."""
        found: dict[str, Any] = {}
        map_ = self._map
        first = sum(map_.comm.allgather(map_.owned)[: map_.comm.rank])
        for port, dofs in electrode_dofs(self._problem.domain, self._problem.spaces):
            numbers = map_.columns[dofs] - first
            mine = numbers[(numbers >= 0) & (numbers < len(map_.field))]
            found[port] = np.union1d(found.get(port, mine), mine).astype(int)
        return found

    @cached_property
    def _mine(self) -> Any:
        return np.concatenate([*self._electrodes.values(), np.empty(0, dtype=int)]).astype(int)

    # --- checkpoints -----------------------------------------------------------------------------

    def gather(self, layout: Layout) -> Array | None:
        """Nodal charges, earlier charges and currents, (3, nodes), on rank 0 (collective).

        It overwrites the problem's state.
        """
        found = []
        for values in (self._charges, self._earlier, self._flow):
            vector = self._map.create_vector()
            vector.array[self._mine] = values[self._mine]
            self._map.expand(vector, self._problem.spaces.w)
            nodal = layout.gather()
            if nodal is not None:
                found.append(nodal[:, self._problem.kinematics.dim])
        return np.array(found) if found else None

    def plain(self) -> dict[str, Any]:
        """Plain values for a checkpoint."""
        return {"before": self._before, "power": self._power, "largest": self._largest}

    def restore(self, layout: Layout, gathered: Array | None, plain: dict[str, Any]) -> None:
        """Inverse of `gather` and `plain` (collective). It overwrites the problem's state."""
        found, dim = [], self._problem.kinematics.dim
        for k in range(3):
            nodal = None
            if gathered is not None:
                nodal = np.zeros((gathered.shape[1], layout.columns))
                nodal[:, dim] = gathered[k]
            layout.scatter(nodal)
            values = np.zeros(self._map.owned)
            values[: len(self._map.free)] = self._problem.spaces.w.x.array[self._map.free]
            found.append(values)
        self._charges, self._earlier, self._flow = found
        self._before, self._power, self._largest = (
            plain[key] for key in ("before", "power", "largest")
        )
