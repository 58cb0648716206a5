"""The measured quantities of a converged state: one small function each.

To add a column to the history, add a function here; its name is the column.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dealib.fem.snapshot import Peak, Snapshot
from dealib.results.local import determinant
from dealib.results.margins import meridional_stretch


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
    """Smallest ratio of the film's thickness to the unstretched one: 1 / |F^-T e_Z|."""
    F = s.film_total
    meridian, hoop = np.hypot(F[..., 0, 0], F[..., 1, 0]), F[..., 2, 2]
    return 1 / s.largest(meridian * hoop / determinant(F))


def tension_min_MPa(s: Snapshot) -> float:
    """Smallest in-plane principal true stress of the film, averaged through its thickness."""
    return float(s.tensions.min())


def breakdown_use(s: Snapshot) -> float | None:
    """Largest true field over the strength that the electrodes leave."""
    strength = s.limits.breakdown
    if strength is None:
        return None
    return s.peak("breakdown_use", np.linalg.norm(s.film.e, axis=-1) / strength)


def wrinkling_use(s: Snapshot) -> float:
    """Share of the mounted tension that is lost (see `Film.wrinkling`)."""
    used = s.points.film.wrinkling(s.tensions)
    k = int(used.argmax())
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
