"""A stored step, sampled for drawing."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints
from dealib.errors import ConfigError
from dealib.results.local import region_materials
from dealib.results.mesh import ResultMesh
from dealib.results.quantities import FieldQuantity
from dealib.results.reader import Run
from dealib.results.sampling import LayerStrip, Sampler
from dealib.results.section import RunSection
from dealib.results.summary import (
    drive,
    moment,
    motion,
    stored_note,
    under_voltage,
    values_told,
    voltages,
)

_MODE = 0.08  # largest displacement of a drawn mode, as a share of the length


def index_of(run: Run, step: int) -> int:
    """Position of a step of the history among the stored steps (-1 is the last stored one).

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
    """The stored step with the largest voltage; without voltages that with the largest motion."""
    _check_stored(run)
    h = run.history
    stored = h["step"].isin(run.stored_steps)
    under = stored & under_voltage(h)
    size = voltages(h) if under.any() else h[[*motion(run), drive(run)][0]].abs()
    chosen = under if under.any() else stored
    return int(h["step"][chosen].iloc[int(size[chosen].argmax())])


def step_of(run: Run, what: FieldQuantity) -> int:
    """The stored step at which a quantity is drawn: for modes the first one that has modes."""
    if what.is_mode:
        for index, step in enumerate(run.stored_steps):
            if run.modes(index) is not None:
                return step
    return typical_step(run)


def _check_stored(run: Run) -> None:
    if not run.stored_steps:
        raise ConfigError(
            f"{run.directory}: no fields are stored (output.fields is 'none', or no step converged)"
        )


