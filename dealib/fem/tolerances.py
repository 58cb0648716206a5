"""What a residual and a step are compared with, by field and by port."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.fem.problem import Problem
from dealib.fem.system import PortLaw

_STEP = 1e-7  # negligible step: of the film's thickness, of 1 kV, of its shear modulus


@dataclass(frozen=True)
class Tolerances:
    """Of one problem; fields are in the order of `constraints.FIELDS`.

    Attributes:
        fields: Of the norm of the residual of each field.
        values: Of the value of a port, where it is prescribed.
        duals: Of the dual of each port, where it is loaded.
        steps: Largest steps of each field that cannot matter: mm, kV, mm, MPa.
    """

    fields: npt.NDArray[np.float64]
    values: float
    duals: Mapping[str, float]
    steps: npt.NDArray[np.float64]

    @classmethod
    def of(cls, problem: Problem) -> Tolerances:
        """`solver.tolerance`, of forces, charges, the air's fictitious forces and the volume."""
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
        """Of the residual of each port's equation."""
        return {
            name: self.duals[name] if law.value is None else self.values
            for name, law in laws.items()
        }
