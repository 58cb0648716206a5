"""Parameters of what makes stress depend on the history: Maxwell branches, softening, set.

A branch stores G/2 (tr(C C_i^-1) - 3), where C is the isochoric part of F^T F and C_i the branch's
internal metric, which relaxes towards C (see `dealib.materials.evolution`).
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

from dealib.materials.softening import Mullins, PermanentSet
from dealib.section import Section
from dealib.units import Stress, Time


class Branch(Section):
    """A neo-Hookean Maxwell branch; it resists isochoric deformation only."""

    shear_modulus: Stress = Field(
        gt=0, description="shear modulus that the branch adds under fast loading"
    )
    relaxation_time: Time = Field(
        gt=0, description="relaxation time of the stress at constant, small strain"
    )
    evolution: Literal["multiplicative", "network"] = Field(
        "multiplicative",
        description="evolution of its internal metric at large strain; multiplicative: it keeps "
        "its determinant; network: a transient network, linear, as in published branches of VHB",
    )


Network = Branch | PermanentSet


class Inelastic(BaseModel):
    """Inelastic parts of a material beside its hyperelastic law."""

    branches: tuple[Branch, ...] = Field(
        (),
        max_length=30,
        description="Maxwell branches beside the law, which alone is the long-time response",
    )
    mullins: Mullins | None = Field(
        None,
        description="Mullins softening: less stress below the largest energy so far",
    )
    permanent_set: PermanentSet | None = Field(
        None, description="a second network that re-forms in the stretched state"
    )

    @property
    def networks(self) -> tuple[Network, ...]:
        """All parts with an internal metric of their own: the branches, and the second network."""
        return self.branches if self.permanent_set is None else (*self.branches, self.permanent_set)

    @property
    def softens(self) -> bool:
        """Whether its stress depends on the largest energy density so far."""
        return self.mullins is not None or self.permanent_set is not None

    @property
    def memory(self) -> tuple[str, ...]:
        """The keys that make its stress depend on the history."""
        return tuple(key for key in Inelastic.model_fields if getattr(self, key))
