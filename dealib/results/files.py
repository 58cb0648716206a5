"""Writing files so that they appear under their names only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from dealib.errors import PlatformError


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


@contextmanager
def new_hdf5(path: Path) -> Iterator[Any]:
    """An HDF5 file that is built in memory and then written whole or not at all.

    In memory, because HDF5 does not survive a disk that fills up beneath it.
    """
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    write_bytes(path, image)
