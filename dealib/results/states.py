"""Reading `results.h5`: mesh, history, texts and nodal states, of which some may be damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from dealib.arrays import Array
from dealib.errors import ConfigError, DealibError, first_line
from dealib.results import store
from dealib.results.history import STAGE, from_columns

if TYPE_CHECKING:
    import pandas

    from dealib.results.mesh import ResultMesh


class StatesReader:
    """Reads the file of a run.

    Args:
        path: The file.
        explained: Adds to an error about a file, whose name comes first, what can still be read.
    """

    def __init__(self, path: Path, explained: Callable[[str, ConfigError], ConfigError]) -> None:
        self._path, self._explained = path, explained

    @contextmanager
    def _open(self) -> Iterator[Any]:
        """The open file.

        Raises:
            ConfigError: If it is damaged, also if that shows only while it is read.
        """
        try:
            with h5py.File(self._path, "r") as file:
                yield file
        except DealibError:
            raise
        except Exception as error:  # h5py raises HDF5's errors as they come
            what = f"damaged ({first_line(error)})" if self._path.is_file() else "missing"
            raise self._explained(store.STATES, ConfigError(f"{self._path}: {what}")) from None

    @cached_property
    def history(self) -> pandas.DataFrame | None:
        """The history; None if there is none that can be read."""
        try:
            with self._open() as file:
                columns = {name: column[:] for name, column in file["history"].items()}
                columns[STAGE] = [name.decode() for name in columns[STAGE]]
                return from_columns(columns)
        except ConfigError:
            return None  # the error is raised where the file itself is needed

    def text(self, name: str) -> str:
        """A text, by the name of its own file; empty if it is not there."""
        try:
            with self._open() as file:
                return str(file[name.removesuffix(".yaml").replace(".", "_")][()].decode())
        except ConfigError:
            return ""

    @cached_property
    def mesh(self) -> ResultMesh:
        """Mesh of the states.

        Raises:
            ConfigError: If the file is damaged.
        """
        with self._open() as file:
            return store.read_mesh(file)

    def steps(self, whole: bool = False) -> tuple[list[int], str]:
        """Steps whose state can be opened (or read, if `whole`), and a problem with the others."""
        with self._open() as file:
            there = {int(n): _is_there(file, f"states/{n}", whole) for n in file["states"]}
        lost = ", ".join(str(step) for step, found in there.items() if not found)
        told = f"damaged (the states of these steps are lost: {lost})"
        problem = f"{self._path}: {told}" if lost else ""
        return sorted(step for step, found in there.items() if found), problem

    def nodal(self, steps: Iterable[int]) -> Iterator[Array]:
        """Nodal values of steps."""
        with self._open() as file:
            for step in steps:
                yield np.asarray(file[f"states/{step:05d}"][:], dtype=np.float64)

    def array(self, group: str, steps: Sequence[int], index: int) -> Array | None:
        """An array of the index-th of some steps; None if the step has none in this group.

        Raises:
            ConfigError: If there is no such step.
        """
        try:
            name = f"{group}/{steps[index]:05d}"
        except IndexError:
            raise ConfigError(
                f"{self._path.parent}: there are {len(steps)} stored steps, no number {index}"
            ) from None
        with self._open() as file:
            return np.asarray(file[name][:], dtype=np.float64) if name in file else None


def _is_there(file: Any, name: str, whole: bool) -> bool:
    """Whether an array, which may be in a linked file, can be opened, or read if `whole`."""
    try:
        return (file[name][()] if whole else file[name]) is not None
    except (KeyError, OSError):
        return False
