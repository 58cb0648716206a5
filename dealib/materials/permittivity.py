"""Permittivity of a film: constant, or linear in its stretch."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from dealib.section import Section


class StretchPermittivity(Section):
    """Relative permittivity that depends on stretch: intercept + slope * stretch.

    The stretch is sqrt(l1 l2), the square root by which the film's area has grown since its
    unstretched state: the stretch itself when equal-biaxial, lz^(-1/2) when incompressible.
    """

    intercept: float = Field(description="relative permittivity extrapolated to the stretch 0")
    slope: float = Field(description="its change per unit of stretch; negative for most films")

    def at(self, stretch: Any) -> Any:
        """Relative permittivity at a stretch."""
        return self.intercept + self.slope * stretch


def _kind(value: object) -> str:
    return "by stretch" if isinstance(value, (dict, StretchPermittivity)) else "number"


RelativePermittivity = Annotated[
    Annotated[float, Field(ge=1), Tag("number")]
    | Annotated[StretchPermittivity, Tag("by stretch")],
    Discriminator(_kind),
]
