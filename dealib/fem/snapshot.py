"""A converged state, with what is derived from it once for all measures."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.fem.differential import capacitances, port_stiffness
from dealib.fem.film import FilmPoints
from dealib.fem.newton import Newton
from dealib.fem.viscous import Viscosity
from dealib.results import local
from dealib.results.electrodes import Rings
from dealib.results.margins import principal_stretch


@dataclass(frozen=True)
class Peak:
    """The largest value of a quantity of the film, and where.

    Attributes:
        value: The value.
        R: Radius in the mesh, mm.
        Z: Height in the mesh, mm.
    """

    value: float
    R: float
    Z: float


@dataclass
class Snapshot:
    """A converged state, for the functions below.

    Attributes:
        newton: The solver.
        points: The film's Gauss points.
        viscosity: State of the Maxwell branches, if there are some.
        peaks: Where the margins are smallest, as far as they have been measured.
    """

    newton: Newton
    points: FilmPoints
    viscosity: Viscosity | None = None
    peaks: dict[str, Peak] = field(default_factory=dict)

    @cached_property
    def ports(self) -> dict[str, float]:
        """Values of the ports: mount displacement in mm, terminal voltage in kV."""
        system = self.newton.system
        return system.map.port_values(system.q)

    def dual(self, port: str) -> float:
        """Force on the mount (N), charge on the terminal (uC)."""
        sign = {"mount": 1.0, "terminal": -1.0}[port]
        return sign * self.newton.system.internal[port] + 0.0

    @cached_property
    def nodal(self) -> Any:
        """Nodal values of the film's cells on this rank."""
        return self.points.nodal()

    @cached_property
    def film(self) -> local.Kinematics:
        """Deformation and field of the film at the Gauss points of this rank's cells."""
        return self.points.points.kinematics(self.nodal[..., :2], self.nodal[..., 2])

    @cached_property
    def film_total(self) -> Any:
        """Deformation gradient of the film since its unstretched state."""
        return self.film.F * self.newton.system.problem.prestretch.value

    @cached_property
    def tensions(self) -> Any:
        """In-plane true stresses of the film, averaged through its thickness, (columns, 2)."""
        mixed = self.nodal.shape[-1] > 3
        pressure = self.nodal[..., 3] @ self.points.points.N.T if mixed else None
        viscosity, cells = self.viscosity, self.points.cells
        internal = None if viscosity is None else viscosity.of_cells("film", cells)
        return self.points.tensions(self.film, pressure, internal)

    @cached_property
    def principal_stretch(self) -> Any:
        """Largest principal stretch at the points."""
        return principal_stretch(self.film_total)

    @property
    def comm(self) -> Any:
        """MPI communicator."""
        return self.newton.system.map.comm

    @property
    def limits(self) -> Any:
        """The config's limits."""
        return self.newton.system.problem.config.limits

    @property
    def sensing(self) -> Any:
        """The config's section."""
        return self.newton.system.problem.config.sensing

    @cached_property
    def capacitance(self) -> float:
        """Q/V, nF; at 0 V by a unit test voltage with the body frozen."""
        volts = self.ports["terminal"]
        small = 1e-6 * self.newton.system.problem.config.geometry.film_thickness  # 1e-6 kV/mm
        return self.dual("terminal") / volts if abs(volts) > small else self.newton.capacitance()

    @cached_property
    def port_stiffness(self) -> Any:
        """See `differential.port_stiffness`."""
        return port_stiffness(self.newton)

    @property
    def capacitances(self) -> tuple[float, float]:
        """dQ/dV with the mount as it is driven, and at constant displacement, nF."""
        mount = self.newton.system.ports["mount"]
        return capacitances(self.port_stiffness, mount, self.ports["mount"])

    @cached_property
    def rings(self) -> Rings:
        """The film in rings, with the device's capacitance shared out by area over thickness."""
        return self.points.rings(self.film, self.capacitance)

    @property
    def resistances(self) -> Any:
        """Of the rings of one electrode, Gohm."""
        return self.rings.resistances(self.sensing.sheet_resistance, self.sensing.area_exponent)

    def largest(self, values: Any) -> float:
        """Maximum over all ranks."""
        mine = float(values.max()) if values.size else -np.inf
        return float(self.comm.allreduce(mine, op=MPI.MAX))

    def peak(self, name: str, values: Any) -> float:
        """Maximum over all ranks of values at the film's points, and remember where."""
        mine = (-np.inf, 0.0, 0.0)
        if values.size:
            k = int(values.argmax())
            R, Z = self.points.points.position.reshape(-1, 2)[k]
            mine = (float(values.ravel()[k]), float(R), float(Z))
        self.peaks[name] = Peak(*max(self.comm.allgather(mine)))
        return self.peaks[name].value
