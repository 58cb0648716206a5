"""Maxwell branches beside a hyperelastic law: their parameters.

A branch stores G/2 (tr(C C_i^-1) - 3), where C is the isochoric part of F^T F and C_i the metric
that it would relax to (`dealib.materials.evolution` says how).
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from dealib.units import Stress, Time


class Branch(BaseModel):
    """A neo-Hookean Maxwell branch, of changes of shape only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    shear_modulus: Stress = Field(gt=0, description="it adds to the law's when loaded fast")
    relaxation_time: Time = Field(gt=0, description="of its stress at constant, small strain")
    evolution: Literal["multiplicative", "network"] = Field(
        "multiplicative",
        description="of its internal metric at large strain; multiplicative: it keeps its "
        "determinant; network: a transient network, linear, as in published branches of VHB",
    )


class Viscoelastic(BaseModel):
    """What a law gets besides its own parameters."""

    branches: tuple[Branch, ...] = Field(
        (),
        max_length=30,
        description="Maxwell branches beside the law, which alone is left in the long run",
    )
