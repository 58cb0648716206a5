"""A stored step, sampled finely for drawing."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from dealib.errors import ConfigError
from dealib.results.elements import Array
from dealib.results.local import region_materials
from dealib.results.mesh import ResultMesh
from dealib.results.quantities import Quantity
from dealib.results.reader import Run
from dealib.results.sampling import Sampler, Strip
from dealib.results.summary import moment, stored_note, under_voltage
from dealib.units import neat


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


class Shape:
    """The layers of a run at a stored step: its regions that carry stress, from the lowest up.

    Args:
        run: The run.
        step: Step of the history; negative ones count back from the last stored one.
        n: Parts into which the cells are cut, a side.
    """

    def __init__(self, run: Run, step: int = -1, n: int = 4) -> None:
        self.run = run
        self.index = index_of(run, step)
        self.step = run.stored_steps[self.index]
        self.row: Any = run.history.set_index("step", drop=False).loc[self.step]
        self.mesh = run.mesh
        self.layers = layers(run)
        self.strips = Sampler.of(self.mesh, self.layers, n=n)

    @cached_property
    def displacement(self) -> Array:
        """Nodal (u_R, u_Z), mm."""
        return self.run.state(self.index)[:, :2]

    @cached_property
    def arrays(self) -> dict[str, Array]:
        """All nodal fields."""
        return self.run.arrays(self.index)

    @property
    def when(self) -> str:
        """Stage, step, time and inputs, for titles."""
        r = self.row
        told = stored_note(self.run)
        u, F, V = (neat(r[c], 4) for c in ("displacement_mm", "force_N", "voltage_kV"))
        values = f"u = {u} mm, F = {F} N, V = {V} kV".replace("-", "−")
        return f"{moment(self.run, r)}: {values}" + (f" ({told})" if told else "")

    @property
    def thickness(self) -> float:
        """Of all layers together on the mesh, mm."""
        return float(np.ptp(self.strips.points[:, 1]))

    @property
    def length(self) -> float:
        """Of the layers on the mesh, mm."""
        return float(np.ptp(self.strips.points[:, 0]))

    def values(self, what: Quantity) -> Array:
        """A quantity at the sampled points; NaN in layers to which it does not belong."""
        sampled = self.strips(what.of(self.arrays))
        ids = [self.mesh.names.index(name) for name in drawn(self.run, what)]
        region = self.strips.of_points(self.mesh.region[self.strips.cells])
        return np.where(np.isin(region, ids), sampled, np.nan)

    def moved(self, magnification: float = 1.0) -> Array:
        """Sampled points of the deformed layers, their thickness magnified about the middle."""
        x = self.strips.points + self.strips(self.displacement)
        if magnification == 1:
            return x
        R, middle = self.middle
        here = self.strips.points[:, 0]
        centre = np.stack([np.interp(here, R, middle[:, k]) for k in (0, 1)], axis=1)
        return np.asarray(centre + magnification * (x - centre))

    @cached_property
    def faces(self) -> tuple[Array, Array, Array]:
        """Radii on the mesh, (points,); deformed lower and upper face there, (points, 2)."""
        now = self.mesh.points + self.displacement
        low, high = Strip(self.mesh, self.layers[0]), Strip(self.mesh, self.layers[-1])
        s = high.positions
        return high.start + s * high.length, low.at(now, s, 0.0), high.at(now, s, 1.0)

    @property
    def middle(self) -> tuple[Array, Array]:
        """Radii on the mesh and deformed positions of the layers' middle line."""
        R, low, high = self.faces
        return R, (low + high) / 2


def layers(run: Run) -> tuple[str, ...]:
    """Regions that carry stress, from the lowest up."""
    mesh = run.mesh
    found = [n for n, m in region_materials(run.config).items() if m.law and _has_cells(mesh, n)]
    height = {n: mesh.corners[mesh.in_region(n)][..., 1].mean() for n in found}
    return tuple(sorted(found, key=height.__getitem__))


def drawn(run: Run, what: Quantity) -> list[str]:
    """Layers in which a quantity says something: in conductors there is no field."""
    materials = region_materials(run.config)
    return [
        name
        for name in layers(run)
        if not ((what.is_electric or what.of_films) and materials[name].permittivity == 0)
    ]


def _has_cells(mesh: ResultMesh, name: str) -> bool:
    return name in mesh.names and bool((mesh.region == mesh.names.index(name)).any())
