"""Small-signal properties at the ports: stiffness and capacitance, from one tangent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem

_SMALL = 1e-4  # change of a port over its characteristic size


def port_stiffness(newton: Newton) -> Array:
    """Second derivatives of the equilibrium potential by the ports' values, (ports, ports).

    With U in mm and V in kV it is [[dF/dU, dF/dV], [-dQ/dU, -dQ/dV]], each derivative at constant
    values of the other ports. The state changes along the tangent's response to each port, and the
    ports' duals are differentiated centrally along it (collective).
    """
    system = newton.system
    sizes = [_SMALL * _size(system.problem, port.kind.name) for port in system.problem.device.ports]
    found = np.empty((len(sizes), len(sizes)))
    with _prescribed(newton):
        for k, (response, size) in enumerate(zip(newton.responses(), sizes, strict=True)):
            found[:, k] = _slope(newton, response, size)
    return found


def _size(problem: Problem, kind: str) -> float:
    sizes = problem.domain.sizes
    return {
        MOUNT.name: sizes.thickness,
        TURN.name: sizes.thickness / sizes.span,
        TERMINAL.name: 1.0,
        CHAMBER.name: problem.config.film.shear_modulus_at_rest * sizes.thickness / sizes.span,
    }[kind]


@contextmanager
def _prescribed(newton: Newton) -> Iterator[None]:
    """A context in which all ports are held at their values."""
    system = newton.system
    laws, q = dict(system.ports), system.q
    for name, value in system.map.port_values(q).items():
        system.ports[name] = PortLaw(value=value)
    try:
        with system.still():
            yield
    finally:
        system.ports.update(laws)
        system.residual(q, system.residual_vector)  # the duals of the state itself


def _slope(newton: Newton, response: Any, size: float) -> Array:
    """Derivatives of the ports' duals along a response."""
    system, moved = newton.system, newton.system.q.copy()
    ends = []
    for sign in (1, -1):
        system.q.copy(moved)
        moved.axpy(sign * size, response)
        system.residual(moved, system.residual_vector)
        ends.append(np.array(list(system.internal.values())))
    return np.asarray((ends[0] - ends[1]) / (2 * size))


def condensed(
    stiffness: Array, laws: Mapping[str, PortLaw], values: Mapping[str, float], port: str
) -> float:
    """Stiffness of a port, dPi/dq by its value, with the other ports driven as they are.

    Args:
        stiffness: Stiffness of all ports (see `port_stiffness`).
        laws: Equations of the ports, in order.
        values: Values of the ports.
        port: The port.
    """
    names = list(laws)
    k = names.index(port)
    free = [i for i, n in enumerate(names) if n != port and laws[n].value is None]
    if not free:
        return float(stiffness[k, k])
    inner = stiffness[np.ix_(free, free)].copy()
    inner -= np.diag([laws[names[i]].balance(values[names[i]])[1] for i in free])
    return float(stiffness[k, k] - stiffness[k, free] @ np.linalg.solve(inner, stiffness[free, k]))


def test_fields(newton: Newton) -> list[Any]:
    """Linear responses to 1 kV at each terminal in turn, other ports held, as reduced vectors."""
    with _prescribed(newton):
        names = list(newton.system.ports)
        responses = newton.responses()
    terminals = [port.name for port in newton.system.problem.device.of(TERMINAL)]
    return [responses[names.index(name)] for name in terminals]


def capacitances(newton: Newton) -> Array:
    """Maxwell's capacitance matrix with the body fixed, nF (collective).

    For a sheet, which has no potential field, it consists of derivatives of the charges at fixed
    thickness and wrinkles.

    Returns:
        Charges on terminals at unit voltage of each one, (terminals, terminals), symmetric.
    """
    problem = newton.system.problem
    if problem.sheet is None:
        return newton.electrostatics.capacitances()
    names = [port.name for port in problem.device.of(TERMINAL)]
    pairs = [[f"corner {a} {b}" for b in names] for a in names]
    with problem.sheet.fixed():
        found = [[problem.integrate(n) if problem.form(n) else 0.0 for n in row] for row in pairs]
    return -np.array(found)
