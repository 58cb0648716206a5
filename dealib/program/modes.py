"""Vibrations about states of a program: frequencies, shapes, and amplitudes at the ports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dealib.config.case import Case
from dealib.config.program import Stage
from dealib.config.stop import StopWhen
from dealib.errors import ConfigError, did_you_mean
from dealib.fem.modes import Eigenmodes
from dealib.fem.vibrations import MORE, Vibrations, vibrations
from dealib.observe.columns import columns
from dealib.program.engine import Engine
from dealib.program.history import State

_GRAMS = 1e6  # in a t


def at_rest(case: Case, stages: Sequence[str], along: str | None = None) -> Case:
    """The same case with quasi-static stages, whose last states are stored.

    Args:
        case: The case.
        stages: Names of stages that it must have. No later ones are solved; without names, all.
        along: Another stage that it must have.

    Raises:
        ConfigError: If a stage or a density is missing, or there is no potential.
    """
    config = case.config
    known = dict.fromkeys(["prestrain", *(stage.stage for stage in config.program)])
    wanted = {*stages, *([] if along is None else [along])}
    for name in wanted:
        if name not in known:
            raise ConfigError(f"{case.path}: there is no stage {name!r}{did_you_mean(name, known)}")
    if config.physics.coupling != "energy":
        raise ConfigError(f"{case.path}: vibrations need physics.coupling: energy")
    with case.blamed():
        config.check_density()
    program = tuple(s.model_copy(update={"dynamic": False}) for s in config.program)
    if stages:
        last = max((k for k, s in enumerate(program) if s.stage in wanted), default=-1)
        program = program[: last + 1] or (Stage(stage="prestrain"),)
    changed: dict[str, Any] = {
        "program": program,
        "stop_when": (),
        "output": config.output.model_copy(update={"fields": "stage", "modes": 0}),
        "sensing": config.sensing.model_copy(update={"charging": False}),
    }
    cut = config.model_copy(update=changed)
    there: Any = columns(cut)  # without later stages, or in equilibrium, some are not

    def met(conditions: Sequence[StopWhen]) -> tuple[StopWhen, ...]:
        return tuple(c for c in conditions if there[c.column].quantity.needs.has(cut))

    changed["program"] = tuple(
        s.model_copy(update={"stop_when": met(s.stop_when)}) for s in program
    )
    changed["stop_when"] = met(config.stop_when)
    return replace(case, config=config.model_copy(update=changed))


def ends_program(state: State) -> bool:
    """Whether a state that ends a stage is the program's last one."""
    progress, program = state.engine.progress, state.engine.config.program
    last = len(program) - (program[0].stage == "prestrain")
    return progress.ended or progress.stage == last


@dataclass
class ModesWatch:
    """Finds the vibrations about states, one after the other (collective).

    Attributes:
        stages: Stages at whose ends modes are found; empty: the end of the program.
        along: Stage at each state of which frequencies are found.
        count: Number of modes.
        rows: Rows of `modes.csv`, one for each mode.
        curve: Rows of `frequencies.csv`, one for each state. A mode is recognised by its shape and
            keeps its number where its frequency crosses that of another one.
    """

    stages: Sequence[str]
    along: str | None
    count: int
    rows: list[dict[str, Any]] = field(default_factory=list)
    curve: list[dict[str, Any]] = field(default_factory=list)
    _followed: Eigenmodes | None = None

    def __call__(self, state: State) -> State:
        """Find modes or frequencies of a state; at the end of a stage it gets the shapes."""
        of, row = state.engine, state.row
        ends = row["stage"] in self.stages if self.stages else ends_program(state)
        wanted = state.end_of_stage and ends
        along = row["stage"] == self.along
        if not state.solved or not (wanted or along):
            return state
        most = int(of.newton.system.q.size) - 1
        count = min(self.count + MORE * along, most)
        found = vibrations(of.newton, of.viscosity, count, circuits=self.count * wanted)
        if along:
            before = self._followed
            # modes beyond `count` are followed too, since they may come in from above
            self._followed = found.modes if before is None else before.again(found.modes)
            self.curve.append(dict(_point(of, row, self._followed.first(self.count))))
        if not wanted:
            return state
        shapes, scales = of.mode_shapes(found.modes.first(self.count))
        self.rows += _modes(of, row, found, scales)
        return replace(state, modes=shapes)

    def told(self) -> Iterator[str]:
        """One line for each mode."""
        for row in self.rows:
            yield mode_told(row)

    def check(self) -> None:
        """Raise `ConfigError` if the run ended before the stages did."""
        if not self.rows:
            names = ", ".join(map(repr, self.stages))
            raise ConfigError(f"the run ended before the end of {names}: a condition stopped it")


def mode_told(row: dict[str, Any]) -> str:
    """One mode in one line."""
    f = row["frequency_Hz"]
    grows = f"  unstable: grows by e in {1 / (-2 * np.pi * f):.3g} s" if f < 0 else ""
    coupled = [
        f"  k2{name.removeprefix('coupling_squared')} {value:.4f}"
        for name, value in row.items()
        if name.startswith("coupling_squared")
    ]
    mass = f"{row['modal_mass_g']:11.5g} g"
    return f"{row['stage']:<12.12s} mode {row['mode']:2d}  {f:12.6g} Hz  {mass}" + "".join(
        [*coupled, grows]
    )


def frequency(squares: Any) -> Any:
    """Frequency, Hz, from the square of the angular frequency, 1/s^2.

    A negative square belongs to a growing mode, and gives minus its growth rate over 2 pi.
    """
    return np.sign(squares) * np.sqrt(np.abs(squares)) / (2 * np.pi)


def _modes(
    of: Engine, row: dict[str, Any], found: Vibrations, scales: Any
) -> Iterator[dict[str, Any]]:
    """Rows of modes, scaled to a largest displacement of 1 mm."""
    device = of.problem.device
    for k, hertz in enumerate(frequency(found.modes.values[: len(scales)])):
        mode = {"stage": row["stage"], "step": row["step"], "mode": k + 1, "frequency_Hz": hertz}
        mode["modal_mass_g"] = _GRAMS / scales[k] ** 2
        for port in device.ports:
            for variable, values, sign in zip(
                port.kind.variables, (found.values, found.duals), (1.0, port.kind.sign), strict=True
            ):
                name = f"{variable.column}_per_mm{port.suffix}"
                change = sign * values[port.name][k] / scales[k]
                mode[name] = variable.factor * change + 0.0
        for name, (opened, closed) in found.circuits.items():
            suffix = device.by_name[name].suffix
            mode[f"open_circuit_Hz{suffix}"] = frequency(opened[k])
            mode[f"short_circuit_Hz{suffix}"] = frequency(closed[k])
            mode[f"coupling_squared{suffix}"] = (opened[k] - closed[k]) / opened[k]
        yield {name: v if isinstance(v, (str, int)) else float(v) for name, v in mode.items()}


def _point(of: Engine, row: dict[str, Any], modes: Eigenmodes) -> Iterator[tuple[str, Any]]:
    """Row of a state on the curve of frequencies, with the variables of the ports."""
    for name in ("stage", "step", "time_s"):
        yield name, row[name]
    for port in of.problem.device.ports:
        for variable in port.kind.variables:
            yield port.column(variable), row[port.column(variable)]
    for k, hertz in enumerate(frequency(modes.values), start=1):
        yield f"frequency_Hz.{k}", float(hertz)
