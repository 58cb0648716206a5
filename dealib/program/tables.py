"""The load program that walks over the grid of a config's tables."""

from __future__ import annotations

from dataclasses import replace

from dealib.config.case import Case
from dealib.config.program import Stage
from dealib.errors import ConfigError
from dealib.units import write


def tables_case(case: Case) -> Case:
    """The same device on a walk over all nodes, both ports prescribed.

    Row by row of one displacement, voltage up and down in turn, so that each state is solved from
    its neighbour.

    Raises:
        ConfigError: If the config has no `tables`.
    """
    config = case.config
    if config.tables is None:
        raise ConfigError(
            f"{case.path}: the key tables is missing; it gives displacements and voltages, such as"
            " tables: {displacement: [0 mm, -2 mm], voltage: [0 V, 2 kV], points: [9, 9]}"
        )
    displacements, voltages = config.tables.grid
    stages = [s for s in config.program[:1] if s.stage == "prestrain"]
    for row, u in enumerate(displacements):
        across = voltages[:: 1 if row % 2 == 0 else -1]
        first = {"voltage": write(float(across[0]), "voltage")} if row == 0 else None
        stages.append(
            Stage.model_validate(
                {
                    "stage": f"row {row + 1}",
                    "mount": {"displacement": write(float(u), "length")},
                    "terminal": first,
                }
            )
        )
        voltage = [write(float(v), "voltage") for v in (across[0], across[-1])]
        stages.append(
            Stage.model_validate(
                {
                    "stage": f"row {row + 1}, voltages",
                    "terminal": {"voltage": voltage},
                    "steps": len(across) - 1,
                }
            )
        )
    return replace(
        case, config=config.model_copy(update={"program": tuple(stages), "stop_when": ()})
    )
