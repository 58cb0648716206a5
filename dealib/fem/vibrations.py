"""Free vibrations about a state, with values and duals of the ports."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.device.records import TERMINAL
from dealib.fem.linear import fixed_tangent
from dealib.fem.modes import Eigenmodes, lowest
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.system import System
from dealib.fem.viscous import Viscosity

Array = npt.NDArray[np.float64]
MORE = 2  # further modes that are solved for, so that modes are found again among them


@dataclass(frozen=True)
class Vibrations:
    """Free vibrations about a state.

    Attributes:
        modes: Squares of the angular frequencies, 1/s^2, and the shapes, of unit mass (1 t).
        values: Value of each port in the shapes, (modes,).
        duals: dPi/dq at each port in the shapes, (modes,).
        circuits: Squares of the angular frequencies of the first modes with a terminal open, and
            with its voltage held, (2, modes), by connected terminal; NaN where a mode is not found
            again.
    """

    modes: Eigenmodes
    values: dict[str, Array]
    duals: dict[str, Array]
    circuits: dict[str, Array]


def vibrations(
    newton: Newton, viscosity: Viscosity | None, count: int, circuits: int = 0
) -> Vibrations:
    """Vibrations under the ports' equations at the current q (collective).

    It is assumed that Maxwell branches do not relax within a period.

    Args:
        newton: The solver.
        viscosity: State of the branches, if there are some.
        count: Number of modes.
        circuits: Number of the first modes whose frequencies are also found with each terminal open
            and held. This is another eigenvalue problem for each terminal.
    """
    system, kept = newton.system, newton.system.q.copy()
    with nullcontext() if viscosity is None else viscosity.held(lambda branch: True):
        newton.polish()
        try:
            return _vibrations(newton, count, circuits)
        finally:
            kept.copy(system.q)
            system.residual(system.q, system.residual_vector)


def _vibrations(newton: Newton, count: int, circuits: int) -> Vibrations:
    system = newton.system
    tangent = fixed_tangent(system)
    mass = system.mass()
    heavy = system.take(mass)
    modes = lowest(tangent, mass, newton.concave, count)
    changes = [port_changes(system, tangent, x) for x in _vectors(system, modes.shapes)]
    values, duals = (
        {name: np.array([change[k][name] for change in changes]) for name in system.ports}
        for k in range(2)
    )
    for name, column in heavy.items():  # the dual of a held port balances inertia at it, too
        moved = [column.dot(x) for x in _vectors(system, modes.shapes)]
        duals[name] = duals[name] - modes.values * moved
    found: dict[str, Array] = {}
    first = modes.first(circuits)
    terminals = system.problem.device.of(TERMINAL) if circuits else ()
    for port in (p for p in terminals if not p.floating):
        short = system.ports[port.name].value is not None
        with switched(system, port.name, opened=short):
            # the mass matrix is the same, since a terminal has no mass
            other = lowest(fixed_tangent(system), mass, newton.concave, circuits + MORE)
        same = first.again(other).values
        both = (same, first.values) if short else (first.values, same)
        found[port.name] = np.array(both)
    return Vibrations(modes, values, duals, found)


def port_changes(
    system: System, tangent: Any, change: Any
) -> tuple[dict[str, float], dict[str, float]]:
    """Changes of the ports' values and of their duals dPi/dq for a change of q (collective).

    Args:
        system: The system.
        tangent: Its last tangent, from `fixed_tangent`.
        change: Change of the reduced unknowns.
    """
    out = change.duplicate()
    tangent.mult(change, out)
    values, rows = system.map.port_values(change), system.map.port_values(out)
    for name, law in system.ports.items():
        if law.fixed:
            rows[name] = system.column(name).dot(change)
        else:
            rows[name] += law.balance(system.values[name])[1] * values[name]
    return values, rows


@contextmanager
def switched(system: System, terminal: str, opened: bool) -> Iterator[None]:
    """A context in which small changes hold the charge of a terminal, or its voltage.

    Args:
        system: The system, at its last residual.
        terminal: Name of the terminal.
        opened: Whether the charge is held.
    """
    law = system.ports[terminal]
    charge, value = system.internal[terminal], system.values[terminal]
    system.ports[terminal] = PortLaw(load=charge) if opened else PortLaw(value=value)
    try:
        yield
    finally:
        system.ports[terminal] = law


def _vectors(system: System, shapes: Array) -> list[Any]:
    found = []
    for shape in shapes:
        vector = system.q.duplicate()
        vector.array[:] = shape[slice(*vector.getOwnershipRange())]
        found.append(vector)
    return found
