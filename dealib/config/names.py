"""Names that users give: safe as names of files, and as cells of a spreadsheet."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator

from dealib.reading import shown, too_long

# a signed number, alone or followed by words: allowed, since it is no formula
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
        raise ValueError("a path must not contain control characters")
    return path


def _cell(text: str) -> str:
    if problem := fault(text):
        raise ValueError(problem)
    return text


def fault(text: str) -> str:
    """Why a text is not allowed in a table; empty if it is."""
    if not text.isprintable():
        return f"{shown(repr(text))} holds a tab, a line break or another control character"
    if text.lstrip()[:1] in tuple("=+-@") and not _AMOUNT.fullmatch(text):
        first = text.lstrip()[0]
        return f"must not begin with '{first}': spreadsheets would take it for a formula"
    return ""


Name = Annotated[str, AfterValidator(_plain)]
FilePath = Annotated[str, AfterValidator(_path)]
Cell = Annotated[str, AfterValidator(_cell)]
