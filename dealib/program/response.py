"""The small-signal spectrum of a terminal about a state of a program."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dealib.config.schema import Config
from dealib.device.records import MOUNT, TERMINAL, Port
from dealib.errors import ConfigError, did_you_mean
from dealib.fem.probes import Probes
from dealib.fem.response import Change, Response, relaxed_state
from dealib.program.engine import Engine
from dealib.program.history import State
from dealib.program.modes import ends_program
from dealib.program.run import ports_told

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Driver:
    """What lies between the source of the voltage and the terminal.

    Attributes:
        resistance: In series, Gohm.
        inductance: In series, GH.
    """

    resistance: float = 0.0
    inductance: float = 0.0

    def impedance(self, omega: float) -> complex:
        """In Gohm."""
        return self.resistance + 1j * omega * self.inductance


def frequencies(low: float, high: float, points: int) -> Any:
    """Frequencies at equal ratios, Hz."""
    return np.geomspace(low, high, points)


def terminal_of(config: Config, name: str | None) -> Port:
    """The terminal of a name, by default the first one.

    Raises:
        ConfigError: If there is none.
    """
    known = {port.name: port for port in config.device.of(TERMINAL) if not port.floating}
    if name is None and known:
        return next(iter(known.values()))
    if name not in known:
        raise ConfigError(
            f"--of {name}: the device has no such terminal{did_you_mean(name, known)}"
        )
    return known[name]


@dataclass
class Spectrum:
    """Finds the spectrum at the end of a stage (collective).

    Attributes:
        stage: The stage; none: where the program ends.
        terminal: Name of the terminal that is driven.
        hertz: Frequencies.
        driver: In series with it.
        rows: Of `response.csv`, a frequency each.
    """

    stage: str | None
    terminal: str
    hertz: Any
    driver: Driver = Driver()
    rows: list[dict[str, float]] = field(default_factory=list)

    def __call__(self, state: State) -> State:
        """Look at a state."""
        at_end = ends_program(state) if self.stage is None else state.row["stage"] == self.stage
        if not (state.end_of_stage and at_end):
            return state
        of = state.engine
        with relaxed_state(of.newton, of.viscosity):
            if of.viscosity is not None:
                _tell_relaxed(of, state.row)
            response = Response(of.newton, of.viscosity, self.terminal)
            probes = _Linear(of, response)
            self.rows = [self._row(of, change, probes) for change in response.at(self.hertz)]
            of.newton.system.residual(of.newton.system.q, of.newton.system.residual_vector)
        return state

    def _row(self, of: Engine, change: Change, probes: _Linear) -> dict[str, float]:
        omega, device = 2 * np.pi * change.frequency, of.problem.device
        charge = -change.duals[self.terminal]  # uC a kV
        inner = 1 / (1j * omega * charge)  # Gohm
        impedance = inner + self.driver.impedance(omega)
        share = inner / impedance  # of the source's voltage that the terminal has
        row = {"frequency_Hz": float(change.frequency)}
        for port in device.ports:
            if port.name == self.terminal:
                continue
            held = port.name in change.duals
            variable = port.kind.dual if held else port.kind.primal
            value = port.kind.sign * change.duals[port.name] if held else change.values[port.name]
            row |= _polar(
                f"{variable.column}_per_kV{port.suffix}",
                _phase(port, variable.name),
                variable.factor * value * share,
            )
        for name, value in probes.of(change):
            row |= _polar(f"{name}_mm_per_kV", f"{name}_phase_deg", value * share)
        suffix, admittance = device.by_name[self.terminal].suffix, 1 / impedance
        for stem, unit, value in (
            ("charge", "uC", charge * share),
            ("current", "uA", 1j * omega * charge * share),
        ):
            row |= _polar(f"{stem}_{unit}_per_kV{suffix}", f"{stem}_phase_deg{suffix}", value)
        row |= _polar(f"impedance_Mohm{suffix}", f"impedance_phase_deg{suffix}", 1e3 * impedance)
        row[f"parallel_capacitance_pF{suffix}"] = 1e3 * admittance.imag / omega
        row[f"loss_tangent{suffix}"] = admittance.real / admittance.imag
        return row


class _Linear:
    """Displacement probes of a change."""

    def __init__(self, of: Engine, response: Response) -> None:
        config = of.config
        self._response, self._problem = response, of.problem
        given = (config.probes or {}).items()
        self._names = [name for name, probe in given if probe.displacement is not None]
        self._probes = Probes(of.problem, of.layout) if self._names else None

    def of(self, change: Change) -> Iterator[tuple[str, complex]]:
        """Each one's name and value, mm."""
        system = self._response.system
        found = []
        for vector in change.vectors if self._names else ():
            system.map.expand(vector, self._problem.spaces.w, system.values)
            assert self._probes is not None
            found.append([self._probes.measure(name, None) for name in self._names])
        for k, name in enumerate(self._names):
            yield name, complex(found[0][k], found[1][k])


def _polar(name: str, phase: str, value: complex) -> dict[str, float]:
    return {name: float(abs(value)), phase: float(np.degrees(np.angle(value)))}


def _phase(port: Port, variable: str) -> str:
    """Column of the phase; that of a mount's displacement is the phase as such."""
    plain = port.kind is MOUNT and variable == MOUNT.primal.name
    return ("phase_deg" if plain else f"{variable}_phase_deg") + port.suffix


def _tell_relaxed(of: Engine, row: dict[str, Any]) -> None:
    """Say where the branches' relaxing leads the ports."""
    now = of.port_pairs()
    reached: dict[str, Any] = {}
    for port in of.problem.device.ports:
        for variable, value in zip(port.kind.variables, now[port.name], strict=True):
            reached[port.column(variable)] = value * variable.factor
    log.info("step %d, its branches relaxed: %s", row["step"], ports_told(reached, "z9.5f"))
