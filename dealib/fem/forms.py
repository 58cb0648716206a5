"""The forms of a problem by name: energies, residuals, tangents, masses.

To add a form, add a function of the problem here and its name to `FORMS`, or to `_OF_PORTS` if the
form belongs to ports.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import ufl

from dealib.device.records import TERMINAL
from dealib.fem.electrodes import power
from dealib.fem.groups import Group

Problem: TypeAlias = Any  # `fem.potential.Problem`, which this module must not import


def ufl_form(problem: Problem, name: str) -> Any:
    """A form by name (see `Problem.form`); None or 0 where the device has no such part."""
    kind, *ports = name.split(" ")
    if name in FORMS:
        return FORMS[name](problem)
    return _OF_PORTS[kind](problem, *ports)


# --- the potential -------------------------------------------------------------------------------


def _energy(name: str, problem: Problem) -> Any:
    if problem.sheet is not None:
        return problem.sheet.energy(name)
    return problem.potential(getattr(problem, name))


def _residual(mesh: bool, problem: Problem) -> Any:
    """First variation of the potential, or of the fictitious energy of the air's mesh."""
    test = ufl.TestFunction(problem.spaces.W)
    if mesh:
        return problem.first(problem.mesh_motion, test) if problem.mesh_motion else None
    if problem.coupling.symmetric:
        first = problem.first(problem.body + problem.electric, test)
    else:
        first = problem.coupling.residual(problem, test)
    return first + _loads(problem, test)


def _tangent(mesh: bool, problem: Problem, trial: Any = None) -> Any:
    """Second variation of the potential, or of the fictitious energy of the air's mesh."""
    W, w = problem.spaces.W, problem.spaces.w
    test, trial = ufl.TestFunction(W), ufl.TrialFunction(W) if trial is None else trial
    if mesh:
        return problem.second(problem.mesh_motion, test, trial) if problem.mesh_motion else None
    if not problem.coupling.symmetric:
        return ufl.derivative(problem.coupling.residual(problem, test), w, trial)
    loads = _loads(problem, test)
    second = problem.second(problem.body + problem.electric, test, trial)
    return second + (ufl.derivative(loads, w, trial) if loads else 0)


def _along(problem: Problem) -> Any:
    return _tangent(False, problem, problem.direction)


def _loads(problem: Problem, test: Any) -> Any:
    ports = dict.fromkeys(port for port, _ in problem.loads)
    return sum(ufl.derivative(problem.load_of(port), problem.spaces.w, test) for port in ports)


def _field(problem: Problem) -> Any:
    """Second variation of the electric energies by the potential, in which they are quadratic."""
    V, last = problem.spaces.potential[0], len(problem.spaces.w) - problem.kinematics.dim - 1
    test, trial = (
        ufl.as_vector([*[0] * problem.kinematics.dim, f(V), *[0] * last])
        for f in (ufl.TestFunction, ufl.TrialFunction)
    )
    return problem.second(problem.electric, test, trial)


# --- ports without degrees of freedom ------------------------------------------------------------


def _dual(problem: Problem, port: str) -> Any:
    """Derivative of the potential by the value of a port; 0 if it does not depend on it."""
    found = problem.load_of(port, derive=True)
    if problem.sheet is not None and _terminal(problem, port):
        found += problem.sheet.dual(port)
    return found


def _column(problem: Problem, port: str) -> Any:
    """Second derivative of the potential by the value of a port and the state."""
    test = ufl.TestFunction(problem.spaces.W)
    if problem.sheet is not None and _terminal(problem, port):
        return problem.sheet.column(port, test)
    return ufl.derivative(_dual(problem, port), problem.state, test)


def _corner(problem: Problem, one: str, other: str) -> Any:
    """Second derivative of the potential by the values of two ports; 0 if there is none."""
    if problem.sheet is not None and _terminal(problem, one) and _terminal(problem, other):
        return problem.sheet.corner(one, other)
    return 0


def _terminal(problem: Problem, port: str) -> bool:
    return bool(problem.device.by_name[port].kind == TERMINAL)


# --- volumes and masses --------------------------------------------------------------------------


def _locked(problem: Problem) -> Any:
    """Mesh area in which a law is stretched to the share `locking` of its limit."""
    return sum(
        ufl.conditional(
            ufl.ge(part.extension(problem.integrals.point_of(part.on)), problem.locking), 1.0, 0.0
        )
        * problem.integrals.measure(part.on)
        for part in problem.solids
        if part.law.locks
    )


def _mounted(problem: Problem, density: Any = 1.0) -> Any:
    """Integral over the mounted volume of all materials."""
    return sum(
        problem.integrals.over(group.name, density) for group in problem.groups if group.material
    )


def _product(problem: Problem) -> Any:
    W = problem.spaces.W
    u, v = (ufl.split(f(W))[0] for f in (ufl.TestFunction, ufl.TrialFunction))
    return _mounted(problem, ufl.dot(u, v))


def _mass(name: str, problem: Problem) -> Any:
    """Forms with the mass; the density is that of the unstretched material."""
    W = problem.spaces.W
    test = ufl.split(problem.direction if name == "inertia work" else ufl.TestFunction(W))[0]
    moved = {"mass": ufl.TrialFunction(W), "mass along": problem.direction}.get(name, problem.rate)
    factor = problem.rate_factor if name == "mass along" else 1.0
    product = factor * ufl.dot(ufl.split(moved)[0], test)
    return sum(
        problem.integrals.over(g.name, problem.density[g.material] * product / _pre_volume(g))
        for g in problem.groups
        if g.material
    )


def _pre_volume(group: Group) -> Any:
    """Mounted volume per unstretched volume of a group."""
    p = group.prestretch
    return 1 if p is None else p[0] * p[1] * p[2]


FORMS: dict[str, Callable[[Problem], Any]] = {
    **{name: partial(_energy, name) for name in ("elastic", "electric", "wrinkled")},
    "residual": partial(_residual, False),
    "tangent": partial(_tangent, False),
    "mesh_residual": partial(_residual, True),
    "mesh_tangent": partial(_tangent, True),
    "along": _along,
    "field": _field,
    "locked": _locked,
    "mounted": _mounted,
    "product": _product,
    "conductance": power,
    **{n: partial(_mass, n) for n in ("mass", "mass along", "inertia", "inertia work")},
}
_OF_PORTS: dict[str, Callable[..., Any]] = {"dual": _dual, "column": _column, "corner": _corner}
