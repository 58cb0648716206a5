"""Membranes: all layers of a laminate on its middle surface, without bending.

Each layer of mounted thickness H adds H W(F) / det F_p with the deformation gradient of the middle
surface and a thickness stretch s of its own, at which the energy is stationary: the layer is free
of stress across. The field between two electrodes is the voltage over H s.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from dealib.device.kinematics import SheetKinematics
from dealib.device.laminate import JOIN
from dealib.fem import compat
from dealib.fem.domain import Domain, Spaces
from dealib.fem.energies import Point
from dealib.fem.groups import Group, Sheet, areas

_ENOUGH, _MOST = 1e-13, 60  # change of a stretch at which it is there, and steps


def equip(
    domain: Domain,
    spaces: Spaces,
    groups: Sequence[Group],
    values: Mapping[str, Any],
    degree: int,
) -> None:
    """Give each layer its point and the function of its thickness stretch.

    Args:
        domain: The mesh.
        spaces: The state.
        groups: The layers.
        values: Voltages of the terminals, UFL variables.
        degree: Quadrature degree.
    """
    mesh, kinematics = domain.mesh, domain.device.kinematics
    assert isinstance(kinematics, SheetKinematics)
    Q = compat.functionspace(mesh, compat.quadrature_element(mesh, degree, 1))
    x, u = ufl.SpatialCoordinate(mesh), ufl.split(spaces.w)[0]
    for group in groups:
        sheet = group.sheet
        assert sheet is not None
        sheet.stretch = fem.Function(Q, name="stretch")
        sheet.stretch.x.array[:] = 1.0
        sheet.across = ufl.variable(sheet.stretch[0])
        F = kinematics.sheet_gradient(u, x, sheet.across)
        volts = [values.get(port, 0.0) if port else 0.0 for port in sheet.between]
        across = 0.0 if None in sheet.between else (volts[0] - volts[1]) / sheet.thickness
        E = ufl.as_vector([across if k == group.normal else 0.0 for k in range(3)])
        sheet.point = Point(x, u, F, E)


def compile_update(domain: Domain, sheet: Sheet, density: Any, degree: int) -> None:
    """Compile the step of a layer's thickness stretch.

    Args:
        domain: The mesh.
        sheet: The layer.
        density: Of all its energies.
        degree: Quadrature degree.
    """
    points, _ = compat.quadrature(domain.mesh, degree)
    slope = ufl.diff(density, sheet.across)
    by_log = slope * sheet.across  # in ln s, so that it stays above zero
    step = by_log / (ufl.diff(slope, sheet.across) * sheet.across**2 + by_log)
    sheet.update = _Update(domain, sheet, compat.expression(step, points), len(points))


class _Update:
    """Newton's method for the thickness stretch of one layer at the quadrature points."""

    def __init__(self, domain: Domain, sheet: Sheet, compiled: Any, points: int) -> None:
        self._sheet, self._step, self._points = sheet, compiled, points
        self._mesh, self._cells = domain.mesh, domain.cells(sheet.area)
        self._dofs = compat.cell_dofs(sheet.stretch.function_space)[self._cells]

    def __call__(self) -> None:
        s = self._sheet.stretch.x.array
        for _ in range(_MOST):
            step = compat.evaluate(self._step, self._mesh, self._cells, self._points)[..., 0]
            change = np.clip(step, -0.5, 0.5)
            s[self._dofs] *= np.exp(-change)
            if not np.abs(step).max(initial=0.0) > _ENOUGH:
                return
        s[self._dofs[np.abs(step) > 1e-9]] = np.nan


def sheet_faces(domain: Domain, w: Any, name: str) -> Iterator[tuple[str, Point]]:
    """Parts of a sheet on which one of its faces lies, and a point there.

    Args:
        domain: The mesh.
        w: The state.
        name: Of the face, or of a part of one.
    """
    kinematics, laminate = domain.device.kinematics, domain.device.laminate
    assert laminate is not None
    assert isinstance(kinematics, SheetKinematics)
    face = laminate.patches[name][0] if name in laminate.patches else name
    sign = 1.0 if laminate.faces[face][1] == "top" else -1.0
    x, u = ufl.SpatialCoordinate(domain.mesh), ufl.split(w)[0]
    area, across = sign * kinematics.area_vector(u, x), sign * kinematics.across()
    point = Point(kinematics.in_space(x), u, None, None, across, area)
    for place in areas(domain):
        if name in place.split(JOIN):
            yield place, point
