"""How the device answers small changes at its ports: one tangent, one back-substitution a port."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.fem.constraints import PORTS
from dealib.fem.system import PortLaw
from dealib.results.elements import Array

if TYPE_CHECKING:
    from dealib.fem.newton import Newton

_SMALL = 1e-4  # change of a port: of the film's thickness, of 1 kV


def port_stiffness(newton: Newton) -> Array:
    """Second derivatives of the equilibrium potential by the ports' values, (2, 2) (collective).

    With U in mm and V in kV: [[dF/dU, dF/dV], [-dQ/dU, -dQ/dV]], each at the other port's value.
    The state follows the ports along the responses of the tangent; along them the ports' duals are
    differentiated centrally.
    """
    system = newton.system
    laws, q = dict(system.ports), system.q
    values = system.map.port_values(q)
    for name, value in values.items():
        system.ports[name] = PortLaw(value=value)
    sizes = _SMALL * np.array([system.problem.config.geometry.film_thickness, 1.0])
    found = np.empty((len(PORTS), len(PORTS)))
    try:
        for k, (response, size) in enumerate(zip(newton.responses(), sizes, strict=True)):
            found[:, k] = _slope(newton, response, float(size))
    finally:
        system.ports.update(laws)
        system.residual(q, system.residual_vector)  # the duals of the state itself
    return found


def _slope(newton: Newton, response: Any, size: float) -> Array:
    """Derivatives of the ports' duals along a response."""
    system, moved = newton.system, newton.system.q.copy()
    ends = []
    for sign in (1, -1):
        system.q.copy(moved)
        moved.axpy(sign * size, response)
        system.residual(moved, system.residual_vector)
        ends.append(np.array([system.internal[name] for name in PORTS]))
    return np.asarray((ends[0] - ends[1]) / (2 * size))


def capacitances(stiffness: Array, mount: PortLaw, displacement: float) -> tuple[float, float]:
    """dQ/dV with the mount as it is driven, and at constant displacement, nF.

    Args:
        stiffness: Of the ports (see `port_stiffness`).
        mount: Equation of the mount.
        displacement: Of the mount, mm.
    """
    blocked = -stiffness[1, 1]
    if mount.value is not None:
        return float(blocked), float(blocked)
    motion = -stiffness[0, 1] / (stiffness[0, 0] - mount.balance(displacement)[1])  # dU/dV
    return float(blocked - stiffness[1, 0] * motion), float(blocked)