class LayerShape:
    """The layers of a run at a stored step: its regions that carry stress, from the lowest up.

    In a plane they are sampled between their nodes; in three dimensions the points are the nodes.

    Args:
        run: The run.
        step: Step of the history; negative numbers count back from the last stored one.
        n: Parts per side into which cells are divided.
        mode: Name of a mode, such as 'mode', that is added to the displacement.
    """

    def __init__(self, run: Run, step: int = -1, n: int = 4, mode: str = "") -> None:
        self.run, self._n, self._mode = run, n, mode
        self.index = index_of(run, step)
        self.step = run.stored_steps[self.index]
        self.row: Any = run.history.set_index("step", drop=False).loc[self.step]
        self.section = RunSection(run)
        self.mesh, self.laminate = self.section.mesh, self.section.laminate
        self.kinematics = run.config.device.kinematics
        self.solid = self.kinematics.dim == 3
        self.layers = layers(run, self.section.across)

    @cached_property
    def strips(self) -> Sampler:
        """Samples the layers in a plane."""
        return Sampler.of(self.mesh, self.layers, n=self._n)

    @cached_property
    def arrays(self) -> dict[str, Array]:
        """All nodal fields."""
        return self.section.arrays(self.index)

    @property
    def displacement(self) -> Array:
        """Nodal displacement by axis, (nodes, axes), mm, including the mode if one is drawn."""
        u = self.arrays["u"]
        if self._mode in self.arrays:
            u = u + _MODE * self.length * self.arrays[self._mode]
        return u[:, : self.kinematics.dim]

    @property
    def points(self) -> Array:
        """Points of the mesh that are drawn, (points, axes), mm."""
        return self.mesh.points if self.solid else self.strips.points

    @cached_property
    def region(self) -> Ints:
        """Region of each point."""
        if not self.solid:
            return self.strips.of_points(self.mesh.region[self.strips.cells])
        found = np.empty(len(self.mesh.points), dtype=np.int64)
        found[self.mesh.cells] = self.mesh.region[:, None]
        return found

    @property
    def symmetry(self) -> list[int]:
        """Numbers of the axes normal to the symmetry planes of a device in space."""
        laminate = self.run.config.device.laminate
        return ["XYZ".index(axis) for axis in laminate.symmetry] if self.solid and laminate else []

    @property
    def mirrors(self) -> list[Array]:
        """Matrices (3, 3) that map the solved part of a device in space to all its parts."""
        found = [np.eye(3)]
        for k in self.symmetry:
            mirror = np.eye(3)
            mirror[k, k] = -1
            found += [mirror @ one for one in found]
        return found

    @property
    def when(self) -> str:
        """Stage, step, time and inputs, for titles."""
        told = stored_note(self.run)
        values = values_told(self.run, self.row)
        return f"{moment(self.run, self.row)}: {values}" + (f" ({told})" if told else "")

    @cached_property
    def size(self) -> Array:
        """Extent of the layers along each axis of the mesh, mm."""
        cells = self.mesh.in_region(*self.layers)
        return np.asarray(np.ptp(self.mesh.corners[cells].reshape(-1, self.kinematics.dim), axis=0))

    @property
    def thickness(self) -> float:
        """Thickness of all layers together in the mesh, mm."""
        return float(self.size[self.section.across])

    @property
    def length(self) -> float:
        """Length of the layers in the mesh, mm."""
        return float(max(np.delete(self.size, self.section.across)))

    def values(self, what: FieldQuantity) -> Array:
        """A quantity at the points, (points,); NaN in layers that do not have it."""
        nodal = what.of(self.arrays)
        ids = [self.mesh.names.index(name) for name in drawn(self.run, what)]
        there = np.isin(self.region, ids)
        return np.where(there, nodal if self.solid else self.strips(nodal), np.nan)

    def moved(self, magnification: float = 1.0) -> Array:
        """Points of the deformed layers, (points, axes), mm, with magnified thickness."""
        u = self.displacement
        x = self.points + (u if self.solid else self.strips(u))
        if magnification == 1:
            return x
        if self.solid:
            centre = _middles(self.points, x)
        else:
            along, middle = self.middle
            here = self.points[:, 1 - self.section.across]
            centre = np.stack([np.interp(here, along, middle[:, k]) for k in (0, 1)], axis=1)
        return np.asarray(centre + magnification * (x - centre))

    @cached_property
    def core(self) -> LayerStrip | None:
        """The middle one of the layers that reach from end to end, for a laminate in a plane."""
        if self.laminate is None:
            return None
        strips = [LayerStrip(self.mesh, name, self.section.across) for name in self.layers]
        whole = [strip for strip in strips if strip.length > 0.999 * self.length]
        return whole[len(whole) // 2] if whole else None

    @property
    def middle(self) -> tuple[Array, Array]:
        """The core's middle line: positions along the mesh, (n,), and deformed, (n, 2), mm."""
        assert self.core is not None
        s = self.core.positions
        line = self.core.at(self.mesh.points + self.displacement, s, 0.5)
        return self.core.start + s * self.core.length, line


def _middles(points: Array, x: Array) -> Array:
    """For each point the middle between the lowest and highest point at its X and Y, (n, 3)."""
    _, column = np.unique(np.round(points[:, :2], 6), axis=0, return_inverse=True)
    order = np.lexsort((points[:, 2], column.ravel()))
    starts = np.flatnonzero(np.diff(column.ravel()[order], prepend=-1))
    ends = np.append(starts[1:], len(order)) - 1
    return np.asarray(((x[order[starts]] + x[order[ends]]) / 2)[column.ravel()])


def layers(run: Run, across: int) -> tuple[str, ...]:
    """Regions that carry stress, from the lowest up along an axis."""
    mesh = run.mesh
    found = [n for n, m in region_materials(run.config).items() if m.law and _has_cells(mesh, n)]
    height = {n: mesh.corners[mesh.in_region(n)][..., across].mean() for n in found}
    return tuple(sorted(found, key=height.__getitem__))


def drawn(run: Run, what: FieldQuantity) -> list[str]:
    """Regions in which a quantity is drawn: conductors, for example, have no field."""
    return [
        name
        for name, material in region_materials(run.config).items()
        if _has_cells(run.mesh, name)
        and material.law
        and not ((what.is_electric or what.of_films) and material.permittivity == 0)
    ]


def _has_cells(mesh: ResultMesh, name: str) -> bool:
    return name in mesh.names and bool((mesh.region == mesh.names.index(name)).any())
