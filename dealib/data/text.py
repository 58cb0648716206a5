"""Tables in text files: rows of numbers, delimiter, decimal mark, and header."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterator, Sequence
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dealib.data.cells import Ambiguous, decimal_mark, kind
from dealib.data.instruments import hints
from dealib.data.lines import (
    ABOVE,
    COMMENT,
    DELIMITERS,
    Flags,
    Ints,
    Lines,
    choose,
    find_delimiter,
    find_rows,
    split,
    without_notes,
)  # fmt: skip
from dealib.data.table import DataTable, assemble
from dealib.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd

    from dealib.data.schema import Format


def read_text(path: Path, data: bytes, wanted: Format, notes: Sequence[str]) -> DataTable:
    """Read the table of a text file.

    Args:
        path: The file, for messages.
        data: Its text in UTF-8.
        wanted: The user's settings for its format.
        notes: Notes so far.

    Raises:
        ConfigError: If there is no table or are several, or a line can be read in two ways.
    """
    lines = Lines.of(data)
    fixed = hints([lines[i] for i in range(min(len(lines), ABOVE))])
    delimiter = wanted.delimiter or fixed.delimiter or find_delimiter(lines)
    rows, ends, words = find_rows(lines, delimiter)
    rows[: fixed.start] = False
    start, stop, told = choose(path, rows, ends, wanted.table, words)
    at = without_notes(lines, np.flatnonzero(rows[start:stop]) + start, delimiter)
    start, stop = int(at[0]), int(at[-1]) + 1
    if (np.diff(lines.starts[stop:]) > 1).any() and not told:
        told = ["lines below it left out"]
    chosen = at[np.unique(np.linspace(0, len(at) - 1, 2000).astype(int))]
    sample = [split(lines[i], delimiter) for i in chosen.tolist()]
    widest = max(map(len, sample))
    width = max((i for row in sample for i, c in enumerate(row, start=1) if c), default=widest)
    above, last = _above(path, lines, start, delimiter, width, widest)
    decimal = wanted.decimal or fixed.decimal
    if decimal is None:
        if delimiter == "," and not above and '"' not in lines[start]:
            _refuse_two_readings(path, lines, at, sample)
        decimal = _decimal(path, lines, (start, stop), delimiter, sample)
    frame = _frame(path, lines, (start, stop), delimiter, decimal, widest, rows)
    told = [
        *notes,
        f"columns separated by {DELIMITERS.get(delimiter, repr(delimiter))}",
        f"decimal mark {decimal!r}",
        f"header in line {last}" if above else "no header",
        f"{len(frame)} rows from line {start + 1} on",
        *told,
    ]
    above, frame = fixed.applied(above, frame)
    return assemble(path, above, frame, decimal, lambda row: str(at[max(row, 0)] + 1), told)


def _above(
    path: Path, lines: Lines, start: int, delimiter: str, width: int, widest: int
) -> tuple[list[list[str]], int]:
    """Rows of the header, and the number of its last line.

    They are the lines above the table that have as many cells as it has columns.

    Raises:
        ConfigError: If the line above has another number of cells, or an open quote.
    """
    found: list[list[str]] = []
    last = 0
    for first, text in reversed(list(_records(lines, max(start - ABOVE, 0), start, delimiter))):
        if not text.strip():
            if found:
                break
            continue
        mark = COMMENT.match(text)
        bare = text[mark.end() :] if mark else text
        if _opens(bare, delimiter):
            raise ConfigError(f"{path}:{first + 1}: a quote is opened and never closed")
        cells = split(bare, delimiter)
        if len(cells) == 1 or delimiter == " ":  # the header may have another delimiter
            options = [cells, *(split(bare, d) for d in DELIMITERS)]
            options.append(re.split(r"\s{2,}", bare.strip()))
            cells = next((c for c in options if width <= len(c) <= widest), cells)
        while len(cells) > widest and (not cells[-1] or cells[-1] == "Comment"):
            cells.pop()
        if all(kind(c) == "missing" for c in cells):  # a rule of dashes
            continue
        if not width <= len(cells) <= widest:
            if found or len([c for c in cells if c]) < 2 or mark:
                break
            raise ConfigError(
                f"{path}:{first + 1}: {len(cells)} headers for {width} columns of numbers; put "
                "headers that contain a comma or a blank in quotes, and separate numbers with "
                "decimal commas by another delimiter"
            )
        found.insert(0, cells)
        last = last or first + 1
        if len(found) == 6:
            break
    return found, last


def _records(lines: Lines, start: int, stop: int, delimiter: str) -> Iterator[tuple[int, str]]:
    """Lines with their numbers; a line with an open quote is joined with the next ones."""
    i = start
    while i < stop:
        first, text = i, lines[i]
        joined = text
        while _opens(joined, delimiter) and i + 1 < min(stop, first + 6):
            i += 1
            joined += " " + lines[i]
        if _opens(joined, delimiter):  # the quote is never closed
            joined, i = text, first
        yield first, joined
        i += 1


def _opens(text: str, delimiter: str) -> bool:
    """Whether a quoted cell is not closed; an inch mark does not count as a quote."""
    return text.count('"') % 2 == 1 and bool(re.search(rf'(^|{re.escape(delimiter)})\s*"', text))


def _decimal(
    path: Path, lines: Lines, span: tuple[int, int], delimiter: str, sample: Sequence[Sequence[str]]
) -> str:
    """The decimal mark, from a sample of rows or, if that is ambiguous, from all rows."""
    try:
        if mark := decimal_mark(zip_longest(*sample, fillvalue="")):
            return mark
    except Ambiguous:
        pass
    every = [split(lines[i], delimiter) for i in range(*span)]
    try:
        return decimal_mark(zip_longest(*every, fillvalue="")) or "."
    except Ambiguous as error:
        raise ConfigError(f"{path}: {error}; say which with format.decimal") from None


def _refuse_two_readings(path: Path, lines: Lines, rows: Ints, sample: Sequence[list[str]]) -> None:
    """Refuse rows without headers whose commas may separate columns, decimals or thousands.

    Examples are '0,25,-2,27', '0,25, -2,27' and '1.5,2,418.5' among rows of other lengths.
    """
    widths = {len(row) for row in sample}
    whole = all(re.fullmatch(r"[+-]?\d*", c) for row in sample for c in row)
    texts = (lines[i] for i in rows[:2000].tolist())
    mixed = any(re.search(r"\d,\s", t) and re.search(r"\d,\d", t) for t in texts)
    columns = list(zip_longest(*sample, fillvalue=""))
    grouped = any(  # 3,132.5 or 3 and 132.5
        all(re.fullmatch(r"[+-]?[1-9]\d{0,2}", c) for c in first)
        and all(re.fullmatch(r"\d{3}(\.\d*)?", c) for c in second)
        for first, second in pairwise(columns)
    )
    if whole or mixed or grouped or len(widths) > 1:
        shown = lines[int(rows[0])].strip()[:40]
        raise ConfigError(
            f"{path}:{rows[0] + 1}: the commas of {shown!r} may separate columns, decimals or "
            "thousands; if all of them separate columns, set format.decimal to '.', otherwise add "
            "a line of headers"
        )


def _frame(
    path: Path, lines: Lines, span: tuple[int, int], delimiter: str, decimal: str, width: int,
    rows: Flags,
) -> pd.DataFrame:  # fmt: skip
    """The cells of a table by columns; columns of numbers only are converted."""
    import pandas as pd

    start, stop = span
    data = lines.data[lines.starts[start] : lines.starts[stop]]
    others = np.flatnonzero(~rows[start:stop]) + start
    others = others[np.diff(lines.starts)[others] > 1]
    if len(others):  # comments among the rows
        kept = np.setdiff1d(np.arange(start, stop), others)
        data = b"".join(lines.data[lines.starts[i] : lines.starts[i + 1]] for i in kept)
    quoted = b'"' in data
    if quoted:
        odd = lines.having(np.frombuffer(lines.data, np.uint8) == 34)[start:stop] % 2 == 1
        if odd.any():
            where = start + int(np.argmax(odd)) + 1
            raise ConfigError(f"{path}:{where}: a quote is opened and never closed")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                io.BytesIO(data),
                sep=r"\s+" if delimiter == " " else delimiter,
                decimal=decimal,
                header=None,
                names=list(range(width + 1)),  # one more, to find lines that are too long
                index_col=False,
                skipinitialspace=True,
                quoting=csv.QUOTE_MINIMAL if quoted else csv.QUOTE_NONE,
                low_memory=False,
                float_precision="round_trip",
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning):
        frame = None
    if frame is None or frame[width].notna().any():
        fault = _misfit(path, lines, span, delimiter, width)
        raise fault or ConfigError(f"{path}: the rows cannot be read as a table")
    short = delimiter == " " and frame[width - 1].isna().any()
    if short and (fault := _misfit(path, lines, span, delimiter, width, shorter=True)):
        raise fault  # with blanks as delimiter nobody knows which cell is missing
    return frame.drop(columns=width)


def _misfit(
    path: Path, lines: Lines, span: tuple[int, int], by: str, width: int, shorter: bool = False
) -> ConfigError | None:
    """An error about the first line with more cells than columns, or, if `shorter`, with fewer."""
    for i in range(*span):
        cells = [] if COMMENT.match(lines[i]) else split(lines[i], by)
        if len(cells) > width or (shorter and 0 < len(cells) < width):
            return ConfigError(f"{path}:{i + 1}: {len(cells)} values for {width} columns")
    return None
