"""Moves values of cells between the ranks and rank 0, some at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.results.rows import Rows, rows_at_once


class Exchange:
    """Rows of this rank, ghosts included, and their places in the whole mesh.

    Rank 0 never holds a copy of all that comes from the other ranks.

    Attributes:
        owned: Which of the rows this rank owns.

    Args:
        comm: MPI communicator.
        original: Number of each row, which gives the order of the whole mesh.
        owned: See above.
        places: On rank 0, places of each rank's own rows in the whole mesh.
    """

    def __init__(self, comm: Any, original: Any, owned: Any, places: list[Any]) -> None:
        self._comm, self._original, self.owned, self._places = comm, original, owned, places

    @cached_property
    def _at(self) -> Any:
        """Place of each row in the whole mesh (collective)."""
        every = np.sort(np.concatenate(self._comm.allgather(self._original[self.owned])))
        return np.searchsorted(every, self._original)

    def stream(self, shape: tuple[int, ...], of: Callable[[Any], Array]) -> Iterator[Array]:
        """Values of all rows in the order of the whole mesh, some at a time, on rank 0.

        No rank holds them all. Every rank must go through to the end (collective).

        Args:
            shape: Of the values of a row.
            of: Gives the values of some of this rank's rows.
        """
        comm, own, places = self._comm, np.flatnonzero(self.owned), self._places[1:]
        own = own[np.argsort(self._at[own])]
        at, every = self._at[own], [np.sort(part) for part in places]
        total, step = int(comm.allreduce(len(own))), rows_at_once((0, *shape))
        for first in range(0, total, step):
            window = first, min(first + step, total)
            low, high = np.searchsorted(at, window)
            mine = of(own[low:high])
            if comm.rank > 0:
                if len(mine):
                    comm.Send(np.ascontiguousarray(mine), 0)
                continue
            found = np.empty((window[1] - first, *shape))
            found[at[low:high] - first] = mine
            for rank, there in enumerate(every, start=1):
                low, high = np.searchsorted(there, window)
                if low < high:
                    piece = np.empty((high - low, *shape))
                    comm.Recv(piece, rank)
                    found[there[low:high] - first] = piece
            yield found

    def mine(self, whole: Rows | None, rows: Any) -> Array:
        """Values of this rank's rows, ghosts included; those that are not given are 0 (collective).

        Args:
            whole: On rank 0, values of some rows of the whole mesh.
            rows: Which these are, in order; likewise.
        """
        comm = self._comm
        shape = comm.bcast(None if whole is None else tuple(whole.shape), root=0)
        rows = comm.bcast(rows, root=0)
        at = np.searchsorted(rows, self._at)
        at[~np.isin(self._at, rows)] = -1
        found, step = np.zeros((len(at), *shape[1:])), rows_at_once(shape)
        for first in range(0, shape[0], step):
            last = min(first + step, shape[0])
            if whole is None:
                window = np.empty((last - first, *shape[1:]))
            else:
                window = np.ascontiguousarray(whole[first:last])
            comm.Bcast(window, root=0)
            here = np.flatnonzero((at >= first) & (at < last))
            found[here] = window[at[here] - first]
        return found

    def collect(self, values: Array) -> Iterator[tuple[Any, Array]]:
        """Yield on rank 0 the values of all ranks' own rows and their places in the whole mesh.

        They come rank by rank and a piece at a time. Other ranks send their values and yield
        nothing (collective).

        Args:
            values: Values of this rank's rows, (rows, ...).
        """
        mine, comm, size = values[self.owned], self._comm, rows_at_once(values.shape)
        if comm.rank > 0:
            for k in range(0, len(mine), size):
                comm.Send(np.ascontiguousarray(mine[k : k + size]), 0)
            return
        yield self._places[0], mine
        for rank, places in enumerate(self._places[1:], start=1):
            for k in range(0, len(places), size):
                piece = np.empty((len(places[k : k + size]), *values.shape[1:]))
                comm.Recv(piece, rank)
                yield places[k : k + size], piece

    def hand_out(self, give: Callable[[Any], Array] | None, shape: tuple[int, ...]) -> Array:
        """Values of this rank's own rows, from rank 0 (collective).

        Args:
            give: On rank 0, gives the values of rows of the whole mesh; None on other ranks.
            shape: Of the values of a row.
        """
        comm, size = self._comm, rows_at_once((0, *shape))
        if give is not None:
            for rank, places in enumerate(self._places[1:], start=1):
                for k in range(0, len(places), size):
                    comm.Send(give(places[k : k + size]), rank)
            return give(self._places[0])
        mine = np.empty((int(self.owned.sum()), *shape))
        for k in range(0, len(mine), size):
            comm.Recv(mine[k : k + size], 0)
        return mine
