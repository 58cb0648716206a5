"""Measured curves under the names and in the units of `history.csv`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dealib.data.names import plain, split_unit
from dealib.data.prepare import Columns, averaged, prepare, resampled
from dealib.data.read import read
from dealib.data.schema import Selection
from dealib.data.table import DataColumn, DataTable
from dealib.errors import ConfigError, did_you_mean
from dealib.units import convert

TIME = "time_s"


@dataclass(frozen=True)
class Measured:
    """Columns of a data file, under the names and in the units of `history.csv`.

    Attributes:
        path: The file.
        x: Name of the abscissa's column.
        columns: Values of each column, (points,), x first; NaN where a curve has no value.
        account: How the file was read and prepared, in one line.
        turn: How far the abscissa must move back to begin a new branch; None: by its noise.
    """

    path: Path
    x: str
    columns: Columns
    account: str = ""
    turn: float | None = None

    @property
    def curves(self) -> list[str]:
        """Names of the columns that are curves over the abscissa; a time is no curve."""
        return [name for name in self.columns if name not in (self.x, TIME)]

    @property
    def points(self) -> int:
        """Number of measured values of all curves."""
        return sum(int(np.isfinite(self.columns[name]).sum()) for name in self.curves)


def measured(path: str | Path, history: Iterable[str], wanted: Selection | None = None) -> Measured:
    """Read the curves of a data file that a history can be compared with.

    Args:
        path: The file.
        history: Columns of the history.
        wanted: Which columns are taken, and how they are prepared. By default all columns are
            taken by their headers, such as 'force [mN]', and each must be known to the history.

    Raises:
        ConfigError: If the file, a header or a value is wrong.
    """
    path, wanted = Path(path), wanted or Selection(file=str(path))
    known = {split_unit(column)[0]: column for column in history}
    table = read(path, wanted.format)
    taken = _taken(table, known, wanted)
    columns: Columns = {}
    for quantity, column in taken.items():
        unit = split_unit(known[quantity])[1]
        if unit and not column.unit:
            raise ConfigError(
                f"{path}: column {column.header!r} has no unit; write '{column.name} [{unit}]', "
                f"here or as columns: {{{quantity}: '{column.name} [{unit}]'}}"
            )
        try:
            columns[known[quantity]] = column.in_unit(unit)
        except ValueError as error:
            raise ConfigError(f"{path}: column {column.header!r}: {error}") from None
    first = next(iter(columns), "") if wanted.x is None else known.get(plain(wanted.x), "")
    if first not in columns or len(columns) < 2:
        what = (
            f"a column {wanted.x!r} and one more"
            if wanted.x is not None
            else "two columns, x and y"
        )
        raise ConfigError(f"{path}: a curve needs {what}")
    try:
        columns, turn, done = _prepared(columns, first, known, wanted)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
    rows = len(columns[first])
    columns = _curves(path, columns, first)
    if left := rows - len(columns[first]):
        done.append(f"{left} row{'s' * (left > 1)} without a point left out")
    sources = ", ".join(f"{known[q]} from {c.header!r}" for q, c in taken.items())
    notes = [table.account, f"x is {first}", sources, *done]
    return Measured(path, first, columns, "; ".join(notes), turn)


def _taken(table: DataTable, known: dict[str, str], wanted: Selection) -> dict[str, DataColumn]:
    """Columns of the file by quantity, in the order of the file."""
    if wanted.columns is not None:
        for quantity in wanted.columns:
            if quantity not in known:
                hint = did_you_mean(quantity, known)
                raise ConfigError(f"{table.path}: unknown quantity {quantity!r}{hint}")
        found = {q: table.find(header) for q, header in wanted.columns.items()}
        names = [c.name for c in table.columns]
        return dict(sorted(found.items(), key=lambda item: names.index(item[1].name)))
    ignored = {table.find(header).header for header in wanted.ignore}
    nameless = {c.header for c in table.columns if re.fullmatch(r"column \d+", c.name)}
    if len(nameless) < len(table.columns):  # counts of rows, notes
        ignored |= nameless
    found = {}
    for column in table.columns:
        if column.header in ignored:
            continue
        quantity = plain(column.name)
        if quantity not in known:  # 'voltage (ch 1)'
            quantity = plain(re.sub(r"\([^()]*\)", "", column.name))
        if quantity not in known:
            hint = did_you_mean(quantity, known)
            raise ConfigError(
                f"{table.path}: column {column.header!r} is no quantity of a run{hint}; "
                f"name those that are (columns) or leave it out (ignore)"
            )
        if quantity in found:
            pair = f"{found[quantity].header!r} and {column.header!r}"
            raise ConfigError(
                f"{table.path}: columns {pair} are both {quantity}: name one (columns) or leave "
                "one out (ignore)"
            )
        found[quantity] = column
    return found


def _prepared(
    columns: Columns, x: str, known: dict[str, str], wanted: Selection
) -> tuple[Columns, float | None, list[str]]:
    """The prepared columns, how far x must move back for a new branch, and notes."""

    def named(quantity: str, key: str) -> str:
        name = known.get(quantity, "")
        if name not in columns:
            taken = [q for q, c in known.items() if c in columns]
            raise ValueError(f"{key}: no column {quantity!r}{did_you_mean(quantity, taken)}")
        return name

    done: list[str] = []
    if wanted.prepare:
        by_name = {named(q, "prepare"): p for q, p in wanted.prepare.items()}
        columns, done = prepare(columns, by_name)
    if wanted.plateaus is not None:
        over = named(wanted.plateaus.of, "plateaus.of")
        columns, notes = averaged(columns, over, wanted.plateaus)
        done += notes
    turn = None if wanted.turn is None else convert(wanted.turn, split_unit(x)[1])
    if wanted.resample is not None:
        good = np.isfinite(columns[x])
        columns = {name: values[good] for name, values in columns.items()}
        columns, notes = resampled(columns, x, wanted.resample, turn)
        done += notes
    return columns, turn, done


def _curves(path: Path, columns: Columns, x: str) -> Columns:
    """The columns without rows that have no point of any curve."""
    curves = {n: v for n, v in columns.items() if n not in (x, TIME)}
    if not curves:
        raise ConfigError(f"{path}: a curve needs two columns, x and y, that are no times")
    kept = np.isfinite(columns[x]) & np.any([np.isfinite(v) for v in curves.values()], axis=0)
    if kept.sum() < 2:
        raise ConfigError(f"{path}: fewer than two rows have numbers for x and a curve")
    for name, values in curves.items():
        if not np.isfinite(values[kept]).any():
            raise ConfigError(f"{path}: {name} has no number in any row that has {x}")
    return {x: columns[x][kept], **{n: v[kept] for n, v in columns.items() if n != x}}
