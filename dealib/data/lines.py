"""Lines of a text: their delimiter, which of them are rows of numbers, and which make a table."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dealib.arrays import Ints
from dealib.data.cells import kind
from dealib.errors import ConfigError

Flags = npt.NDArray[np.bool_]

DELIMITERS = {"\t": "tab", ";": "';'", "|": "'|'", ",": "','", " ": "blanks"}
COMMENT = re.compile(r"\s*(?:#(?!N/A|DIV|VALUE|WERT|REF|NUM|NAME|NULL|ZAHL)|%|//|!|\*\*)+\s*")
ABOVE = 200  # lines that are searched for a header
_HEAD = 3000  # lines from which the delimiter is found
_PLAIN = np.zeros(256, dtype=bool)  # bytes of lines that hold only numbers and delimiters
_PLAIN[list(b"0123456789+-.,;:/ \t\"'|eETZ\n")] = True
_DIGITS = {bytes([c]) for c in b"0123456789+-.,"}
_LARGE = 10  # a table with this many times the rows of all others is taken


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


def find_delimiter(lines: Lines) -> str:
    """The delimiter with which most lines are rows of numbers only."""
    head = [line for i in range(min(len(lines), _HEAD)) if (line := lines[i]).strip()]
    scores = {}
    for delimiter in DELIMITERS:
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
    best = max(scores, key=lambda d: scores[d])  # the first one of equals
    return best if scores[best] else ","


def is_row(cells: Sequence[str]) -> bool:
    """Whether cells are a row of a table: numbers, with at most few texts among them."""
    kinds = [kind(c) for c in cells]
    numbers, texts = sum(k in ("number", "time") for k in kinds), kinds.count("text")
    return (not texts and any(cells)) or (numbers > 1 and 2 * numbers >= texts)


def find_rows(lines: Lines, delimiter: str) -> tuple[Flags, Flags, Flags]:
    """Which lines are rows of numbers, end a table, or are rows beginning with a word, (lines,)."""
    codes = np.frombuffer(lines.data, np.uint8)
    look = lines.having(~_PLAIN[codes]) > 0
    blank = np.diff(lines.starts) <= 1
    look[:ABOVE] = True
    look &= ~blank
    rows, ends, words = ~look & ~blank, np.zeros_like(look), np.zeros_like(look)
    ends[1:] = blank[1:] & blank[:-1]
    width, by, starts = 0, None if delimiter == " " else delimiter.encode(), lines.starts
    for i in np.flatnonzero(look).tolist():
        parts = lines.data[starts[i] : starts[i + 1]].split(by)
        if i > ABOVE and len(parts) == width and sum(p[:1] in _DIGITS for p in parts) > 1:
            rows[i] = True  # a quick test: it looks like the row before
            continue
        cells = split(lines[i], delimiter)
        if COMMENT.match(lines[i]):
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
    """First line of the chosen table, the line after it, and a note on other tables.

    Args:
        path: The file, for messages.
        rows: Lines that are rows of numbers.
        ends: Lines that end a table.
        wanted: Number of the table; None for the one that is much larger than all others.
        words: Rows that begin with a word, such as 'Gain;1;2'. They count as a table only if there
            are no other rows.

    Raises:
        ConfigError: If there is no table, or none is much larger than the others.
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


def without_notes(lines: Lines, rows: Ints, delimiter: str) -> Ints:
    """Rows without notes at both ends, which have words where their neighbours have numbers."""

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
