"""What an engineer asks of a history first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Actuation:
    """What the voltage did in one stage, against the state just before it.

    Attributes:
        stage: Name of the stage.
        stroke: Largest change of the displacement, mm.
        force_change: Largest change of the force, N: the blocking force if the mount is held.
        peak_voltage: kV.
    """

    stage: str
    stroke: float
    force_change: float
    peak_voltage: float


def actuations(history: pandas.DataFrame) -> list[Actuation]:
    """One entry for each stage under voltage, in order."""
    loaded = history[history["voltage_kV"] != 0]
    found = []
    for (_, stage), part in loaded.groupby(
        [loaded["stage"].ne(loaded["stage"].shift()).cumsum(), "stage"]
    ):
        before = history.loc[max(part.index[0] - 1, 0)]
        found.append(
            Actuation(
                str(stage),
                float((part["displacement_mm"] - before["displacement_mm"]).abs().max()),
                float((part["force_N"] - before["force_N"]).abs().max()),
                float(part["voltage_kV"].abs().max()),
            )
        )
    return found
