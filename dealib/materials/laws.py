"""Hyperelastic laws: each class is one frozen parameter record and one pure energy function.

A new law is a new class here: its fields are its parameters, its docstring is its documentation,
`energy` is all that the solver, the plots and the pre-stretch need. The same function serves the
UFL forms (symbolic invariants, parameters as constants) and numpy. It separates: a function of I1
and I2, plus bulk_modulus/2 (J - 1)^2, which the mixed form replaces by its own.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import CoreSchema

from dealib.errors import ValueAt
from dealib.units import Stress, parse


@dataclass(frozen=True)
class Invariants:
    """Invariants of C = F^T F, isochoric where barred.

    Attributes:
        I1: First isochoric invariant, J^(-2/3) tr C.
        I2: Second isochoric invariant, J^(-4/3) (tr(C)^2 - tr(C^2)) / 2.
        J: det F.
    """

    I1: Any
    I2: Any
    J: Any


def invariants_of_stretches(l1: Any, l2: Any, l3: Any) -> Invariants:
    """Invariants at principal stretches (numbers or arrays, real or complex)."""
    a, b, c = l1 * l1, l2 * l2, l3 * l3
    J = l1 * l2 * l3
    return Invariants(J ** (-2 / 3) * (a + b + c), J ** (-4 / 3) * (a * b + b * c + c * a), J)


class Law(BaseModel):
    """Base of the laws: strain energy density per unstretched volume, in MPa."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    youngs_modulus: Stress | None = Field(
        None,
        gt=0,
        exclude=True,
        description="Young's modulus at small strain; alone, it sets the parameters by the "
        "thesis's rule",
    )

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The law's own parameters, in order."""
        law = LAWS[_name(cls)]
        return tuple(n for n in law.model_fields if n not in Law.model_fields and n != "law")

    @staticmethod
    @abstractmethod
    def from_youngs_modulus(modulus: float) -> dict[str, float]:
        """Parameters in MPa by the rule of the thesis (sections 2.2.3 and 4.2)."""

    @staticmethod
    @abstractmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density.

        Args:
            i: Invariants of the elastic deformation.
            p: The parameters, as attributes of the law's names, in MPa.
        """

    @classmethod
    def isochoric_energy(cls, i: Invariants, p: Any) -> Any:
        """The energy without its volumetric part: `energy` at J = 1."""
        return cls.energy(Invariants(i.I1, i.I2, 1.0), p)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: Any) -> dict[str, Any]:
        """In the JSON schema too, Young's modulus alone stands for the law's parameters."""
        schema: dict[str, Any] = handler.resolve_ref_schema(handler(core))
        own = [n for n in schema.get("required", ()) if n in cls.names()] if cls is not Law else []
        if own:
            schema["required"] = [n for n in schema["required"] if n not in own]
            of_law = [{"required": [n]} for n in cls.names()]
            schema["oneOf"] = [
                {"required": ["youngs_modulus"], "not": {"anyOf": of_law}},
                {"required": own, "not": {"required": ["youngs_modulus"]}},
            ]
        return schema

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the law's own parameters, in internal units."""
        return {name: float(getattr(self, name)) for name in self.names()}

    @model_validator(mode="before")
    @classmethod
    def _thesis_rule(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = [name for name in cls.names() if name in data]
        if data.get("youngs_modulus") is None:
            needed = [n for n in cls.names() if cls.model_fields[n].is_required()]
            missing = [n for n in needed if n not in data]
            if missing and all(key in cls.model_fields for key in data):  # else one is misspelt
                rest = "" if given else ", or youngs_modulus alone"
                raise ValueAt(("law",), f"{_name(cls)} needs {' and '.join(missing)}{rest}")
            return data
        if given:
            raise ValueAt((given[0],), "give either youngs_modulus or the law's own parameters")
        try:
            modulus = parse(data["youngs_modulus"], "stress")
        except ValueError:
            modulus = 1.0  # the field itself reports what is wrong with it
        return data | {k: f"{v!r} MPa" for k, v in cls.from_youngs_modulus(modulus).items()}


class NeoHookean(Law):
    """Neo-Hookean: W = G/2 (I1 - 3) + kappa/2 (J - 1)^2, with the isochoric I1."""

    law: Literal["neo_hookean"]
    shear_modulus: Stress = Field(gt=0, description="shear modulus G")
    bulk_modulus: Stress = Field(gt=0, description="bulk modulus kappa")

    @staticmethod
    def from_youngs_modulus(modulus: float) -> dict[str, float]:
        """G = E/3, kappa = 50/3 E (thesis, Table 1)."""
        return {"shear_modulus": modulus / 3, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density, MPa."""
        return p.shear_modulus / 2 * (i.I1 - 3) + p.bulk_modulus / 2 * (i.J - 1) ** 2


class MooneyRivlin(Law):
    """Mooney-Rivlin: W = C10 (I1 - 3) + C01 (I2 - 3) + kappa/2 (J - 1)^2, isochoric I1, I2."""

    law: Literal["mooney_rivlin"]
    c10: Stress = Field(description="first coefficient C10")
    c01: Stress = Field(description="second coefficient C01; may be negative")
    bulk_modulus: Stress = Field(gt=0, description="bulk modulus kappa")

    @staticmethod
    def from_youngs_modulus(modulus: float) -> dict[str, float]:
        """C10 = E/4, C01 = -E/12, kappa = 50/3 E (thesis, eq. 22, 23 and Table 1)."""
        return {"c10": modulus / 4, "c01": -modulus / 12, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density, MPa."""
        return p.c10 * (i.I1 - 3) + p.c01 * (i.I2 - 3) + p.bulk_modulus / 2 * (i.J - 1) ** 2

    @model_validator(mode="after")
    def _stiff_at_rest(self) -> MooneyRivlin:
        if self.c10 + self.c01 <= 0:
            raise ValueAt(
                ("c01",), "c10 + c01 must be positive: it is half the shear modulus at rest"
            )
        return self


def _name(law: type[Law]) -> str:
    return str(get_args(law.model_fields["law"].annotation)[0])


LAWS: dict[str, type[Law]] = {_name(law): law for law in Law.__subclasses__()}
