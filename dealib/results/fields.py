"""Nodal fields of a state, such as stresses, from nodal u and phi on a `ResultMesh`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from dealib.arrays import Array, Ints
from dealib.config.schema import Config
from dealib.results import local, stress
from dealib.results.mesh import Average, ResultMesh
from dealib.results.rows import Rows

_ROOM = 16e6  # bytes of a block of cells


def fields(
    config: Config, mesh: ResultMesh, state: Array, internal: Array | None = None
) -> dict[str, Array]:
    """All nodal fields of one state (see `Fields`)."""
    return Fields(config, mesh)(state, internal)


def named(modes: Array | None, velocity: Array | None = None) -> dict[str, Array]:
    """Modes as fields 'mode', 'mode2', ..., and 'velocity' in mm/s, (nodes, 3) each."""
    found = {}
    if velocity is not None:
        found["velocity"] = np.pad(velocity, ((0, 0), (0, 3 - velocity.shape[1])))
    for k, u in enumerate(() if modes is None else modes, start=1):
        found["mode" + (str(k) if k > 1 else "")] = np.pad(u, ((0, 0), (0, 3 - u.shape[1])))
    return found


class Fields:
    """Derives the nodal fields of states; quantities common to all states are computed once.

    Args:
        config: The config of the run.
        mesh: Mesh of the results.
    """

    def __init__(self, config: Config, mesh: ResultMesh) -> None:
        viscous, kinematics = local.cells_with_memory(config, mesh), config.device.kinematics
        self._mesh, self._axes = mesh, kinematics.dim
        self._wrinkles = config.physics.wrinkling == "tension_field"
        at_once = max(1, int(_ROOM / _bytes(mesh)))
        self._parts = []
        for material, cells in _by_material(config, mesh):
            blocks = np.split(cells, range(at_once, len(cells), at_once))
            points = partial(local.CellPoints.of, kinematics, material, mesh.cell)
            kept = len(blocks) == 1
            found = [_Block(mesh, c, np.searchsorted(viscous, c), points, kept) for c in blocks]
            self._parts.append(_Part(material, found, Average(mesh, blocks)))

    def __call__(self, state: Array, internal: Rows | None = None) -> dict[str, Array]:
        """All fields of a state.

        Args:
            state: Nodal u by axis and phi, and p in the mixed form, shape (nodes, columns).
            internal: Internal variables of materials at the Gauss points of
                `local.cells_with_memory`, packed, (cells, points, entries, 4).

        Returns:
            Arrays by name, (nodes,), (nodes, 3) or (nodes, 3, 3), with the components of the
            kinematics:

            - u (mm), phi (kV), J = det F;
            - E (kV/mm) and D (uC/mm^2), the true fields in the deformed body;
            - cauchy_stress and second_pk_stress of the material (MPa; the latter per mesh area),
              and maxwell_stress, the stress of the field with electrostriction (MPa);
            - p in the mixed form (MPa, positive in tension);
            - in tension fields wrinkling, the excess length of the film over its surface, and
              crest, that times a unit vector along the crests, whose sign is arbitrary.
        """
        n, axes = len(self._mesh.points), self._axes
        out: dict[str, Array] = {
            "u": np.column_stack([state[:, :axes], np.zeros((n, 3 - axes))]),
            "phi": state[:, axes].copy(),
            "E": np.zeros((n, 3)),
            "D": np.zeros((n, 3)),
            "cauchy_stress": np.zeros((n, 3, 3)),
            "second_pk_stress": np.zeros((n, 3, 3)),
            "maxwell_stress": np.zeros((n, 3, 3)),
            "J": np.ones(n),
        }
        if self._wrinkles:
            out |= {"wrinkling": np.zeros(n), "crest": np.zeros((n, 3, 3))}
        elif state.shape[1] > axes + 1:
            out["p"] = state[:, axes + 1].copy()
        for part in self._parts:
            part.average.into(
                out, (self._of(part.material, b, state, internal) for b in part.blocks)
            )
        if self._wrinkles:
            out["crest"] = out["wrinkling"][:, None] * _main_direction(out["crest"])
        return out

    def _of(
        self, material: stress.RegionMaterial, block: _Block, state: Array, internal: Rows | None
    ) -> dict[str, Array]:
        """Values at the nodes of each cell of a block."""
        nodal, points = state[block.mesh.cells[block.cells]], block.points()
        mine = internal[block.viscous] if internal is not None and material.remembers else None
        k = points.deformation(nodal, mine)
        found = {"J": self._at_nodes(k.J)}
        if self._wrinkles and (crests := points.crests(nodal)):
            found |= dict(zip(("wrinkling", "crest"), map(self._at_nodes, crests), strict=True))
        if material.permittivity:
            eps = self._at_nodes(np.broadcast_to(material.permittivity_at(k), k.J.shape))
            e = self._at_nodes(k.e)
            found["E"], found["D"] = e, eps[..., None] * e
            found["maxwell_stress"] = stress.maxwell(eps, e)
            if material.slope:
                plain = stress.maxwell(material.permittivity_at(k), k.e)
                more = material.electric_stress(k) - plain
                found["maxwell_stress"] += self._at_nodes(more)
        if material.law is not None:
            S = material.elastic_stress(k, points.pressure(nodal), mine)
            found["second_pk_stress"] = self._at_nodes(S)
            found["cauchy_stress"] = self._at_nodes(stress.cauchy(k.F, S))
        return found

    def _at_nodes(self, values: Array) -> Array:
        flat = values.reshape(*values.shape[:2], -1)
        nodal = self._mesh.cell.from_gauss @ flat
        return np.asarray(nodal.reshape(*nodal.shape[:2], *values.shape[2:]))


def _main_direction(dyads: Array) -> Array:
    """Directions of the largest eigenvalues of tensors (n, 3, 3); zero where these are zero."""
    found = np.zeros(dyads.shape[:2])
    there = np.flatnonzero(np.trace(dyads, axis1=1, axis2=2) > 0)
    found[there] = np.linalg.eigh(dyads[there])[1][..., 2]
    return found


@dataclass(frozen=True)
class _Part:
    """The cells of one material.

    Attributes:
        material: The material.
        blocks: The cells, in blocks that fit into the memory.
        average: Averages their values at the nodes.
    """

    material: stress.RegionMaterial
    blocks: list[_Block]
    average: Average


@dataclass
class _Block:
    """Some cells.

    Attributes:
        mesh: The mesh.
        cells: Indices of the cells.
        viscous: Indices of the cells among those with internal variables.
        make: Makes `local.Points` from the cells' nodes and reference coordinates.
        kept: Whether the points are kept from one state to the next.
    """

    mesh: ResultMesh
    cells: Ints
    viscous: Ints
    make: Callable[[Array, Array], local.CellPoints]
    kept: bool
    _points: local.CellPoints | None = None

    def points(self) -> local.CellPoints:
        """Their Gauss points."""
        found = self._points
        if found is None:
            found = self.make(self.mesh.points[self.mesh.cells[self.cells]], self.mesh.cell.gauss)
            self._points = found if self.kept else None
        return found


def _bytes(mesh: ResultMesh) -> float:
    """Bytes for the Gauss points of a cell, mostly gradients of shape functions."""
    points, axes = mesh.cell.gauss.shape
    return 8.0 * points * (mesh.cells.shape[1] * axes + 60)


def _by_material(config: Config, mesh: ResultMesh) -> Iterator[tuple[stress.RegionMaterial, Ints]]:
    """Materials and their cells; regions that share one, as the electrodes do, come together."""
    found: dict[int, tuple[stress.RegionMaterial, list[Ints]]] = {}
    for name, material in local.region_materials(config).items():
        found.setdefault(id(material), (material, []))[1].append(mesh.in_region(name))
    for material, parts in found.values():
        cells = np.sort(np.concatenate(parts))
        if len(cells):
            yield material, cells
