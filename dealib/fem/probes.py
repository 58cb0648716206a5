"""Evaluates the probes of a config in the current state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.config.probes import Probe
from dealib.errors import ValueAt
from dealib.fem import compat
from dealib.fem.layout import Layout
from dealib.fem.problem import Problem
from dealib.fem.viscous import Viscosity
from dealib.observe.local_quantities import Here, local_quantities
from dealib.results import local, stress
from dealib.results.elements import Cell

_INSIDE = 1e-9  # how far outside its reference cell a point still counts as inside


@dataclass(frozen=True)
class _Spots:
    """Points of some local cells of one material.

    Attributes:
        cells: The cells.
        reference: The points in the reference cell, (points, dim).
        points: Shape functions, gradients and material at the points.
        weights: Volume or area of the device at each point, (cells, points); 1 at a single point.
        material: Material of the cells.
        group: Name of their group of regions.
    """

    cells: Any
    reference: Array
    points: local.CellPoints
    weights: Array
    material: stress.RegionMaterial
    group: str


class Probes:
    """The probes of a problem, whose points are found once.

    Args:
        problem: The problem.
        layout: Its layout.

    Raises:
        ValueAt: If a point lies outside the mesh.
    """

    def __init__(self, problem: Problem, layout: Layout) -> None:
        self._problem, self._layout = problem, layout
        self._known = local_quantities(problem.kinematics)
        self._materials = local.region_materials(problem.config)
        given = problem.config.probes or {}
        self._probes = {name: (probe, self._spots(name, probe)) for name, probe in given.items()}

    def measure(self, name: str, viscosity: Viscosity | None) -> float:
        """Value of a probe in the current state (collective)."""
        probe, spots = self._probes[name]
        comm, nodal = self._problem.domain.comm, self._layout.local()
        found = [(self._values(probe, s, nodal[s.cells], viscosity), s.weights) for s in spots]
        values = np.concatenate([v.ravel() for v, _ in found] or [np.empty(0)])
        weights = np.concatenate([w.ravel() for _, w in found] or [np.empty(0)])
        if probe.on is not None and probe.take in ("max", "min"):
            sign = 1.0 if probe.take == "max" else -1.0
            mine = float((sign * values).max()) if values.size else -np.inf
            return sign * float(comm.allreduce(mine, op=MPI.MAX))
        total, size = comm.allreduce(np.array([(values * weights).sum(), weights.sum()]))
        return float(total if probe.take == "integral" and probe.on is not None else total / size)

    def _values(self, probe: Probe, s: _Spots, nodal: Array, viscosity: Viscosity | None) -> Array:
        axes = self._problem.kinematics.dim
        internal = None
        if viscosity is not None:
            internal = viscosity.of_cells(s.group, s.cells, s.reference)
        here = Here(
            s.material,
            s.points.deformation(nodal, internal),
            np.einsum("pn,cna->cpa", s.points.N, nodal[..., :axes]),
            nodal[..., axes] @ s.points.N.T,
            s.points.pressure(nodal),
            internal,
        )
        return np.asarray(self._known[probe.measured].evaluate(here))

    # --- points ----------------------------------------------------------------------------------

    def _spots(self, name: str, probe: Probe) -> list[_Spots]:
        if probe.at is not None:
            return self._at(name, np.array(probe.at))
        assert probe.on is not None
        domain = self._problem.domain
        dim, entities = domain.entities(probe.on)
        if dim == domain.dim:
            points, weights = compat.quadrature(domain.mesh, self._problem.spaces.degree)
            return self._over(domain.owned(entities), points, weights, probe.on)
        return self._on_facets(entities)

    def _group_of(
        self, cells: Any, region: str | None = None
    ) -> list[tuple[str, stress.RegionMaterial, Any]]:
        """Rows of cells by group of regions.

        In a sheet they are the rows of a region, or by default those of one layer, a dielectric if
        there is one.
        """
        found = []
        for group in self._problem.groups:
            rows = self._layout.rows(group)
            mine = rows[np.isin(self._layout.cells(rows), cells)]
            if len(mine) and (region in (None, *group.regions) or not self._sheet):
                found.append((group.name, self._materials[group.regions[0]], mine))
        if self._sheet and region is None:
            found.sort(key=lambda item: not item[1].permittivity)
            return found[:1]
        return found

    @property
    def _sheet(self) -> bool:
        return self._problem.kinematics.sheet

    def _over(self, cells: Any, points: Array, weights: Array, on: str) -> list[_Spots]:
        found, device = [], self._problem.device
        region = on if any(r.name == on for r in device.regions) else None
        for group, material, mine in self._group_of(cells, region):
            nodes = self._layout.nodes[mine]
            at = self._points(nodes, points, material)
            kinematics, cell = self._problem.kinematics, self._layout.cell
            size = local.volumes(kinematics, cell, nodes, points, weights)
            if region is not None and material.thickness:
                size = size * material.thickness
            found.append(_Spots(mine, points, at, size, material, group))
        return found

    def _points(
        self, nodes: Array, reference: Array, material: stress.RegionMaterial
    ) -> local.CellPoints:
        kinematics, cell = self._problem.kinematics, self._layout.cell
        return local.CellPoints.of(kinematics, material, cell, nodes, reference)

    def _on_facets(self, facets: Any) -> list[_Spots]:
        """Quadrature points on facets, in the cell on one side: a dielectric if there is one."""
        domain, cell = self._problem.domain, self._layout.cell
        owned = compat.local_cells(domain.mesh)
        chosen: dict[int, list[int]] = {}
        films = set(
            domain.cells(*(n for n, m in self._materials.items() if m.permittivity and m.law))
        )
        to_cells = domain.mesh.topology.connectivity(domain.dim - 1, domain.dim)
        domain.mesh.topology.create_connectivity(domain.dim, domain.dim - 1)
        to_facets = domain.mesh.topology.connectivity(domain.dim, domain.dim - 1)
        solids = set(domain.solids.tolist())
        for facet in facets:
            beside = sorted(
                to_cells.links(facet), key=lambda c: (c not in films, c not in solids, c)
            )
            if beside[0] < owned:
                side = list(to_facets.links(beside[0])).index(facet)
                chosen.setdefault(side, []).append(beside[0])
        found = []
        for side, cells in chosen.items():
            points, weights, tangents = compat.facet_quadrature(
                domain.mesh, side, self._problem.spaces.degree
            )
            for group, material, mine in self._group_of(np.array(cells)):
                nodes = self._layout.nodes[mine]
                at = self._points(nodes, points, material)
                jacobian = np.swapaxes(nodes, 1, 2)[:, None] @ cell.shape(points)[1]
                size = _area(jacobian @ tangents.T) * self._problem.kinematics.volumes(at.position)
                found.append(_Spots(mine, points, at, size * weights, material, group))
        return found

    def _at(self, name: str, x: Array) -> list[_Spots]:
        """The point x in its cell, on the lowest rank that has such a cell (collective)."""
        domain, layout = self._problem.domain, self._layout
        lies = list(self._problem.kinematics.lies)
        rows = layout.owned(np.arange(len(layout.nodes)))
        nodes = layout.nodes[rows][..., lies]
        slack, x = 1e-6 * domain.sizes.thickness, x[lies]
        near = ((nodes.min(1) - slack <= x) & (x <= nodes.max(1) + slack)).all(axis=1)
        solids = set(domain.solids.tolist())
        inside = []
        for row in sorted(rows[near], key=lambda r: (layout.cells(r) not in solids, r)):
            reference = _inverse(layout.cell, layout.nodes[row][..., lies], x)
            if reference is not None:
                inside.append((int(layout.cells(row)), reference))
        ranks = domain.comm.allgather(bool(inside))
        if not any(ranks):
            at = ", ".join(f"{v:g}" for v in x)
            raise ValueAt(("probes", name, "at"), f"the point ({at}) mm lies outside the mesh")
        if ranks.index(True) != domain.comm.rank:
            return []
        cell, reference = inside[0]
        (group, material, cells), *_ = self._group_of(np.array([cell]))
        points = self._points(layout.nodes[cells], reference[None], material)
        return [_Spots(cells, reference[None], points, np.ones((1, 1)), material, group)]


def _area(tangents: Array) -> Array:
    """Length or area that one or two tangents span, (...), from (..., axes, 1 or 2)."""
    if tangents.shape[-1] == 1:
        return np.asarray(np.linalg.norm(tangents[..., 0], axis=-1))
    return np.asarray(np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1))


def _inverse(cell: Cell, nodes: Array, x: Array) -> Array | None:
    """Reference coordinates of a point in a cell by Newton's method; None if it is outside."""
    reference = cell.nodes[: cell.corners].mean(axis=0)
    for _ in range(20):
        N, dN = cell.shape(reference[None])
        gap = x - N[0] @ nodes
        step = np.linalg.lstsq(nodes.T @ dN[0], gap, rcond=None)[0]
        reference = reference + step
        if np.abs(step).max() < 1e-12:
            break
    else:
        return None
    low, high = reference.min(), reference.max()
    if cell.name in ("triangle", "tetrahedron"):
        high = max(high, reference.sum())
    return reference if low >= -_INSIDE and high <= 1 + _INSIDE else None
