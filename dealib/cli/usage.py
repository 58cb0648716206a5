"""Messages about mistakes in the arguments of the command line."""

from __future__ import annotations

import re
from collections.abc import Sequence

import typer

from dealib.errors import ConfigError
from dealib.reading import too_long

UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # base of all of typer's errors


def refuse_long(arguments: Sequence[str]) -> None:
    """Refuse arguments that are too long for a path; only values of --set may be longer.

    Raises:
        ConfigError: With the argument.
    """
    for before, argument in zip(("", *arguments), arguments, strict=False):
        if before != "--set" and not argument.startswith("--set=") and (said := too_long(argument)):
            raise ConfigError(said)


def explain(error: Exception, arguments: Sequence[str] = ()) -> str:
    """Typer's usage error in one line: what is wrong, and the command of the help page.

    Args:
        error: The error.
        arguments: The command line; the error does not know the command if an option lacks its
            value.
    """
    from pydantic import ValidationError

    from dealib.config.messages import problem

    if isinstance(error.__cause__, ValidationError):
        parameter = getattr(error, "param", None)
        name = max(parameter.opts, key=len) if parameter is not None else "argument"
        said = f"{name}: {problem(error.__cause__.errors()[0])}"
    else:
        said = error.format_message()  # type: ignore[attr-defined]
        said = said[0].lower() + said[1:].rstrip(".")
        said = re.sub(r" \(Possible options: (\S+).*\)$", r"; did you mean \1", said)
        said = re.sub(r"\. Did you mean (.*)\?$", r"; did you mean \1", said)
    context = getattr(error, "ctx", None)
    command = arguments[0] if context is None and arguments else ""
    if context is not None and context.parent is not None:
        command = context.info_name
    return f"{said} (see: {' '.join(filter(None, ('dealib', command, '--help')))})"
