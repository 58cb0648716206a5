"""Large arrays of which only some rows are in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from dealib.arrays import Array

ROOM = 2**24  # bytes of the rows that are taken at a time


class Rows(Protocol):
    """An array, or what gives some of its rows when they are asked for."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the whole."""

    def __getitem__(self, rows: Any) -> Array:
        """Some rows."""


@dataclass(frozen=True)
class Stream:
    """An array whose rows come once, in order.

    Attributes:
        shape: Of the whole.
        parts: Its rows, some at a time.
    """

    shape: tuple[int, ...]
    parts: Iterator[Array]

    def whole(self) -> Array:
        """All of it in memory."""
        found, at = np.empty(self.shape), 0
        for part in self.parts:
            found[at : at + len(part)] = part
            at += len(part)
        return found


@dataclass(frozen=True)
class Stored:
    """An array in a file of numpy, of which nothing stays in memory.

    Attributes:
        path: The file.
    """

    path: Path

    @property
    def shape(self) -> tuple[int, ...]:
        """See `Rows`."""
        return tuple(np.load(self.path, mmap_mode="r").shape)

    def __getitem__(self, rows: Any) -> Array:
        """See `Rows`."""
        return np.array(np.load(self.path, mmap_mode="r")[rows])


@dataclass(frozen=True)
class Transferred:
    """Values at some points of cells as values at others.

    Attributes:
        values: Values, (cells, points, ...).
        weights: Of the given points at each other one, (others, points).
    """

    values: Rows
    weights: Array

    @property
    def shape(self) -> tuple[int, ...]:
        """See `Rows`."""
        cells, _, *rest = self.values.shape
        return (cells, len(self.weights), *rest)

    def __getitem__(self, rows: Any) -> Array:
        """See `Rows`."""
        return np.asarray(np.einsum("gq,cq...->cg...", self.weights, self.values[rows]))


def in_parts(rows: Rows) -> Iterator[tuple[slice, Array]]:
    """All rows, some at a time, and where they are."""
    step = rows_at_once(rows.shape)
    for k in range(0, rows.shape[0], step):
        at = slice(k, min(k + step, rows.shape[0]))
        yield at, rows[at]


def rows_at_once(shape: tuple[int, ...]) -> int:
    """How many rows of numbers are taken at a time."""
    return max(1, ROOM // max(1, 8 * int(np.prod(shape[1:]))))
