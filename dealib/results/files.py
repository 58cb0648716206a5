"""Writing files so that they appear under their names only when they are complete."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from dealib.errors import PlatformError

_count = itertools.count()


@contextmanager
def guarded(path: Path) -> Iterator[None]:
    """Turn a disk's refusal into a message.

    Raises:
        PlatformError: Instead of OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise PlatformError(
            f"cannot write {path}: {reason}; what was written before is intact"
        ) from None


def write_bytes(path: Path, data: Any, durable: bool = False) -> None:
    """Write a file whole or not at all.

    Args:
        path: The file; it is replaced.
        data: Its bytes.
        durable: Wait until they are on the disk.

    Raises:
        PlatformError: If the disk refuses; an earlier file is then intact.
    """
    temporary = path.with_name(path.name + ".tmp")
    with guarded(path):
        try:
            with temporary.open("wb") as file:
                file.write(data)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            os.replace(temporary, path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all (see `write_bytes`)."""
    write_bytes(path, text.encode())


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
