"""The quantities of a converged state: each is one record, and one column of the history.

To add a column, add a `Quantity` here: its name, unit and label, the condition on the config, and a
function of the state. Add its meaning to `dealib.observe.reference`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from dealib.device.device import Device
from dealib.device.records import CHAMBER, KINDS, MOUNT, TERMINAL, TURN, Port, PortKind
from dealib.errors import ValueAt
from dealib.materials.laws import LAWS
from dealib.materials.response import softens
from dealib.observe.local_quantities import local_quantities

Snapshot: TypeAlias = Any  # `fem.snapshot.Snapshot`, which this module must not import


@dataclass(frozen=True)
class Need:
    """A condition on the config for a quantity to be recorded.

    Attributes:
        text: The condition in words.
        has: Whether a config meets it.
    """

    text: str
    has: Callable[[Any], bool]


ALWAYS = Need("", lambda config: True)


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


@dataclass(frozen=True)
class Column:
    """A column of one device.

    Attributes:
        name: In the history.
        quantity: Its quantity.
        ports: Its port, or pair of ports.
        probe: Whether a probe of the config measures it.
    """

    name: str
    quantity: Quantity
    ports: tuple[Port, ...] = ()
    probe: bool = False

    @property
    def unit(self) -> str:
        """Its unit."""
        return self.quantity.unit

    @property
    def label(self) -> str:
        """Name in pictures and tables, such as 'displacement of plate'."""
        names = dict.fromkeys(port.name for port in self.ports if port.suffix)
        return f"{self.quantity.label} of {' and '.join(names)}" if names else self.quantity.label

    def measure(self, s: Snapshot) -> float:
        """Its value in a state (collective)."""
        assert self.quantity.measure is not None
        return self.quantity.measure(s, *self.ports)


# --- conditions on the config --------------------------------------------------------------------


def _films(config: Any) -> list[Any]:
    return [m for name, m in config.solids.items() if not config.conducts(name)]


_STRENGTH = Need("limits.breakdown_strength", lambda c: c.limits.breakdown is not None)
_WEIBULL = Need("limits.weibull", lambda c: c.limits.weibull is not None)
_STRETCH = Need("limits.stretch_max", lambda c: c.limits.stretch_max is not None)
_SOFTENING = Need(
    "a film that can lose its stiffness, such as mooney_rivlin with c01 below 0",
    lambda c: any(softens(film) for film in _films(c)),
)
_LOCKING = Need(
    f"a film whose law locks: {' or '.join(n for n, law in LAWS.items() if law.locks)}",
    lambda c: any(film.locks for film in _films(c)),
)
_DIFFERENTIAL = Need("sensing.differential: true", lambda c: c.sensing.differential)
_LADDER = Need(
    "sensing.sheet_resistance, of a laminate in two dimensions with one terminal",
    lambda c: c.sensing.sheet_resistance is not None and c.device.ladder,
)
_BRANCHES = Need(
    "Maxwell branches, such as materials.film.branches",
    lambda c: any(law.branches for law in c.solids.values()),
)
_MEMORY = Need(
    "a material with branches, mullins or permanent_set",
    lambda c: any(law.memory for law in c.solids.values()),
)
_TENSION_FIELD = Need(
    "physics.wrinkling: tension_field", lambda c: c.physics.wrinkling == "tension_field"
)
_TAUT = Need("physics.wrinkling: taut", lambda c: c.physics.wrinkling == "taut")
_MOVES = Need("a stage with dynamic: true", lambda c: c.moves)
_DAMPED = Need(
    f"{_MOVES.text}, and damping", lambda c: c.moves and (c.damping.mass or c.damping.stiffness)
)
_CHARGING = Need("sensing.charging: true", lambda c: c.sensing.charging)
_FOLLOW = Need("a stage with follow", lambda c: any(s.follow is not None for s in c.program))
_AUTO = Need("a stage with steps: auto", lambda c: any(s.auto for s in c.program))
_WATCHED = Need("output.modes above 0", lambda c: c.output.modes > 0)
_COUNTED = Need(f"{_WATCHED.text}, or {_FOLLOW.text}", lambda c: _WATCHED.has(c) or _FOLLOW.has(c))


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
    Q("breakdown_use", "", "breakdown", _breakdown, _STRENGTH, extreme=True),
    Q("failure_probability", "", "probability of breakdown", _failure, _WEIBULL),
    Q(
        *("wrinkling_use", "", "wrinkling"),
        lambda s: s.peak("wrinkling_use", lambda f: f.film.wrinkling(f.tensions)),
        _TAUT,
        extreme=True,
    ),
    Q(
        *("pull_in_use", "", "pull-in"),
        lambda s: s.peak("pull_in_use", lambda f: f.film.pull_in(f.k)),
        extreme=True,
    ),
    Q("stability_use", "", "material stability", _softening, _SOFTENING, extreme=True),
    Q("stretch_use", "", "stretch", _stretch, _STRETCH, extreme=True),
    Q("locking_use", "", "locking", _locking, _LOCKING, extreme=True),
    Q(
        *("differential_capacitance_pF", "pF", "differential capacitance"),
        lambda s, port: 1e3 * s.slope(port, blocked=False),
        *(_DIFFERENTIAL, TERMINAL),
    ),
    Q(
        *("blocked_capacitance_pF", "pF", "blocked capacitance"),
        lambda s, port: 1e3 * s.slope(port, blocked=True),
        *(_DIFFERENTIAL, TERMINAL),
    ),
    Q(
        *("mount_stiffness_N_per_mm", "N/mm", "stiffness at the mount"),
        lambda s, port: s.slope(port, blocked=True),
        *(_DIFFERENTIAL, MOUNT),
    ),
    Q("electrode_resistance_kohm", "kohm", "electrode resistance", _resistance, _LADDER),
    Q("rc_time_us", "us", "charging time constant", _time_constant, _LADDER),
    Q("dissipated_energy_mJ", "mJ", "dissipated energy", _dissipated, _MEMORY),
    Q("dissipated_power_mW", "mW", "dissipated power", _power, _BRANCHES),
    Q(
        *("electrode_loss_mJ", "mJ", "energy lost in the electrodes"),
        lambda s: s.newton.system.charging.lost,
        _CHARGING,
    ),
    Q("kinetic_energy_mJ", "mJ", "kinetic energy", lambda s: s.inertia.kinetic, _MOVES),
    Q("damped_energy_mJ", "mJ", "damped energy", lambda s: s.inertia.damped, _DAMPED),
    Q(
        *("numerical_dissipation_mJ", "mJ", "numerical dissipation"),
        lambda s: s.inertia.numerical,
        _MOVES,
    ),
    *(
        Q(
            name,
            unit,
            label,
            lambda s, port: s.inertia.velocity(port.name) * port.kind.primal.factor,
            _MOVES,
            kind,
        )
        for name, unit, label, kind in (
            ("velocity_mm_per_s", "mm/s", "velocity", MOUNT),
            ("angular_velocity_deg_per_s", "deg/s", "angular velocity", TURN),
        )
    ),
    *(
        Q(f"{kind.name}_work_mJ", "mJ", f"work of the {kind.name}", kind=kind)
        for kind in (MOUNT, TERMINAL, CHAMBER, TURN)
    ),
    Q(
        *("wrinkled_area_mm2", "mm2", "wrinkled area as mounted"),
        lambda s: s.newton.system.problem.wrinkled_area(),
        _TENSION_FIELD,
    ),
    Q("energy_residual_mJ", "mJ", "energy residual"),
    Q("softest_mode_N_per_mm", "N/mm", "stiffness of the softest mode", _softest, _WATCHED),
    Q("unstable_modes", "", "unstable modes", needs=_COUNTED),
    Q("limit_point", "", "limit point", needs=_FOLLOW),
    Q("bifurcation", "", "bifurcation", needs=_FOLLOW),
    Q("solved", "", "solved state", needs=_AUTO),
)


def columns(config: Any) -> dict[str, Column]:
    """All columns that the history of a config's device can have, in order."""
    found = [c for quantity in QUANTITIES for c in _columns(quantity, config.device)]
    for opening in (name for port in config.device.of(CHAMBER) for name, _ in port.openings):
        told = f"inflow through {opening}"
        quantity = Quantity(
            f"inflow_mm3.{opening}", "mm3", told, lambda s, name=opening: s.through.get(name, 0.0)
        )
        found.append(Column(quantity.name, quantity))
    known = local_quantities(config.device.kinematics)
    for name, probe in (config.probes or {}).items():
        of = known[probe.measured]
        unit, suffix = of.unit, of.suffix
        if probe.take == "integral":
            unit, suffix = "", ""
        extreme = probe.on is not None and probe.take in ("max", "min")
        measure = lambda s, name=name: s.probe(name)  # noqa: E731
        quantity = Quantity(name + suffix, unit, name, measure, extreme=extreme)
        if any(quantity.name == column.name for column in found):
            problem = f"the history has a column {quantity.name} already; choose another name"
            raise ValueAt(("probes", name), problem)
        found.append(Column(quantity.name, quantity, probe=True))
    return {column.name: column for column in found}


def _columns(quantity: Quantity, device: Device) -> Iterator[Column]:
    if quantity.kind is None:
        yield Column(quantity.name, quantity)
        return
    ports = device.of(quantity.kind)
    if quantity.pairs and len(ports) > 1:
        for a in ports:
            for b in ports:
                yield Column(f"{quantity.name}.{a.name}.{b.name}", quantity, (a, b))
        return
    for port in ports:
        yield Column(quantity.name + port.suffix, quantity, (port,))


def measured(config: Any) -> list[Column]:
    """Columns that are measured in each state of a run."""
    return [
        column
        for column in columns(config).values()
        if column.quantity.measure is not None and column.quantity.needs.has(config)
    ]
