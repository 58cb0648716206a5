"""The measured quantities of a converged state: one small function each.

To add a column to the history, add a function here; its name is the column.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from dealib.fem.layout import Layout
from dealib.fem.newton import Newton
from dealib.fem.viscous import Viscosity
from dealib.geometry import names
from dealib.results import local
from dealib.results.elements import inverse


@dataclass
class Snapshot:
    """A converged state, for the functions below."""

    newton: Newton
    layout: Layout
    viscosity: Viscosity | None = None

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
    def film(self) -> local.Kinematics:
        """Deformation and field of the film at the Gauss points of this rank's cells."""
        device = self.newton.system.problem.device
        cells = device.owned(device.cells(names.FILM))
        nodal = self.layout.local()[cells]
        cell, corners = self.layout.cell, self.layout.corners[cells]
        return local.kinematics(cell, corners, cell.gauss, nodal[..., :2], nodal[..., 2])

    @cached_property
    def film_total(self) -> Any:
        """Deformation gradient of the film since its unstretched state."""
        return self.film.F @ np.diag(self.newton.system.problem.prestretch.value)

    def largest(self, values: Any) -> float:
        """Maximum over all ranks."""
        mine = float(values.max()) if values.size else -np.inf
        return float(self.newton.system.map.comm.allreduce(mine, op=MPI.MAX))


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
    volts = s.ports["terminal"]
    small = 1e-6 * s.newton.system.problem.config.geometry.film_thickness  # 1e-6 kV/mm
    nano = s.dual("terminal") / volts if abs(volts) > small else s.newton.capacitance()
    return 1e3 * nano


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


def newton_iterations(s: Snapshot) -> int:
    """Iterations of this step."""
    return s.newton.iterations


def stretch_max(s: Snapshot) -> float:
    """Largest principal stretch of the film since its unstretched state."""
    F = s.film_total
    C = np.swapaxes(F, -1, -2) @ F
    return float(np.sqrt(s.largest(np.linalg.eigvalsh(C)[..., -1])))


def dissipated_energy_mJ(s: Snapshot) -> float:
    """Energy dissipated in Maxwell branches so far."""
    return 0.0 if s.viscosity is None else s.viscosity.dissipated


def dissipated_power_mW(s: Snapshot) -> float:
    """Rate of the energy above."""
    return 0.0 if s.viscosity is None else s.viscosity.power


QUANTITIES: dict[str, Callable[[Snapshot], float]] = {
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
    )
}


# with Maxwell branches
VISCOUS = {f.__name__: f for f in (dissipated_energy_mJ, dissipated_power_mW)}


def film_stretches(newton: Newton, layout: Layout) -> Any:
    """In-plane principal stretches of the film since its unstretched state (collective).

    Returns:
        Shape (points, 2): the larger stretch in the R-Z plane and the hoop stretch, of all ranks.
    """
    F = Snapshot(newton, layout).film_total
    C = np.swapaxes(F, -1, -2) @ F
    C = C.reshape(-1, 3, 3)
    middle, half = (C[:, 0, 0] + C[:, 1, 1]) / 2, (C[:, 0, 0] - C[:, 1, 1]) / 2
    meridional = middle + np.hypot(half, C[:, 0, 1])
    mine = np.sqrt(np.column_stack([meridional, C[:, 2, 2]]))
    return np.concatenate(newton.system.map.comm.allgather(mine))


def measure(newton: Newton, layout: Layout, viscosity: Viscosity | None = None) -> dict[str, float]:
    """All quantities of the current state, on every rank (collective)."""
    snapshot = Snapshot(newton, layout, viscosity)
    wanted = QUANTITIES if viscosity is None else QUANTITIES | VISCOUS
    return {name: function(snapshot) for name, function in wanted.items()}
