"""Key figures of a run: strokes, margins, and texts about single states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.errors import ConfigError
from dealib.observe.columns import columns
from dealib.results import stages
from dealib.units import neat

if TYPE_CHECKING:
    import pandas

    from dealib.results.reader import Run


def voltages(history: pandas.DataFrame) -> pandas.Series[float]:
    """Largest voltage of any terminal, kV, row by row."""
    names = [name for name in map(str, history) if name.partition(".")[0] == TERMINAL.primal.column]
    return history[names].abs().max(axis=1)


def under_voltage(history: pandas.DataFrame) -> pandas.Series[bool]:
    """Whether there is a voltage (above rounding), row by row."""
    voltage = voltages(history)
    return voltage > 1e-9 * voltage.max()


def stored_note(run: Run) -> str:
    """A note if the run had a voltage but no state under voltage is stored; else ''."""
    under = under_voltage(run.history)
    stored = run.history["step"].isin(run.stored_steps)
    return "no state under voltage was stored" if under.any() and not (under & stored).any() else ""


def moment(run: Run, row: Mapping[str, Any] | pandas.Series[Any]) -> str:
    """Step, time and stage of a state as text: 'step 21, t = 25 s, actuate'.

    Args:
        run: The run.
        row: Row of the history, with `step`, `time_s` and `stage`.
    """
    timed = stages.clock(run.config.program) == "time_s"
    time = f", t = {neat(row['time_s'], 4)} s" if timed else ""
    return f"step {row['step']}{time}, {row['stage']}"


SYMBOLS = {
    "displacement_mm": "u",
    "force_N": "F",
    "rotation_deg": "rot",
    "moment_Nmm": "M",
    "voltage_kV": "V",
    "charge_uC": "Q",
    "pressure_kPa": "p",
    "volume_mm3": "vol",
}


def motion(run: Run) -> list[str]:
    """Up to two columns for the motion: of the first mount or chamber, else of two probes."""
    for port in (p for kind in (MOUNT, CHAMBER) for p in run.config.device.of(kind)):
        return [port.column(variable) for variable in port.kind.variables]
    return [c.name for c in columns(run.config).values() if c.probe and c.name in run.history][:2]


def drive(run: Run) -> str:
    """Column of the first terminal's voltage; without terminals that of the elastic energy."""
    terminals = run.config.device.of(TERMINAL)
    return terminals[0].column(TERMINAL.primal) if terminals else "elastic_energy_mJ"


def values_told(run: Run, row: Any, digits: int = 4) -> str:
    """Motion and drive of a state as text: 'u = −3 mm, F = −0.8133 N, V = 2.5 kV'."""
    known, found = columns(run.config), []
    for name in dict.fromkeys([*motion(run), drive(run)]):
        column = known[name]
        symbol = SYMBOLS.get(name.partition(".")[0])
        of = "".join(f" of {port.name}" for port in column.ports if port.suffix)
        value = f"{neat(row[name], digits)} {column.unit.replace('mm3', 'mm³')}".rstrip()
        found.append(f"{symbol + of if symbol else column.label} = {value}")
    return ", ".join(found).replace("-", "−")


@dataclass(frozen=True)
class Actuation:
    """The largest change of one quantity in a stage under voltage, from the state before it.

    Attributes:
        stage: Name of the stage, numbered if several stages have this name.
        peak_voltage: Largest voltage in the stage, kV.
        what: 'stroke', 'force change' for a mount that is held, 'change of tip' for a probe, ...
        value: Largest change.
        unit: Unit of `value`.
        kept: What stays constant, such as 'mount held'; empty if nothing does.
    """

    stage: str
    peak_voltage: float
    what: str
    value: float
    unit: str
    kept: str = ""


_LEAST = 1e-6  # mm, kPa: a port whose value changes less is held
# by kind of port: name of a change of its value, and the note if the value is held
_STROKE = {
    MOUNT: ("stroke", "mount held"),
    TURN: ("rotation", "turn held"),
    CHAMBER: ("pressure change", "pressure constant"),
}


