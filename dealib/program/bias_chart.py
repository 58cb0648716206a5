"""Computes the chart of a biased film: the film's force curves, and its exact equilibria."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dealib.config.bias import Bistable, Sampled, Table
from dealib.config.case import Case
from dealib.config.inputs import MountInput, TerminalInput
from dealib.config.program import Stage
from dealib.config.wave import reach as reach_of
from dealib.device.records import MOUNT, TERMINAL
from dealib.errors import ConfigError, NotConverged, by_caller
from dealib.fem.port_law import PortLaw
from dealib.program.inputs import drives, law
from dealib.program.simulation import Simulation
from dealib.program.turns import alone
from dealib.results.bias import BiasChart, Equilibrium, crossings

log = logging.getLogger(__name__)

_POINTS = 48  # solved points of each curve
_FINE = 2001  # points at which curves are compared to tell equilibria apart


@dataclass(frozen=True)
class _Point:
    displacement: float
    force: float
    q: Any


@alone()
def chart(
    case: Case, voltage: float | None = None, reach: tuple[float, float] | None = None
) -> BiasChart:
    """The chart of the last bias in a case's program.

    Args:
        case: The case; Maxwell branches of its materials are left out.
        voltage: Full voltage, kV; default the program's largest.
        reach: Lowest and highest displacement, mm; default a range that holds the equilibria.

    Raises:
        ConfigError: If there is no bias, no voltage, or no reach to be guessed.
        NotConverged: If the film cannot be moved so far.
    """
    stage, given = _bias(case)
    volts = _full_voltage(case) if voltage is None else voltage
    if volts == 0:
        raise ConfigError(
            f"the program applies no voltage; give {by_caller('one with --voltage', 'voltage')}"
        )
    case = _in_the_long_run(case)
    simulation = Simulation(case)
    (mount,) = case.config.device.of(MOUNT)
    bias = law(drives(mount, given, 0.0, 0.0, sample=simulation.sample, stage=stage), 1.0)
    low, high = reach or _reach(case, bias, volts)
    curves = _film(case, volts, low, high)
    u = np.linspace(low, high, _FINE)
    force = np.array([bias.balance(x)[0] for x in u])
    film, equilibria = {}, {}
    for at, (simulation, solved) in curves.items():
        curve = _spline(solved)
        film[at] = curve(u)
        net = partial(_net, curve, bias)
        equilibria[at] = [_exact(simulation, solved, at, x, curve, bias) for x in crossings(u, net)]
    return BiasChart(case.config.name, u, film, force, equilibria)


def _in_the_long_run(case: Case) -> Case:
    """The case without Maxwell branches, which have relaxed in equilibrium."""
    given = case.config.materials
    materials = {k: law.model_copy(update={"branches": ()}) for k, law in given.items()}
    return replace(case, config=case.config.model_copy(update={"materials": materials}))


def _bias(case: Case) -> tuple[Stage, MountInput]:
    for stage in reversed(case.config.program):
        for _, _, _, given in stage.inputs:
            if isinstance(given, MountInput) and given.displacement is None:
                return stage, given
    raise ConfigError(
        f"{case.path}: no stage loads the mount by bias, spring, mass or force: no chart to draw"
    )


def _full_voltage(case: Case) -> float:
    given = (item for stage in case.config.program for _, _, _, item in stage.inputs)
    inputs = [reach_of(g.voltage) for g in given if isinstance(g, TerminalInput) and g.voltage]
    return max((v for values in inputs for v in values), key=abs, default=0.0)


def _reach(case: Case, bias: PortLaw, volts: float) -> tuple[float, float]:
    """Displacements between which film and bias can be in equilibrium, mm."""
    ends = [0.0]
    for element, anchor in bias.elements:
        if isinstance(element, Bistable):
            ends += [anchor - 1.25 * element.well, anchor + 1.25 * element.well]
        elif isinstance(element, (Table, Sampled)):
            ends += [anchor, *(anchor + x for x in element.reach)]
        else:
            ends.append(anchor)
    if bias.load:  # a weight pulls at any displacement: solve for how far it moves the film
        program = [
            {"stage": "load", "mount": {"force": f"{bias.load!r} N"}, "steps": 8},
            {"stage": "actuate", "terminal": {"voltage": f"{volts!r} kV"}, "steps": 8},
        ]
        for state in Simulation(_with(case, program)):
            last = state.row["displacement_mm"]
        ends.append(1.4 * last)
    span = max(ends) - min(ends)
    if span == 0:
        raise ConfigError(
            f"{case.path}: the bias leaves the mount at 0 mm; give the displacements of the chart "
            + by_caller("with --reach, such as '-4 mm, 0 mm'", "as reach, such as (-4.0, 0.0)")
        )
    # equilibria lie on the side to which the bias pulls; a tenth of the span is shown beyond flat
    return max(min(ends), -span), min(max(ends), 0.1 * span) if min(ends) < 0 else max(ends)


def _with(case: Case, program: list[dict[str, Any]]) -> Case:
    stages = tuple(Stage.model_validate(stage) for stage in program)
    first = case.config.program[0]
    if first.stage == "prestrain":
        stages = (first, *stages)
    return replace(case, config=case.config.model_copy(update={"program": stages, "stop_when": ()}))


def _film(
    case: Case, volts: float, low: float, high: float
) -> dict[float, tuple[Simulation, list[_Point]]]:
    """The film's force over displacement without and with voltage."""
    down = max(round(_POINTS * max(-low, 0) / (high - low)), 0)
    up = max(_POINTS - down, 0) if high > 0 else 0

    def move(to: float, steps: int) -> list[dict[str, Any]]:
        there = {"stage": "move", "mount": {"displacement": f"{to!r} mm"}, "steps": steps}
        return [there] if steps else []

    program = [
        *move(low, down),
        {"stage": "on", "terminal": {"voltage": f"{volts!r} kV"}, "steps": 6},
        *move(0.0, down),
        *move(high, up),
        {"stage": "off", "terminal": {"voltage": "0 kV"}, "steps": 6},
        *move(0.0, up),
    ]
    simulation = Simulation(_with(case, program))
    found: dict[float, dict[float, _Point]] = {0.0: {}, volts: {}}
    for state in simulation:
        row = state.row
        if row["voltage_kV"] in found:
            q = simulation.engine.newton.system.q.copy()
            point = _Point(row["displacement_mm"], row["force_N"], q)
            found[row["voltage_kV"]].setdefault(round(point.displacement, 12), point)
    return {at: (simulation, [p for _, p in sorted(of.items())]) for at, of in found.items()}


