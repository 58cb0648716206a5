"""Membranes: all layers of a laminate on its middle surface, without bending.

Each layer of mounted thickness H adds H W(F) / det F_p with the metric of the middle surface and a
thickness stretch s of its own, in which the energy is stationary: there is no stress across the
layer. The field between two electrodes is the voltage over H s. In tension fields the metric is
that of the wrinkled sheet (see `materials.wrinkling`).

So the energy depends on the metric's components and the terminals' voltages only. Its first and
second derivatives by these are computed at the quadrature points and stored in a function; the
forms are the same for all laws.

A wrinkled sheet has no stiffness across its wrinkles, and a slack one none at all. For a regular
tangent they get the energy k/2 |grad u|^2. It is convex, so that nothing buckles, and smallest in
the mounted state, so that nothing collapses; no energy that is invariant to rotations is both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from dealib.device.laminate import JOIN
from dealib.fem import compat
from dealib.fem.domain import Domain, Spaces
from dealib.fem.energies import Point
from dealib.fem.groups import Group, areas
from dealib.fem.sheet_layer import FIRST, LayerEnergy
from dealib.materials.wrinkling import Wrinkles

_ELASTIC, _ELECTRIC = 0, 1  # columns of the values; derivatives begin at FIRST

Densities = Callable[[Group], tuple[Any, Any, Any]]


class SheetModel:
    """Energies, stress resultants and stiffnesses of a sheet at its quadrature points.

    Attributes:
        wrinkles: Wrinkles on each part of the base, in tension fields.
        reference: Quadrature points in the reference cell, (points, dim).

    Args:
        domain: The mesh.
        spaces: The state.
        groups: The layers, equipped.
        densities: Gives the energies of a layer (see `Problem.densities`).
        ports: Voltages of the terminals by name, UFL variables of constants.
        degree: Quadrature degree.
        measure: Integration over all cells.
        slack: Remaining stiffness k of wrinkled parts of the base, N/mm; None for taut sheets.
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
        self._layers: dict[str, list[LayerEnergy]] = {}
        for group in groups:
            assert group.sheet is not None
            layer = LayerEnergy(domain, group.sheet, densities(group), list(ports), degree)
            self._layers.setdefault(group.sheet.area, []).append(layer)
            self._excess = group.sheet.excess
        mesh, total = domain.mesh, FIRST + count + len(self._pairs[0])
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
        """Set the excess metric of cells, (cells, points, components)."""
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
        """Solve for thickness stretches and wrinkles, and store energies and derivatives."""
        volts = {port: float(v.ufl_operands[0].value) for port, v in self._ports.items()}
        dofs = compat.cell_dofs(self._values.function_space)
        packed = self._values.x.array.reshape(-1, self._values.function_space.dofmap.bs)
        for area, cells in self._cells.items():
            energies, slopes, hessian = self._relaxed(area, volts)
            upper = hessian[..., self._pairs[0], self._pairs[1]]
            packed[dofs[cells]] = np.concatenate([energies, slopes, upper], axis=-1)

    @contextmanager
    def fixed(self) -> Iterator[None]:
        """While the context lasts, second derivatives are those at fixed thickness and wrinkles."""
        dofs = compat.cell_dofs(self._values.function_space)
        packed = self._values.x.array.reshape(-1, self._values.function_space.dofmap.bs)
        kept = packed.copy()
        for area, cells in self._cells.items():
            hessian = sum(layer.derivatives(fixed=True)[2] for layer in self._layers[area])
            upper = hessian[..., self._pairs[0], self._pairs[1]]
            packed[dofs[cells], -upper.shape[-1] :] = upper
        yield
        packed[:] = kept

    def _sum(self, area: str, volts: Mapping[str, float]) -> list[Any]:
        """Energies and derivatives of all layers on a part of the base."""
        for layer in self._layers[area]:
            layer.settle(volts)
        return [
            sum(parts) for parts in zip(*(x.derivatives() for x in self._layers[area]), strict=True)
        ]

    def _relaxed(self, area: str, volts: Mapping[str, float]) -> list[Any]:
        """Energies and derivatives with the wrinkles that minimise the energy."""
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
        """Form of the elastic or electric energy, mJ, or of the mounted wrinkled area, mm^2."""
        if name == "wrinkled":
            return self._over(self._flags[0])
        if name == "elastic" and self._slack is not None:
            return self._over(self._values[_ELASTIC] + self._springs[0] * self._slack)
        return self._over(self._values[_ELASTIC if name == "elastic" else _ELECTRIC])

    def first(self, test: Any) -> Any:
        """Form of the first variation of the potential."""
        total = sum(self._slope(k) * self._varied(k, test) for k in range(self._size))
        if self._slack is not None:
            total += self._springs[0] * ufl.derivative(self._slack, self._w, test)
        return self._over(total)

    def second(self, test: Any, trial: Any) -> Any:
        """Form of the second variation of the potential."""
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
        """Form of the derivative of the potential by a terminal's voltage."""
        return self._over(self._slope(self._number(port)))

    def column(self, port: str, test: Any) -> Any:
        """Form of the second derivative by a terminal's voltage and the state."""
        k = self._number(port)
        parts = (self._hessian(k, j) * self._varied(j, test) for j in range(self._size))
        return self._over(sum(parts))

    def corner(self, one: str, other: str) -> Any:
        """Form of the second derivative by the voltages of two terminals."""
        return self._over(self._hessian(self._number(one), self._number(other)))

    def _over(self, density: Any) -> Any:
        return density * self._volume * self._measure

    def _number(self, port: str) -> int:
        return self._size + list(self._ports).index(port)

    def _slope(self, k: int) -> Any:
        return self._values[FIRST + k]

    def _hessian(self, i: int, j: int) -> Any:
        low, high = min(i, j), max(i, j)
        pairs = [(int(a), int(b)) for a, b in zip(*self._pairs, strict=True)]
        return self._values[FIRST + self._size + len(self._ports) + pairs.index((low, high))]

    def _varied(self, k: int, direction: Any) -> Any:
        return ufl.derivative(self._metric[k], self._w, direction)


def sheet_faces(domain: Domain, w: Any, name: str) -> Iterator[tuple[str, Point]]:
    """Parts of the base on which a face lies, and a point on the face.

    Args:
        domain: The mesh.
        w: The state.
        name: Name of the face or patch.
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
