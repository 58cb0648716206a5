"""Tables in spreadsheets (XLSX, XLS, ODS) and in MAT files."""

from __future__ import annotations

import datetime
import io
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.data.cells import Ambiguous, decimal_mark
from dealib.data.decode import LARGEST
from dealib.data.lines import choose, is_row
from dealib.data.matfile import HDF5
from dealib.data.names import parted
from dealib.data.table import DataColumn, DataTable, assemble
from dealib.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from dealib.data.schema import Format

_ZIP, _OLE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
_OTHERS = {
    b"TDSm": "a TDMS file of LabVIEW: save it as LVM or as text",
    b"\x1f\x8b": "a compressed file: unpack it",
    b"%PDF": "a PDF: take the table out of it, as text",
    b"\x89PNG": "a picture: a plot digitiser makes a table of it",
}


def read_book(path: Path, data: bytes, wanted: Format) -> DataTable | None:
    """Read a spreadsheet or a MAT file; None if the file is neither.

    Args:
        path: The file, for messages.
        data: Content of the file.
        wanted: Sheet or variable, and number of the table.

    Raises:
        ConfigError: If the file is damaged, or has no table or several.
    """
    for mark, what in _OTHERS.items():
        if data.startswith(mark):
            raise ConfigError(f"{path}: {what}")
    if data.startswith((_ZIP, _OLE)):
        return _spreadsheet(path, data, wanted)
    if data.startswith((b"MATLAB", HDF5)) or path.suffix.lower() == ".mat":
        return _mat(path, wanted)
    return None


def _spreadsheet(path: Path, data: bytes, wanted: Format) -> DataTable:
    from python_calamine import CalamineWorkbook

    try:
        if data.startswith(_ZIP):
            with zipfile.ZipFile(io.BytesIO(data)) as parts:
                if sum(part.file_size for part in parts.infolist()) > LARGEST:
                    raise ConfigError(f"{path}: larger than {LARGEST >> 30} GB when unpacked")
        book = CalamineWorkbook.from_filelike(io.BytesIO(data))
        hidden = {m.name for m in book.sheets_metadata if "Visible" not in str(m.visible)}
        names = [n for n in book.sheet_names if n not in hidden or n == wanted.sheet]
        if wanted.sheet is not None:
            if wanted.sheet not in names:
                hint = did_you_mean(wanted.sheet, names)
                raise ConfigError(f"{path}: no sheet {wanted.sheet!r}{hint}")
            names = [wanted.sheet]
        sheets = {n: book.get_sheet_by_name(n).to_python(skip_empty_area=False) for n in names}
    except ConfigError:
        raise
    except Exception as error:  # calamine has an error of its own for each format
        raise ConfigError(f"{path}: cannot be read as a spreadsheet: {error}") from None
    found = {name: flags for name, rows in sheets.items() if (flags := _flags(rows))[0].sum() > 1}
    if not found:
        raise ConfigError(f"{path}: expected a header and at least two rows of numbers")
    if len(found) > 1:
        named = ", ".join(map(repr, found))
        raise ConfigError(f"{path}: tables in the sheets {named}: choose with format.sheet")
    ((name, flags),) = found.items()
    return _sheet(path, data, name, sheets[name], flags, wanted)


def _flags(rows: list[list[Any]]) -> tuple[Any, Any]:
    """Which rows of a sheet contain numbers, and which rows end a table."""
    numbers = np.array(
        [sum(isinstance(c, float) for c in r) > 1 or is_row(_texts(r)) for r in rows], dtype=bool
    )
    blank = np.array([not any(c != "" for c in r) for r in rows], dtype=bool)
    ends = ~numbers & ~blank
    ends[1:] |= blank[1:] & blank[:-1]
    return numbers, ends


