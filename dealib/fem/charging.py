"""Electrodes that charge through their resistance: their potential diffuses from the contact on.

The charge Q of a point of an electrode changes by what flows to it, dQ/dt = -G phi with the
conductances G of `fem.electrodes`. A step is of second order and stiffly stable (BDF2; the first
one after rest is implicit Euler):

    Q' - Q* + h G phi' = 0,

Q* and h fixed at its start, and G too. So it adds -h/2 phi.G phi to the potential, which stays
symmetric, and the electrodes' charges Q* as loads.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx.fem import petsc as fem_petsc

from dealib.fem.electrodes import electrode_dofs
from dealib.fem.layout import Layout
from dealib.fem.potential import Problem

Array = npt.NDArray[np.float64]
_LONG = 1e6  # s
_LEAST = 1e-3  # of the flat film's charge at 1 kV


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
        map_ = self._map
        matrix.setLGMap(map_.lgmap(map_.physical), map_.lgmap(map_.columns))
        fem_petsc.assemble_matrix(matrix, self._problem.form("conductance"))

    # --- what it adds to the equations -----------------------------------------------------------

    def _conductance(self, like: Any) -> Any:
        if self._matrix is None:
            self._matrix = like.duplicate(copy=False)
            self._matrix.zeroEntries()
            self.assemble(self._matrix)
            self._matrix.assemble()
        return self._matrix

    def add(self, out: Any, q: Any, like: Any) -> None:
        """Add to a reduced residual, which holds the slopes of the potential.

        Args:
            out: The residual.
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
        """Add its derivative."""
        same = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        matrix.axpy(-self._h, self._conductance(matrix), structure=same)

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """As if the electrodes had charged for long."""
        kept = self._h, self._load
        self._h, self._load = _LONG, np.zeros_like(self._load)
        try:
            yield
        finally:
            self._h, self._load = kept

    # --- steps -----------------------------------------------------------------------------------

    def rest(self) -> None:
        """Take the present charges as those of rest."""
        self._charges, self._flow, self._power = self._now, np.zeros_like(self._now), 0.0
        self._step = self._before = 0.0

    def begin(self, duration: float) -> None:
        """Prepare a step from the last accepted state, in s (collective)."""
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
        """What the terminals supply is all charge of their electrodes: loads sum up to zero."""
        map_, load = self._map, self._load.copy()
        ports = list(map_.ports)
        for name, mine in self._electrodes.items():
            total = map_.comm.allreduce(float(load[mine].sum()))
            if map_.comm.rank == 0 and name:
                load[map_.owned - len(ports) + ports.index(name)] -= total
        self._load = load

    def error(self) -> float:
        """Error of the charges in the step just solved over the largest so far (collective).

        2/9 of h^3 times the third derivative (BDF2), which is that of the cubic through both ends.
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
        """Accept the current state for a while, to look at it (collective)."""
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
        """Numbers of this rank's free potentials on the electrodes of each terminal, and ground."""
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
        """Charges, those before, and flows, at the nodes of the whole mesh on rank 0 (collective).

        Shape (3, nodes). The problem's state is another one afterwards.
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
        """What else a checkpoint holds."""
        return {"before": self._before, "power": self._power, "largest": self._largest}

    def restore(self, layout: Layout, gathered: Array | None, plain: dict[str, Any]) -> None:
        """Inverse of both (collective). The problem's state is another one afterwards."""
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
