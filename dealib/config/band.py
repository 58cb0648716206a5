"""The small-signal spectrum of a case: its frequencies and the driven terminal."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from dealib.section import Section
from dealib.units import Frequency, Resistance

Positive = Annotated[Frequency, Field(gt=0)]


class Band(Section):
    """Small-signal spectrum at the end of the stage of the data (see dealib respond)."""

    band: tuple[Positive, Positive] = Field(
        description="lowest and highest frequency, such as [1 Hz, 1 kHz]"
    )
    points: int = Field(
        100, ge=2, le=10_000, description="number of frequencies, logarithmically spaced"
    )
    of: str | None = Field(None, description="terminal that is driven; default the first one")
    series_resistance: Resistance = Field(
        0.0, ge=0, description="resistance of the driver and its leads"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Band:
        if not self.band[0] < self.band[1]:
            raise ValueError("the band needs its lower frequency first")
        return self
