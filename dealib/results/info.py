"""Reading `run.json`; entries that are damaged are replaced by defaults."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict  # of Python 3.12, as pydantic wants it

INFO = "run.json"


class _Stop(TypedDict):
    step: int
    time_s: float
    stage: str
    when: str
    ends: str


class _Worst(TypedDict):  # besides, the coordinates of the place in mm
    use: float | None
    ok: bool
    step: int
    time_s: float
    stage: str


# entries that every run has, with the defaults that replace damaged ones
_UNKNOWN = {"status": "unknown", "started": "", "argv": [], "config": "", "set": [], "ranks": 1}
_UNKNOWN |= {"pid": 0, "host": "", "versions": {}, "git": None}
_KINDS: dict[str, Any] = {
    **dict.fromkeys(("name", "status", "started", "config", "host", "ended", "error"), str),
    **dict.fromkeys(("argv", "set", "warnings"), list[str]),
    **dict.fromkeys(("ranks", "pid", "unknowns", "steps"), int),
    "git": str | None,
    "versions": dict[str, str],
    "timings": dict[str, float],
    "margins": dict[str, _Worst],
    "stops": list[_Stop],
    "earlier_sessions": list[dict[str, Any]],
}


@cache
def _adapter(name: str) -> TypeAdapter[Any]:
    return TypeAdapter(_KINDS.get(name, Any))


def read_info(directory: Path) -> tuple[dict[str, Any], str]:
    """The entries of `run.json` in a directory, and what is wrong with it ('' if nothing)."""
    unknown = _UNKNOWN | {"name": directory.resolve().name}
    try:
        found = json.loads((directory / INFO).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return unknown, "missing"
    except (OSError, ValueError, RecursionError):
        return unknown, "damaged (not readable as JSON)"
    if not isinstance(found, dict):
        return unknown, "damaged (no mapping)"
    wrong = {name for name in unknown if name not in found}
    for name, value in found.items():
        try:
            _adapter(name).validate_python(value)
        except ValidationError:
            wrong.add(name)
    intact = {name: value for name, value in found.items() if name not in wrong}
    return unknown | intact, f"damaged ({', '.join(sorted(wrong))})" if wrong else ""
