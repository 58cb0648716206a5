"""Reduced viscosity and inertia of a device, which complete its tables to a model.

Maxwell branches are kept at a few weighted points. The weights are chosen such that the forces of
unit branches between any two states of the grid equal those of the whole device: an empirical
cubature (J. A. Hernandez, M. A. Caicedo, A. Ferrer, Comput. Methods Appl. Mech. Engrg. 313 (2017)
687). The strains at the points are those of the relaxed device at the same values of its ports.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array, Ints
from dealib.config.schema import Config
from dealib.errors import ConfigError, by_caller
from dealib.materials import evolution
from dealib.materials.branches import Branch
from dealib.results import local
from dealib.results.hermite import spline_slope
from dealib.results.mesh import ResultMesh
from dealib.results.reader import Run
from dealib.results.tables import DeviceTables

_CELLS, _PAIRS = 400, 300  # cells of a region, and pairs of states, that the cubature uses
_POINTS = 12  # largest number of points of a material
_MISSING = 1e-3  # tolerance of a force, as a share of its range


@dataclass(frozen=True)
class CubaturePoint:
    """A point of the cubature, at which branches are kept.

    Attributes:
        branches: Branches of its material.
        volume: Unstretched volume that it represents, mm^3.
        metric: Isochoric metric C at the nodes of the grid, packed, (*grid, 4 or 6).
    """

    branches: tuple[Branch, ...]
    volume: float
    metric: Array


@dataclass(frozen=True)
class _Part:
    """Gauss points of some cells of a region, which represent the whole region.

    Attributes:
        material: Name of the material.
        points: The points.
        nodes: Nodes of the cells.
        volume: Unstretched volumes, (points,), mm^3.
    """

    material: str
    points: local.CellPoints
    nodes: Ints
    volume: Array

    def see(self, state: Array) -> tuple[Array, Array]:
        """Isochoric metrics (points, size) and displacements (points, axes) in a state."""
        nodal, k = state[self.nodes], self.points.kinematics
        C = evolution.isochoric(self.points.deformation(nodal).F, k.packed)
        u = self.points.N @ nodal[..., : k.dim]
        return C.reshape(-1, k.packed), u.reshape(-1, k.dim)


def lumped(
    run: Run, tables: DeviceTables, config: Config
) -> tuple[list[CubaturePoint], list[float]]:
    """Points of the cubature, and the effective mass of the device along each axis.

    Args:
        run: The run of the relaxed device over the grid.
        tables: Its tables, with the rows of their nodes.
        config: The device with its branches.

    Returns:
        The points, and masses in kg for displacements and kg mm^2 / deg^2 for rotations.

    Raises:
        ConfigError: If the states of the run are not stored.
    """
    masses, points, grids = (
        [0.0] * len(tables.axes),
        list[CubaturePoint](),
        list(tables.axes.values()),
    )
    if not any(law.branches or law.density for law in config.solids.values()):
        return points, masses
    assert tables.rows is not None
    steps = run.history["step"].to_numpy()[tables.rows]
    if not np.isin(steps, run.stored_steps).all():
        again = by_caller("--overwrite", "overwrite=True")
        raise ConfigError(f"{run.directory}: its fields are not stored; solve it again by {again}")
    parts = list(_parts(run.config, run.mesh))
    seen = [[part.see(state) for part in parts] for state in run.states(steps.ravel())]
    metrics: dict[str, list[Array]] = {}
    for k, part in enumerate(parts):
        C, u = (
            np.reshape([x[k][i] for x in seen], (*steps.shape, len(part.volume), -1))
            for i in (0, 1)
        )
        metrics.setdefault(part.material, []).append(C)
        density = config.materials[part.material].density or 0.0
        for axis, grid in enumerate(grids):
            square = (np.gradient(u, grid, axis=axis) ** 2).sum(axis=-1) @ part.volume
            masses[axis] += 1e3 * density * float(square.mean())  # from t to kg
    for name, law in config.solids.items():
        if law.branches:
            C = np.concatenate(metrics[name], axis=-2)
            volume = np.concatenate([part.volume for part in parts if part.material == name])
            modulus = sum(branch.shear_modulus for branch in law.branches)
            chosen = _cubature(tables, C, modulus * volume)
            points += [
                CubaturePoint(law.branches, w / modulus, C[..., p, :]) for p, w in chosen.items()
            ]
    return points, masses


def _parts(config: Config, mesh: ResultMesh) -> Iterator[_Part]:
    k, cell = config.device.kinematics, mesh.cell
    materials = local.region_materials(config)
    for region in config.device.solids:
        cells, material = mesh.in_region(region.name), materials[region.name]
        every = max(1, -(-len(cells) // _CELLS))
        nodes, some = mesh.points[mesh.cells[cells]], slice(None, None, every)
        volume = local.volumes(k, cell, nodes, cell.gauss, cell.gauss_weight)
        scale = volume.sum() / volume[some].sum() * (material.thickness if k.sheet else 1.0)
        if material.prestretch is not None:
            scale /= material.prestretch.prod()
        points = local.CellPoints.of(k, material, cell, nodes[some], cell.gauss)
        name, mine = region.material or "", mesh.cells[cells][some]
        yield _Part(name, points, mine, scale * volume[some].ravel())


def _cubature(tables: DeviceTables, C: Array, stiff: Array) -> dict[int, float]:
    """Choose points one by one, with weights, until they exert the forces of all points.

    Args:
        tables: The tables, whose ranges of forces and charges scale the tolerance.
        C: Metrics, (*grid, points, size).
        stiff: Modulus times volume of the points, mJ.

    Returns:
        Weights by number of the point, mJ.
    """
    from scipy.optimize import nnls

    shape, n = C.shape[-2:], len(tables.axes)
    inner = evolution.inverted(C).reshape(-1, *shape)
    here, there = np.random.default_rng(0).integers(0, len(inner), (2, _PAIRS))
    rows = []
    for k, grid in enumerate(tables.axes.values()):
        slope = spline_slope(grid, C, k).reshape(-1, *shape)[here]
        # branches exert no force in the state in which they are relaxed
        force = evolution.contract(slope, inner[there]) - evolution.contract(slope, inner[here])
        rows.append(force / 2 / np.ptp(tables.derivatives[..., 2 ** (n - 1 - k)]))
    forces = np.concatenate(rows)
    whole, length = forces @ stiff, np.linalg.norm(forces, axis=0)
    length[length == 0] = np.inf
    chosen: list[int] = []
    weights, left = np.zeros(0), whole
    while len(chosen) < _POINTS and np.abs(left).max() > _MISSING:
        chosen.append(int((left @ forces / length).argmax()))
        weights, _ = nnls(forces[:, chosen], whole)
        left = whole - forces[:, chosen] @ weights
    return {p: float(w) for p, w in zip(chosen, weights, strict=True) if w > 0}
