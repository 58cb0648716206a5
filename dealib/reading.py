"""Reading input files: regular files only, of limited size."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from dealib.errors import ConfigError, did_you_mean

_KINDS = {stat.S_IFIFO: "it is a pipe", stat.S_IFSOCK: "it is a socket"}


def read_bytes(path: Path, what: str, most: int) -> bytes:
    """The content of a file.

    Args:
        path: The file.
        what: Its kind, for messages, such as 'config'.
        most: Largest size, bytes.

    Raises:
        ConfigError: If it is not a regular file, cannot be read or is too large.
    """
    try:
        # without O_NONBLOCK, opening a pipe waits until a program writes into it
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            mode = stat.S_IFMT(os.fstat(file.fileno()).st_mode)
            if mode != stat.S_IFREG:
                raise OSError(0, _KINDS.get(mode, "it is a device"))
            content = file.read(most + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{shown(path)}: cannot read the {what}: {reason}") from None
    if len(content) > most:
        raise ConfigError(f"{path}: larger than {most / 1e6:g} MB, too large for a {what}")
    return content


def read_text(path: Path, what: str, most: int) -> str:
    """The text of a file in UTF-8; arguments and errors are those of `read_bytes`."""
    try:
        return read_bytes(path, what, most).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None


def shown(text: object, most: int = 100) -> str:
    """A text for a message, shortened in the middle to `most` characters."""
    whole = str(text)
    return whole if len(whole) <= most else f"{whole[: most - 30]}...{whole[-27:]}"


def too_long(path: str) -> str:
    """The message for a path that is longer than file systems allow; empty if it is not."""
    longest = max(len(os.fsencode(part)) for part in path.split("/"))
    fits = longest <= 240 and len(path) <= 4000  # limits are 255 and 4096; suffixes are added
    return "" if fits else f"{shown(path)}: too long for a path"


def no_file(name: str, beside: Path) -> str:
    """The message for a missing file that another file names.

    Args:
        name: The name as given.
        beside: Folder of the file that contains the name.
    """
    given, here = Path(name), beside.resolve() == Path.cwd()
    folders = "the present folder" if here else f"{beside}, nor in the present folder"
    near = did_you_mean(
        given.name, [p.name for p in beside.glob(f"*{given.suffix or '.*'}")][:1000]
    )
    return f"there is no file {name!r} in {folders}{near if near.startswith('; did') else ''}"
