"""Unexpected errors: a message, and a file with all that a bug report needs."""

from __future__ import annotations

import platform
import shlex
import tempfile
import traceback
from collections.abc import Sequence

from dealib.log import verbose
from dealib.versions import installed


def told(error: Exception, arguments: Sequence[str]) -> str:
    """Write the traceback to a file; with -v it is part of the message too.

    Args:
        error: The error; its notes tell what was being done.
        arguments: The command line.

    Returns:
        The message.
    """
    command = shlex.join(["dealib", *arguments])
    trace = "".join(traceback.format_exception(error))
    versions = ", ".join(f"{name} {version}" for name, version in installed().items())
    where = f"{platform.platform()}, Python {platform.python_version()}"
    facts = f"{command}\n{where}\n{versions}\n\n{trace}"
    summary = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    lines = [f"a fault of dealib itself in: {command}", f"    {summary}"]
    lines += [f"    {note}" for note in getattr(error, "__notes__", ())]
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="dealib-", suffix=".log", delete=False, encoding="utf-8"
        ) as file:
            file.write(facts)
        lines.append(f"The traceback and the versions are in {file.name} (-v shows them here).")
    except OSError:
        lines.append(facts)
    lines.append("Please report it: send that file, and the input if possible (see README, Help).")
    return "\n".join([*lines, facts] if verbose() else lines)
