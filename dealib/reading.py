"""Reading what users and other people give: plain files only, and not without end."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from dealib.errors import ConfigError, did_you_mean

_KINDS = {stat.S_IFDIR: "Is a directory", stat.S_IFIFO: "it is a pipe", stat.S_IFSOCK: "a socket"}


def read_bytes(path: Path, what: str, most: int) -> bytes:
    """The content of a file.

    Args:
        path: The file.
        what: What it should be, for messages, such as 'config'.
        most: Largest size, bytes.

    Raises:
        ConfigError: If it is no plain file, cannot be read or is too large.
    """
    try:
        # opened without O_NONBLOCK, a pipe would wait for somebody who writes into it
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            mode = stat.S_IFMT(os.fstat(file.fileno()).st_mode)
            if mode != stat.S_IFREG:
                raise OSError(0, _KINDS.get(mode, "it is a device"))
            content = file.read(most + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{shown(path)}: cannot read the {what}: {reason}") from None
    if len(content) > most:
        raise ConfigError(f"{path}: more than {most / 1e6:g} MB are too large for a {what}")
    return content


def read_text(path: Path, what: str, most: int) -> str:
    """The text of a file in UTF-8 (see `read_bytes`)."""
    try:
        return read_bytes(path, what, most).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None


def shown(text: object, most: int = 100) -> str:
    """A text of any length, short enough for a message."""
    whole = str(text)
    return whole if len(whole) <= most else f"{whole[: most - 30]}...{whole[-27:]}"


def too_long(path: str) -> str:
    """Why no file system takes a path; empty if its length is none."""
    longest = max(len(os.fsencode(part)) for part in path.split("/"))
    fits = longest <= 240 and len(path) <= 4000  # what is added to it has to fit too
    return "" if fits else f"{shown(path)}: too long for a path"


def no_file(name: str, beside: Path) -> str:
    """What is wrong where a file that another one names is not there.

    Args:
        name: The name that is given.
        beside: Folder of the file that gives it.
    """
    given, here = Path(name), beside.resolve() == Path.cwd()
    folders = "the present folder" if here else f"{beside}, nor in the present folder"
    near = did_you_mean(
        given.name, [p.name for p in beside.glob(f"*{given.suffix or '.*'}")][:1000]
    )
    return f"there is no file {name!r} in {folders}{near if near.startswith('; did') else ''}"
