"""The small-signal spectrum of a terminal about a state of a program."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dealib.config.band import Band
from dealib.config.case import Case
from dealib.config.schema import Config
from dealib.device.records import MOUNT, TERMINAL, Port
from dealib.errors import ConfigError, by_caller, did_you_mean
from dealib.fem.probes import Probes
from dealib.fem.response import Change, Response, relaxed_state
from dealib.program.engine import Engine
from dealib.program.history import State
from dealib.program.modes import at_rest, ends_program
from dealib.program.run import ports_told, simulate
from dealib.results import sound, spectra

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
    if not known:
        raise ConfigError(config.device.lacks(TERMINAL))
    if name is None:
        return next(iter(known.values()))
    if name not in known:
        said = f"{by_caller('--of', 'of')} {name}: the device has no such terminal"
        raise ConfigError(said + did_you_mean(name, known))
    return known[name]


@dataclass
class SpectrumWatch:
    """Finds the spectrum at the end of a stage (collective).

    Attributes:
        stage: The stage; None: the end of the program.
        terminal: Name of the terminal that is driven.
        hertz: Frequencies, Hz.
        driver: Impedance in series with the terminal.
        distance: Distance on the axis at which sound pressure is found, mm; None: no sound.
        path: File to which the spectrum is written, if any.
        more: Largest number of frequencies that are added where the response is curved.
        rows: Rows of `response.csv`, one for each frequency.
    """

    stage: str | None
    terminal: str
    hertz: Any
    driver: Driver = Driver()
    distance: float | None = None
    path: Path | None = None
    more: int = 0
    rows: list[dict[str, float]] = field(default_factory=list)

    def __call__(self, state: State) -> State:
        """Find the spectrum if the state ends the stage; returns the state."""
        at_end = ends_program(state) if self.stage is None else state.row["stage"] == self.stage
        if not (state.end_of_stage and at_end):
            return state
        of = state.engine
        with relaxed_state(of.newton, of.viscosity):
            if of.viscosity is not None:
                _log_relaxed(of, state.row)
            response = Response(of.newton, of.viscosity, self.terminal)
            probes = _ProbeResponse(of, response)
            face = None if self.distance is None else _Face(of, response)
            changes = response.at(self.hertz, self.more)
            self.rows = [self._row(of, change, probes, face) for change in changes]
            of.newton.system.residual(of.newton.system.q, of.newton.system.residual_vector)
        if self.path is not None and of.comm.rank == 0:
            spectra.write(self.path, self.rows)
        return state

    def check(self) -> None:
        """Raise `ConfigError` if the run ended before the stage did."""
        if not self.rows:
            problem = "a condition stopped it"
            raise ConfigError(f"the run ended before the end of {self.stage!r}: {problem}")

    def _row(
        self, of: Engine, change: Change, probes: _ProbeResponse, face: _Face | None
    ) -> dict[str, float]:
        omega, device = 2 * np.pi * change.frequency, of.problem.device
        charge = -change.duals[self.terminal]  # uC/kV
        inner = 1 / (1j * omega * charge)  # Gohm
        impedance = inner + self.driver.impedance(omega)
        share = inner / impedance  # voltage at the terminal over that of the source
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
        if face is not None and self.distance is not None:
            heard, power = face.sound(change, self.distance)
            row |= _polar("sound_pressure_Pa_per_kV", "sound_phase_deg", 1e6 * heard * share)
            row["sound_power_mW_per_kV2"] = power * abs(share) ** 2
        return row


def solve_spectrum(
    case: Case, directory: Path, band: Band, stage: str | None, **options: Any
) -> None:
    """Run a case with quasi-static stages, and write a spectrum into its directory.

    Args:
        case: The case.
        directory: Run directory.
        band: Frequencies, and the terminal that is driven.
        stage: Stage at whose end the spectrum is found; default the last one.
        options: Further arguments of `simulate`.

    Raises:
        ConfigError: If the run ended before the stage did.
    """
    terminal = terminal_of(case.config, band.of)
    hertz, driver = frequencies(*band.band, band.points), Driver(band.series_resistance)
    path = directory / spectra.RESPONSE
    spectrum = SpectrumWatch(stage, terminal.name, hertz, driver, path=path)
    with case.blamed():
        simulate(at_rest(case, [stage] if stage else []), directory, look=spectrum, **options)
    spectrum.check()


class _ProbeResponse:
    """Values of displacement probes in the response."""

    def __init__(self, of: Engine, response: Response) -> None:
        config = of.config
        self._response, self._problem = response, of.problem
        given = (config.probes or {}).items()
        self._names = [name for name, probe in given if probe.displacement is not None]
        self._probes = Probes(of.problem, of.layout) if self._names else None

    def of(self, change: Change) -> Iterator[tuple[str, complex]]:
        """Name and value of each probe, mm."""
        system = self._response.system
        found = []
        for vector in change.vectors if self._names else ():
            system.map.expand(vector, self._problem.spaces.w, system.values)
            assert self._probes is not None
            found.append([self._probes.measure(name, None) for name in self._names])
        for k, name in enumerate(self._names):
            yield name, complex(found[0][k], found[1][k])


class _Face:
    """The upper face of a disc or an annulus, which radiates sound from a baffle.

    A dome z(r) displaces the same volume as a flat face that moves by u_z - u_r dz/dr. A rigid
    plate within an annulus moves like the inner edge.

    Raises:
        ConfigError: If the device is no axisymmetric disc or annulus.
    """

    def __init__(self, of: Engine, response: Response) -> None:
        laminate = of.problem.device.laminate
        flat = laminate is not None and laminate.base.along == "R"
        if not (flat and of.problem.kinematics.revolved):
            raise ConfigError("sound: only for a disc or an annulus in the axisymmetric space")
        self._of, self._system = of, response.system
        self._system.expand(self._system.q)
        mesh, nodal = of.layout.mesh, of.layout.gather()
        if mesh is None or nodal is None:
            return
        air = [k for k, name in enumerate(mesh.names) if of.problem.device.region(name).air]
        nodes = np.unique(mesh.cells[~np.isin(mesh.region, air)])
        order = nodes[np.lexsort((-mesh.points[nodes, 1], mesh.points[nodes, 0].round(9)))]
        _, first = np.unique(mesh.points[order, 0].round(9), return_index=True)
        self._top = order[first]
        self._r, z = (mesh.points[self._top] + nodal[self._top, :2]).T
        self._slope = np.gradient(z, self._r)

    def sound(self, change: Change, distance: float) -> tuple[complex, float]:
        """Pressure on the axis, MPa, and radiated power, mW (collective)."""
        of, system, omega = self._of, self._system, 2 * np.pi * change.frequency
        found: list[Any] = []
        for vector in change.vectors:
            system.map.expand(vector, of.problem.spaces.w, system.values)
            nodal = of.layout.gather()
            found.append(None if nodal is None else nodal[self._top, :2])
        heard = 0j, 0.0
        if of.layout.mesh is not None:
            u = found[0] + 1j * found[1]
            speed = 1j * omega * (u[:, 1] - u[:, 0] * self._slope)
            heard = (
                sound.on_axis(self._r, speed, omega, distance),
                sound.power(self._r, speed, omega),
            )
        return of.comm.bcast(heard, root=0)


def _polar(name: str, phase: str, value: complex) -> dict[str, float]:
    return {name: float(abs(value)), phase: float(np.degrees(np.angle(value)))}


def _phase(port: Port, variable: str) -> str:
    """Column of the phase, such as 'force_phase_deg'; 'phase_deg' for a mount's displacement."""
    plain = port.kind is MOUNT and variable == MOUNT.primal.name
    return ("phase_deg" if plain else f"{variable}_phase_deg") + port.suffix


def _log_relaxed(of: Engine, row: dict[str, Any]) -> None:
    """Log the values of the ports after the branches have relaxed."""
    now = of.port_pairs()
    reached: dict[str, Any] = {}
    for port in of.problem.device.ports:
        for variable, value in zip(port.kind.variables, now[port.name], strict=True):
            reached[port.column(variable)] = value * variable.factor
    log.info("step %d with relaxed branches: %s", row["step"], ports_told(reached, "z9.5f"))
