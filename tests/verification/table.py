"""Rows of the verification table, and how they are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

HEADER = ("case", "quantity", "reference", "computed", "error", "tolerance", "source")
BEGIN, END = "<!-- verification:begin -->", "<!-- verification:end -->"


@dataclass(frozen=True)
class Row:
    """One checked number.

    Attributes:
        case: What was computed.
        quantity: Which number of it, with its unit.
        reference: What it must be.
        computed: What dealib gives.
        tolerance: Largest error allowed.
        source: Where the reference comes from.
        error_is: The difference, relative to the reference or as it is.
    """

    case: str
    quantity: str
    reference: float
    computed: float
    tolerance: float
    source: str
    error_is: Literal["relative", "absolute"] = "relative"

    @property
    def error(self) -> float:
        """Signed error of the computed number."""
        difference = self.computed - self.reference
        return difference / abs(self.reference) if self.error_is == "relative" else difference

    @property
    def passed(self) -> bool:
        """Whether the error is within its tolerance; a number that is missing (nan) is not."""
        return math.isfinite(self.error) and abs(self.error) <= self.tolerance

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the table's columns."""
        numbers = (f"{self.reference:.8g}", f"{self.computed:.8g}")
        error = f"{self.error:+.1e}" + ("" if self.error_is == "relative" else " abs.")
        mark = "" if self.passed else " FAILED"
        return (
            self.case,
            self.quantity,
            *numbers,
            error + mark,
            f"{self.tolerance:.0e}" if self.tolerance < 1e-3 else f"{self.tolerance:g}",
            self.source,
        )


@dataclass(frozen=True)
class Case:
    """A function that gives rows.

    Attributes:
        name: Short name, for the command line and for pytest.
        rows: The function.
        slow: Too long for the default test suite.
    """

    name: str
    rows: Callable[[], Iterator[Row]]
    slow: bool = False


def markdown(rows: list[Row]) -> str:
    """The table in Markdown."""
    lines = ["| " + " | ".join(HEADER) + " |", "|---|---|--:|--:|--:|--:|---|"]
    lines += ["| " + " | ".join(row.cells) + " |" for row in rows]
    return "\n".join(lines)


def write_into(readme: Path, table: str) -> None:
    """Replace what is between the two markers of a Markdown file.

    Raises:
        ValueError: If the file lacks them.
    """
    text = readme.read_text(encoding="utf-8")
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{readme}: there are no lines {BEGIN} and {END} to write between")
    readme.write_text(f"{head}{BEGIN}\n{table}\n{END}{tail}", encoding="utf-8")
