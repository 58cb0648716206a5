"""A table of named columns with units, and notes on how it was read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.arrays import Array
from dealib.data.cells import Ambiguous, convert
from dealib.data.names import Header, headers, is_unit, parted, plain, scale, spelt
from dealib.errors import ConfigError, did_you_mean
from dealib.units import factor

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class DataColumn:
    """A column of numbers.

    Attributes:
        name: The header without the unit.
        unit: The unit as written; empty if there is none.
        values: Numbers, (rows,), NaN where a cell has none.
        empty: Number of empty cells.
        overload: Number of cells that say that the instrument was overloaded.
    """

    name: str
    unit: str
    values: Array
    empty: int = 0
    overload: int = 0

    @property
    def header(self) -> str:
        """Name and unit, such as 'Force [mN]'."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def in_unit(self, unit: str) -> Array:
        """The values in a unit, (rows,); the empty unit is for dimensionless numbers.

        Raises:
            ValueError: If the column has no unit, or one of another kind.
        """
        if unit and not self.unit:
            raise ValueError(f"has no unit; write it as '{self.name} [{unit}]'")
        return self.values * scale((self.name, self.unit), unit)


@dataclass(frozen=True, repr=False)
class DataTable:
    """The table of a file.

    Attributes:
        path: The file.
        columns: The columns, all of one length.
        notes: Notes on how it was read.
    """

    path: Path
    columns: tuple[DataColumn, ...]
    notes: tuple[str, ...]

    @property
    def account(self) -> str:
        """Name of the file and notes on how it was read, in one line."""
        return f"{self.path.name}: {'; '.join(self.notes)}"

    def __repr__(self) -> str:
        return f"<Table {self.path}: {', '.join(self.headers)}>"

    @property
    def frame(self) -> pd.DataFrame:
        """The columns by their headers, for pandas."""
        import pandas as pd

        return pd.DataFrame({c.header: c.values for c in self.columns})

    @property
    def headers(self) -> list[str]:
        """Names and units of all columns."""
        return [c.header for c in self.columns]

    def find(self, header: str) -> DataColumn:
        """A column by its header, or by its name alone.

        'Load [N]' also finds a column 'Load' without a unit in the file, and gives it this unit.

        Raises:
            ConfigError: If there is none, or there are several.
        """
        name, unit = parted(header)
        for matches in (
            [c for c in self.columns if header.strip() in (c.header, c.name)],
            [c for c in self.columns if plain(c.name) == plain(name) and unit in ("", c.unit)],
            [
                replace(c, unit=unit)
                for c in self.columns
                if plain(c.name) == plain(name) and not c.unit
            ],
        ):
            if len(matches) > 1:
                named = " and ".join(repr(c.header) for c in matches)
                raise ConfigError(f"{self.path}: {header!r} may be {named}: name one in full")
            if matches:
                return matches[0]
        hint = did_you_mean(header, self.headers)
        raise ConfigError(f"{self.path}: no column {header!r}{hint}")


def assemble(
    path: Path,
    above: Sequence[Sequence[str]],
    frame: pd.DataFrame,
    decimal: str,
    line: Callable[[int], str],
    notes: Sequence[str],
) -> DataTable:
    """A table from the rows above its numbers and its cells.

    Args:
        path: The file, for messages.
        above: Rows of the header; may be empty.
        frame: Numbers or texts, a column each.
        decimal: The decimal mark.
        line: Gives the place of a row of the frame in the file, for messages.
        notes: Notes so far.

    Raises:
        ConfigError: If a cell is no number, or can be read in two ways.
    """
    named = headers(above, frame.shape[1])
    width = max((len(row) for row in above), default=frame.shape[1])
    columns: list[DataColumn] = []
    notes, texts = list(notes), []
    for i, header in enumerate(named):
        cells = frame[frame.columns[i]]
        filled = int(cells.notna().sum())
        if not filled:
            continue
        if i >= width:
            said = f"{width} headers for more columns"
            raise ConfigError(f"{path}:{line(-1)}: {said}; give each column a header")
        try:
            found = convert(cells, decimal, header[1])
        except Ambiguous as error:
            raise ConfigError(f"{path}: column {_shown(header)!r}: {error}") from None
        if found.text:
            if not (columns and _gives_units(columns, cells)):
                texts.append(header[0])
            continue
        if found.faults:
            row, text = found.faults[0]
            mark = f" with the decimal mark {decimal!r}" if set(text) & set(".,") else ""
            where = f"{path}:{line(row)}: {_shown(header)}"
            raise ConfigError(f"{where}: {text!r} is no number{mark}")
        notes += [f"{header[0]}: {found.note}"] if found.note else []
        unit = found.unit or header[1]
        columns.append(DataColumn(header[0], unit, found.values, found.empty, found.overload))
    if texts:
        notes.append(f"text left out: {_listed(texts)}")
    for what in ("empty", "overload"):
        if count := sum(getattr(c, what) for c in columns):
            notes.append(f"{count} {what} cell{'s' * (count > 1)}")
    return DataTable(path, tuple(columns), tuple(notes))


def _gives_units(columns: list[DataColumn], words: pd.Series[Any]) -> bool:
    """Whether a column of words holds units for the column before it, which then gets them."""
    column, units = columns[-1], [str(w).strip() for w in words.fillna("")]
    kinds = {u for u in units if u}
    if column.unit or not kinds or not all(map(is_unit, kinds)):
        return False
    first = next(u for u in units if u)
    try:
        factors = {u: factor(spelt(u), spelt(first)) for u in kinds} | {"": np.nan}
    except ValueError:
        return False
    values = column.values * np.array([factors[u] for u in units])
    columns[-1] = replace(column, unit=first, values=values)
    return True


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _shown(header: Header) -> str:
    return f"{header[0]} [{header[1]}]" if header[1] else header[0]
