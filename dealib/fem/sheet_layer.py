"""One layer of a membrane at the quadrature points: its energy by metric and voltages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from dealib.fem import compat
from dealib.fem.domain import Domain, Spaces
from dealib.fem.energies import Point, constant
from dealib.fem.groups import Group, Sheet

_ENOUGH, _MOST = 1e-13, 60  # change of a stretch at which Newton's method has converged; most steps
FIRST = 2  # number of the energies, which come before their derivatives


def equip(domain: Domain, spaces: Spaces, groups: Sequence[Group], degree: int) -> None:
    """Create point, thickness stretch and field of each layer.

    Args:
        domain: The mesh.
        spaces: The state.
        groups: The layers.
        degree: Quadrature degree.
    """
    mesh, kinematics = domain.mesh, domain.symbolic
    scalars = compat.functionspace(mesh, compat.quadrature_element(mesh, degree, 1))
    x, u = ufl.SpatialCoordinate(mesh), ufl.split(spaces.w)[0]
    metric = kinematics.metric(u, x)
    size = len(metric)
    excess = fem.Function(
        compat.functionspace(mesh, compat.quadrature_element(mesh, degree, size)), name="excess"
    )
    for group in groups:
        sheet = group.sheet
        assert sheet is not None
        sheet.excess, sheet.stretch = excess, fem.Function(scalars, name="stretch")
        sheet.stretch.x.array[:] = 1.0
        parts = [ufl.variable(c + excess[k]) for k, c in enumerate(metric)]
        sheet.field = constant(mesh, 0.0)
        field, across = ufl.variable(sheet.field), ufl.variable(sheet.stretch[0])
        sheet.variables = (*parts, *([field] if sheet.driven else []), across)
        F = kinematics.sheet_gradient(tuple(parts), across)
        E = ufl.as_vector([field if k == group.normal and sheet.driven else 0 for k in range(3)])
        sheet.point = Point(x, u, F, E, principal=kinematics.dim == 2)


class LayerEnergy:
    """Energy of one layer at the quadrature points, as a function of metric and voltages.

    Args:
        domain: The mesh.
        sheet: The layer.
        energies: Its energies (see `Problem.densities`).
        ports: Terminals in the order of their voltages among the variables.
        degree: Quadrature degree.
    """

    def __init__(
        self,
        domain: Domain,
        sheet: Sheet,
        energies: tuple[Any, Any, Any],
        ports: Sequence[str],
        degree: int,
    ) -> None:
        self._sheet, self._mesh, self._cells = sheet, domain.mesh, domain.cells(sheet.area)
        points, _ = compat.quadrature(domain.mesh, degree)
        self._points = len(points)
        elastic, electric, total = energies
        variables = sheet.variables
        slopes = [ufl.diff(total, v) for v in variables]
        self._pairs = np.triu_indices(len(variables))
        curvatures = [ufl.diff(slopes[i], variables[j]) for i, j in zip(*self._pairs, strict=True)]
        both = ufl.as_vector([elastic, electric, *slopes, *curvatures])
        self._all = compat.expression(both, points)
        across = variables[-1]
        by_log = slopes[-1] * across  # Newton's method in ln s keeps s positive
        step = by_log / (ufl.diff(slopes[-1], across) * across**2 + by_log)
        self._step = compat.expression(step, points)
        self._dofs = compat.cell_dofs(sheet.stretch.function_space)[self._cells]
        self._ports = list(ports)

    def _volts_to_field(self) -> Any:
        """Derivatives of the layer's variables, but the last, by metric and voltages, (own, n)."""
        sheet, ports = self._sheet, self._ports
        own = len(sheet.variables) - 1
        size = own - sheet.driven
        found = np.zeros((own, size + len(ports)))
        found[:size, :size] = np.eye(size)
        if sheet.driven:
            for port, sign in zip(sheet.between, (1, -1), strict=True):
                if port:
                    found[size, size + ports.index(port)] += sign / sheet.thickness
        return found

    def settle(self, volts: Mapping[str, float]) -> None:
        """Solve for the thickness stretch by Newton's method at each point.

        Where that does not converge the stretch becomes NaN, so that the residual is undefined.

        Args:
            volts: Voltages of the terminals, kV.
        """
        low, high = (volts[port] if port else 0.0 for port in self._sheet.between)
        self._sheet.field.value = (low - high) / self._sheet.thickness
        s = self._sheet.stretch.x.array
        s[~np.isfinite(s)] = 1.0  # left by a failed increment
        for _ in range(_MOST):
            step = compat.evaluate(self._step, self._mesh, self._cells, self._points)[..., 0]
            s[self._dofs] *= np.exp(-np.clip(step, -0.5, 0.5))
            if not np.abs(step).max(initial=0.0) > _ENOUGH:
                return
        s[self._dofs[~(np.abs(step) < 1e-9)]] = np.nan

    def derivatives(self, fixed: bool = False) -> tuple[Any, Any, Any]:
        """Energies and their derivatives by metric and voltages, per area of the mesh.

        Args:
            fixed: Second derivatives at a fixed thickness; default with the thickness stretch
                eliminated by static condensation.

        Returns:
            Energies (cells, points, 2), first derivatives (cells, points, n) and second ones
            (cells, points, n, n).
        """
        found = compat.evaluate(self._all, self._mesh, self._cells, self._points)
        found *= self._sheet.thickness
        own = len(self._sheet.variables)
        slopes, packed = found[..., FIRST : FIRST + own], found[..., FIRST + own :]
        full = np.empty((*slopes.shape, own))
        full[..., self._pairs[0], self._pairs[1]] = full[..., self._pairs[1], self._pairs[0]] = (
            packed
        )
        curvature = full[..., :-1, :-1]
        if not fixed:
            mixed = full[..., :-1, -1]
            curvature = curvature - mixed[..., :, None] * mixed[..., None, :] / full[..., -1:, -1:]
        T = self._volts_to_field()
        return found[..., :FIRST], slopes[..., :-1] @ T, T.T @ curvature @ T
