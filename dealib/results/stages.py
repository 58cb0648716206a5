"""Stages of a history: which one each state belongs to, and what drives the mount in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.results.mesh import Ints

if TYPE_CHECKING:
    import pandas

    from dealib.config.program import Stage

LED = ("displacement", "path")  # drives that lead the mount, whatever its force


def numbers(
    history: pandas.DataFrame, program: Sequence[Stage], stops: Sequence[Mapping[str, Any]] = ()
) -> Ints:
    """Index in the program of each row's stage, (rows,); that of the first row is 0.

    Stages of one name in a row are told apart by their durations; those that follow a branch have
    none.

    Args:
        history: The history.
        program: The stages.
        stops: Where conditions ended a stage, as in `run.json`.
    """
    ended = [float(s["time_s"]) for s in stops]
    k, begin, last, found = 0, 0.0, 0.0, [0]
    for name, time in zip(history["stage"][1:], history["time_s"][1:], strict=True):
        while k + 1 < len(program) and (
            program[k].stage != name
            or (program[k + 1].stage == name and time > _end(program[k], begin, ended))
        ):
            k, begin = k + 1, last
        found.append(k)
        last = time
    return np.array(found)


def _end(stage: Stage, begin: float, ended: Sequence[float]) -> float:
    if stage.follow is not None:
        return np.inf
    end = begin + (0.0 if stage.stage == "prestrain" else stage.duration * stage.cycles)
    early = (t for t in ended if begin < t < end)
    return min(early, default=end) * (1 + 1e-9)


def titles(program: Sequence[Stage]) -> list[str]:
    """Names of the stages; equal ones are numbered."""
    count = Counter(stage.stage for stage in program)
    seen: Counter[str] = Counter()
    found = []
    for name in (stage.stage for stage in program):
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if count[name] > 1 else name)
    return found


def mount_drives(program: Sequence[Stage]) -> list[str]:
    """What drives the mount in each stage: 'displacement', 'force', ...; 'path' if followed."""
    found, now = [], "displacement"
    for stage in program:
        if stage.mount is not None:
            now = stage.mount.given[0]
        followed = stage.follow is not None and stage.follow.vary in ("displacement", "force")
        found.append("path" if followed else now)
    return found
