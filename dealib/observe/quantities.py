"""The quantities of a converged state: each is one record, and one column of the history.

To add a column, add a `Quantity` here: its name, unit and label, the condition on the config, and a
function of the state. Add its meaning to `dealib.observe.reference`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from dealib.device.records import CHAMBER, KINDS, MOUNT, TERMINAL, TURN, Port, PortKind
from dealib.observe import needs
from dealib.observe.needs import ALWAYS, Need

Snapshot: TypeAlias = Any  # `fem.snapshot.Snapshot`, which this module must not import


@dataclass(frozen=True)
class Quantity:
    """One column of the history.

    Attributes:
        name: Name of the column, which ends in the unit; a port's suffix follows.
        unit: Unit; empty for plain numbers.
        label: Name in pictures and tables.
        measure: Value from a snapshot and, if `kind` is given, a port; None if the load program
            itself records it.
        needs: Condition on the config.
        kind: Kind of the ports that each have a column of their own.
        pairs: Whether each pair of ports has a column, where there are several.
        extreme: Whether it is an extreme over the device, which moves from place to place.
    """

    name: str
    unit: str
    label: str
    measure: Callable[..., float] | None = None
    needs: Need = ALWAYS
    kind: PortKind | None = None
    pairs: bool = False
    extreme: bool = False


# --- measures ------------------------------------------------------------------------------------


def _primal(s: Snapshot, port: Port) -> float:
    return float(s.primal(port) * port.kind.primal.factor)


def _dual(s: Snapshot, port: Port) -> float:
    return float(s.dual(port) * port.kind.dual.factor)


def _capacitance(s: Snapshot, port: Port, other: Port | None = None) -> float:
    found = s.capacitance(port) if other is None else s.capacitances[port.name, other.name]
    return 1e3 * float(found)


def _field(s: Snapshot) -> float:
    return float(np.sqrt(s.largest(np.einsum("...i,...i", f.k.e, f.k.e) for f in s.states)))


def _thickness(s: Snapshot) -> float:
    return -float(s.largest(-f.thickness_stretch for f in s.states))


def _tension(s: Snapshot) -> float:
    return -float(s.largest(-f.smallest_tension for f in s.states))


def _breakdown(s: Snapshot) -> float:
    strength = s.config.limits.breakdown
    return float(s.peak("breakdown_use", lambda f: np.linalg.norm(f.k.e, axis=-1) / strength))


def _failure(s: Snapshot) -> float:
    """1 - exp(-integral of (E / E0)^m dV / V0) over the mounted volume, by the weakest link.

    W. Weibull, J. Appl. Mech. 18 (1951) 293.
    """
    w = s.config.limits.weibull
    of = s.integral(lambda f: (np.linalg.norm(f.k.e, axis=-1) / w.strength) ** w.shape)
    return float(-np.expm1(-of / w.volume))


def _stretch(s: Snapshot) -> float:
    allowed = s.config.limits.stretch_max
    return float(s.peak("stretch_use", lambda f: f.principal_stretch / allowed))


def _softening(s: Snapshot) -> float:
    return float(s.peak("stability_use", lambda f: f.film.softening(f.k.F)))


def _locking(s: Snapshot) -> float:
    return float(s.peak("locking_use", lambda f: f.film.extension(f.k.F)))


def _resistance(s: Snapshot) -> float:
    return float(1e6 * s.resistances.sum())


def _time_constant(s: Snapshot) -> float:
    contact = s.config.sensing.contact
    at_start = contact is not None and contact == s.device.laminate.base.ends[0]
    return float(1e6 * s.rings.time_constant(s.resistances, at_start))


def _dissipated(s: Snapshot) -> float:
    return 0.0 if s.viscosity is None else float(s.viscosity.dissipated)


def _power(s: Snapshot) -> float:
    return 0.0 if s.viscosity is None else float(s.viscosity.power)


def _velocity(s: Snapshot, port: Port) -> float:
    return float(s.inertia.velocity(port.name) * port.kind.primal.factor)


def _softest(s: Snapshot) -> float:
    return float(s.modes.values[0])


def _of_ports() -> Iterator[Quantity]:
    for kind in KINDS.values():
        for variable, measure in zip(kind.variables, (_primal, _dual), strict=True):
            yield Quantity(variable.column, variable.unit, variable.name, measure, kind=kind)
        if kind is TERMINAL:
            yield Quantity(
                "capacitance_pF", "pF", "capacitance", _capacitance, kind=kind, pairs=True
            )


Q = Quantity
QUANTITIES: tuple[Quantity, ...] = (
    Q("step", "", "step"),
    Q("time_s", "s", "time"),
    *_of_ports(),
    Q("elastic_energy_mJ", "mJ", "elastic energy", lambda s: s.energy("elastic")),
    Q("electric_energy_mJ", "mJ", "electric energy", lambda s: s.energy("electric")),
    Q("field_max_MV_per_m", "MV/m", "largest field", _field, extreme=True),
    Q("thickness_stretch_min", "", "smallest thickness stretch", _thickness, extreme=True),
    Q("newton_iterations", "", "Newton iterations", lambda s: s.newton.iterations),
    Q(
        *("stretch_max", "", "largest stretch"),
        lambda s: s.largest(f.principal_stretch for f in s.states),
        extreme=True,
    ),
    Q("tension_min_MPa", "MPa", "smallest tension", _tension, extreme=True),
    Q("breakdown_use", "", "breakdown", _breakdown, needs.STRENGTH, extreme=True),
    Q("failure_probability", "", "probability of breakdown", _failure, needs.WEIBULL),
    Q(
        *("wrinkling_use", "", "wrinkling"),
        lambda s: s.peak("wrinkling_use", lambda f: f.film.wrinkling(f.tensions)),
        needs.TAUT,
        extreme=True,
    ),
    Q(
        *("pull_in_use", "", "pull-in"),
        lambda s: s.peak("pull_in_use", lambda f: f.film.pull_in(f.k)),
        extreme=True,
    ),
    Q("stability_use", "", "material stability", _softening, needs.SOFTENING, extreme=True),
    Q("stretch_use", "", "stretch", _stretch, needs.STRETCH, extreme=True),
    Q("locking_use", "", "locking", _locking, needs.LOCKING, extreme=True),
    Q(
        *("differential_capacitance_pF", "pF", "differential capacitance"),
        lambda s, port: 1e3 * s.slope(port, blocked=False),
        *(needs.DIFFERENTIAL, TERMINAL),
    ),
    Q(
        *("blocked_capacitance_pF", "pF", "blocked capacitance"),
        lambda s, port: 1e3 * s.slope(port, blocked=True),
        *(needs.DIFFERENTIAL, TERMINAL),
    ),
    Q(
        *("mount_stiffness_N_per_mm", "N/mm", "stiffness at the mount"),
        lambda s, port: s.slope(port, blocked=True),
        *(needs.DIFFERENTIAL, MOUNT),
    ),
    Q("electrode_resistance_kohm", "kohm", "electrode resistance", _resistance, needs.LADDER),
    Q("rc_time_us", "us", "charging time constant", _time_constant, needs.LADDER),
    Q("dissipated_energy_mJ", "mJ", "dissipated energy", _dissipated, needs.MEMORY),
    Q("dissipated_power_mW", "mW", "dissipated power", _power, needs.BRANCHES),
    Q(
        *("electrode_loss_mJ", "mJ", "energy lost in the electrodes"),
        lambda s: s.newton.system.charging.lost,
        needs.CHARGING,
    ),
    Q("kinetic_energy_mJ", "mJ", "kinetic energy", lambda s: s.inertia.kinetic, needs.MOVES),
    Q("damped_energy_mJ", "mJ", "damped energy", lambda s: s.inertia.damped, needs.DAMPED),
    Q(
        *("numerical_dissipation_mJ", "mJ", "numerical dissipation"),
        lambda s: s.inertia.numerical,
        needs.MOVES,
    ),
    Q("velocity_mm_per_s", "mm/s", "velocity", _velocity, needs.MOVES, MOUNT),
    Q(
        *("angular_velocity_deg_per_s", "deg/s", "angular velocity"),
        _velocity,
        *(needs.MOVES, TURN),
    ),
    *(
        Q(f"{kind.name}_work_mJ", "mJ", f"work of the {kind.name}", kind=kind)
        for kind in (MOUNT, TERMINAL, CHAMBER, TURN)
    ),
    Q(
        *("wrinkled_area_mm2", "mm2", "wrinkled area as mounted"),
        lambda s: s.newton.system.problem.wrinkled_area(),
        needs.TENSION_FIELD,
    ),
    Q("energy_residual_mJ", "mJ", "energy residual"),
    Q("softest_mode_N_per_mm", "N/mm", "stiffness of the softest mode", _softest, needs.WATCHED),
    Q("unstable_modes", "", "unstable modes", needs=needs.COUNTED),
    Q("limit_point", "", "limit point", needs=needs.FOLLOW),
    Q("bifurcation", "", "bifurcation", needs=needs.FOLLOW),
    Q("solved", "", "solved state", needs=needs.AUTO),
)
