"""Quantities at points of the body, by name: for probes, and for pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.kinematics import Kinematics


@dataclass(frozen=True)
class Here:
    """Points of cells of one material in a state.

    Attributes:
        material: `results.stress.RegionMaterial`.
        k: `results.stress.Deformation` there.
        u: Displacement, (..., axes), mm.
        phi: Potential, (...), kV.
        pressure: The mixed form's p, (...), MPa, or None.
        internal: C_i of Maxwell branches, (..., branches, 4), or None.
    """

    material: Any
    k: Any
    u: Array
    phi: Array
    pressure: Array | None = None
    internal: Array | None = None

    @property
    def total(self) -> Array:
        """Deformation gradient since the unstretched state."""
        return np.asarray(self.k.F * self.material.stretch)

    @property
    def elastic(self) -> Array:
        """True stress of the material, MPa; zero in air and rigid blocks."""
        if self.material.law is None:
            return np.zeros_like(self.k.F)
        return np.asarray(self.material.true_stress(self.k, self.pressure, self.internal))

    @property
    def electric(self) -> Array:
        """Maxwell stress, which adds to the material's true stress, MPa."""
        if not self.material.permittivity:
            return np.zeros_like(self.k.F)
        return np.asarray(self.material.electric_stress(self.k))


@dataclass(frozen=True)
class LocalQuantity:
    """One quantity.

    Attributes:
        unit: Its unit; empty for plain numbers.
        evaluate: Its values at points.
    """

    unit: str
    evaluate: Callable[[Here], Array]

    @property
    def suffix(self) -> str:
        """Suffix of a column's name, made of the unit."""
        return f"_{self.unit.replace('/', '_per_')}" if self.unit else ""


def _component(i: int, j: int, of: Callable[[Here], Array]) -> Callable[[Here], Array]:
    return lambda here: of(here)[..., i, j]


def _stretch(i: int) -> Callable[[Here], Array]:
    return lambda here: np.asarray(np.linalg.norm(here.total[..., i], axis=-1))


def local_quantities(kinematics: Kinematics) -> dict[str, LocalQuantity]:
    """All quantities of a space, by name."""
    Q = LocalQuantity
    names = kinematics.components
    found = {
        "phi": Q("kV", lambda here: here.phi),
        "E": Q("MV/m", lambda here: np.asarray(np.linalg.norm(here.k.e, axis=-1))),
        "D": Q(
            "uC/mm2",
            lambda here: here.material.permittivity_at(here.k) * np.linalg.norm(here.k.e, axis=-1),
        ),
        "J": Q("", lambda here: here.k.J),
        "thickness_stretch": Q(
            "",
            lambda here: (
                here.material.stretch[here.material.normal]
                / np.linalg.norm(here.k.inverse[..., here.material.normal, :], axis=-1)
            ),
        ),
        "area_stretch": Q("", lambda here: here.material.area_stretch(here.k)),
    }
    for k, axis in enumerate(kinematics.axes):
        found[f"u_{axis}"] = Q("mm", lambda here, k=k: here.u[..., k])  # type: ignore[misc]
        found[f"E_{axis}"] = Q("MV/m", lambda here, k=k: here.k.e[..., k])  # type: ignore[misc]
    for i, a in enumerate(names):
        found[f"stretch_{a}"] = Q("", _stretch(i))
        for j, b in enumerate(names[i:], start=i):
            found[f"elastic_{a}{b}"] = Q("MPa", _component(i, j, lambda here: here.elastic))
            found[f"maxwell_{a}{b}"] = Q("MPa", _component(i, j, lambda here: here.electric))
            found[f"stress_{a}{b}"] = Q(
                "MPa", _component(i, j, lambda here: here.elastic + here.electric)
            )
    return found
