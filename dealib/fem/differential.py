"""Small-signal properties at the ports: stiffness and capacitance, from one tangent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.fem.constraints import FIELDS
from dealib.fem.linear import set_options
from dealib.fem.newton import Newton
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem

_CORRECTIONS = 20  # largest number of corrections of a test potential
_ENOUGH = 1e-12  # relative error of its energy at which it has converged
Array = npt.NDArray[np.float64]

_SMALL = 1e-4  # change of a port over its characteristic size
_PREFIX, _ELECTROSTATIC = "dealib_field_", {"mat_mumps_icntl_7": 5}


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


def capacitance_matrix(newton: Newton) -> Array:
    """Maxwell's capacitance matrix with the body fixed, nF (collective).

    Returns:
        Charges on terminals at unit voltage of each one, (terminals, terminals), symmetric.
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


def capacitance(newton: Newton, port: str) -> float:
    """Small-signal capacitance of a terminal at 0 V with the body fixed, nF.

    A back-substitution with the last tangent, which may be that of a nearby state, gives a trial
    potential for a unit test voltage, and further ones correct it. The electric energy is
    stationary in the potential, so that its error enters squared. For a sheet, which has no
    potential field, the capacitance is the derivative of the charge.
    """
    system, problem = newton.system, newton.system.problem
    if problem.sheet is not None:
        return -problem.integrate(f"corner {port} {port}")
    q, right = system.q, system.q.duplicate()
    at_once = nullcontext() if system.charging is None else system.charging.at_once()
    with system.elsewhere(), at_once:
        charge: float | None = None
        if newton.factored and system.charging is None:
            charge, _ = _test_charge(newton, port)
        if charge is None:  # the last tangent is that of a state too far away
            system.residual(q, right)
            newton.assemble()
            charge, trial = _test_charge(newton, port, needed=True)
            if system.charging is not None:  # the residual contains currents too
                system.expand(trial)
                charge = -2 * problem.integrate("electric")
    if system.charging is not None:
        system.residual(q, right)
    assert charge is not None
    return charge


def _test_charge(newton: Newton, port: str, needed: bool = False) -> tuple[float | None, Any]:
    """Charge at 1 kV at a terminal with the body fixed, uC, and the state with that potential.

    The charge is twice the energy, which is quadratic in the potential phi: with the residual r and
    the charge Q at phi it is Q - phi.r, and a correction d of the potential adds -r.d. The
    problem's state is overwritten.

    Args:
        newton: The solver, with a tangent.
        port: The terminal.
        needed: Whether to return a charge even if the corrections do not converge; otherwise the
            charge is then None.
    """
    system = newton.system
    trial, right, response = (system.q.copy() for _ in range(3))
    fields = np.flatnonzero(system.map.field == FIELDS.index("potential"))

    def size(vector: Any) -> float:
        return float(system.field_norms(vector)[FIELDS.index("potential")])

    right.set(0.0)
    system.map.set_port(right, port, 1.0)
    system.eliminate(right)
    newton.solve_linear(right, response)
    trial.array[fields] = response.array_r[fields] / system.map.port_values(response)[port]
    system.map.set_port(trial, port, 1.0)
    charge, before = 0.0, 1.0
    for _ in range(_CORRECTIONS):
        system.residual(trial, right)
        missed = right.array_r[fields]
        phi = trial.array_r[fields]
        right.set(0.0)
        right.array[fields] = missed
        newton.solve_linear(right, response)
        correction = response.array_r[fields]
        mine = float(missed @ (correction - phi))
        charge = system.map.comm.allreduce(mine) - system.internal[port]
        trial.array[fields] -= correction
        left = size(response) / (size(trial) or 1.0)  # there may be no free potential
        if left**2 * (left / before) <= _ENOUGH:
            return charge, trial
        before = left
    return charge if needed else None, trial
