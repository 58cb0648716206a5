"""Tables in text files: which lines are numbers, what parts the columns, what stands above."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dealib.data.cells import Ambiguous, decimal_mark, kind
from dealib.data.instruments import hints
from dealib.data.table import Table, assemble
from dealib.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd

    from dealib.data.schema import Format

Flags = npt.NDArray[np.bool_]

_DELIMITERS = {"\t": "tab", ";": "';'", "|": "'|'", ",": "','", " ": "blanks"}
_COMMENT = re.compile(r"\s*(?:#(?!N/A|DIV|VALUE|WERT|REF|NUM|NAME|NULL|ZAHL)|%|//|!|\*\*)+\s*")
_PLAIN = np.zeros(256, dtype=bool)  # bytes of lines that need no look: numbers and what parts them
_PLAIN[list(b"0123456789+-.,;:/ \t\"'|eETZ\n")] = True
_DIGITS = {bytes([c]) for c in b"0123456789+-.,"}
_HEAD, _ABOVE = 3000, 200  # lines that are looked at for the delimiter, and for the header
_LARGE = 10  # a table with so many times the rows of all others is the one that is meant


@dataclass(frozen=True)
class Lines:
    """A text by lines, as bytes.

    Attributes:
        data: The text in UTF-8.
        starts: Where each line starts, and the end (lines + 1,).
    """

    data: bytes
    starts: npt.NDArray[np.int64]

    @classmethod
    def of(cls, data: bytes) -> Lines:
        """The lines of a text."""
        ends = np.flatnonzero(np.frombuffer(data, np.uint8) == 10) + 1
        tail = [] if data.endswith(b"\n") else [len(data)]
        return cls(data, np.concatenate([[0], ends, tail]).astype(np.int64))

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, i: int) -> str:
        return self.data[self.starts[i] : self.starts[i + 1]].decode().rstrip("\n")

    def having(self, at: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
        """Number of marked bytes in each line (lines,)."""
        line = np.searchsorted(self.starts, np.flatnonzero(at), side="right") - 1
        return np.bincount(line, minlength=len(self)).astype(np.int64)


def split(line: str, delimiter: str) -> list[str]:
    """Cells of a line."""
    if delimiter == " ":
        parts = re.split(r"\s{2,}|\t", line.strip())
        words = re.findall(r"\"[^\"]*\"|\S+(?:\s*[\[(][^\])]*[\])])?", line)
        return [w.strip('"') for w in (words if len(words) > len(parts) else parts)]
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [" ".join(c.split()) for c in cells]


def read_text(path: Path, data: bytes, wanted: Format, notes: Sequence[str]) -> Table:
    """Read the table of a text file.

    Args:
        path: The file, for messages.
        data: Its text in UTF-8.
        wanted: What the user says about its format.
        notes: What was decided so far.

    Raises:
        ConfigError: If there is no table or are several, or a line has no single reading.
    """
    lines = Lines.of(data)
    fixed = hints([lines[i] for i in range(min(len(lines), _ABOVE))])
    delimiter = wanted.delimiter or fixed.delimiter or _delimiter(lines)
    rows, ends, words = _rows(lines, delimiter)
    rows[: fixed.start] = False
    start, stop, told = choose(path, rows, ends, wanted.table, words)
    at = _without_notes(lines, np.flatnonzero(rows[start:stop]) + start, delimiter)
    start, stop = int(at[0]), int(at[-1]) + 1
    if (np.diff(lines.starts[stop:]) > 1).any() and not told:
        told = ["what stands below left out"]
    chosen = at[np.unique(np.linspace(0, len(at) - 1, 2000).astype(int))]
    sample = [split(lines[i], delimiter) for i in chosen.tolist()]
    widest = max(map(len, sample))
    width = max((i for row in sample for i, c in enumerate(row, start=1) if c), default=widest)
    above, last = _above(path, lines, start, delimiter, width, widest)
    decimal = wanted.decimal or fixed.decimal
    if decimal is None:
        _refuse_split_decimals(path, start, delimiter, sample, above)
        decimal = _decimal(path, lines, (start, stop), delimiter, sample)
    frame = _frame(path, lines, (start, stop), delimiter, decimal, widest, rows)
    told = [
        *notes,
        f"columns parted by {_DELIMITERS.get(delimiter, repr(delimiter))}",
        f"decimal mark {decimal!r}",
        f"header in line {last}" if above else "no header",
        f"{len(frame)} rows from line {start + 1} on",
        *told,
    ]
    above, frame = fixed.applied(above, frame)
    return assemble(path, above, frame, decimal, lambda row: str(at[max(row, 0)] + 1), told)


def _delimiter(lines: Lines) -> str:
    """The delimiter by which most lines are rows of numbers, and of nothing else."""
    head = [line for i in range(min(len(lines), _HEAD)) if (line := lines[i]).strip()]
    scores = {}
    for delimiter in _DELIMITERS:
        score = 0.0
        for line in head:
            cells = split(line, delimiter)
            kinds = [kind(c) for c in cells]
            if delimiter == "," and '"' not in line:  # '1,5 200,5' are two numbers
                kinds = ["text" if " " in c and k == "number" else k
                         for c, k in zip(cells, kinds, strict=True)]  # fmt: skip
            numbers, texts = sum(k in ("number", "time") for k in kinds), kinds.count("text")
            if numbers > texts and len(kinds) > 1:
                score += 0.5 if texts else 1
        scores[delimiter] = score
    best = max(scores, key=lambda d: scores[d])  # of equal ones the first
    return best if scores[best] else ","


def is_row(cells: Sequence[str]) -> bool:
    """Whether cells are a row of a table: numbers, and not many texts beside them."""
    kinds = [kind(c) for c in cells]
    numbers, texts = sum(k in ("number", "time") for k in kinds), kinds.count("text")
    return (not texts and any(cells)) or (numbers > 1 and 2 * numbers >= texts)


def _rows(lines: Lines, delimiter: str) -> tuple[Flags, Flags, Flags]:
    """Which lines are rows of numbers, end a table, or are rows that begin with a word (lines,)."""
    codes = np.frombuffer(lines.data, np.uint8)
    look = lines.having(~_PLAIN[codes]) > 0
    blank = np.diff(lines.starts) <= 1
    look[:_ABOVE] = True
    look &= ~blank
    rows, ends, words = ~look & ~blank, np.zeros_like(look), np.zeros_like(look)
    ends[1:] = blank[1:] & blank[:-1]
    width, by, starts = 0, None if delimiter == " " else delimiter.encode(), lines.starts
    for i in np.flatnonzero(look).tolist():
        parts = lines.data[starts[i] : starts[i + 1]].split(by)
        if i > _ABOVE and len(parts) == width and sum(p[:1] in _DIGITS for p in parts) > 1:
            rows[i] = True  # like the one before, seen at a glance
            continue
        cells = split(lines[i], delimiter)
        if _COMMENT.match(lines[i]):
            continue
        if is_row(cells):
            rows[i], words[i], width = True, kind(cells[0]) == "text", len(cells)
        elif rows[i - 1] and kind(cells[0]) != "text" and len(cells) == width:
            rows[i] = any(kind(c) == "number" for c in cells)  # one with a bad cell
        ends[i] = not rows[i]
    return rows, ends, words


def choose(
    path: Path, rows: Flags, ends: Flags, wanted: int | None, words: Flags | None = None
) -> tuple[int, int, list[str]]:
    """The lines of the table that is meant, from and to, and what else there is.

    Args:
        path: The file, for messages.
        rows: Lines that are rows of numbers.
        ends: Lines that end a table.
        wanted: Number of the table; None: the one that is much larger than all others.
        words: Rows that begin with a word, such as 'Gain;1;2': they only are a table if no others.

    Raises:
        ConfigError: If there is none, or it is not clear which.
    """
    if words is not None and np.count_nonzero(rows & ~words) > 1:
        of = np.cumsum(ends)
        rows = rows & (np.bincount(of, rows & ~words)[of] > 0)
    at = np.flatnonzero(rows)
    of = np.cumsum(ends)[at]
    first = np.flatnonzero(np.diff(of, prepend=-1))
    size = np.diff(np.append(first, len(at)))
    tables = [
        (int(at[f]), int(at[f + n - 1]) + 1, int(n))
        for f, n in zip(first, size, strict=True)
        if n > 1
    ]
    if not tables:
        raise ConfigError(f"{path}: expected a header line and at least two lines of numbers")
    named = "; ".join(f"{i}: lines {a + 1} to {b}" for i, (a, b, _) in enumerate(tables[:9], 1))
    largest = max(tables, key=lambda t: t[2])
    if wanted is not None:
        if wanted > len(tables):
            raise ConfigError(f"{path}: there is no table {wanted}; it has {named}")
        largest = tables[wanted - 1]
    elif sum(n for *_, n in tables) - largest[2] > largest[2] / _LARGE:
        raise ConfigError(f"{path}: {len(tables)} tables ({named}): choose with format.table")
    others = len(tables) - 1
    told = [f"{others} smaller table{'s' * (others > 1)} left out"] if others else []
    if wanted is not None:
        told = [f"table {wanted} of {len(tables)}"]
    return largest[0], largest[1], told


def _without_notes(
    lines: Lines, rows: npt.NDArray[np.int64], delimiter: str
) -> npt.NDArray[np.int64]:
    """Rows without those at both ends that have words where their neighbours have numbers."""

    def noted(row: int, neighbour: int, first_only: bool) -> bool:
        cells = [split(lines[i], delimiter) for i in (row, neighbour)]
        pairs = [(kind(a), kind(b)) for a, b in zip(*cells, strict=False)]
        if all(a == "missing" for a, _ in pairs):  # a rule of dashes
            return True
        return ("text", "number") in (pairs[:1] if first_only else pairs)

    while len(rows) > 2 and noted(rows[0], rows[1], False):
        rows = rows[1:]
    end = rows[-10:]  # 'Mean;2.5;3.1' below the table
    while len(end) > 2 and noted(end[-1], end[0], True):
        end, rows = end[:-1], rows[:-1]
    return rows


def _above(
    path: Path, lines: Lines, start: int, delimiter: str, width: int, widest: int
) -> tuple[list[list[str]], int]:
    """Rows of the header, the lines above that have as many cells, and the line of the last.

    Raises:
        ConfigError: If the line above has cells, but not as many, or an open quote.
    """
    found: list[list[str]] = []
    last = 0
    for first, text in reversed(list(_records(lines, max(start - _ABOVE, 0), start, delimiter))):
        if not text.strip():
            if found:
                break
            continue
        mark = _COMMENT.match(text)
        bare = text[mark.end() :] if mark else text
        if _opens(bare, delimiter):
            raise ConfigError(f"{path}:{first + 1}: a quote is opened and never closed")
        options = [split(bare, d) for d in (delimiter, *_DELIMITERS)]
        options.append(re.split(r"\s{2,}", bare.strip()))
        fits = [c for c in options if width <= len(c) <= widest]
        cells = fits[0] if fits else options[0]
        while len(cells) > widest and (not cells[-1] or cells[-1] == "Comment"):
            cells.pop()
        if all(kind(c) == "missing" for c in cells):  # a rule of dashes
            continue
        if not width <= len(cells) <= widest:
            if found or len([c for c in cells if c]) < 2 or mark:
                break
            raise ConfigError(
                f"{path}:{first + 1}: {len(cells)} headers for {width} columns of numbers; "
                "a header with a comma or a blank in it needs quotes, numbers with decimal commas "
                "another delimiter"
            )
        found.insert(0, cells)
        last = last or first + 1
        if len(found) == 4:
            break
    return found, last


def _records(lines: Lines, start: int, stop: int, delimiter: str) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, joined where a quote goes on in the next ones."""
    i = start
    while i < stop:
        first, text = i, lines[i]
        joined = text
        while _opens(joined, delimiter) and i + 1 < min(stop, first + 6):
            i += 1
            joined += " " + lines[i]
        if _opens(joined, delimiter):  # it stays open
            joined, i = text, first
        yield first, joined
        i += 1


