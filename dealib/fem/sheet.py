"""Membranes: all layers of a laminate on its middle surface, without bending.

Each layer of mounted thickness H adds H W(F) / det F_p with the metric of the middle surface and a
thickness stretch s of its own, at which the energy is stationary: the layer is free of stress
across. The field between two electrodes is the voltage over H s. In tension fields the metric is
that of the wrinkled sheet (see `materials.wrinkling`).

The energy is so a function of the metric's components and of the terminals' voltages alone. Its
first and second derivatives by these are found at the quadrature points and kept there; the forms
are the same for all laws.

A wrinkled sheet has no stiffness across its wrinkles, and a slack one none at all. What it keeps,
so that it can be solved, is k/2 |grad u|^2: it is convex, so that nothing buckles, and least where
the sheet was mounted, so that nothing collapses. No energy that a turn leaves alone is both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from dealib.device.laminate import JOIN
from dealib.fem import compat
from dealib.fem.domain import Domain, Spaces
from dealib.fem.energies import Point, constant
from dealib.fem.groups import Group, Sheet, areas
from dealib.materials.wrinkling import Wrinkles

_ENOUGH, _MOST = 1e-13, 60  # change of a stretch at which it is there, and steps
_ELASTIC, _ELECTRIC, _FIRST = 0, 1, 2  # where the energies and their derivatives are kept

Densities = Callable[[Group], tuple[Any, Any, Any]]


def equip(domain: Domain, spaces: Spaces, groups: Sequence[Group], degree: int) -> None:
    """Give each layer its point, its thickness stretch and its field.

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


class Layer:
    """Energy of one layer at the quadrature points, as a function of metric and voltages.

    Args:
        domain: The mesh.
        sheet: The layer.
        energies: Its elastic energy without branches, the electric one, and the sum of all.
        ports: Terminals, in the order in which their voltages count.
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
        by_log = slopes[-1] * across  # in ln s, so that it stays above zero
        step = by_log / (ufl.diff(slopes[-1], across) * across**2 + by_log)
        self._step = compat.expression(step, points)
        self._dofs = compat.cell_dofs(sheet.stretch.function_space)[self._cells]
        self._ports = list(ports)

    def _volts_to_field(self) -> Any:
        """Derivative of the layer's variables, all but the last, by metric and voltages."""
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
        """Bring the thickness stretch to where it belongs, by Newton's method at each point.

        Where it does not end the stretch is not a number, which the solver sees.
        """
        low, high = (volts[port] if port else 0.0 for port in self._sheet.between)
        self._sheet.field.value = (low - high) / self._sheet.thickness
        s = self._sheet.stretch.x.array
        s[~np.isfinite(s)] = 1.0  # what an increment that failed has left
        for _ in range(_MOST):
            step = compat.evaluate(self._step, self._mesh, self._cells, self._points)[..., 0]
            s[self._dofs] *= np.exp(-np.clip(step, -0.5, 0.5))
            if not np.abs(step).max(initial=0.0) > _ENOUGH:
                return
        s[self._dofs[~(np.abs(step) < 1e-9)]] = np.nan

    def derivatives(self) -> tuple[Any, Any, Any]:
        """Energies (cells, points, 2), and derivatives by metric and voltages, the stretch out.

        Of shape (cells, points, n) and (cells, points, n, n), per area of the mesh.
        """
        found = compat.evaluate(self._all, self._mesh, self._cells, self._points)
        found *= self._sheet.thickness
        own = len(self._sheet.variables)
        slopes, packed = found[..., _FIRST : _FIRST + own], found[..., _FIRST + own :]
        full = np.empty((*slopes.shape, own))
        full[..., self._pairs[0], self._pairs[1]] = full[..., self._pairs[1], self._pairs[0]] = (
            packed
        )
        mixed = full[..., :-1, -1]
        both = mixed[..., :, None] * mixed[..., None, :]
        condensed = full[..., :-1, :-1] - both / full[..., -1:, -1:]
        T = self._volts_to_field()
        return found[..., :_FIRST], slopes[..., :-1] @ T, T.T @ condensed @ T


