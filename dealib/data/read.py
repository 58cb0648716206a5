"""Reading of data files of laboratory software, plot digitisers and spreadsheets."""

from __future__ import annotations

from pathlib import Path

from dealib.data.decode import as_utf8, load
from dealib.data.schema import Format
from dealib.data.table import DataTable


def read(path: str | Path, wanted: Format | None = None) -> DataTable:
    """Read the table of a text file, a spreadsheet (XLSX, XLS, ODS) or a MAT file.

    Encoding, delimiter, decimal mark, header and units are recognised from all rows of the file;
    `DataTable.account` says how it was read.

    Args:
        path: The file.
        wanted: Settings for what the file does not determine.

    Raises:
        ConfigError: If it is none of these, is damaged, or can be read in two ways.
    """
    path, wanted = Path(path), wanted or Format()
    data = load(path)
    from dealib.data import books

    if table := books.read_book(path, data, wanted):
        return table
    from dealib.data.text import read_text

    text, notes = as_utf8(path, data, wanted.encoding)
    del data
    return read_text(path, text, wanted, notes)
