"""Tolerances of residuals and steps by field and by port, and the comparison with them."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.fem.constraints import FIELDS
from dealib.fem.port_law import PortLaw
from dealib.fem.problem import Problem
from dealib.fem.system import System

log = logging.getLogger(__name__)

_ROUNDING = 1e4  # residual over tolerance up to which rounding may be all that is left
_STEP = 1e-7  # negligible step over the film's thickness, 1 kV, or its shear modulus


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of a problem; fields are in the order of `constraints.FIELDS`.

    Attributes:
        fields: Tolerance of the norm of each field's residual, (fields,).
        values: Tolerance of the value of a prescribed port.
        duals: Tolerance of the dual of each loaded port.
        steps: Largest negligible step of each field, (fields,): mm, kV, mm, MPa.
    """

    fields: Array
    values: float
    duals: Mapping[str, float]
    steps: Array

    @classmethod
    def of(cls, problem: Problem) -> Tolerances:
        """Products of `solver.tolerance` and characteristic forces, charges and volumes."""
        sizes, config = problem.domain.sizes, problem.config
        air = sizes.around * max(sizes.height, 1.0) * config.physics.air_stiffness
        scales = np.array([problem.force_scale, problem.charge_scale, air, sizes.volume])
        fields = config.solver.tolerance * scales
        kinds = dict(zip((MOUNT, TERMINAL, CHAMBER), fields[[0, 1, 3]], strict=True))
        kinds[TURN] = kinds[MOUNT] * sizes.span
        duals = {port.name: kinds[port.kind] for port in problem.device.ports}
        modulus = config.film.shear_modulus_at_rest
        steps = _STEP * np.array([sizes.thickness, 1.0, sizes.thickness, modulus])
        return cls(fields, config.solver.tolerance, duals, steps)

    def of_ports(self, laws: Mapping[str, PortLaw]) -> dict[str, float]:
        """Tolerance of the residual of each port's equation."""
        return {
            name: self.duals[name] if law.value is None else self.values
            for name, law in laws.items()
        }


class Judge:
    """Compares residuals and steps of a system with their tolerances, by field and by port.

    Args:
        system: The system.
    """

    def __init__(self, system: System) -> None:
        self._system, self._tolerances = system, Tolerances.of(system.problem)
        self._norms, self._worst_port = np.zeros(len(FIELDS)), 0.0

    def size(self, iteration: int) -> float:
        """Largest part of the system's residual over its tolerance; infinite if undefined.

        Args:
            iteration: Number for the log.
        """
        system, residual = self._system, self._system.residual_vector
        self._norms = system.field_norms(residual)
        ports = system.map.port_values(residual)
        if log.isEnabledFor(logging.DEBUG):
            shown = [*zip(FIELDS, self._norms, strict=True), *ports.items()]
            log.debug("  %2d  %s", iteration, "  ".join(f"{k} {abs(v):.1e}" for k, v in shown))
        limits = self._tolerances.of_ports(system.ports)
        self._worst_port = max((abs(ports[n]) / limit for n, limit in limits.items()), default=0.0)
        size = max(self._worst_field, self._worst_port)
        return size if math.isfinite(size) else math.inf

    @property
    def _worst_field(self) -> float:
        return float((self._norms / self._tolerances.fields).max())

    def met(self, step: Any, known: bool = False) -> bool:
        """Whether every field and every port is within its tolerance.

        Near incompressibility the residual cannot fall below its own rounding error, of the order
        of the bulk modulus. Newton's method has converged there when its step is negligible.

        Args:
            step: Newton's last step; None before the first.
            known: Whether the state was accepted before under the same equations, so that a step
                would only repeat rounding errors.
        """
        if not self._worst_port <= 1:
            return False
        if self._worst_field <= 1:
            return True
        if not self._worst_field <= _ROUNDING or (step is None and not known):
            return False
        if known:
            return True
        return bool((self._system.field_norms(step) <= self._tolerances.steps).all())

    def told(self, what: str) -> str:
        """The message of a failure, with the fields that exceed their tolerances."""
        worst = ", ".join(
            f"{name} {norm / limit:.1e}"
            for name, norm, limit in zip(FIELDS, self._norms, self._tolerances.fields, strict=True)
            if not norm <= limit
        )
        return f"{what} (residual over tolerance: {worst or 'ports'})"
