"""A stored step, sampled finely for drawing: second-order cells are cut into small triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.tri import Triangulation

from dealib.errors import ConfigError
from dealib.geometry import names
from dealib.results.elements import Array, Cell, face
from dealib.results.mesh import ResultMesh
from dealib.results.reader import Run
from dealib.results.summary import stored_note, under_voltage

Ints = npt.NDArray[np.int64]
STRIPS = (names.BOTTOM_ELECTRODE, names.FILM, names.TOP_ELECTRODE)
BLOCKS = (names.MOUNT_BLOCK, names.FRAME_BLOCK)


def index_of(run: Run, step: int) -> int:
    """Position among the stored steps of a step of the history (-1 is the last stored one).

    Raises:
        ConfigError: If its fields are not stored.
    """
    _check_stored(run)
    stored = run.stored_steps
    if -len(stored) <= step < 0:
        return step % len(stored)
    if step in stored:
        return stored.index(step)
    raise ConfigError(
        f"{run.directory}: the fields of step {step} are not stored; "
        f"stored: {stored[0]} .. {stored[-1]}, {len(stored)} steps"
    )


def typical_step(run: Run) -> int:
    """The stored step of the largest voltage, else of the largest displacement."""
    _check_stored(run)
    stored = run.history["step"].isin(run.stored_steps)
    under = stored & under_voltage(run.history)
    column, chosen = ("voltage_kV", under) if under.any() else ("displacement_mm", stored)
    rows = run.history[chosen]
    return int(rows["step"].iloc[int(rows[column].abs().argmax())])


def _check_stored(run: Run) -> None:
    if not run.stored_steps:
        raise ConfigError(
            f"{run.directory}: no fields are stored (output.fields is 'none', or no step converged)"
        )


def reference_grid(cell: Cell, n: int) -> tuple[Array, Ints]:
    """Points and triangles that cut a reference cell into n parts a side."""
    j, i = np.divmod(np.arange((n + 1) ** 2), n + 1)
    a = np.array([k for k in range((n + 1) * n) if k % (n + 1) < n])
    b, c, d = a + 1, a + n + 2, a + n + 1  # the small squares' other corners
    triangles = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    points = np.stack([i, j], axis=1) / n
    if cell.corners == 3:  # keep what lies in the lower left half, cut along the other diagonal
        triangles = np.vstack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)])
        triangles = triangles[((i + j)[triangles] <= n).all(axis=1)]
        used = np.flatnonzero(i + j <= n)
        points, triangles = points[used], np.searchsorted(used, triangles)
    return points, triangles


def locate(mesh: ResultMesh, cells: Ints, points: Array) -> tuple[Ints, Array]:
    """Cells (of one region) that hold points of the mesh configuration.

    Returns:
        Cell of each point and its reference coordinates, (points, 2).
    """
    nodes, triangles = reference_grid(mesh.cell, mesh.cell.order)
    own = np.abs(nodes[:, None] - mesh.cell.nodes).sum(axis=2).argmin(axis=1)
    stretch = np.array([1.0, np.sqrt(len(cells))])  # flat cells upset the search for triangles
    corners = mesh.cells[cells][:, own][:, triangles].reshape(-1, 3)
    used, corners = np.unique(corners, return_inverse=True)
    x, y = (mesh.points[used] * stretch).T
    grid = Triangulation(x, y, corners.reshape(-1, 3))
    finder: Any = grid.get_trifinder()
    found = cells[finder(*(points * stretch).T) // len(triangles)]
    linear = Cell(mesh.cell.name, 1)
    at = np.full((len(points), 2), 1 / mesh.cell.corners**0.5)
    for _ in range(8):  # Newton on the (bi)linear map; exact at once for rectangles
        N, dN = linear.shape(at)
        reached = np.einsum("pn,pni->pi", N, mesh.corners[found])
        slope = np.einsum("pnj,pni->pij", dN, mesh.corners[found])
        at = at + np.linalg.solve(slope, (points - reached)[..., None])[..., 0]
    return found, at


@dataclass(frozen=True)
class Sampler:
    """Cuts the cells of some regions into triangles.

    Attributes:
        mesh: The mesh of the results.
        cells: Its cells that are sampled.
        n: Parts a side.
    """

    mesh: ResultMesh
    cells: Ints
    n: int = 4

    @classmethod
    def of(cls, mesh: ResultMesh, regions: tuple[str, ...] = STRIPS, n: int = 4) -> Sampler:
        """A sampler of named regions; those that the mesh lacks are empty."""
        found = [mesh.in_region(r) for r in regions if r in mesh.names]
        return cls(mesh, np.concatenate(found), n if mesh.cell.order == 2 else 1)

    @cached_property
    def _grid(self) -> tuple[Array, Ints]:
        return reference_grid(self.mesh.cell, self.n)

    @cached_property
    def triangles(self) -> Ints:
        """Corners of the triangles among the sampled points."""
        points, triangles = self._grid
        start = len(points) * np.arange(len(self.cells))[:, None, None]
        return np.asarray((start + triangles).reshape(-1, 3))

    @cached_property
    def outline(self) -> Ints:
        """Pairs of sampled points along the rim of all regions together, (edges, 2)."""
        places = np.round(self.points / np.ptp(self.points, axis=0).min(), 9)
        _, place = np.unique(places, axis=0, return_inverse=True)
        edges = self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        _, first, count = np.unique(
            np.sort(place.ravel()[edges], axis=1), axis=0, return_index=True, return_counts=True
        )
        return np.asarray(edges[first[count == 1]])  # inner edges belong to two triangles

    def __call__(self, nodal: Array) -> Array:
        """Nodal values at the sampled points, through the cells' own shape functions."""
        N, _ = self.mesh.cell.shape(self._grid[0])
        found = np.einsum("pn,cn...->cp...", N, nodal[self.mesh.cells[self.cells]])
        return np.asarray(found.reshape(-1, *nodal.shape[1:]))

    @cached_property
    def points(self) -> Array:
        """Sampled points in the mesh configuration, (R, Z) in mm."""
        return self(self.mesh.points)