def _sheet(
    path: Path,
    data: bytes,
    name: str,
    rows: list[list[Any]],
    flags: tuple[Any, Any],
    wanted: Format,
) -> DataTable:
    import pandas as pd

    start, stop, told = choose(path, *flags, wanted.table)
    above: list[list[str]] = []
    for row in reversed(rows[max(start - 4, 0) : start]):
        texts = _texts(row)
        if sum(map(bool, texts)) < 1 + (sum(c != "" for c in rows[start]) > 1):
            break
        above.insert(0, texts)
    body = [r for r, kept in zip(rows[start:stop], flags[0][start:stop], strict=True) if kept]
    at = np.flatnonzero(flags[0][start:stop]) + start
    frame = pd.DataFrame(
        {
            i: pd.Series([_plain(c) for c in column])
            for i, column in enumerate(zip(*body, strict=True))
        }
    )
    for i in _percentages(data, name, above, int(at[0])):
        frame[i] *= 100
    try:
        words = [[c for c in frame[i] if isinstance(c, str)] for i in frame.columns]
        decimal = wanted.decimal or decimal_mark(words) or "."
    except Ambiguous as error:
        raise ConfigError(f"{path}: {error}; say which with format.decimal") from None
    header = f"header in row {start}" if above else "no header"
    notes = [f"sheet {name!r}", header, f"{len(frame)} rows from row {start + 1} on", *told]
    return assemble(path, above, frame, decimal, lambda row: f"row {at[max(row, 0)] + 1}", notes)


def _percentages(data: bytes, sheet: str, above: list[list[str]], row: int) -> list[int]:
    """Numbers of the columns in percent whose cells hold 0.12 and are displayed as 12 %."""
    columns = [i for texts in above for i, text in enumerate(texts) if "%" in text]
    if not columns or not data.startswith(_ZIP):
        return []
    import openpyxl

    book = openpyxl.load_workbook(io.BytesIO(data), read_only=True)
    cells = next(book[sheet].iter_rows(min_row=row + 1, max_row=row + 1))
    return [i for i in columns if "%" in (cells[i].number_format or "")]


def _texts(row: list[Any]) -> list[str]:
    return [str(c).strip() for c in row]


def _plain(cell: Any) -> Any:
    """A cell as a number or a text; None if it is empty."""
    if isinstance(cell, datetime.timedelta):
        minutes, seconds = divmod(cell.total_seconds(), 60)
        return f"{minutes // 60:.0f}:{minutes % 60:02.0f}:{seconds:09.6f}"
    if isinstance(cell, str | datetime.date | datetime.time):
        return str(cell).strip().replace("−", "-") or None
    return float(cell)


def _mat(path: Path, wanted: Format) -> DataTable:
    # in another process, because scipy crashes on some damaged files
    command = [sys.executable, "-m", "dealib.data.matfile", str(path)]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise ConfigError(f"{path}: cannot be read as a MAT file: {(said or ['damaged'])[0]}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as stored:
        arrays = {str(name): stored[f"arr_{i}"] for i, name in enumerate(stored["names"])}
    columns: dict[int, list[DataColumn]] = {}
    for name, values in arrays.items():
        if wanted.sheet is not None and wanted.sheet not in (name, name.split(".")[0]):
            continue
        wide = values if values.ndim == 1 or values.shape[0] >= values.shape[1] else values.T
        for i, column in enumerate(wide.reshape(len(wide), -1).T, start=1):
            header = name if wide.ndim == 1 else f"{name} {i}"
            numbers = np.where(np.isfinite(column), column, np.nan)
            empty = int(np.isnan(numbers).sum())
            columns.setdefault(len(column), []).append(DataColumn(*parted(header), numbers, empty))
    tables = {n: found for n, found in columns.items() if len(found) > 1}
    if not tables:
        known = ", ".join(arrays) or "none"
        raise ConfigError(
            f"{path}: expected vectors of one length, or a matrix with a column each; numbers are "
            f"in: {known}. Tables of MATLAB itself: save table2struct(T, 'ToScalar', true)"
        )
    names = {n: ", ".join(c.name for c in found[:4]) for n, found in tables.items()}
    listed = "; ".join(f"{i}: {n} rows of {names[n]}" for i, n in enumerate(tables, start=1))
    if wanted.table is None and len(tables) > 1:
        raise ConfigError(f"{path}: {len(tables)} tables ({listed}): choose with format.table")
    if (wanted.table or 1) > len(tables):
        raise ConfigError(f"{path}: there is no table {wanted.table}; it has {listed}")
    rows, found = list(tables.items())[(wanted.table or 1) - 1]
    left = sum(len(others) for n, others in columns.items() if n != rows)
    told = [f"{left} of other lengths left out"] if left else []
    return DataTable(path, tuple(found), ("MAT file", f"{rows} rows", *told))
