"""The measured quantities of a converged state: one small function each.

To add a column to the history, add a function here; its name is the column.
"""

from __future__ import annotations

from collections.abc import Callable
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
from dealib.results.elements import inverse
from dealib.results.margins import meridional_stretch, principal_stretch


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


def displacement_mm(s: Snapshot) -> float:
    """Axial displacement of the mount."""
    return s.ports["mount"]


def force_N(s: Snapshot) -> float:
    """Force on the mount, negative when it pushes down."""
    return s.dual("mount")


def voltage_kV(s: Snapshot) -> float:
    """Voltage of the top electrode against the bottom one."""
    return s.ports["terminal"]


def charge_uC(s: Snapshot) -> float:
    """Charge on the top electrode."""
    return s.dual("terminal")


def capacitance_pF(s: Snapshot) -> float:
    """Q/V; at 0 V by a unit test voltage with the body frozen."""
    return 1e3 * s.capacitance


def elastic_energy_mJ(s: Snapshot) -> float:
    """Elastic energy of film and electrodes and their branches, zero in the unstretched state."""
    branches = 0.0 if s.viscosity is None else s.viscosity.stored
    return s.newton.system.problem.integrate("elastic") + branches


def electric_energy_mJ(s: Snapshot) -> float:
    """Energy of the electric field, eps e.e / 2 over the deformed dielectrics."""
    return 0.0 - s.newton.system.problem.integrate("electric")


def field_max_MV_per_m(s: Snapshot) -> float:
    """Largest true field in the film, at its Gauss points."""
    return float(np.sqrt(s.largest(np.einsum("...i,...i", s.film.e, s.film.e))))


def thickness_stretch_min(s: Snapshot) -> float:
    """Smallest ratio of the film's thickness to the unstretched one: 1 / |F^-T n|."""
    rows = inverse(s.film_total)[..., 1, :]  # row Z of F^-1 is F^-T e_Z
    return float(1 / np.sqrt(s.largest(np.einsum("...i,...i", rows, rows))))


def tension_min_MPa(s: Snapshot) -> float:
    """Smallest in-plane principal true stress of the film, averaged through its thickness."""
    return float(np.nanmin(s.tensions))


def breakdown_use(s: Snapshot) -> float | None:
    """Largest true field over the strength that the electrodes leave."""
    strength = s.limits.breakdown
    if strength is None:
        return None
    return s.peak("breakdown_use", np.linalg.norm(s.film.e, axis=-1) / strength)


def wrinkling_use(s: Snapshot) -> float:
    """Share of the mounted tension that is lost (see `Film.wrinkling`)."""
    used = s.points.film.wrinkling(s.tensions)
    k = int(np.nanargmax(used))
    s.peaks["wrinkling_use"] = Peak(float(used[k]), float(s.points.columns.radii[k]), 0.0)
    return float(used[k])


def pull_in_use(s: Snapshot) -> float:
    """Field over the one at which the film itself loses stability (see `Film.pull_in`)."""
    return s.peak("pull_in_use", s.points.film.pull_in(s.film))


def stability_use(s: Snapshot) -> float | None:
    """Share of the law's stiffness that is lost (see `Film.softening`), of a law with a limit."""
    film = s.points.film
    return s.peak("stability_use", film.softening(s.film.F)) if film.softens else None


def stretch_use(s: Snapshot) -> float | None:
    """Largest principal stretch over the one allowed."""
    allowed = s.limits.stretch_max
    return None if allowed is None else s.peak("stretch_use", s.principal_stretch / allowed)


def locking_use(s: Snapshot) -> float | None:
    """Share of its extensibility that a law which locks has used (see `Law.extension`)."""
    film = s.points.film
    return s.peak("locking_use", film.extension(s.film.F)) if film.law.locks else None


def newton_iterations(s: Snapshot) -> int:
    """Iterations of this step."""
    return s.newton.iterations


def stretch_max(s: Snapshot) -> float:
    """Largest principal stretch of the film since its unstretched state."""
    return s.largest(s.principal_stretch)


def dissipated_energy_mJ(s: Snapshot) -> float:
    """Energy dissipated in Maxwell branches so far."""
    return 0.0 if s.viscosity is None else s.viscosity.dissipated


def dissipated_power_mW(s: Snapshot) -> float:
    """Rate of the energy above."""
    return 0.0 if s.viscosity is None else s.viscosity.power


def differential_capacitance_pF(s: Snapshot) -> float | None:
    """Small-signal dQ/dV, the mount driven as it is."""
    return 1e3 * s.capacitances[0] if s.sensing.differential else None


def blocked_capacitance_pF(s: Snapshot) -> float | None:
    """Small-signal dQ/dV at constant displacement."""
    return 1e3 * s.capacitances[1] if s.sensing.differential else None


def mount_stiffness_N_per_mm(s: Snapshot) -> float | None:
    """Small-signal dF/dU at constant voltage."""
    return float(s.port_stiffness[0, 0]) if s.sensing.differential else None


def electrode_resistance_kohm(s: Snapshot) -> float | None:
    """Resistance of one electrode from edge to edge (see `Rings`)."""
    return 1e6 * s.resistances.sum() if s.sensing.sheet_resistance is not None else None


def rc_time_us(s: Snapshot) -> float | None:
    """Slowest time constant at which the electrodes charge (see `Rings`)."""
    if s.sensing.sheet_resistance is None:
        return None
    return 1e6 * s.rings.time_constant(s.resistances, s.sensing.contact)


QUANTITIES: dict[str, Callable[[Snapshot], float | None]] = {
    f.__name__: f
    for f in (
        displacement_mm,
        force_N,
        voltage_kV,
        charge_uC,
        capacitance_pF,
        elastic_energy_mJ,
        electric_energy_mJ,
        field_max_MV_per_m,
        thickness_stretch_min,
        newton_iterations,
        stretch_max,
        tension_min_MPa,
        breakdown_use,
        wrinkling_use,
        pull_in_use,
        stability_use,
        stretch_use,
        locking_use,
        differential_capacitance_pF,
        blocked_capacitance_pF,
        mount_stiffness_N_per_mm,
        electrode_resistance_kohm,
        rc_time_us,
    )
}


# with Maxwell branches
VISCOUS = {f.__name__: f for f in (dissipated_energy_mJ, dissipated_power_mW)}


def film_stretches(s: Snapshot) -> Any:
    """In-plane principal stretches of the film since its unstretched state (collective).

    Returns:
        Shape (points, 2): the larger stretch in the R-Z plane and the hoop stretch, of all ranks.
    """
    F = s.film_total.reshape(-1, 3, 3)
    mine = np.column_stack([meridional_stretch(F), F[:, 2, 2]])
    return np.concatenate(s.comm.allgather(mine))


def measure(s: Snapshot) -> dict[str, float]:
    """All quantities of a state that the device has, on every rank (collective)."""
    wanted = QUANTITIES if s.viscosity is None else QUANTITIES | VISCOUS
    found = {name: function(s) for name, function in wanted.items()}
    return {name: value for name, value in found.items() if value is not None}
