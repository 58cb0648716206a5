"""Names of the fields that can be drawn, such as 'S_RR', 'E' or 'phi', with labels and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.device import Device
from dealib.device.kinematics import Kinematics
from dealib.errors import ConfigError, did_you_mean
from dealib.results.summary import MARGINS

NOISE = 1e-14  # smaller values are rounding, in internal units: at 0 V the field is 1e-19 MV/m


@dataclass(frozen=True)
class FieldQuantity:
    """A scalar to draw.

    Attributes:
        name: Name that the user writes, such as 'S_RR'.
        label: Label in pictures, with the symbol.
        unit: Unit; '' if it has none.
        field: Name of the array that it is taken from (see `dealib.results.fields`).
        component: Indices into that array; None for a scalar, or for the length of a vector.
        factor: Factor from internal units to `unit`.
    """

    name: str
    label: str
    unit: str
    field: str
    component: tuple[int, ...] | None = None
    factor: float = 1.0

    @property
    def is_use(self) -> bool:
        """Whether it is a margin, of which 1 is the limit."""
        return self.name in MARGINS

    @property
    def is_mode(self) -> bool:
        """Whether it is the shape of a mode."""
        return self.field.startswith("mode")

    @property
    def of_solids(self) -> bool:
        """Whether it exists only in regions that carry stress."""
        return self.field in ("second_pk_stress", "cauchy_stress")

    @property
    def of_films(self) -> bool:
        """Whether it exists only in dielectrics that carry stress."""
        return self.field in ("tension", *MARGINS) or self.name == SURFACE_CHARGE.name

    @property
    def is_electric(self) -> bool:
        """Whether it vanishes in conductors."""
        return self.field in ("E", "D", "maxwell_stress")

    @property
    def title(self) -> str:
        """Label with the unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def of(self, arrays: Mapping[str, Array]) -> Array:
        """Nodal values from the arrays of a state.

        Raises:
            ConfigError: If the run has no such field.
        """
        if self.field not in arrays:
            why = "it exists with physics.wrinkling: tension_field only"
            if self.is_use:
                why = "its config sets no limit"
            elif self.is_mode:
                why = "modes exist where stability is lost, with output.modes above 0"
            raise ConfigError(f"{self.name}: the run has no such field; {why}")
        values = arrays[self.field]
        if self.component is not None:
            index: Any = (..., *self.component)
            values = values[index]
        elif values.ndim == 2:
            values = np.linalg.norm(values, axis=1)
        if self.field == "wrinkling":  # extrapolation to the nodes may be negative
            values = np.maximum(values, 0.0)
        return self.factor * np.where(np.abs(values) < NOISE, 0.0, values)


@cache
def quantities(kinematics: Kinematics) -> dict[str, FieldQuantity]:
    """All fields of a kind of space by name; names contain components, with T for theta."""
    found = [
        FieldQuantity("phi", "Electric potential φ", "kV", "phi"),
        FieldQuantity("J", "Volume ratio J", "", "J"),
        FieldQuantity("wrinkling", "Wrinkling: excess length", "", "wrinkling"),
        FieldQuantity("tension", "Smallest in-plane stress", "MPa", "tension"),
    ]
    for key, (name, *_) in MARGINS.items():
        found.append(FieldQuantity(key, f"{name.capitalize()}: use (1 is the limit)", "", key))
    for key, label, unit, field, factor in (
        ("u", "Displacement", "mm", "u", 1.0),
        ("E", "Electric field", "MV/m", "E", 1.0),
        ("D", "Electric displacement", "mC/m²", "D", 1e3),
    ):
        found.append(FieldQuantity(key, f"{label} |{key}|", unit, field, None, factor))
        found += [
            FieldQuantity(f"{key}_{c}", f"{label} {key}$_{c}$", unit, field, (k,), factor)
            for k, c in enumerate(kinematics.axes)
        ]
    for k in range(1, 10):
        name = "mode" + (str(k) if k > 1 else "")
        found.append(FieldQuantity(name, f"Mode {k}: displacement over the largest", "", name))
    letters = [c[0].upper() for c in kinematics.components]
    pairs = [(k, k) for k in range(3)] + list(combinations(range(kinematics.dim), 2))
    for key, symbol, label, field in (
        ("S", "S", "Second Piola-Kirchhoff stress", "second_pk_stress"),
        ("sigma", "σ", "Cauchy stress", "cauchy_stress"),
        ("maxwell", "T", "Maxwell stress", "maxwell_stress"),
    ):
        for pair in pairs:
            sub = "".join(letters[k] for k in pair)
            index = sub.replace("T", r"\theta ")
            shown = f"{label} {symbol}$_{{{index}}}$"
            found.append(FieldQuantity(f"{key}_{sub}", shown, "MPa", field, pair))
    return {q.name: q for q in found}


SURFACE_CHARGE = FieldQuantity("D_n", "Surface charge density D·n", "mC/m²", "D", factor=1e3)


def quantity(
    name: str, kinematics: Kinematics, kind: str = "field", also: tuple[FieldQuantity, ...] = ()
) -> FieldQuantity:
    """Find a quantity by its name.

    Args:
        name: Name that the user wrote.
        kinematics: Kinematics of the run.
        kind: Word for it in messages.
        also: Further quantities that are allowed, such as `SURFACE_CHARGE`.

    Raises:
        ConfigError: If there is none of this name.
    """
    known = {q.name: q for q in also} | quantities(kinematics)
    if name not in known:
        raise ConfigError(f"there is no {kind} {name!r} to draw{did_you_mean(name, known)}")
    return known[name]


def main_stress(device: Device) -> str:
    """Name of the stress along the layers, or along the first axis."""
    axes = device.kinematics.axes
    along = axes[0] if device.laminate is None else device.laminate.base.along
    return f"S_{2 * (along if along in axes else axes[0])}"
