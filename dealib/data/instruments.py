"""What the header lines of single programs say that no table shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

Rows = list[list[str]]


@dataclass(frozen=True)
class Hints:
    """What the lines above a table say about it.

    Attributes:
        delimiter: Between the columns; None if they do not say.
        decimal: The decimal mark; None if they do not say.
        channels: Of LabVIEW's LVM files the rows about channels, by their first word.
        start: Number of lines at the top that are no table.
    """

    delimiter: str | None = None
    decimal: str | None = None
    channels: dict[str, list[str]] = field(default_factory=dict)
    start: int = 0

    def applied(self, above: Rows, frame: pd.DataFrame) -> tuple[Rows, pd.DataFrame]:
        """Header and cells with what the hints add: units, and times that are not written."""
        if self.channels and above:
            return self._lvm(above[-1], frame)
        names = [c.lower() for c in above[0]] if len(above) > 1 else []
        if "increment" in names and "start" in names:  # Rigol: the first column counts
            first, step = (float(above[1][names.index(n)]) for n in ("start", "increment"))
            frame[0] = first + step * np.arange(len(frame))
            units = ["s", *(u if not _is_number(u) else "" for u in above[1][1:])]
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
            if frame[i].isna().all() and "Delta_X" in self.channels:
                mark = self.decimal or "."
                first, step = (
                    float(self.channels.get(k, ["0"])[0].replace(mark, "."))
                    for k in ("X0", "Delta_X")
                )
                frame[i] = first + step * np.arange(len(frame))
        return [heads], frame


def hints(lines: Sequence[str]) -> Hints:
    """What the first lines of a file say."""
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


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
