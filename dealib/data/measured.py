"""Measured curves from CSV files whose headers carry units, in the units of `history.csv`."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dealib.errors import ConfigError, did_you_mean
from dealib.units import factor

Array = npt.NDArray[np.float64]

_BRACKETS = re.compile(r"^(.*?)\s*[\[(](.*)[\])]\s*$")
_NO_UNITS = {"min", "max", "step", "steps"}  # words that end names of columns


@dataclass(frozen=True)
class Measured:
    """Columns of a data file, under the names and in the units of `history.csv`.

    Attributes:
        path: The file.
        x: Name of the column that is the abscissa.
        columns: Values of each column, (points,).
    """

    path: Path
    x: str
    columns: dict[str, Array]

    @property
    def curves(self) -> list[str]:
        """Names of the columns that are curves over the abscissa."""
        return [name for name in self.columns if name != self.x]


def read(
    path: str | Path,
    history: Iterable[str],
    names: Mapping[str, str] | None = None,
    x: str | None = None,
) -> Measured:
    """Read a data file.

    Args:
        path: CSV file with one header line; comma, semicolon or tab; lines from '#' are comments.
        history: Columns of the history that a curve can be compared with.
        names: Header of the file by quantity, where they differ; default: headers such as
            'force [mN]' or 'force_mN', of which those that the history does not know are errors.
        x: Quantity that is the abscissa; default the first column.

    Raises:
        ConfigError: If the file, a header or a value is not as it should be.
    """
    path = Path(path)
    known = {split_unit(column)[0]: column for column in history}
    headers, rows, lines = _table(path)
    if names is not None:
        for quantity, header in names.items():
            if header not in headers:
                raise ConfigError(f"{path}: no column {header!r}{did_you_mean(header, headers)}")
            if quantity not in known:
                hint = did_you_mean(quantity, known)
                raise ConfigError(f"{path}: unknown quantity {quantity!r}{hint}")
        wanted = {header: quantity for quantity, header in names.items()}
    else:
        wanted = {header: _quantity(header, known, path) for header in headers}
    columns: dict[str, Array] = {}
    for i, header in enumerate(headers):
        if header not in wanted:
            continue
        column = known[wanted[header]]
        scale = _scale(header, column, path)
        columns[column] = scale * _numbers(path, header, [row[i] for row in rows], lines)
    first = next(iter(columns), "") if x is None else known.get(x, "")
    if first not in columns or len(columns) < 2:
        what = f"a column {x!r} and one more" if x is not None else "two columns, x and y"
        raise ConfigError(f"{path}: a curve needs {what}")
    return Measured(path, first, columns)


def split_unit(name: str) -> tuple[str, str]:
    """Quantity and unit of a column: 'Force [mN]' -> force, mN; 'field_max_MV_per_m' -> MV/m."""
    if found := _BRACKETS.match(name):
        return _plain(found[1]), found[2].strip()
    parts = name.strip().replace(" ", "_").split("_")
    for k in range(1, len(parts)):
        unit = "_".join(parts[k:]).replace("_per_", "/")
        if unit not in _NO_UNITS and _is_unit(unit):
            return _plain("_".join(parts[:k])), unit
    return _plain(name), ""


def _plain(name: str) -> str:
    return re.sub(r"[\s-]+", "_", name.strip()).lower()


def _is_unit(text: str) -> bool:
    try:
        factor(text, text)
    except ValueError:
        return False
    return True


def _quantity(header: str, known: Mapping[str, str], path: Path) -> str:
    quantity = split_unit(header)[0]
    if quantity not in known:
        hint = did_you_mean(quantity, known)
        raise ConfigError(f"{path}: column {header!r} is no quantity of a run{hint}")
    return quantity


def _scale(header: str, column: str, path: Path) -> float:
    """Factor from the unit of a header to that of a column of the history."""
    given, unit = split_unit(header)[1], split_unit(column)[1]
    if unit and not given:
        raise ConfigError(f"{path}: column {header!r} has no unit; write '{header} [{unit}]'")
    try:
        return factor(given or "dimensionless", unit or "dimensionless")
    except ValueError as error:
        raise ConfigError(f"{path}: column {header!r}: {error}") from None


def _table(path: Path) -> tuple[list[str], list[list[str]], list[int]]:
    """Headers, rows, and the line number of each row."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the data: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    lines = [
        (n, line)
        for n, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) < 3:
        raise ConfigError(f"{path}: expected a header line and at least two lines of numbers")
    delimiter = max(";\t,", key=lines[0][1].count)
    rows = [
        [c.strip() for c in row] for row in csv.reader((x for _, x in lines), delimiter=delimiter)
    ]
    if delimiter == ";":  # where a comma may be the decimal sign
        rows[1:] = [[c.replace(",", ".") for c in row] for row in rows[1:]]
    for (n, _), row in zip(lines, rows, strict=True):
        if len(row) != len(rows[0]):
            raise ConfigError(f"{path}:{n}: {len(row)} values for {len(rows[0])} columns")
    if len(set(rows[0])) < len(rows[0]):
        raise ConfigError(f"{path}:{lines[0][0]}: two columns have the same header")
    return rows[0], rows[1:], [n for n, _ in lines[1:]]


def _numbers(path: Path, header: str, texts: list[str], lines: list[int]) -> Array:
    values = np.empty(len(texts))
    for i, (text, line) in enumerate(zip(texts, lines, strict=True)):
        try:
            values[i] = float(text)
        except ValueError:
            raise ConfigError(f"{path}:{line}: {header}: {text!r} is no number") from None
        if not np.isfinite(values[i]):
            raise ConfigError(f"{path}:{line}: {header}: {text!r} is not finite")
    return values
