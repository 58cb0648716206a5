"""Read a laboratory's data file, whichever program wrote it."""

from __future__ import annotations

from pathlib import Path

from dealib.data.decode import as_utf8, load
from dealib.data.schema import Format
from dealib.data.table import Table


def read(path: str | Path, wanted: Format | None = None) -> Table:
    """Read the table of a text file, a spreadsheet (XLSX, XLS, ODS) or a MAT file.

    Encoding, delimiter, decimal mark, header and units are told by the file itself, by all its
    rows together; `Table.account` says what was decided.

    Args:
        path: The file.
        wanted: What it does not tell.

    Raises:
        ConfigError: If it is none of these, is damaged, or has two readings.
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
