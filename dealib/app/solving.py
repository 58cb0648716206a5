"""Solves the config of a page's sliders; only their newest position is solved."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import pandas as pd

from dealib.config.case import Case, resolved
from dealib.config.schema import Config
from dealib.design.keys import Key, keys, moved
from dealib.errors import ConfigError, DealibError, first_line
from dealib.fem.reuse import Reuse
from dealib.files import write_new
from dealib.plots.labels import split
from dealib.program import Simulation
from dealib.program.margins import table
from dealib.results.reader import Run
from dealib.results.summary import motion

_COLUMNS, _STEPS = 12, 2  # elements along the film and steps of a stage in a quick solution
_REACH = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # lower ends of a slider, as shares of the number
QUICK, FULL, CHECK = 0, 1, 2  # levels of a solution
_REST = 1.0  # s without a new position before the solid, whose steps cannot be stopped, is solved
_HOW = ("quick: few steps and elements", "all steps", "checked by the solid")
Values = tuple[float, ...]


class Slider(NamedTuple):
    """A number of the config that a slider changes, and its range."""

    key: Key
    low: float
    high: float


class Answer(NamedTuple):
    """A run or an error, and a line about the solution."""

    run: Run | None
    told: str
    problem: str = ""


class Kept(Run):
    """A run in memory."""

    def __init__(self, config: Config, rows: list[Any], states: list[Any], last: Any) -> None:
        self.directory, self._told, self._states = Path(config.directory), set(), states
        self._info = {"margins": table(last.progress.worst), "name": config.name, "status": "done"}
        # attributes that `Run` reads from files
        self.__dict__ |= {"config": config, "title": config.name, "mesh": last.layout.mesh}
        self.__dict__ |= {"history": pd.DataFrame(rows)}

    info = property(lambda self: self._info)
    stored_steps = property(lambda self: list(range(len(self._states))))

    def _stored(self, group: str, index: int) -> Any:
        return self._states[index].get(group)


def sliders(config: Config, wanted: Sequence[str]) -> list[Slider]:
    """Sliders for numbers of a config, up to 50 % to both sides as far as the config is valid.

    Raises:
        ConfigError: If there is no such number, or it cannot be changed.
    """
    found = []
    for key in keys(config, wanted):
        ends = [1.0, 1.0]
        for k, factors in enumerate((_REACH, [2 - f for f in _REACH])):
            for ends[k] in (*factors, 1.0):
                try:
                    moved(config, {key: ends[k]})
                    break
                except ConfigError:
                    continue
        if ends[0] < ends[1]:
            found.append(Slider(key, *sorted(f * key.value for f in ends)))
    if not found:
        raise ConfigError("the config has no such number that can be changed")
    return found


class Session:
    """A config with sliders; threads of the page ask, and the thread of `serve` solves.

    Attributes:
        sliders: The sliders.
        run: The last result; the config of the file is solved first.
        checks: Whether a membrane replaces the solid, which then checks it.

    Args:
        case: The case.
        wanted: Keys of the sliders; default all numbers that the file gives.

    Raises:
        ConfigError: If a key is wrong.
        NotConverged: If the config of the file has no solution.
    """

    def __init__(self, case: Case, wanted: Sequence[str] = ()) -> None:
        self._case, self.sliders = case, sliders(case.config, wanted)
        self._reuse = dict[tuple[bool, str], Reuse]()
        self._turn, self._ticket, self._newest = threading.Condition(), 0, Values()
        self._asked: tuple[int, int, Values] | None = None
        self._found: tuple[int, Answer | None] = (0, None)
        start, own = tuple(s.key.value for s in self.sliders), case.config.physics.model
        self._sheet: dict[str, Any] = {}  # changes that make the solid a membrane
        if own == "solid":
            self._sheet = {"physics": {"model": "membrane", "formulation": "displacement"}}
            if getattr(case.config.geometry, "air_height", 0):
                self._sheet["geometry"] = {"air_height": "0 mm"}
        self._model: str = "membrane in place of the solid" if self._sheet else own
        try:
            self.run: Run = self._solve(self.config(start), self._sheet or own == "membrane")
        except DealibError as error:
            if not self._sheet:
                raise
            self._sheet, self._model = {}, f"solid (no membrane: {first_line(error)})"
            self.run = self._solve(self.config(start), False)
        self.checks = bool(self._sheet)

    def config(self, values: Values, solid: bool = False) -> Config:
        """The config of a position of the sliders.

        Args:
            values: Values of the sliders, in the units of their keys.
            solid: Whether it is the solid, even if a membrane replaces it.

        Raises:
            ConfigError: If the config is not valid.
        """
        pairs = zip(self.sliders, values, strict=True)
        factors = {s.key: v / s.key.value for s, v in pairs if abs(v / s.key.value - 1) > 1e-9}
        return moved(self._case.config, factors, {} if solid else self._sheet)

    def save(self, values: Values) -> Path:
        """Write the config of a position to a new file in the present folder."""
        config, k = self.config(values), 0
        while True:
            k += 1
            path = Path(f"{config.name}-app-{k}.yaml")
            output = config.output.model_copy(update={"directory": f"runs/{path.stem}"})
            text = resolved(config.model_copy(update={"output": output}))
            if write_new(path, f"# position of the sliders of dealib app; {self._model}\n{text}"):
                return path

    def ask(self, level: int, values: Values) -> Answer | None:
        """Ask for the solution of a position, and wait for it.

        Args:
            level: QUICK, FULL or CHECK.
            values: Values of the sliders.

        Returns:
            The answer; None if the values are incomplete, or another position is asked for.
        """
        if len(values) != len(self.sliders) or not all(isinstance(v, (int, float)) for v in values):
            return None  # the user is typing a value
        with self._turn:
            if level == QUICK:
                self._newest = values
            elif values != self._newest:
                return None
            self._ticket = mine = self._ticket + 1
            self._asked = mine, level, values
            self._turn.notify_all()
            self._turn.wait_for(lambda: self._ticket != mine or self._found[0] == mine)
            return self._found[1] if self._found[0] == mine else None

    def serve(self) -> None:
        """Answer until a signal comes."""
        while True:
            with self._turn:
                self._turn.wait_for(lambda: self._asked is not None)
                assert self._asked is not None
                (ticket, level, values), self._asked = self._asked, None
                if level == CHECK and self._turn.wait_for(lambda: self._asked is not None, _REST):
                    continue
            answer = self._answer(ticket, level, values)
            with self._turn:
                self._found = ticket, answer
                self._turn.notify_all()

    def _answer(self, ticket: int, level: int, values: Values) -> Answer | None:
        begin, told = time.perf_counter(), f"{self._model}, {_HOW[level]}"
        if level == QUICK and self._model.startswith("solid"):
            return Answer(self.run, f"{self._model}: is being solved")
        try:
            run = self._solve(self.config(values, level == CHECK), level == QUICK, ticket)
        except DealibError as error:
            kept = "this membrane" if level == CHECK else "an earlier position"
            return Answer(None, f"{told}: the curves are those of {kept}", str(error))
        if run is None:
            return None
        told += f", {time.perf_counter() - begin:.2f} s"
        if level == CHECK:
            return Answer(run, told + deviation(self.run, run))
        self.run = run
        return Answer(run, told)

    def _solve(self, config: Config, quick: Any, ticket: int = 0) -> Any:
        """Solve a config; None if another one is asked for meanwhile."""
        solved = [s.all_solved for s in config.program]  # each row has its state to be drawn
        if quick:
            columns = min(config.mesh.columns, _COLUMNS)
            mesh = config.mesh.model_copy(update={"columns": columns})
            solved = [s.model_copy(update={"steps": min(s.count, _STEPS)}) for s in solved]
            config = config.model_copy(update={"mesh": mesh})
        config = config.model_copy(update={"program": tuple(solved)})
        kind = bool(quick), config.physics.model  # each has a mesh of its own
        reuse = self._reuse.setdefault(kind, Reuse())
        case = replace(self._case, config=config)
        simulation = Simulation(case, MPI.COMM_SELF, reuse=reuse)
        rows, states = list[Any](), list[Any]()
        for state in simulation:
            rows.append(state.row)
            states.append({"states": state.nodal(), "internal": state.internal()})
            if self._ticket != ticket:
                return None
        return Kept(config, rows, states, simulation.engine)


def deviation(fast: Run, solid: Run) -> str:
    """The error of a membrane relative to the range of the device's motion, in words."""
    told, at = [], solid.history["time_s"]
    for name in motion(solid):
        exact = solid.history[name].to_numpy()
        off = np.abs(np.interp(at, fast.history["time_s"], fast.history[name]) - exact).max()
        if off > 1e-6 * np.ptp(exact) > 1e-15:  # otherwise the motion is prescribed
            told.append(f"{split(name)[0].lower()} {100 * off / np.ptp(exact):.2g} %")
    return f"; the membrane deviates by {', '.join(told)} of the range" if told else ""