class Shape:
    """The strips of a run at a stored step.

    Args:
        run: The run.
        step: Step of the history; negative ones count back from the last stored one.
        n: Parts into which the cells are cut, a side.
    """

    def __init__(self, run: Run, step: int = -1, n: int = 4) -> None:
        self.run = run
        self.index = index_of(run, step)
        self.step = run.stored_steps[self.index]
        self.row: Any = run.history.set_index("step").loc[self.step]
        self.mesh = run.mesh
        self.strips = Sampler.of(self.mesh, n=n)
        self.geometry = run.config.geometry

    @cached_property
    def state(self) -> Array:
        """Nodal (u_R, u_Z, phi)."""
        return self.run.state(self.index)

    @cached_property
    def arrays(self) -> dict[str, Array]:
        """All nodal fields."""
        return self.run.arrays(self.index)

    @property
    def when(self) -> str:
        """Step, time and inputs, for titles."""
        r = self.row
        told = stored_note(self.run)
        return (
            f"step {self.step}, t = {r['time_s']:.4g} s: u = {_zero(r['displacement_mm'])} mm, "
            f"F = {_zero(r['force_N'])} N, V = {_zero(r['voltage_kV'])} kV"
            + (f" ({told})" if told else "")
        )

    def moved(self, magnification: float = 1.0) -> Array:
        """Sampled points of the deformed strips, their thickness magnified about the middle."""
        x = self.strips.points + self.strips(self.state[:, :2])
        if magnification == 1:
            return x
        R, middle = self.middle
        here = self.strips.points[:, 0]
        centre = np.stack([np.interp(here, R, middle[:, k]) for k in (0, 1)], axis=1)
        return np.asarray(centre + magnification * (x - centre))

    @cached_property
    def middle(self) -> tuple[Array, Array]:
        """Radii and deformed positions of the film's middle line."""
        R = self.face(names.FILM_TOP)[1]
        line = np.stack([R, np.zeros_like(R)], axis=1)
        return R, line + self.along_middle(self.state[:, :2])

    def face(self, name: str) -> tuple[Ints, Array]:
        """The film's own nodes on one of its faces, outwards, and their radii."""
        cells, cell = self.mesh.in_region(names.FILM), self.mesh.cell
        on, n = face(self.mesh.corners[cells], 1 if name == names.FILM_TOP else -1), cell.corners
        own = self.mesh.cells[cells]
        found = [own[:, :n], np.roll(own[:, :n], -1, axis=1)]
        found += [own[:, n : 2 * n]] if cell.order == 2 else []
        nodes = np.unique([part[on] for part in found])
        nodes = nodes[np.argsort(self.mesh.points[nodes, 0])]
        return nodes, self.mesh.points[nodes, 0]

    def along_middle(self, nodal: Array) -> Array:
        """Nodal values of the film on its middle line, at the radii of its top face."""
        cells, reference = self._middle_cells
        N, _ = self.mesh.cell.shape(reference)
        return np.asarray(np.einsum("pn,pn...->p...", N, nodal[self.mesh.cells[cells]]))

    @cached_property
    def _middle_cells(self) -> tuple[Ints, Array]:
        """Film cells that hold the points of the middle line, and where in the cells."""
        _, R = self.face(names.FILM_TOP)
        points = np.stack([np.clip(R, R[0] + 1e-9, R[-1] - 1e-9), np.zeros_like(R)], axis=1)
        return locate(self.mesh, self.mesh.in_region(names.FILM), points)


def _zero(value: float) -> str:
    """Four digits, no 1e-17, a minus sign that is one."""
    return f"{0.0 if abs(value) < 1e-9 else value:.4g}".replace("-", "−")
