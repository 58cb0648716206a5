"""Hyperelastic laws: each class is one frozen parameter record and one pure energy function.

A new law is a new class here: its fields are its parameters, its docstring is its documentation,
`energy` is all that the solver, the plots and the pre-stretch need. The same function serves the
UFL forms (symbolic invariants, parameters as constants) and numpy. It must be the sum of a function
of the isochoric invariants and bulk_modulus/2 (J - 1)^2, which the mixed form replaces.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from dealib.errors import ValueAt
from dealib.materials.functions import POLES, chebyshev, ln, power_sum, residues
from dealib.materials.law import Invariants, Law, invariants_of_stretches
from dealib.units import Stress, list_of

if TYPE_CHECKING:
    Stresses: TypeAlias = tuple[float, ...]
    Exponents: TypeAlias = tuple[float, ...]
else:
    Stresses, Exponents = list_of(Stress), list_of(float)

_BULK = "bulk modulus kappa; needed unless youngs_modulus is given"

__all__ = ["LAWS", "Invariants", "Law", "invariants_of_stretches"]


class NeoHookean(Law):
    """Neo-Hookean: W = G/2 (I1 - 3) + kappa/2 (J - 1)^2, with the isochoric I1."""

    law: Literal["neo_hookean"]
    shear_modulus: Stress = Field(gt=0, description="shear modulus G")
    bulk_modulus: Stress = Field(gt=0, description=_BULK)

    @staticmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
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
    bulk_modulus: Stress = Field(gt=0, description=_BULK)

    @staticmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
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


class Yeoh(Law):
    """Yeoh: W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3 + kappa/2 (J - 1)^2, isochoric I1.

    O. H. Yeoh, Rubber Chem. Technol. 66, 754-771 (1993).
    """

    law: Literal["yeoh"]
    c10: Stress = Field(gt=0, description="first coefficient C10, half the shear modulus at rest")
    c20: Stress = Field(0.0, description="second coefficient C20; may be negative")
    c30: Stress = Field(0.0, description="third coefficient C30")
    bulk_modulus: Stress = Field(gt=0, description=_BULK)

    besides: ClassVar[tuple[str, ...]] = ("c20", "c30")

    @staticmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
        """C10 = E/6, kappa = 50/3 E; C20 and C30 as they are given."""
        return {"c10": modulus / 6, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density, MPa."""
        x = i.I1 - 3
        return x * (p.c10 + x * (p.c20 + x * p.c30)) + p.bulk_modulus / 2 * (i.J - 1) ** 2


