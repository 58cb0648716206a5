"""Assembles forms straight into vectors and matrices of the reduced unknowns.

Rows and columns of ports that several degrees of freedom follow, or none, are added as borders.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx.fem import petsc as fem_petsc

from dealib.device.records import TERMINAL
from dealib.fem import compat
from dealib.fem.platform import Platform
from dealib.fem.problem import Problem

_NOISE = 1e-14  # entry of a port's column over its largest one below which it is rounding


class Assembler:
    """Assembles a problem's residual and tangent at its state, without the equations of the ports.

    Attributes:
        forces: Last assembled linear form at the degrees of freedom of each rigid mount, locally.
    """

    forces: list[Any]

    def __init__(self, problem: Problem) -> None:
        self._problem, self._map = problem, problem.constraints
        self._parts = [("residual", "tangent", self._map.physical)]
        if problem.mesh_motion:
            self._parts.append(("mesh_residual", "mesh_tangent", self._map.mesh_rows))
        assembled = [name for part in self._parts for name in part[:2]]
        for port in problem.values:
            assembled += [f"dual {port}", f"column {port}"]
            assembled += [f"corner {port} {other}" for other in problem.values]
        assembled += ["along"] if self._map.platforms else []
        if problem.sheet is None and problem.device.of(TERMINAL):
            assembled.append("field")
        for name in ("elastic", "electric", *assembled):
            problem.form(name)
        self._local = compat.create_vector(problem.spaces.W, self._map.comm)
        self._columns = self._map.lgmap(self._map.columns)
        self._rows = [self._map.lgmap(rows) for _, _, rows in self._parts]
        self.restart()

    def restart(self) -> None:
        """Forget what was assembled."""
        with self._local.localForm() as local:
            local.set(0.0)
        self.forces = self._on_platforms()

    # --- residual --------------------------------------------------------------------------------

    def residual(self, out: Any, more: Iterable[str] = ()) -> None:
        """Set a reduced vector to the residual.

        Args:
            out: The vector.
            more: Linear forms that are added.
        """
        out.set(0.0)
        for form, _, rows in reversed(self._parts[1:]):
            self._add_vector(out, [form], rows)
        self._add_vector(out, ["residual", *more], self._map.physical)
        self.forces = self._on_platforms()

    def duals(self, values: Mapping[str, float]) -> dict[str, float]:
        """Residuals of the ports of rigid mounts, and of those without degrees of freedom.

        They belong to the last `residual` (collective).

        Args:
            values: Values of the ports.
        """
        found: dict[str, float] = {}
        for platform, forces in zip(self._map.platforms, self.forces, strict=True):
            duals = self._map.summed(platform.directions(values) @ forces)
            found |= dict(zip(platform.ports, duals.tolist(), strict=True))
        return found | {n: self._problem.integrate(f"dual {n}") for n in self._problem.values}

    def _add_vector(self, out: Any, forms: Iterable[str], rows: Any) -> None:
        """Assemble a sum of linear forms into reduced rows."""
        with self._local.localForm() as local:
            local.set(0.0)
        for form in forms:
            fem_petsc.assemble_vector(self._local, self._problem.form(form))
        with self._local.localForm() as local:
            used = rows >= 0
            out.setValues(rows[used], local.array_r[used], addv=PETSc.InsertMode.ADD_VALUES)
        out.assemble()

    def _on_platforms(self) -> list[Any]:
        with self._local.localForm() as local:
            return [local.array_r[platform.dofs] for platform in self._map.platforms]

    # --- tangent ---------------------------------------------------------------------------------

    def tangent(self, matrix: Any, values: Mapping[str, float], moving: bool = False) -> None:
        """Add the derivative of the last residual to a reduced matrix (collective).

        Args:
            matrix: The matrix; it is left to be assembled.
            values: Values of the ports.
            moving: Whether to add the inertia of what rigid mounts carry.
        """
        for (_, form, _), rows in zip(self._parts, self._rows, strict=True):
            matrix.setLGMap(rows, self._columns)
            fem_petsc.assemble_matrix(matrix, self._problem.form(form))
        matrix.assemble(PETSc.Mat.AssemblyType.FLUSH)
        for port in self._problem.values:
            self._add_border(matrix, port, [f"column {port}"], _NOISE)
            for names, shares in self._on_ports(values):
                for name, share in zip(names, shares.tolist(), strict=True):
                    self.add(matrix, port, [(name, share)])
                    self.add(matrix, name, [(port, share)])
            for other in self._problem.values:
                if self._problem.form(f"corner {port} {other}") is not None:
                    corner = self._problem.integrate(f"corner {port} {other}")
                    self.add(matrix, port, [(other, corner)])
        along = ["along", "mass along"] if moving else ["along"]
        for platform, forces in zip(self._map.platforms, self.forces, strict=True):
            self._add_platform(matrix, platform, along, values)
            bends = self._map.summed(platform.curvature(values, forces))
            for name, bend in zip(platform.ports, bends.tolist(), strict=True):
                self.add(matrix, name, zip(platform.ports, bend, strict=True))
        matrix.assemble(PETSc.Mat.AssemblyType.FLUSH)

    def add(self, matrix: Any, name: str, weights: Iterable[tuple[str, float]]) -> None:
        """Add weights to the row of a port, in the columns of other ports."""
        for port, weight in weights if self._map.comm.rank == 0 else ():
            row, column = self._map.ports[name], self._map.ports[port]
            matrix.setValue(row, column, weight, addv=PETSc.InsertMode.ADD_VALUES)

    def add_carried(self, matrix: Any, values: Mapping[str, float]) -> None:
        """Add the rows and columns of rigid mounts in the mass matrix (collective).

        Args:
            matrix: The mass matrix.
            values: Values of the ports.
        """
        self._problem.rate_factor.value = 1.0
        for platform in self._map.platforms:
            self._add_platform(matrix, platform, ["mass along"], values)

    def _add_platform(
        self, matrix: Any, platform: Platform, forms: Iterable[str], values: Mapping[str, float]
    ) -> None:
        """Add the rows and the columns of a rigid mount.

        Args:
            matrix: The matrix.
            platform: The mount.
            forms: Bilinear forms in the direction of `Problem.direction`.
            values: Values of the ports.
        """
        along = self._problem.direction.x.array
        for name, direction in zip(platform.ports, platform.directions(values), strict=True):
            along[:] = 0.0
            along[platform.dofs] = direction
            self._add_border(matrix, name, forms)
            for names, shares in self._on_ports(values):
                self.add(matrix, name, zip(names, shares.tolist(), strict=True))

    def _on_ports(self, values: Mapping[str, float]) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Last assembled linear form along each port of the rigid mounts (collective)."""
        for platform, forces in zip(self._map.platforms, self._on_platforms(), strict=True):
            yield platform.ports, self._map.summed(platform.directions(values) @ forces)

    def _add_border(self, matrix: Any, port: str, forms: Iterable[str], noise: float = 0.0) -> None:
        """Add row and column of a port from linear forms; relative `noise` is left out."""
        column = self._map.create_vector()
        self._add_vector(column, forms, self._map.physical)
        start, _ = column.getOwnershipRange()
        # a follower pressure's entries of inner nodes are rounding, outside the matrix's pattern
        least = noise * column.norm(PETSc.NormType.NORM_INFINITY)
        mine = np.flatnonzero(np.abs(column.array_r) > least)
        rows, index = (start + mine).astype(np.int32), np.array([self._map.ports[port]], np.int32)
        values, add = column.array_r[mine], PETSc.InsertMode.ADD_VALUES
        matrix.setValues(rows, index, values, addv=add)
        matrix.setValues(index, rows, values, addv=add)
