"""Writing files so that they appear under their names only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dealib.errors import PlatformError, first_line

TEMPORARY = ".tmp"  # in the names of files that are not complete


@contextmanager
def guarded(path: Path) -> Iterator[None]:
    """Turn a disk's refusal into a message.

    Raises:
        PlatformError: Instead of OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or first_line(error)
        raise PlatformError(
            f"cannot write {path}: {reason}; what was written before is intact"
        ) from None


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Write a file whole or not at all: what is written to the path given takes its place.

    Args:
        path: The file; it is replaced.

    Yields:
        Another one beside it, with the same suffix, since formats are known by it.

    Raises:
        PlatformError: If the disk refuses; an earlier file is then intact.
    """
    temporary = path.with_name(f"{path.stem}{TEMPORARY}{path.suffix}")
    with guarded(path):
        try:
            yield temporary
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def write_bytes(path: Path, data: Any, durable: bool = False) -> None:
    """Write bytes, whole or not at all (see `whole`).

    Args:
        path: The file; it is replaced.
        data: Its bytes.
        durable: Wait until they are on the disk.
    """
    with whole(path) as temporary, temporary.open("wb") as file:
        file.write(data)
        if durable:
            file.flush()
            os.fsync(file.fileno())


def write_text(path: Path, text: str) -> None:
    """Write a text, whole or not at all (see `whole`)."""
    write_bytes(path, text.encode())


def write_new(path: Path, text: str) -> bool:
    """Write a text to a file that is not there yet: one that is there stays as it is.

    Returns:
        Whether it was written.

    Raises:
        PlatformError: If the disk refuses; there is no file then.
    """
    with guarded(path):
        try:
            file = path.open("x", encoding="utf-8")
        except FileExistsError:
            return False
        try:
            with file:
                file.write(text)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
    return True