def actuations(run: Run) -> list[Actuation]:
    """Changes of mounts, turns, chambers and probes in each stage under voltage, in order.

    Ports whose value is prescribed to change, or that follow a branch, are left out.
    """
    h, program, device = run.history, run.config.program, run.config.device
    number = stages.numbers(h, program, run.info.get("stops", ()))
    titles, driven = stages.titles(program), stages.drives(program, device)
    under, voltage = under_voltage(h).to_numpy(), voltages(h).to_numpy()
    probes = [c for c in columns(run.config).values() if c.probe and c.name in h]
    found = []
    for k in np.unique(number[under]):
        rows = np.flatnonzero(under & (number == k))
        part = h.iloc[[max(rows[0] - 1, 0), *rows]]
        peak = float(voltage[part.index].max())

        def change(column: str, part: Any = part) -> float:
            return float((part[column] - part[column].iloc[0]).abs().max())

        for port in (p for kind in _STROKE for p in device.of(kind)):
            primal, dual = (port.column(v) for v in port.kind.variables)
            of = f" of {port.name}" if port.suffix else ""
            stroke, kept = _STROKE[port.kind]
            drive, told = driven[k][port.name], (titles[k], peak)
            if drive == port.kind.primal.name:
                if change(primal) < _LEAST:
                    what, unit = f"{port.kind.dual.name} change{of}", port.kind.dual.unit
                    found.append(Actuation(*told, what, change(dual), unit, kept))
            elif drive != "path":
                what, unit = stroke + of, port.kind.primal.unit
                found.append(Actuation(*told, what, change(primal), unit))
        found += [
            Actuation(titles[k], peak, f"change of {c.quantity.label}", change(c.name), c.unit)
            for c in probes
        ]
    return found


# column of the history -> name, what is compared, and what it means to exceed the limit
MARGINS = {
    "breakdown_use": (
        "breakdown",
        "true field over the strength that the electrodes leave",
        "the film breaks down",
    ),
    "wrinkling_use": (
        "wrinkling",
        "lost share of the mounted tension, thickness average",
        "a real film wrinkles, this one carries pressure in its plane",
    ),
    "pull_in_use": (
        "pull-in",
        "field over the one at which the film itself loses stability",
        "a film under dead loads would be unstable; clamped as here it bears more",
    ),
    "stability_use": (
        "material stability",
        "lost share of the law's stiffness at rest",
        "the law itself is unstable",
    ),
    "stretch_use": (
        "stretch",
        "largest stretch over the one allowed",
        "the film is stretched more than is allowed",
    ),
    "locking_use": ("locking", "share of the law's extensibility", "the law has locked"),
}
VERDICTS = ("limit exceeded", "beyond")
GIVEN = ("breakdown_use", "stretch_use")  # limits of the config; the others are the film's own


@dataclass(frozen=True)
class Margin:
    """The worst value of one margin over a run.

    Attributes:
        name: Name of the margin.
        meaning: What is compared.
        beyond: What it means to exceed the limit.
        given: Whether the config gives the limit; else it follows from the film's material.
        use: Used share: 1 is the limit; infinite if the film is unstable without a field.
        where: Place in the mesh, if known.
        when: Step, time and stage.
        ok: Whether the limit is kept.
    """

    name: str
    meaning: str
    beyond: str
    given: bool
    use: float
    where: str
    when: str
    ok: bool

    @property
    def used(self) -> str:
        """`use` as text."""
        return f"{self.use:.3f}" if self.use < float("inf") else "∞"

    @property
    def verdict(self) -> str:
        """'ok', 'limit exceeded' for a limit of the config, or 'beyond' for one of the film."""
        return "ok" if self.ok else VERDICTS[not self.given]


def margins(run: Run) -> list[Margin]:
    """The margins of a run, in a fixed order; if the run was killed, from its history."""
    found = run.info.get("margins") or _from_history(run)
    places = {f"{axis}_mm" for axis in run.config.device.kinematics.axes}
    return [
        Margin(
            *MARGINS[column],
            column in GIVEN,
            float("inf") if m["use"] is None else m["use"],
            ", ".join(
                f"{key.removesuffix('_mm')} = {value:.4g} mm"
                for key, value in m.items()
                if key in places
            ),
            moment(run, m),
            m["ok"],
        )
        for column in MARGINS
        if (m := found.get(column)) is not None
    ]


def _from_history(run: Run) -> dict[str, dict[str, Any]]:
    try:
        h = run.history
    except ConfigError:
        return {}  # nothing has converged
    worst: dict[str, Any] = {c: h.iloc[int(h[c].argmax())].to_dict() for c in MARGINS if c in h}
    return {c: {**row, "use": row[c], "ok": row[c] <= 1 + 1e-9} for c, row in worst.items()}


def alarms(run: Run) -> dict[str, str]:
    """Margins whose limit is exceeded, by verdict, as text: 'wrinkling 1.193, pull-in 1.072'."""
    found = [m for m in margins(run) if not m.ok]
    told = {
        verdict: ", ".join(f"{m.name} {m.used}" for m in found if m.verdict == verdict)
        for verdict in VERDICTS
    }
    return {verdict: text for verdict, text in told.items() if text}
