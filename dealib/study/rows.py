"""The rows of a history, and the functions over them that expressions use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dealib.arrays import Array, Ints
from dealib.config.schema import Config
from dealib.device.records import MOUNT, TERMINAL
from dealib.errors import did_you_mean
from dealib.study.expressions import Function
from dealib.study.scope import Work, setting

_VOLTS = TERMINAL.primal.column


class StageRows:
    """The rows of a history by stage.

    Args:
        names: Columns of numbers, by name.
        stages: Stage of each row.
        work: The config or material test of the history.
    """

    def __init__(self, names: Mapping[str, Array], stages: Any, work: Work) -> None:
        self.names, self._stages, self._work = names, np.asarray(stages), work

    @property
    def functions(self) -> dict[str, Function]:
        """The functions of `expressions.OF_A_HISTORY`."""
        return {
            "end": lambda x, stage: x[self.of(stage)[-1]],
            "start": lambda x, stage: x[self._from(stage)],
            "during": self._during,
            "at": _at,
            "stroke": self._stroke,
            "setting": lambda path: setting(self._work, path),
        }

    def of(self, stage: str) -> Ints:
        """Indices of the rows of a stage.

        Raises:
            ValueError: If there are none.
        """
        rows = np.flatnonzero(self._stages == stage)
        if len(rows) == 0:
            known = list(dict.fromkeys(map(str, self._stages)))
            raise ValueError(f"no stage {stage!r} in the results{did_you_mean(stage, known)}")
        return rows

    def _from(self, stage: str) -> int:
        """Index of the row at which a stage begins: the last row of the stage before."""
        return max(int(self.of(stage)[0]) - 1, 0)

    def _during(self, x: Array, stage: str) -> Array:
        return x[self._from(stage) : self.of(stage)[-1] + 1]

    def _stroke(self, stage: str) -> float:
        """Stroke under voltage relative to the state just before it, as in `dealib info`."""
        mounts = self._work.device.of(MOUNT) if isinstance(self._work, Config) else ()
        if not mounts:
            raise ValueError("stroke: there is no mount")
        rows, voltages = self.of(stage), [self.names[n] for n in self.names if n.startswith(_VOLTS)]
        if voltages:
            size = np.abs(voltages).max(axis=0)
            under = rows[size[rows] > 1e-9 * size.max()]
            rows = under if len(under) else rows
        moved = self.names[mounts[0].column(MOUNT.primal)]
        return float(np.abs(moved[rows] - moved[max(int(rows[0]) - 1, 0)]).max())


def _at(x: Array, y: Array, value: float) -> float:
    """X where y first reaches a value, interpolated linearly; NaN if y never does."""
    gap = np.asarray(y, float) - value
    if np.isclose(gap[0], 0):
        return float(x[0])
    crossed = np.flatnonzero(np.sign(gap[1:]) != np.sign(gap[0]))
    if len(crossed) == 0:
        return float("nan")
    i = int(crossed[0])
    return float(x[i] + (x[i + 1] - x[i]) * gap[i] / (gap[i] - gap[i + 1]))
