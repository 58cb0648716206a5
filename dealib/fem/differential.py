"""How the device answers small changes at its ports: one tangent, one back-substitution a port."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.fem.linear import set_options
from dealib.fem.newton import Newton
from dealib.fem.problem import Problem
from dealib.fem.system import PortLaw

Array = npt.NDArray[np.float64]

_SMALL = 1e-4  # change of a port, of its size
_PREFIX, _ELECTROSTATIC = "dealib_field_", {"mat_mumps_icntl_7": 5}


def port_stiffness(newton: Newton) -> Array:
    """Second derivatives of the equilibrium potential by the ports' values, (ports, ports).

    With U in mm and V in kV: [[dF/dU, dF/dV], [-dQ/dU, -dQ/dV]], each at the other ports' values.
    The state follows the ports along the responses of the tangent; along them the ports' duals are
    differentiated centrally (collective).
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
    """Prescribe the values that all ports have, for a while."""
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
    """Derivative of the potential's slope at a port by its value, the others driven as they are.

    Args:
        stiffness: Of the ports (see `port_stiffness`).
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
    """States in which one terminal after the other has 1 kV and the body moves linearly."""
    with _prescribed(newton):
        names = list(newton.system.ports)
        responses = newton.responses()
    terminals = [port.name for port in newton.system.problem.device.of(TERMINAL)]
    return [responses[names.index(name)] for name in terminals]


def capacitance_matrix(newton: Newton) -> Array:
    """Charges on all terminals at unit voltage of each, the body frozen, nF (collective).

    Returns:
        Shape (terminals, terminals), symmetric.
    """
    system = newton.system
    names = [port.name for port in system.problem.device.of(TERMINAL)]
    with _prescribed(newton):
        system.residual(system.q, system.residual_vector)
        system.tangent(system.matrix)
        columns = [system.column(name) for name in names]
        numbers = PETSc.IS().createGeneral(system.map.numbers("potential"), comm=system.map.comm)
        inner = system.matrix.createSubMatrix(numbers, numbers)
        set_options(_PREFIX, _ELECTROSTATIC)
        solver = PETSc.KSP().create(system.map.comm)
        solver.setType("preonly")
        solver.getPC().setType("lu")
        solver.getPC().setFactorSolverType("mumps")
        solver.setOptionsPrefix(_PREFIX)
        solver.setFromOptions()
        solver.setOperators(inner)
        found = np.empty((len(names), len(names)))
        for j, column in enumerate(columns):
            right = column.getSubVector(numbers)
            x = right.duplicate()
            solver.solve(right, x)
            column.restoreSubVector(numbers, right)
            for i, other in enumerate(columns):
                at_port = system.map.port_values(column)[names[i]]
                left = other.getSubVector(numbers)
                found[i, j] = -(at_port - left.dot(x))
                other.restoreSubVector(numbers, left)
    return found
