"""All fields of a state for the eye: from nodal u and phi on a `ResultMesh`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dealib.config.schema import Config
from dealib.results import local
from dealib.results.elements import Array
from dealib.results.mesh import Average, Ints, ResultMesh


def fields(
    config: Config, mesh: ResultMesh, state: Array, internal: Array | None = None
) -> dict[str, Array]:
    """All nodal fields of one state (see `Fields`)."""
    return Fields(config, mesh)(state, internal)


class Fields:
    """Derives the nodal fields of states; what is the same in all of them is found once.

    Args:
        config: The config of the run.
        mesh: Mesh of the results.
    """

    def __init__(self, config: Config, mesh: ResultMesh) -> None:
        viscous = local.branch_cells(config, mesh)
        self._mesh = mesh
        self._parts = [
            _Part(
                material,
                mesh.cells[cells],
                local.Points.of(mesh.cell, mesh.corners[cells], mesh.cell.gauss),
                Average(mesh, cells),
                np.searchsorted(viscous, cells),
            )
            for material, cells in _by_material(config, mesh)
        ]

    def __call__(self, state: Array, internal: Array | None = None) -> dict[str, Array]:
        """All fields of a state.

        Args:
            state: Nodal (u_R, u_Z, phi), and p in the mixed form, shape (nodes, 3 or 4).
            internal: C_i of Maxwell branches at the Gauss points of `local.branch_cells`, (cells,
                points, branches, 4).

        Returns:
            u (mm) and phi (kV); E (kV/mm) and D (uC/mm^2) in the deformed body; cauchy_stress and
            second_pk_stress (of the solid, per mesh area for the latter) and maxwell_stress, MPa:
            all that the field adds, electrostriction included where the permittivity depends on
            stretch; J = det F; in the mixed form p (MPa, positive in tension). Vectors have
            components (R, Z, theta), tensors (3, 3).
        """
        n = len(self._mesh.points)
        out: dict[str, Array] = {
            "u": np.column_stack([state[:, :2], np.zeros(n)]),
            "phi": state[:, 2].copy(),
            "E": np.zeros((n, 3)),
            "D": np.zeros((n, 3)),
            "cauchy_stress": np.zeros((n, 3, 3)),
            "second_pk_stress": np.zeros((n, 3, 3)),
            "maxwell_stress": np.zeros((n, 3, 3)),
            "J": np.ones(n),
        }
        if state.shape[1] > 3:
            out["p"] = state[:, 3].copy()
        for part in self._parts:
            part.average.into(out, self._of(part, state[part.cells], internal))
        return out

    def _of(self, part: _Part, nodal: Array, internal: Array | None) -> dict[str, Array]:
        """Values at the nodes of each cell of one material."""
        material, k = part.material, part.points.kinematics(nodal[..., :2], nodal[..., 2])
        found = {"J": self._at_nodes(k.J)}
        if material.permittivity:
            e, eps = self._at_nodes(k.e), np.asarray(material.permittivity)
            if material.slope:
                eps = self._at_nodes(material.permittivity_at(k.F))
            found["E"], found["D"] = e, eps[..., None] * e
            found["maxwell_stress"] = local.maxwell(eps, e)
            if material.slope:
                stretch = material.area_stretch(k.F)
                stress = local.electrostriction(material.slope, stretch, k.F, k.e)
                found["maxwell_stress"] += self._at_nodes(stress)
        if material.law is not None:
            pressure = nodal[..., 3] @ part.points.N.T if nodal.shape[-1] > 3 else None
            S = local.second_pk(material.law, k.F, material.prestretch, pressure)
            if material.branches and internal is not None:
                mine = internal[part.viscous]
                S += local.branches_pk(material.branches, k.F, mine, material.prestretch)
            found["second_pk_stress"] = self._at_nodes(S)
            found["cauchy_stress"] = self._at_nodes(local.cauchy(k.F, S))
        return found

    def _at_nodes(self, values: Array) -> Array:
        flat = values.reshape(*values.shape[:2], -1)
        nodal = self._mesh.cell.from_gauss @ flat
        return np.asarray(nodal.reshape(*nodal.shape[:2], *values.shape[2:]))


@dataclass(frozen=True)
class _Part:
    """The cells of one material.

    Attributes:
        material: The material.
        cells: Their nodes.
        points: Their Gauss points.
        average: At their nodes.
        viscous: Their indices among the cells with Maxwell branches, if they have some.
    """

    material: local.RegionMaterial
    cells: Ints
    points: local.Points
    average: Average
    viscous: Ints


def _by_material(config: Config, mesh: ResultMesh) -> Iterator[tuple[local.RegionMaterial, Ints]]:
    """Materials and their cells; regions that share one, as the electrodes do, come together."""
    found: dict[int, tuple[local.RegionMaterial, list[Ints]]] = {}
    for name, material in local.region_materials(config).items():
        found.setdefault(id(material), (material, []))[1].append(mesh.in_region(name))
    for material, parts in found.values():
        cells = np.sort(np.concatenate(parts))
        if len(cells):
            yield material, cells
