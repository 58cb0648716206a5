"""Names that users give: what is safe as a file's name, and in a table that a spreadsheet opens."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator

from dealib.reading import shown, too_long

# what begins like a number is one, or is followed by words; a formula would go on otherwise
_AMOUNT = re.compile(r"[-+](\d+\.?\d*|\.\d+)([eE][-+]?\d+)?([ ,][^=|!()@]*)?")


def _plain(name: str) -> str:
    if not re.fullmatch(r"[\w.+-]+", name):
        raise ValueError("use letters, digits, '_', '-', '.' and '+' only")
    if not re.match(r"\w", name):
        raise ValueError("must begin with a letter, a digit or '_'")
    return _path(name)


def _path(path: str) -> str:
    if problem := too_long(path):
        raise ValueError(problem)
    if not path.isprintable():
        raise ValueError("a path without control characters is needed")
    return path


def _cell(text: str) -> str:
    if problem := fault(text):
        raise ValueError(problem)
    return text


def fault(text: str) -> str:
    """Why a text must not stand in a table; empty if it may."""
    if not text.isprintable():
        return f"{shown(repr(text))} holds a tab, a line break or another control character"
    if text.lstrip()[:1] in tuple("=+-@") and not _AMOUNT.fullmatch(text):
        first = text.lstrip()[0]
        return f"must not begin with '{first}': spreadsheets would take it for a formula"
    return ""


Name = Annotated[str, AfterValidator(_plain)]
FilePath = Annotated[str, AfterValidator(_path)]
Cell = Annotated[str, AfterValidator(_cell)]
