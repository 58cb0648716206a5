"""Stored states of a run for sampling; a sheet on a line gets the thickness of its layers."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from dealib.arrays import Array, Ints
from dealib.device.sheet_kinematics import SheetKinematics
from dealib.results.elements import Cell, determinant, gradients
from dealib.results.mesh import ResultMesh
from dealib.results.reader import Run
from dealib.results.sampling import LayerStrip


class RunSection:
    """The mesh and the fields of a run, to be sampled and drawn.

    For a membrane in a plane the mesh has quadrilaterals with the thickness of the layers.
    Otherwise mesh and fields are those of the run.

    Args:
        run: The run.
    """

    def __init__(self, run: Run) -> None:
        self.run, self.device = run, run.config.device
        self.mesh, self._sheet = run.mesh, run.mesh.cell.dim == 1
        if self._sheet:
            self.mesh, self._source, self._height = self._thick()
        plane = self.device.kinematics.dim == 2
        self.laminate = self.device.laminate if plane else None
        axes = self.device.kinematics.axes
        self.across = axes.index("Z" if self.laminate is None else self.laminate.base.across)

    def arrays(self, index: int) -> dict[str, Array]:
        """All nodal fields of the index-th stored step."""
        found = self.run.arrays(index)
        if not self._sheet:
            return found
        moved = self._lifted(found)
        found = {name: values[self._source] for name, values in found.items()}
        found["u"] = found["u"] + self._height[:, None] * moved[self._source]
        return found

    def layer(self, region: str) -> LayerStrip:
        """A region as a strip.

        Raises:
            ValueError: If there is no such region, or the device is no laminate in a plane.
        """
        if self.laminate is None:
            raise ValueError(
                f"fields along {region!r} are known for layers in a plane only; this device "
                + ("is a mesh of its own" if self.device.laminate is None else "is in space")
            )
        return LayerStrip(self.mesh, region, self.across)

    def _thick(self) -> tuple[ResultMesh, Ints, Array]:
        """Quadrilaterals on the line's cells; for each node its node on the line and height, mm."""
        laminate, mesh, k = self.device.laminate, self.run.mesh, self.device.kinematics
        assert laminate is not None
        assert isinstance(k, SheetKinematics)
        bottoms = accumulate(
            (x.thickness for x in laminate.layers), initial=-laminate.thickness / 2
        )
        height = np.zeros((len(mesh.points), 3))
        for layer, bottom in zip(laminate.layers, bottoms, strict=False):
            nodes = np.unique(mesh.cells[mesh.in_region(layer.name)])
            height[nodes] = bottom + layer.thickness * np.array([0, 0.5, 1])
        source = np.repeat(np.arange(len(mesh.points)), 3)
        points = mesh.points[source]
        points[:, k.normal] += height.ravel()
        a, b, *middle = 3 * mesh.cells.T
        cells = [a, b, b + 2, a + 2]
        for m in middle:
            cells += [m, b + 1, m + 2, a + 1, m + 1]
        cell = Cell("quadrilateral", mesh.cell.order)
        thick = ResultMesh(cell, points, np.stack(cells, axis=1), mesh.region, mesh.names)
        return thick, source, height.ravel()

    def _lifted(self, arrays: dict[str, Array]) -> Array:
        """Displacement of a point of unit height above each node, relative to it, (nodes, 3)."""
        mesh, k = self.run.mesh, self.device.kinematics
        assert isinstance(k, SheetKinematics)
        at, lies = mesh.cell.nodes, list(k.lies)
        N, dN = mesh.cell.shape(at)[0], gradients(mesh.cell, mesh.nodes[..., lies], at)[1]
        u = arrays["u"][mesh.cells][..., : k.dim]
        F = k.sheet_deformation(u, N, dN, mesh.nodes)
        lifted = F[..., k.normal] * (arrays["J"][mesh.cells] / determinant(F))[..., None]
        out = {"lifted": np.zeros((len(mesh.points), 3))}
        mesh.average({"lifted": lifted}, np.arange(len(mesh.cells)), out)
        return np.asarray(out["lifted"] - np.eye(3)[k.normal])
