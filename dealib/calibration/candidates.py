"""Candidate models of a material: a law with branches, softening and permanent set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np

from dealib.arrays import Array
from dealib.calibration.coupon_data import CouponTest
from dealib.calibration.task import History, Values
from dealib.errors import NotConverged
from dealib.materials import coupon
from dealib.materials.law import Law
from dealib.materials.softening import Mullins, PermanentSet


@dataclass(frozen=True)
class Candidate:
    """A candidate model of a material.

    Attributes:
        law: The law.
        terms: Number of terms of the law ogden; 0 for other laws.
        branches: Number of Maxwell branches.
        evolution: Evolution equation of the branches, 'multiplicative' or 'network'.
        mullins: Whether it has Mullins softening.
        set: Whether it has a permanent set.
        unit: Unit in which moduli are fitted, 'kPa' or 'MPa'.
    """

    law: type[Law]
    terms: int
    branches: int
    evolution: str
    mullins: bool
    set: bool
    unit: str

    @property
    def label(self) -> str:
        """Its name for reports, such as 'ogden, 2 terms, 1 branch'."""
        parts = [self.law.name() + (f", {self.terms} terms" if self.terms > 1 else "")]
        if self.branches:
            parts.append("1 branch" if self.branches == 1 else f"{self.branches} branches")
        parts += ["mullins"] * self.mullins + ["permanent set"] * self.set
        return ", ".join(parts)

    @property
    def moduli(self) -> list[str]:
        """The law's moduli, in which its stress is linear."""
        return [k for n in self._names() if _is_stress(self.law, n) for k in self._keys(n)]

    @property
    def shapes(self) -> list[str]:
        """The law's other parameters."""
        return [k for n in self._names() if not _is_stress(self.law, n) for k in self._keys(n)]

    def _names(self) -> list[str]:
        return [n for n in self.law.names() if n != "bulk_modulus"]

    def _keys(self, name: str) -> list[str]:
        return [f"{name}.{k}" for k in range(self.terms)] if self.terms else [name]

    def positive(self, key: str) -> bool:
        """Whether a parameter must be positive."""
        field = self.law.model_fields.get(key.split(".")[0])
        return field is None or any(getattr(m, "gt", None) is not None for m in field.metadata)

    def material(self, values: Values) -> coupon.IncompressibleMaterial:
        """The material at parameter values, with moduli in `unit`."""
        scale = 1e-3 if self.unit == "kPa" else 1.0
        p: dict[str, Any] = {}
        for name in self._names():
            factor = scale if _is_stress(self.law, name) else 1.0
            found = [factor * values[key] for key in self._keys(name)]
            p[name] = np.array(found) if self.terms else found[0]
        branches = tuple(
            (scale * values[f"branches.{k}.shear_modulus"], values[f"branches.{k}.relaxation_time"])
            for k in range(self.branches)
        )
        mullins = network = None
        if self.mullins:
            given = {"r": values["mullins.r"], "m": scale * values["mullins.m"]}
            mullins = Mullins.model_construct(None, **given)
        if self.set:
            names = ("shear_modulus", "energy")
            given = {name: scale * values[f"permanent_set.{name}"] for name in names}
            network = PermanentSet.model_construct(None, **given)
        law = SimpleNamespace(**p, bulk_modulus=0.0)
        return coupon.IncompressibleMaterial(
            self.law, law, self.evolution, branches, mullins, network
        )

    def fitted(self, values: Values) -> Law:
        """The law with these parameters, even if a config would refuse them."""
        p = vars(self.material(values).p)
        given: dict[str, Any] = {"law": self.law.name()}
        given |= {k: tuple(v) if isinstance(v, np.ndarray) else v for k, v in p.items()}
        return self.law.model_construct(None, **given)

    def solve(
        self, specimens: Sequence[CouponTest], sets: list[Values]
    ) -> list[list[History | NotConverged]]:
        """Histories of all tests at each set of values."""
        materials = [self.material(values) for values in sets]
        columns = [
            [_history(s, stress) for stress in coupon.stresses(s.path, materials)]
            for s in specimens
        ]
        return [[column[k] for column in columns] for k in range(len(sets))]


def _is_stress(law: type[Law], name: str) -> bool:
    notes = [law.model_fields[name].metadata, get_args(law.model_fields[name].annotation)]
    return "'stress'" in repr(notes)


def _history(specimen: CouponTest, stress: Array) -> History | NotConverged:
    if not np.isfinite(stress).all():
        return NotConverged("the law locks within the test")
    return specimen.history(stress)
