"""Derivatives of a whole history by numbers of its config, computed during the run."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.design.keys import Key, keys
from dealib.design.neighbours import Neighbours
from dealib.design.sensitivity import STEP, as_function_of_state, refuse
from dealib.errors import ConfigError, ValueAt
from dealib.files import write_bytes
from dealib.study.scope import of_the_state

FILE = "slopes.npz"


class Slopes:
    """Observer that writes the derivatives of a history by numbers of its config (on one rank).

    Args:
        wanted: Keys of the numbers; those without a derivative are left out.
        directory: The run directory.
    """

    def __init__(self, wanted: Sequence[str], directory: Path) -> None:
        self._wanted, self._path = wanted, directory / FILE

    def start(self, simulation: Any) -> None:
        """See `Observer`."""
        config = simulation.case.config
        found = [key for name in self._wanted for key in _key(config, name)]
        needed = {*of_the_state(as_function_of_state(config))}
        self._near = Neighbours(simulation, found, needed, STEP)

    def see(self, state: Any) -> None:
        """See `Observer`."""
        self._near.follow()

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
        if error is not None:
            return
        found = {}
        for pair in self._near.pairs:
            up, down = (_table(side.rows) for side in pair.sides)
            found[pair.key.name] = {name: (up[name] - down[name]) / (2 * STEP) for name in up}
        out, columns = io.BytesIO(), list(next(iter(found.values()), {}))
        values = [[slopes[name] for name in columns] for slopes in found.values()]
        np.savez(out, keys=np.array(list(found), str), columns=columns, values=np.array(values))
        write_bytes(self._path, out.getvalue())


def known(config: Config) -> bool:
    """Whether each row of a config's history has derivatives (see `sensitivity.refuse`)."""
    try:
        refuse(config)
    except ValueAt:
        return False
    # interpolated rows have no state of their own from which those beside are found
    return not config.output.modes and not any(stage.auto for stage in config.program)


def read(directory: Path) -> dict[str, dict[str, Array]]:
    """Derivatives by the logarithm of each key, by key and column; empty without a file."""
    try:
        with np.load(directory / FILE, allow_pickle=False) as file:
            found = (dict(zip(map(str, file["columns"]), v, strict=True)) for v in file["values"])
            return dict(zip(map(str, file["keys"]), found, strict=True))
    except (OSError, ValueError, KeyError):
        return {}


def _key(config: Config, name: str) -> list[Key]:
    try:
        return keys(config, [name])
    except ConfigError:  # the key is zero or not a number
        return []


def _table(rows: list[dict[str, Any]]) -> dict[str, Array]:
    numbers = [name for name, value in rows[0].items() if isinstance(value, (int, float))]
    return {name: np.array([row[name] for row in rows], float) for name in numbers}
