"""Integrals over the regions and faces of a mesh, and the points at which densities are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import ufl
from dolfinx import fem

from dealib.fem import compat
from dealib.fem.chambers import sides
from dealib.fem.domain import Domain, Spaces
from dealib.fem.energies import Energy, Point
from dealib.fem.groups import Group
from dealib.fem.sheet import sheet_faces


@dataclass
class Integrals:
    """Makes integrals over groups of regions and over faces.

    Attributes:
        domain: Mesh and names.
        spaces: Spaces and current state.
        groups: Regions that share energies.
    """

    domain: Domain
    spaces: Spaces
    groups: tuple[Group, ...]

    def point_of(self, group: str) -> Point:
        """The point at which energies of a group are evaluated."""
        sheet = self.group(group).sheet
        return self.point if sheet is None else sheet.point

    def group(self, name: str) -> Group:
        """A group by name."""
        return next(g for g in self.groups if g.name == name)

    @cached_property
    def point(self) -> Point:
        """A point of the current state inside the body."""
        u, phi = ufl.split(self.spaces.w)[:2]
        x, k = ufl.SpatialCoordinate(self.domain.mesh), self.domain.device.kinematics
        F, E = k.deformation_gradient(u, x), k.nominal_field(phi)
        return Point(x, u, F, E, principal=k.dim == 2)

    @cached_property
    def face(self) -> Point:
        """A point of the current state on a face, its normal out of the cell."""
        N = self.domain.device.kinematics.vector(ufl.FacetNormal(self.domain.mesh))
        p = self.point
        return replace(p, N=N, area=ufl.det(p.F) * ufl.inv(p.F).T * N)

    @cached_property
    def _places(self) -> tuple[tuple[str, ...], ...]:
        """Cells of the groups by name: their regions, in sheets their part of the base."""
        found = [g.regions if g.sheet is None else (g.sheet.area,) for g in self.groups]
        return tuple(dict.fromkeys(found))

    @cached_property
    def _tags(self) -> Any:
        return self.domain.tagged(self._places)

    @property
    def everywhere(self) -> Any:
        """Integration over all cells; dolfinx 0.9 wants the same tags in all parts of a form."""
        return self._measure("dx", self._tags)

    def measure(self, group: str) -> Any:
        """Integration over a group of regions."""
        found = self.group(group)
        place = found.regions if found.sheet is None else (found.sheet.area,)
        return self._measure("dx", self._tags)(1 + self._places.index(place))

    def over(self, group: str, density: Any) -> Any:
        """Integral over a group of regions of a density per mesh volume, of the whole device."""
        sheet = self.group(group).sheet
        size = self.domain.symbolic.volume(self.point_of(group).x) * (
            1.0 if sheet is None else sheet.thickness
        )
        return density * size * self.measure(group)

    def total(self, energies: Iterable[Energy], take: Callable[[Energy, Point], Any]) -> Any:
        """Sum of integrals of energies, each over its region.

        Args:
            energies: The energies; at least one.
            take: The density of an energy at a point of its region.
        """
        first, *others = (self.over(e.on, take(e, self.point_of(e.on))) for e in energies)
        return sum(others, first)

    def over_face(self, name: str, density: Any, *regions: str) -> Any:
        """Integral over a boundary of a density at `face`, on the side of some regions.

        Args:
            name: Name of the boundary.
            density: Density per mesh area.
            regions: Regions whose side counts where facets lie inside the mesh; between two such
                regions it is the mean of both sides.
        """
        density = density * self.domain.symbolic.volume(self.point.x)
        tags = tuple(tag for _, tag in self.domain.tags(name))
        if sides(self.domain, name) == 1:
            return density * self._measure("ds", self.domain.facet_tags)(tags)
        mesh = self.domain.mesh
        V = compat.functionspace(mesh, compat.element(mesh, "DG", 0))
        chi = fem.Function(V, name="indicator")
        chi.x.array[compat.cell_dofs(V)[self.domain.cells(*regions), 0]] = 1.0
        both = chi("+") * density("+") + chi("-") * density("-")
        return both / (chi("+") + chi("-")) * self._measure("dS", self.domain.facet_tags)(tags)

    def _measure(self, sort: str, tags: Any) -> Any:
        return ufl.Measure(
            sort,
            domain=self.domain.mesh,
            subdomain_data=tags,
            metadata={"quadrature_degree": self.spaces.degree},
        )

    def faces(self, name: str) -> Iterator[tuple[Callable[[Any], Any], Point]]:
        """Functions that integrate over a face, and points on it."""
        if not self.domain.device.kinematics.sheet:
            yield partial(self._on_face, name), self.face
            return
        for area, point in sheet_faces(self.domain, self.spaces.w, name):
            tag = 1 + self._places.index((area,))
            size = self.domain.symbolic.volume(ufl.SpatialCoordinate(self.domain.mesh))
            yield partial(self._on_sheet, size, tag), point

    def _on_face(self, name: str, density: Any) -> Any:
        return self.over_face(name, density, *(region.name for region in self.domain.device.solids))

    def _on_sheet(self, size: Any, tag: int, density: Any) -> Any:
        return density * size * self._measure("dx", self._tags)(tag)
