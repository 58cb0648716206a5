"""Writing files so that they appear under their names only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dealib.errors import PlatformError, first_line

TEMPORARY = ".tmp"  # part of the names of incomplete files


@contextmanager
def guarded(path: Path) -> Iterator[None]:
    """Turn an error of writing into a message.

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
    """Write a file whole or not at all.

    Args:
        path: The file; it is replaced when the context ends without an error.

    Yields:
        A temporary file in the same folder, to write to. It has the suffix of `path`, from which
        some libraries infer the format.

    Raises:
        PlatformError: If it cannot be written; an earlier file is then intact.
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
    write_parts(path, [data], durable)


def write_parts(path: Path, parts: Iterable[Any], durable: bool = False) -> None:
    """The same of bytes that are made one part after the other."""
    with whole(path) as temporary, temporary.open("wb") as file:
        for part in parts:
            file.write(part)
        if durable:
            file.flush()
            os.fsync(file.fileno())


def write_text(path: Path, text: str) -> None:
    """Write a text, whole or not at all (see `whole`)."""
    write_bytes(path, text.encode())


def write_new(path: Path, text: str) -> bool:
    """Write a text to a new file; an existing file stays as it is.

    Returns:
        Whether the file is new.

    Raises:
        PlatformError: If it cannot be written; no file is left then.
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
