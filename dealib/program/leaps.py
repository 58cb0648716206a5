"""Leaps of Newton's method to states that no motion of the device leads to."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.device.sheet_kinematics import SheetKinematics
from dealib.errors import NotConverged
from dealib.fem.layout import Layout
from dealib.fem.newton import Newton
from dealib.results.elements import gradients

_THROUGH_AXIS = "the radius became negative: the body went through its axis"
_TURNED = "material turned over in one increment, to an unstable state: no motion leads there"


class Leaps:
    """Refuses states beyond a limit point that Newton's method finds, but the device cannot reach.

    For example, a balloon has no state above its largest pressure but inside out. Two signs are
    enough. A state of a body of revolution is impossible where the radius, and with it the stretch
    around the axis, is negative; for the energy that stretch squared would do. And where in one
    increment a fibre or a sheet's normal has turned by more than 90 degrees, the state must be
    stable: a real snap-through, which loses energy, ends in a stable state only. A motion that
    is merely fast turns less in the smaller increments that follow a refusal, and passes. A
    dynamic stage has no leaps, and without a potential, or with an iterative solver, stability is
    not known.

    Args:
        newton: The solver.
        layout: Nodal values.
    """

    def __init__(self, newton: Newton, layout: Layout) -> None:
        self._newton, self._layout = newton, layout
        problem, cell = newton.system.problem, layout.cell
        self._kinematics, self._comm = problem.kinematics, problem.domain.comm
        solid = (g for g in problem.groups if g.material in problem.config.materials)
        rows = np.concatenate([layout.rows(group) for group in solid])
        middle = cell.nodes[: cell.corners].mean(axis=0)[None]
        nodes = layout.nodes[rows]
        dN = gradients(cell, nodes[..., list(self._kinematics.lies)], middle)[1]
        N = cell.shape(middle)[0]
        self._at, self._dofs = (N, dN, N @ nodes), [d[rows] for d in layout.displacements]
        self._before = self._deformation()

    def keep(self) -> None:
        """Take the present state as the last one (collective)."""
        system = self._newton.system
        system.expand(system.q)
        self._before = self._deformation()

    def check(self) -> None:
        """Judge the state of the last residual (collective).

        Raises:
            NotConverged: If it cannot be reached from the last one.
        """
        now, system = self._deformation(), self._newton.system
        if self._kinematics.revolved and self._any(now[:, 2, 2] <= 0):
            raise NotConverged(_THROUGH_AXIS)
        potential = system.inertia is None and system.problem.coupling.symmetric
        judged = potential and not self._newton.iterative  # the factors may need too much memory
        turned = np.einsum("cij,cij->cj", self._before, now) < 0
        if judged and self._any(turned) and self._newton.unstable_modes() > 0:
            raise NotConverged(_TURNED)

    def _any(self, mine: Any) -> bool:
        return bool(self._comm.allreduce(int(mine.any()), op=MPI.MAX))

    def _deformation(self) -> Array:
        """F in the middle of each cell, of sheets with the normal across, (cells, 3, 3)."""
        k, w = self._kinematics, self._newton.system.problem.spaces.w.x.array
        u = np.stack([w[dofs] for dofs in self._dofs], axis=-1)
        F = (k.sheet_deformation if isinstance(k, SheetKinematics) else k.deformation)(u, *self._at)
        return np.asarray(F[:, 0])