class SheetModel:
    """Energies, stress resultants and stiffnesses of a sheet at its quadrature points.

    Attributes:
        wrinkles: Of each part of the base, in tension fields.
        reference: Quadrature points of the reference cell.

    Args:
        domain: The mesh.
        spaces: The state.
        groups: The layers, equipped.
        densities: Elastic energy of a layer without branches, the electric one, and the sum of all.
        ports: Voltages of the terminals by name, UFL variables of constants.
        degree: Quadrature degree.
        measure: Integration over all cells.
        slack: Stiffness that a wrinkled sheet keeps, of each part of the base, N/mm; None for taut
            sheets.
    """

    def __init__(
        self,
        domain: Domain,
        spaces: Spaces,
        groups: Sequence[Group],
        densities: Densities,
        ports: Mapping[str, Any],
        degree: int,
        measure: Any,
        slack: Mapping[str, float] | None = None,
    ) -> None:
        kinematics = domain.symbolic
        x, self._u = ufl.SpatialCoordinate(domain.mesh), ufl.split(spaces.w)[0]
        self._w, self._metric = spaces.w, kinematics.metric(self._u, x)
        self._size, self._ports, self._domain = len(self._metric), ports, domain
        count = self._size + len(ports)
        self._pairs = np.triu_indices(count)
        self._layers: dict[str, list[Layer]] = {}
        for group in groups:
            assert group.sheet is not None
            layer = Layer(domain, group.sheet, densities(group), list(ports), degree)
            self._layers.setdefault(group.sheet.area, []).append(layer)
            self._excess = group.sheet.excess
        mesh, total = domain.mesh, _FIRST + count + len(self._pairs[0])
        element = compat.quadrature_element(mesh, degree, total)
        self._values = fem.Function(compat.functionspace(mesh, element), name="resultants")
        scalars = compat.functionspace(mesh, compat.quadrature_element(mesh, degree, 1))
        self._flags = fem.Function(scalars, name="wrinkled")
        self._springs = fem.Function(scalars, name="springs")
        self._cells = {area: domain.cells(area) for area in self._layers}
        points = len(compat.quadrature(mesh, degree)[0])
        self._points, self.wrinkles = points, {}
        self.reference = compat.quadrature(mesh, degree)[0]
        self._volume, self._measure = kinematics.volume(x), measure
        self._slack = None if slack is None else kinematics.gradient_square(self._u, x) / 2
        for area, share in (slack or {}).items():
            cells = self._cells[area]
            self.wrinkles[area] = Wrinkles(len(cells) * points, self._size)
            self._springs.x.array[compat.cell_dofs(scalars)[cells]] = share

    # --- at the quadrature points ----------------------------------------------------------------

    def excess_of_cells(self, cells: Any) -> Any:
        """The excess metric at the quadrature points of cells, (cells, components, points)."""
        dofs = compat.cell_dofs(self._excess.function_space)[cells]
        return np.swapaxes(self._excess.x.array.reshape(-1, self._size)[dofs], 1, 2)

    def set_excess(self, cells: Any, excess: Any) -> None:
        """Start from another excess metric, (cells, points, components)."""
        dofs = compat.cell_dofs(self._excess.function_space)
        array = self._excess.x.array.reshape(-1, self._size)
        array[dofs[cells]] = excess
        for area, wrinkles in self.wrinkles.items():
            wrinkles.set_excess(array[dofs[self._cells[area]]].reshape(-1, self._size))

    def flag_wrinkles(self) -> None:
        """Mark the quadrature points that are wrinkled or slack for the energy 'wrinkled'."""
        dofs = compat.cell_dofs(self._flags.function_space)
        for area, cells in self._cells.items():
            flags = self.wrinkles[area].wrinkled.reshape(len(cells), self._points)
            self._flags.x.array[dofs[cells]] = flags

    def settle(self) -> None:
        """Bring stretches and wrinkles to where they belong, and find the energy's derivatives."""
        volts = {port: float(v.ufl_operands[0].value) for port, v in self._ports.items()}
        dofs = compat.cell_dofs(self._values.function_space)
        packed = self._values.x.array.reshape(-1, self._values.function_space.dofmap.bs)
        for area, cells in self._cells.items():
            energies, slopes, hessian = self._relaxed(area, volts)
            upper = hessian[..., self._pairs[0], self._pairs[1]]
            packed[dofs[cells]] = np.concatenate([energies, slopes, upper], axis=-1)

    def _sum(self, area: str, volts: Mapping[str, float]) -> list[Any]:
        """Energies and derivatives of all layers on a part of the base."""
        for layer in self._layers[area]:
            layer.settle(volts)
        return [
            sum(parts) for parts in zip(*(x.derivatives() for x in self._layers[area]), strict=True)
        ]

    def _relaxed(self, area: str, volts: Mapping[str, float]) -> list[Any]:
        """The same with the wrinkles that make the energy smallest."""
        if area not in self.wrinkles:
            return self._sum(area, volts)
        wrinkles, cells, size = self.wrinkles[area], self._cells[area], self._size
        shape = (len(cells), self._points)
        dofs = compat.cell_dofs(self._excess.function_space)[cells]
        array = self._excess.x.array.reshape(-1, size)

        def evaluate(excess: Any) -> tuple[Any, Any]:
            array[dofs] = excess.reshape(*shape, size)
            _, slopes, hessian = self._sum(area, volts)
            return (
                slopes[..., :size].reshape(-1, size),
                hessian[..., :size, :size].reshape(-1, size, size),
            )

        there = wrinkles.relax(evaluate)
        evaluate(wrinkles.excess)
        energies, slopes, hessian = self._sum(area, volts)
        flat = hessian.reshape(-1, *hessian.shape[2:])
        flat = wrinkles.condensed(slopes[..., :size].reshape(-1, size), flat)
        hessian = flat.reshape(hessian.shape)
        slopes[np.logical_not(there.reshape(shape))] = np.nan
        return [energies, slopes, hessian]

    # --- forms -----------------------------------------------------------------------------------

    def energy(self, name: str) -> Any:
        """The elastic or the electric energy, mJ; or the wrinkled area as mounted, mm^2."""
        if name == "wrinkled":
            return self._over(self._flags[0])
        if name == "elastic" and self._slack is not None:
            return self._over(self._values[_ELASTIC] + self._springs[0] * self._slack)
        return self._over(self._values[_ELASTIC if name == "elastic" else _ELECTRIC])

    def first(self, test: Any) -> Any:
        """First variation of the potential."""
        total = sum(self._slope(k) * self._varied(k, test) for k in range(self._size))
        if self._slack is not None:
            total += self._springs[0] * ufl.derivative(self._slack, self._w, test)
        return self._over(total)

    def second(self, test: Any, trial: Any) -> Any:
        """Second variation."""
        total: Any = 0
        if self._slack is not None:
            total = ufl.derivative(ufl.derivative(self._slack, self._w, test), self._w, trial)
            total *= self._springs[0]
        for i in range(self._size):
            total += self._slope(i) * ufl.derivative(self._varied(i, test), self._w, trial)
            for j in range(self._size):
                total += self._hessian(i, j) * self._varied(i, test) * self._varied(j, trial)
        return self._over(total)

    def dual(self, port: str) -> Any:
        """Derivative of the potential by a voltage."""
        return self._over(self._slope(self._number(port)))

    def column(self, port: str, test: Any) -> Any:
        """Derivative of that by the state."""
        k = self._number(port)
        parts = (self._hessian(k, j) * self._varied(j, test) for j in range(self._size))
        return self._over(sum(parts))

    def corner(self, one: str, other: str) -> Any:
        """Second derivative of the potential by two voltages."""
        return self._over(self._hessian(self._number(one), self._number(other)))

    def _over(self, density: Any) -> Any:
        return density * self._volume * self._measure

    def _number(self, port: str) -> int:
        return self._size + list(self._ports).index(port)

    def _slope(self, k: int) -> Any:
        return self._values[_FIRST + k]

    def _hessian(self, i: int, j: int) -> Any:
        low, high = min(i, j), max(i, j)
        pairs = [(int(a), int(b)) for a, b in zip(*self._pairs, strict=True)]
        return self._values[_FIRST + self._size + len(self._ports) + pairs.index((low, high))]

    def _varied(self, k: int, direction: Any) -> Any:
        return ufl.derivative(self._metric[k], self._w, direction)


def sheet_faces(domain: Domain, w: Any, name: str) -> Iterator[tuple[str, Point]]:
    """Parts of a sheet on which one of its faces lies, and a point there.

    Args:
        domain: The mesh.
        w: The state.
        name: Of the face, or of a part of one.
    """
    kinematics, laminate = domain.symbolic, domain.device.laminate
    assert laminate is not None
    face = laminate.patches[name][0] if name in laminate.patches else name
    sign = 1.0 if laminate.faces[face][1] == "top" else -1.0
    x, u = ufl.SpatialCoordinate(domain.mesh), ufl.split(w)[0]
    area, across = sign * kinematics.area_vector(u, x), sign * kinematics.across()
    point = Point(kinematics.in_space(x), u, None, None, across, area)
    for place in areas(domain):
        if name in place.split(JOIN):
            yield place, point