class Gent(Law):
    """Gent: W = -(G/2) J_lim ln(1 - (I1 - 3)/J_lim) + kappa/2 (J - 1)^2, with the isochoric I1.

    A. N. Gent, Rubber Chem. Technol. 69, 59-61 (1996).
    """

    law: Literal["gent"]
    shear_modulus: Stress = Field(gt=0, description="shear modulus G at rest")
    j_lim: float = Field(gt=0, examples=[90.0], description="J_lim, limit of I1 - 3")
    bulk_modulus: Stress = Field(gt=0, description=_BULK)

    besides: ClassVar[tuple[str, ...]] = ("j_lim",)
    locks: ClassVar[bool] = True

    @staticmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
        """G = E/3, kappa = 50/3 E; J_lim as it is given."""
        return {"shear_modulus": modulus / 3, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density, MPa."""
        chains = -p.shear_modulus / 2 * p.j_lim * ln(1 - (i.I1 - 3) / p.j_lim)
        return chains + p.bulk_modulus / 2 * (i.J - 1) ** 2

    @staticmethod
    def extension(i: Invariants, p: Any) -> Any:
        """See `Law`: (I1 - 3) / J_lim."""
        return (i.I1 - 3) / p.j_lim


class ArrudaBoyce(Law):
    """Arruda-Boyce: eight chains of modulus G that lock at sqrt(I1/3) = L, with the isochoric I1.

    E. M. Arruda, M. C. Boyce, J. Mech. Phys. Solids 41, 389-412 (1993).
    """

    law: Literal["arruda_boyce"]
    shear_modulus: Stress = Field(
        gt=0,
        description="modulus G of the chains; at rest the shear modulus is G (1 + 3/(5 L^2)..)",
    )
    locking_stretch: float = Field(
        gt=1, examples=[6.0], description="L, limit of the chains' stretch sqrt(I1/3)"
    )
    bulk_modulus: Stress = Field(gt=0, description=_BULK)

    besides: ClassVar[tuple[str, ...]] = ("locking_stretch",)
    locks: ClassVar[bool] = True

    @staticmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
        """E/3 is the shear modulus at rest, kappa = 50/3 E; the locking stretch as it is given."""
        z = float(given["locking_stretch"]) ** -2
        if z >= 1:
            raise ValueError("chains cannot lock before they are stretched")
        at_rest = 2 / 3 * (1 / 2 - z / 10 - z**2 / 5 + 1 / (1 - z))
        return {"shear_modulus": modulus / 3 / at_rest, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density, MPa: dW/dy = G L^2 beta(y), y = sqrt(I1/3)/L, by y from rest.

        beta, the inverse Langevin function, is y (2/(1 - y^2) + 1 - y^2/5 - 2 y^4/5) here, that is
        the (3 y - y (6 y^2 + y^4 - 2 y^6)/5)/(1 - y^2) of M. Kroeger, J. Non-Newton. Fluid Mech.
        223, 77-87 (2015): exact at rest and at locking, at most 0.28 % off in between.
        """
        # its integral in z = y^2: z/2 - z^2/20 - z^3/15 - ln(1 - z), here without cancellation
        L2 = p.locking_stretch**2
        rest = 1 / L2
        x = (i.I1 - 3) / (3 * L2)
        z = rest + x
        chains = x / 2 - x * (z + rest) / 20 - x * (z**2 + z * rest + rest**2) / 15
        chains = chains - ln(1 - x / (1 - rest))
        return p.shear_modulus * L2 * chains + p.bulk_modulus / 2 * (i.J - 1) ** 2

    @staticmethod
    def extension(i: Invariants, p: Any) -> Any:
        """See `Law`: sqrt(I1/3) / L."""
        return (i.I1 / 3) ** 0.5 / p.locking_stretch


class Ogden(Law):
    """Ogden: W = sum of mu_i/alpha_i (l1^a_i + l2^a_i + l3^a_i - 3) + kappa/2 (J - 1)^2, a = alpha.

    The l are the isochoric principal stretches; any number of terms; sum of mu_i alpha_i = 2 G.
    R. W. Ogden, Proc. R. Soc. Lond. A 326, 565-584 (1972).
    """

    law: Literal["ogden"]
    mu: Stresses = Field(description="moduli mu_i, one for each term")
    alpha: Exponents = Field(
        examples=[[1.3, 5.0, -2.0]], description="exponents alpha_i, one for each term"
    )
    bulk_modulus: Stress = Field(gt=0, description=_BULK)

    besides: ClassVar[tuple[str, ...]] = ("alpha",)

    @staticmethod
    def from_youngs_modulus(modulus: float, given: Mapping[str, Any]) -> dict[str, Any]:
        """Each term has the same share of G = E/3 at rest, kappa = 50/3 E."""
        alpha = given["alpha"] if isinstance(given["alpha"], list) else [given["alpha"]]
        shares = [2 / 3 * modulus / len(alpha) / float(a) for a in alpha]
        return {"mu": shares, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i: Invariants, p: Any) -> Any:
        """Strain energy density, MPa.

        If the hoop stretch is known, I1 gives the powers of the other two (see `chebyshev`);
        otherwise I1 and I2 give those of all three (see `power_sum`).
        """
        w = p.bulk_modulus / 2 * (i.J - 1) ** 2
        if i.hoop is None:
            for k, exponent in enumerate(p.exponents):
                weights = [p.residues[k, j] for j in range(len(POLES))]
                powers = power_sum(i.I1, i.I2, exponent / 2, weights)
                w = w + p.mu[k] / exponent * (powers - 3)
            return w
        c = i.hoop
        coincidence = (i.I1 - c) / 2 * c**0.5  # 1 where the other two stretches are equal
        for k in range(len(p.mu)):
            mu, alpha = p.mu[k], p.alpha[k]
            others = 2 * c ** (-alpha / 4) * chebyshev(coincidence, alpha / 2)
            w = w + mu / alpha * (others + c ** (alpha / 2) - 3)
        return w

    @property
    def parameters(self) -> dict[str, Any]:
        """See `Law`; besides, the weights of powers (see `functions.residues`)."""
        return super().parameters | {"residues": np.array([residues(a / 2) for a in self.alpha])}

    @property
    def fixed(self) -> dict[str, Any]:
        """See `Law`: the exponents, which determine the expressions of powers."""
        return {"exponents": self.alpha}

    @model_validator(mode="after")
    def _stiff_at_rest(self) -> Ogden:
        if 0 in self.alpha:
            raise ValueAt(("alpha",), "an exponent must not be 0")
        if len(self.mu) != len(self.alpha):
            raise ValueAt(("alpha",), f"{len(self.alpha)} exponents for {len(self.mu)} moduli mu")
        if sum(m * a for m, a in zip(self.mu, self.alpha, strict=True)) <= 0:
            raise ValueAt(
                ("mu",), "the sum of mu_i alpha_i must be positive: it is twice the shear modulus"
            )
        return self


LAWS: dict[str, type[Law]] = {law.name(): law for law in Law.__subclasses__()}
