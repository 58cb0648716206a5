"""What every hyperelastic law is: a frozen parameter record and one pure energy function."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar, get_args

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import CoreSchema

from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Stress, parse, split


@dataclass(frozen=True)
class Invariants:
    """Invariants of C = F^T F; the first two are isochoric.

    Attributes:
        I1: First isochoric invariant, J^(-2/3) tr C.
        I2: Second isochoric invariant, J^(-4/3) (tr(C)^2 - tr(C^2)) / 2.
        J: det F.
        hoop: A principal value of J^(-2/3) C, that of the hoop direction; None if none is known.
    """

    I1: Any
    I2: Any
    J: Any
    hoop: Any


def invariants_of_stretches(l1: Any, l2: Any, l3: Any) -> Invariants:
    """Invariants at principal stretches (numbers or arrays, real or complex), l3 the hoop's."""
    a, b, c = l1 * l1, l2 * l2, l3 * l3
    J = l1 * l2 * l3
    q = J ** (-2 / 3)
    return Invariants(q * (a + b + c), q * q * (a * b + b * c + c * a), J, q * c)


_READ: dict[tuple[type, bool], frozenset[str]] = {}  # see `Law.reads`


class Law(Section):
    """Base of the laws: strain energy density per unstretched volume, in MPa."""

    youngs_modulus: Stress | None = Field(
        None,
        gt=0,
        exclude=True,
        description="Young's modulus at small strain; it sets the law's moduli by the "
        "thesis's rule",
    )

    besides: ClassVar[tuple[str, ...]] = ()  # parameters that Young's modulus does not set
    locks: ClassVar[bool] = False  # whether the law has a finite limit of stretch

    @classmethod
    def name(cls) -> str:
        """The law's name in the config."""
        return str(get_args(cls.model_fields["law"].annotation)[0])

    @classmethod
    @functools.cache
    def names(cls) -> tuple[str, ...]:
        """The law's own parameters, in order."""
        law = next(c for c in cls.__mro__ if issubclass(c, Law) and Law in c.__bases__)
        return tuple(n for n in law.model_fields if n not in Law.model_fields and n != "law")

    @classmethod
    def ruled(cls) -> tuple[str, ...]:
        """The law's own parameters that Young's modulus sets."""
        return tuple(n for n in cls.names() if n not in cls.besides)

    @classmethod
    def example(cls) -> dict[str, Any]:
        """Parameters as in a config: Young's modulus 1 MPa, and what else is needed."""
        given = {n: cls.model_fields[n] for n in cls.besides}
        needed = {n: (f.examples or [None])[0] for n, f in given.items() if f.is_required()}
        return {"youngs_modulus": "1 MPa"} | needed

    @staticmethod
    @abstractmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
        """Parameters in MPa at Young's modulus, kappa = 50/3 E (thesis, sections 2.2.3 and 4.2).

        Args:
            modulus: Young's modulus, MPa.
            given: The other keys of the config; `besides` among them.
        """

    @staticmethod
    @abstractmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density.

        Args:
            i: Invariants of the elastic deformation.
            p: The parameters as attributes, moduli in MPa.
        """

    @classmethod
    def isochoric_energy(cls, i: Invariants, p: Any) -> Any:
        """The energy without its volumetric part: `energy` at J = 1."""
        return cls.energy(replace(i, J=1.0), p)

    @staticmethod
    def extension(i: Invariants, p: Any) -> Any:
        """Share of the law's extensibility that is used: 1 where it locks; 0 if it never does."""
        return 0.0 * i.I1

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: Any) -> dict[str, Any]:
        """In the JSON schema too, Young's modulus stands for parameters of the law."""
        schema: dict[str, Any] = handler.resolve_ref_schema(handler(core))
        own = [n for n in schema.get("required", ()) if n in cls.names()] if cls is not Law else []
        if own:
            schema["required"] = [n for n in schema["required"] if n not in own]
            besides = [n for n in own if n in cls.besides]
            ruled = [{"required": [n]} for n in cls.ruled()]
            schema["oneOf"] = [
                {"required": ["youngs_modulus", *besides], "not": {"anyOf": ruled}},
                {"required": own, "not": {"required": ["youngs_modulus"]}},
            ]
        return schema

    @property
    def parameters(self) -> dict[str, Any]:
        """Values of the law's own parameters, in internal units; lists as arrays."""
        given = {name: getattr(self, name) for name in self.names()}
        return {n: np.array(v) if isinstance(v, tuple) else float(v) for n, v in given.items()}

    @property
    def fixed(self) -> dict[str, Any]:
        """Further parameters of `energy`, for which a form is compiled anew."""
        return {}

    @property
    def values(self) -> SimpleNamespace:
        """The parameters as `energy` takes them."""
        return SimpleNamespace(**self.parameters, **self.fixed)

    def reads(self, hoop: bool) -> frozenset[str]:
        """Names of the invariants that its energy depends on.

        Args:
            hoop: Whether the hoop's is known.
        """
        key = type(self), hoop
        if key not in _READ:
            rest = Invariants(3.0, 3.0, 1.0, 1.0 if hoop else None)
            each = {n: replace(rest, **{n: np.nan}) for n, x in vars(rest).items() if x is not None}
            p = self.values
            _READ[key] = frozenset(n for n, i in each.items() if np.isnan(self.energy(i, p)))
        return _READ[key]

    @property
    def shear_modulus_at_rest(self) -> float:
        """Shear modulus at small strain, MPa, from W = 2 G e^2 in pure shear at stretch exp(e)."""
        strain = 1e-3
        sheared = invariants_of_stretches(np.exp(strain), np.exp(-strain), 1.0)
        return float(self.energy(sheared, self.values)) / (2 * strain**2)

    @property
    def words(self) -> str:
        """The parameters in words, such as 'c10 0.25 MPa, c01 -0.05 MPa'."""

        def text(value: Any) -> str:
            if isinstance(value, list):
                return "[" + ", ".join(map(text, value)) + "]"
            number, unit = split(value)
            return f"{number:.4g} {unit}".rstrip()

        given = self.model_dump(mode="json", include=set(self.names()))
        return ", ".join(f"{name} {text(given[name])}" for name in self.names())

    @model_validator(mode="before")
    @classmethod
    def _thesis_rule(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = [name for name in cls.names() if name in data]
        by_modulus = data.get("youngs_modulus") is not None
        possible = cls.besides if by_modulus else cls.names()
        missing = [n for n in possible if cls.model_fields[n].is_required() and n not in data]
        if missing and all(key in cls.model_fields for key in data):  # else one is misspelt
            alone = " and ".join(("youngs_modulus", *_needed(cls, cls.besides)))
            rest = f", or {alone}" + ("" if cls.besides else " alone")
            rest = " besides youngs_modulus" if by_modulus else "" if given else rest
            raise ValueAt(("law",), f"{cls.name()} needs {' and '.join(missing)}{rest}")
        if missing or not by_modulus:
            return data
        double = [n for n in given if n in cls.ruled()]
        if double:
            raise ValueAt((double[0],), "give either youngs_modulus or the law's own parameters")
        try:
            modulus = parse(data["youngs_modulus"], "stress")
            ruled = cls.from_youngs_modulus(modulus if modulus > 0 else 1.0, data)
        except (ValueError, TypeError, ZeroDivisionError):
            # the field itself reports what is wrong with it
            ruled = cls.from_youngs_modulus(1.0, cls.example())
        return data | {k: _in_MPa(v) for k, v in ruled.items()}


def _needed(law: type[Law], names: tuple[str, ...]) -> list[str]:
    return [n for n in names if law.model_fields[n].is_required()]


def _in_MPa(value: Any) -> Any:
    return [_in_MPa(v) for v in value] if isinstance(value, list) else f"{value!r} MPa"
