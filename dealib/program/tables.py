"""The load program that walks over the grid of a config's tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.config.case import Case
from dealib.config.program import Stage
from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.errors import ConfigError, ValueAt, by_caller
from dealib.units import DIMENSIONS


def tables_case(case: Case, fmu: bool = False) -> Case:
    """The same device with a program that visits all nodes of the grid.

    It goes row by row, in alternating directions of the last variable, so that each state is solved
    from a neighbour.

    Args:
        case: The device.
        fmu: Leave branches out, which the FMU has itself, and store the states.

    Raises:
        ConfigError: If the config has no `tables`, or branches and is not for an FMU.
    """
    config = case.config
    if config.tables is None:
        raise ConfigError(
            f"{case.path}: the key tables is missing; it gives the ranges of two ports, such as "
            "tables: {displacement: [0 mm, -2 mm], voltage: [0 V, 2 kV], points: [9, 9]}"
        )
    grids = config.tables.grids
    *_, last = grids
    program = [s for s in config.program[:1] if s.stage == "prestrain"]
    here: dict[str, float] = {}
    for row, (there, along) in enumerate(_rows(list(grids.values())), start=1):
        to = dict(zip(grids, [*there, along[0]], strict=True))
        changed = {name: [value] for name, value in to.items() if here.get(name) != value}
        program.append(_stage(f"row {row}", config.device, changed))
        ends = {last: [along[0], along[-1]]}
        title = f"row {row}, {last.partition('.')[0]}s"
        program.append(_stage(title, config.device, ends, len(along) - 1))
        here = to | {last: along[-1]}
    update: dict[str, Any] = {"program": tuple(program), "stop_when": ()}
    if fmu:
        relaxed = {n: m.model_copy(update={"branches": ()}) for n, m in config.materials.items()}
        update["materials"] = relaxed
        update["output"] = config.output.model_copy(update={"fields": "every"})
    with case.blamed():
        _check_branches(config, grids, fmu)
    return replace(case, config=config.model_copy(update=update))


def _check_branches(config: Config, axes: Collection[str], fmu: bool) -> None:
    """Raise `ValueAt` if there are branches that tables, or an FMU of them, cannot have."""
    for name, law in config.solids.items():
        if law.branches and not fmu:
            model = by_caller("--fmu", "fmu=True")
            problem = f"its force depends on time, which tables lack; {model} makes a model with it"
            raise ValueAt(("tables",), f"materials.{name} has branches: {problem}")
        stems = {axis.partition(".")[0] for axis in axes}
        if law.branches and ("pressure" in stems or not stems & {"displacement", "rotation"}):
            problem = "in an FMU only displacements and rotations strain them; "
            problem += "give a displacement or a rotation as a variable, and no pressure"
            raise ValueAt(("tables",), f"materials.{name} has branches: {problem}")


def _rows(grids: Sequence[Array]) -> Iterator[tuple[list[float], Array]]:
    """Values of all variables but the last, and those of the last along a row, alternating."""
    *outer, last = grids
    for row, index in enumerate(np.ndindex(*map(len, outer))):
        values = []
        for k, (grid, i) in enumerate(zip(outer, index, strict=True)):
            passed = int(np.ravel_multi_index(index[:k], [len(g) for g in outer[:k]])) if k else 0
            values.append(float(grid[i if passed % 2 == 0 else -1 - i]))
        yield values, last[:: 1 if row % 2 == 0 else -1]


def _stage(name: str, device: Device, given: dict[str, list[float]], steps: int = 1) -> Stage:
    """A stage that moves variables to a value, or from one to another."""
    inputs: dict[str, Any] = {}
    for variable, values in given.items():
        port, stem = device.variables[variable], variable.partition(".")[0]
        unit = DIMENSIONS[port.kind.primal.dimension][0]
        drive = {stem: [f"{float(v)!r} {unit}" for v in values]}
        inputs.setdefault(f"{port.kind.name}s", {})[port.name] = drive
    return Stage.model_validate({"stage": name, "steps": steps, **inputs})
