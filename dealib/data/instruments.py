"""Header lines of particular instruments, from which units and times are taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from dealib.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

Rows = list[list[str]]


@dataclass(frozen=True)
class Hints:
    """Information in the lines above a table.

    Attributes:
        delimiter: Delimiter of the columns; None if unknown.
        decimal: The decimal mark; None if unknown.
        channels: Rows about channels in LabVIEW's LVM files, by their first word.
        start: Number of lines at the top that do not belong to a table.
    """

    delimiter: str | None = None
    decimal: str | None = None
    channels: dict[str, list[str]] = field(default_factory=dict)
    start: int = 0

    def applied(self, above: Rows, frame: pd.DataFrame) -> tuple[Rows, pd.DataFrame]:
        """Header and cells, completed by units and by times that the file only implies."""
        if self.channels and above:
            return self._lvm(above[-1], frame)
        named = (
            dict(zip((c.lower() for c in above[0]), above[1], strict=False)) if above[1:] else {}
        )
        if {"start", "increment"} <= set(named):  # Rigol: the first column counts
            frame[0] = _steps(named["start"], named["increment"], frame)
            units = ["s", *("" if np.isfinite(_number(u)) else u for u in above[1][1:])]
            return [["time", *above[0][1:]], units], frame
        return above, frame

    def _lvm(self, names: list[str], frame: pd.DataFrame) -> tuple[Rows, pd.DataFrame]:
        in_time = "time" in " ".join(self.channels.get("X_Dimension", ["time"])).lower()
        labels = iter(self.channels.get("Y_Unit_Label", []))
        heads = []
        for i, name in enumerate(names):
            if name != "X_Value":
                unit = next(labels, "")
                heads.append(f"{name} [{unit}]" if unit else name)
                continue
            heads.append("time [s]" if in_time else name)
            if frame[i].isna().all() and self.channels.get("Delta_X"):
                step = self.channels["Delta_X"][0]
                frame[i] = _steps(self.channels.get("X0", ["0"])[0], step, frame)
        return [heads], frame


def hints(lines: Sequence[str]) -> Hints:
    """The information in the first lines of a file."""
    if not lines or not lines[0].startswith("LabVIEW Measurement"):
        return Hints()
    by = next(
        (line[9] for line in lines if line.startswith("Separator") and line[9:10] in ",\t;"), "\t"
    )
    found = {
        cells[0]: [c.strip() for c in cells[1:]] for line in lines if (cells := line.split(by))
    }
    decimal = next(iter(found.get("Decimal_Separator", [])), None) or None
    ends = [i for i, line in enumerate(lines) if line.startswith("***End_of_Header***")]
    return Hints(by, decimal, found, ends[min(1, len(ends) - 1)] + 1 if ends else 0)


def _steps(first: str, step: str, frame: pd.DataFrame) -> Array:
    return np.asarray(_number(first) + _number(step) * np.arange(len(frame)), dtype=np.float64)


def _number(text: str) -> float:
    """A number with either decimal mark; NaN if it is none."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return float("nan")