def _opens(text: str, delimiter: str) -> bool:
    """Whether a quoted cell does not end; an inch mark opens none."""
    return text.count('"') % 2 == 1 and bool(re.search(rf'(^|{re.escape(delimiter)})\s*"', text))


def _decimal(
    path: Path, lines: Lines, span: tuple[int, int], delimiter: str, sample: Sequence[Sequence[str]]
) -> str:
    """The decimal mark, told by a sample of rows, else by all of them."""
    try:
        if mark := decimal_mark(zip_longest(*sample, fillvalue="")):
            return mark
    except Ambiguous:
        pass
    every = [split(lines[i], delimiter) for i in range(*span)]
    try:
        return (
            decimal_mark(zip(*(r for r in every if len(r) == len(sample[0])), strict=True)) or "."
        )
    except Ambiguous as error:
        raise ConfigError(f"{path}: {error}; say which with format.decimal") from None


def _refuse_split_decimals(
    path: Path, start: int, delimiter: str, sample: Sequence[Sequence[str]], above: list[list[str]]
) -> None:
    """Refuse '0,25,-2,27' without headers, which is two numbers or four."""
    n = len(sample[0])
    if above or delimiter != "," or n % 2 or {len(row) for row in sample} != {n}:
        return
    if all(re.fullmatch(r"-?\d+", c) for row in sample for c in row) and not any(
        c[0] == "-" for row in sample for c in row[1::2]
    ):
        raise ConfigError(
            f"{path}:{start + 1}: {n} whole numbers or {n // 2} with decimal commas; say which "
            "with format.decimal '.', or export with another delimiter"
        )


def _frame(
    path: Path, lines: Lines, span: tuple[int, int], delimiter: str, decimal: str, width: int,
    rows: npt.NDArray[np.bool_],
) -> pd.DataFrame:  # fmt: skip
    """The cells of a table, a column each: numbers where all of a column are."""
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
                names=list(range(width + 1)),  # one more finds lines that are too long
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
        raise fault  # which of its cells is blank is not to be seen
    return frame.drop(columns=width)


def _misfit(
    path: Path, lines: Lines, span: tuple[int, int], by: str, width: int, shorter: bool = False
) -> ConfigError | None:
    """An error that names the first line with more cells than columns, or also with fewer."""
    for i in range(*span):
        cells = [] if _COMMENT.match(lines[i]) else split(lines[i], by)
        if len(cells) > width or (shorter and 0 < len(cells) < width):
            return ConfigError(f"{path}:{i + 1}: {len(cells)} values for {width} columns")
    return None
