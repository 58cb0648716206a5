"""HDF5 files that are built in memory and written whole or not at all."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from dealib.files import write_bytes

_count = itertools.count()


def memory_hdf5() -> Any:
    """An empty HDF5 file in memory, because HDF5 does not survive a disk that fills up beneath it.

    It has a name of its own: HDF5 does not open one twice.
    """
    return h5py.File(f"memory-{next(_count)}", "w", driver="core", backing_store=False)


def write_hdf5(path: Path, file: Any) -> None:
    """Write a file in memory, whole or not at all (see `write_bytes`)."""
    file.flush()
    write_bytes(path, file.id.get_file_image())


@contextmanager
def new_hdf5(path: Path) -> Iterator[Any]:
    """An HDF5 file that is built in memory and then written whole or not at all."""
    with memory_hdf5() as file:
        yield file
        write_hdf5(path, file)
