"""A converged state, with derived values that several quantities share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.records import TERMINAL, Port
from dealib.fem.differential import capacitances, condensed, port_stiffness
from dealib.fem.films import FilmPoints
from dealib.fem.inertia import Inertia
from dealib.fem.modes import Eigenmodes
from dealib.fem.newton import Newton
from dealib.fem.probes import Probes
from dealib.fem.viscous import Viscosity
from dealib.results import stress
from dealib.results.electrodes import Rings
from dealib.results.margins import principal_stretch, smallest


@dataclass(frozen=True)
class Extremum:
    """The largest value of a quantity of the films, and its place.

    Attributes:
        value: The value.
        at: Position in the mesh, by axis, mm.
    """

    value: float
    at: tuple[float, ...]


class FilmState:
    """One film in a state.

    Attributes:
        film: Material and reference values.
        points: Its Gauss points.
        k: Deformation and field there.

    Args:
        points: Its Gauss points.
        viscosity: State of Maxwell branches, if there are some.
    """

    def __init__(self, points: FilmPoints, viscosity: Viscosity | None) -> None:
        self.points, self.film = points, points.film
        self._nodal = points.nodal()
        self._internal = None
        if viscosity is not None:
            self._internal = viscosity.of_cells(points.group.name, points.cells)
        self.k: stress.Deformation = points.points.deformation(self._nodal, self._internal)

    @cached_property
    def principal_stretch(self) -> Array:
        """Largest principal stretch at the points."""
        stretch = self.film.material.stretch
        return principal_stretch(self.k.C * np.outer(stretch, stretch))

    @cached_property
    def tensions(self) -> Array:
        """In-plane true stresses, averaged through the thickness of a layer (collective)."""
        return self.points.tensions(self.k, self._nodal, self._internal)

    @property
    def smallest_tension(self) -> Array:
        """Smaller principal value of the in-plane stresses."""
        return smallest(self.tensions)

    @property
    def thickness_stretch(self) -> Array:
        """See `Film.thickness_stretch`."""
        return self.film.thickness_stretch(self.k)

    @property
    def positions(self) -> Array:
        """Position of each value of `tensions` in the mesh, (..., axes), mm."""
        columns = self.points.columns
        if columns is None:
            return self.points.points.position
        at = np.zeros((len(columns.middles), 2))
        at[:, 1 - self.film.material.normal] = columns.middles
        return at


@dataclass
class Snapshot:
    """A converged state.

    Attributes:
        newton: The solver.
        films: The films' Gauss points.
        probes: The config's probes.
        viscosity: State of the Maxwell branches, if there are some.
        inertia: Velocities and accelerations, if a stage is dynamic.
        through: Volume that has flowed into chambers through each opening, mm^3.
        peaks: Largest value and place of each limit that has been measured.
    """

    newton: Newton
    films: tuple[FilmPoints, ...]
    probes: Probes
    viscosity: Viscosity | None = None
    inertia: Inertia | None = None
    through: Mapping[str, float] = field(default_factory=dict)
    peaks: dict[str, Extremum] = field(default_factory=dict)

    @property
    def config(self) -> Config:
        """The config."""
        return self.newton.system.problem.config

    @property
    def device(self) -> Device:
        """The device."""
        return self.newton.system.problem.device

    @property
    def comm(self) -> Any:
        """MPI communicator."""
        return self.newton.system.map.comm

    # --- ports -----------------------------------------------------------------------------------

    def primal(self, port: Port) -> float:
        """Value of a port: displacement (mm), voltage (kV), pressure (MPa)."""
        return self.newton.system.values[port.name]

    def dual(self, port: Port) -> float:
        """Its dual: force (N), charge (uC), displaced volume (mm^3)."""
        return port.kind.sign * self.newton.system.internal[port.name] + 0.0

    def energy(self, name: str) -> float:
        """Energy of the body, 'elastic', or of the field, 'electric', mJ."""
        found = self.newton.system.problem.integrate(name)
        if name == "electric":
            return 0.0 - found
        return found + (0.0 if self.viscosity is None else self.viscosity.stored)

    def capacitance(self, port: Port) -> float:
        """Q/V of the only terminal, nF.

        At 0 V, and for electrodes that charge in time, it is the small-signal capacitance with the
        body fixed and the electrodes fully charged.
        """
        volts = self.primal(port)
        small = 1e-6 * self.newton.system.problem.domain.sizes.thickness  # 1e-6 kV/mm
        if abs(volts) > small and self.newton.system.charging is None:
            return self.dual(port) / volts
        return self.capacitances[port.name, port.name]

    @cached_property
    def capacitances(self) -> dict[tuple[str, str], float]:
        """Charge on each terminal at unit voltage of another one, nF."""
        names = [port.name for port in self.device.of(TERMINAL)]
        found = capacitances(self.newton)
        return {(a, b): found[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}

    @cached_property
    def modes(self) -> Eigenmodes:
        """The softest modes, as many as `output.modes` asks for (collective)."""
        return self.newton.softest_modes(self.config.output.modes)

    @cached_property
    def stiffness(self) -> Array:
        """See `differential.port_stiffness`."""
        return port_stiffness(self.newton)

    def slope(self, port: Port, blocked: bool) -> float:
        """Derivative of a port's dual by its value, other ports blocked or driven as they are."""
        system = self.newton.system
        if blocked:
            k = list(system.ports).index(port.name)
            return port.kind.sign * float(self.stiffness[k, k])
        return port.kind.sign * condensed(self.stiffness, system.ports, system.values, port.name)

    # --- films -----------------------------------------------------------------------------------

    @cached_property
    def states(self) -> tuple[FilmState, ...]:
        """The films in this state."""
        return tuple(FilmState(points, self.viscosity) for points in self.films)

    def largest(self, values: Iterable[Any]) -> float:
        """Maximum over all values and ranks."""
        mine = max((float(v.max()) for v in values if v.size), default=-np.inf)
        return float(self.comm.allreduce(mine, op=MPI.MAX))

    def peak(self, name: str, of: Callable[[FilmState], Any]) -> float:
        """Maximum over all films and ranks of values at the points; `peaks` gets its place."""
        mine = (-np.inf, (0.0,) * self.device.kinematics.dim)
        for state in self.states:
            values = of(state)
            on_columns = values.ndim == 1
            where = state.positions if on_columns else state.points.points.position
            if values.size:
                k = int(values.argmax())
                at = tuple(map(float, where.reshape(-1, where.shape[-1])[k]))
                mine = max(mine, (float(values.ravel()[k]), at))
        self.peaks[name] = Extremum(*max(self.comm.allgather(mine)))
        return self.peaks[name].value

    def integral(self, of: Callable[[FilmState], Any]) -> float:
        """Integral over the films, as mounted, of values at their points (collective)."""
        mine = sum(float((of(state) * state.points.volumes).sum()) for state in self.states)
        return float(self.comm.allreduce(mine))

    def probe(self, name: str) -> float:
        """Value of a probe (collective)."""
        return self.probes.measure(name, self.viscosity)

    # --- electrodes ------------------------------------------------------------------------------

    @cached_property
    def rings(self) -> Rings:
        """The only film in rings, which share the capacitance by area and thickness."""
        (port,) = self.device.of(TERMINAL)
        return self.films[0].rings(self.states[0].k, self.capacitance(port))

    @property
    def resistances(self) -> Array:
        """Resistances of the rings of one electrode, Gohm."""
        sensing, base = self.config.sensing, self.device.laminate
        assert base is not None
        assert sensing.sheet_resistance is not None
        return self.rings.resistances(sensing.sheet_resistance, sensing.area_exponent, base.base)