def _spline(points: list[_Point]) -> Any:
    from scipy.interpolate import CubicSpline

    return CubicSpline([p.displacement for p in points], [p.force for p in points])


def _net(curve: Any, bias: PortLaw, u: Any) -> Any:
    return curve(u) - np.array([bias.balance(float(x))[0] for x in u])


def _exact(
    simulation: Simulation, points: list[_Point], volts: float, u: float, curve: Any, bias: PortLaw
) -> Equilibrium:
    """The equilibrium near a crossing of the two curves, solved with the bias on the mount."""
    stiffness = float(curve(u, 1)) - bias.balance(u)[1]
    newton = simulation.engine.newton
    system = newton.system
    near = min(points, key=lambda p: abs(p.displacement - u))
    near.q.copy(system.q)
    device = system.problem.device
    mount, terminal = (device.of(kind)[0].name for kind in (MOUNT, TERMINAL))
    try:
        for equation in (PortLaw(value=u), bias):
            system.ports.update({mount: equation, terminal: PortLaw(value=volts)})
            newton.solve()
        x, force = system.map.port_values(system.q)[mount], system.internal[mount]
        if abs(x - u) > abs(points[1].displacement - points[0].displacement):
            raise NotConverged("Newton's method went to another equilibrium")
        return Equilibrium(volts, x, force, stiffness)
    except NotConverged as error:
        log.warning("the equilibrium at %.5g mm is only interpolated: %s", u, str(error))
        return Equilibrium(volts, u, float(curve(u)), stiffness)
