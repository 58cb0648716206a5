"""HDF5 files that are written whole or not at all: small ones are built in memory."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from dealib.files import whole, write_bytes

_ROOM = 8e6  # bytes of a file that is built in memory, where it is held twice
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
def new_hdf5(path: Path, size: float = 0) -> Iterator[Any]:
    """A new HDF5 file, written whole or not at all.

    Args:
        path: The file.
        size: Bytes of its arrays, about: a large file is built on the disk.
    """
    if size <= _ROOM:
        with memory_hdf5() as file:
            yield file
            write_hdf5(path, file)
        return
    with whole(path) as temporary:
        try:
            with h5py.File(temporary, "w") as file:
                yield file
        except (RuntimeError, ValueError) as error:  # HDF5 on a full disk
            raise OSError(str(error)) from None
