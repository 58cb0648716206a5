"""All fields of a state for the eye: from nodal u and phi on a `ResultMesh`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dealib.config.schema import Config
from dealib.results import local
from dealib.results.elements import Array
from dealib.results.mesh import Ints, ResultMesh


def fields(
    config: Config, mesh: ResultMesh, state: Array, internal: Array | None = None
) -> dict[str, Array]:
    """Nodal fields, averaged within a region and never across its faces.

    They are extrapolated from the Gauss points, where derivatives are best: at the nodes
    themselves the pressure of nearly incompressible cells oscillates.

    Args:
        config: The config of the run.
        mesh: Mesh of the results.
        state: Nodal (u_R, u_Z, phi), and p in the mixed form, shape (nodes, 3 or 4).
        internal: C_i of Maxwell branches at the Gauss points of `local.branch_cells`, (cells,
            points, branches, 4).

    Returns:
        u (mm) and phi (kV); E (kV/mm) and D (uC/mm^2) in the deformed body; cauchy_stress and
        second_pk_stress (of the solid, per mesh area for the latter) and maxwell_stress, MPa: all
        that the field adds, electrostriction included where the permittivity depends on stretch;
        J = det F; in the mixed form p (MPa, positive in tension). Vectors have components
        (R, Z, theta), tensors (3, 3).
    """
    n = len(mesh.points)
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
    mixed = state.shape[1] > 3
    if mixed:
        out["p"] = state[:, 3].copy()

    viscous = local.branch_cells(config, mesh)

    def at_nodes(values: Array) -> Array:
        flat = values.reshape(*values.shape[:2], -1)
        nodal = mesh.cell.from_gauss @ flat
        return np.asarray(nodal.reshape(*nodal.shape[:2], *values.shape[2:]))

    for material, cells in _by_material(config, mesh):
        nodal = state[mesh.cells[cells]]
        k = local.kinematics(
            mesh.cell, mesh.corners[cells], mesh.cell.gauss, nodal[..., :2], nodal[..., 2]
        )
        found = {"J": at_nodes(k.J)}
        if material.permittivity:
            e, eps = at_nodes(k.e), np.asarray(material.permittivity)
            if material.slope:
                eps = at_nodes(material.permittivity_at(k.F))
            found["E"], found["D"] = e, eps[..., None] * e
            found["maxwell_stress"] = local.maxwell(eps, e)
            if material.slope:
                stress = local.electrostriction(
                    material.slope, material.area_stretch(k.F), k.F, k.e
                )
                found["maxwell_stress"] += at_nodes(stress)
        if material.law is not None:
            pressure = None
            if mixed:
                N, _ = mesh.cell.shape(mesh.cell.gauss)
                pressure = nodal[..., 3] @ N.T
            S = local.second_pk(material.law, k.F, material.prestretch, pressure)
            if material.branches and internal is not None:
                mine = internal[np.searchsorted(viscous, cells)]
                S += local.branches_pk(material.branches, k.F, mine, material.prestretch)
            found["second_pk_stress"] = at_nodes(S)
            found["cauchy_stress"] = at_nodes(local.cauchy(k.F, S))
        mesh.average(found, cells, out)
    return out


def _by_material(config: Config, mesh: ResultMesh) -> Iterator[tuple[local.RegionMaterial, Ints]]:
    """Materials and their cells; regions that share one, as the electrodes do, come together."""
    found: dict[int, tuple[local.RegionMaterial, list[Ints]]] = {}
    for name, material in local.region_materials(config).items():
        found.setdefault(id(material), (material, []))[1].append(mesh.in_region(name))
    for material, parts in found.values():
        cells = np.sort(np.concatenate(parts))
        if len(cells):
            yield material, cells
