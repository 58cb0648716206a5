"""Stages of a history: the stage of each state, and what drives the ports in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.arrays import Ints

if TYPE_CHECKING:
    import pandas

    from dealib.config.program import Stage
    from dealib.device.device import Device


def numbers(
    history: pandas.DataFrame, program: Sequence[Stage], stops: Sequence[Mapping[str, Any]] = ()
) -> Ints:
    """Index in the program of each row's stage, (rows,); that of the first row is 0.

    A stage lasts as long as the rows have its name. If the next stage has the same name, it ends
    after its duration (unless it follows a branch), or where a condition ended it.

    Args:
        history: The history.
        program: The stages.
        stops: The stages that conditions ended, as in `run.json`.
    """
    time, names, steps = (history[c].to_numpy() for c in ("time_s", "stage", "step"))
    ended = {stop["step"] for stop in stops}
    found, last = np.zeros(len(history), dtype=np.int64), 0
    for k, stage in enumerate(program):
        if stage.stage == "prestrain":
            continue
        end = np.inf if stage.follow else time[last] + stage.duration * stage.cycles
        while (
            last + 1 < len(time)
            and names[last + 1] == stage.stage
            and time[last + 1] <= end * (1 + 1e-9)
        ):
            last += 1
            found[last] = k
            if steps[last] in ended:
                break
    return found


def clock(program: Sequence[Stage]) -> str:
    """Column over which the states of a run are drawn: `time_s`, or `step` if a branch is followed.

    In a stage that follows a branch the time only counts steps along the path.
    """
    return "step" if any(stage.follow is not None for stage in program) else "time_s"


def titles(program: Sequence[Stage]) -> list[str]:
    """Names of the stages; equal ones are numbered."""
    count = Counter(stage.stage for stage in program)
    seen: Counter[str] = Counter()
    found = []
    for name in (stage.stage for stage in program):
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if count[name] > 1 else name)
    return found


def drives(program: Sequence[Stage], device: Device) -> list[dict[str, str]]:
    """What drives each port in each stage: 'displacement', 'mass', ...; 'path' if followed.

    After a stage that follows a branch, the variable that was unknown in it is held at its value.
    """
    now = {p.name: (p.kind.dual if p.floating else p.kind.primal).name for p in device.ports}
    found = []
    for stage in program:
        now |= {name: given.given[0] for name, given in stage.driven(device).items()}
        found.append(dict(now))
        if stage.follow is not None:
            free = device.variables[stage.follow.vary].name
            now[free] = stage.follow.vary.partition(".")[0]
            found[-1][free] = "path"
    return found
