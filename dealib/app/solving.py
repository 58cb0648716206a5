"""Solves what the sliders of a page ask for: the newest position wins."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pandas as pd

from dealib.config.case import Case, resolved
from dealib.config.schema import Config
from dealib.design.keys import Key, changed, keys, moved
from dealib.errors import ConfigError, DealibError, first_line
from dealib.files import guarded
from dealib.plots.labels import split
from dealib.program import Simulation
from dealib.program.margins import table
from dealib.results.reader import Run
from dealib.results.summary import motion

_COLUMNS, _STEPS = 12, 2  # of a quick answer: elements along the film, steps of a stage
_REACH = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of a slider, of the number that the file gives
QUICK, FULL, CHECK = 0, 1, 2  # what is asked for
_HOW = ("quick: few steps and elements", "all steps", "checked by the solid")
Values = tuple[float, ...]


@dataclass(frozen=True)
class Slider:
    """A number of the config that can be moved, and how far."""

    key: Key
    low: float
    high: float


@dataclass(frozen=True)
class Answer:
    """What was found for a position of the sliders: a run, or what went wrong; and how."""

    run: Run | None
    told: str
    problem: str = ""


class Kept(Run):
    """A run in memory."""

    def __init__(self, config: Config, rows: list[Any], states: list[Any], last: Any) -> None:
        self.directory, self._told, self._states = Path(config.directory), set(), states
        self._info = {"margins": table(last.progress.worst), "name": config.name, "status": "done"}
        # what a run would read from its files
        self.__dict__ |= {"config": config, "title": config.name, "mesh": last.layout.mesh}
        self.__dict__ |= {"history": pd.DataFrame(rows)}

    @property
    def info(self) -> dict[str, Any]:
        """See `Run`."""
        return self._info

    @property
    def stored_steps(self) -> list[int]:
        """See `Run`."""
        return list(range(len(self._states)))

    def _stored(self, group: str, index: int) -> Any:
        return self._states[index].get(group)


def sliders(config: Config, wanted: Sequence[str]) -> list[Slider]:
    """Numbers of a config that can be moved by half of themselves, or as far as it may.

    Raises:
        ConfigError: If there is no such number, or it cannot be moved.
    """
    found = []
    for key in keys(config, wanted):
        ends = [next((f for f in tried if _allowed(config, key, f)), 1.0)
                for tried in (_REACH, [2 - f for f in _REACH])]  # fmt: skip
        if ends[0] < ends[1]:
            found.append(Slider(key, *sorted(f * key.value for f in ends)))
        elif wanted:
            raise ConfigError(f"--key {key.name}: the config allows no other value of it")
    if not found:
        raise ConfigError("the config gives no number that could be moved")
    return found


def _allowed(config: Config, key: Key, factor: float) -> bool:
    try:
        return bool(changed(config, key, factor))
    except ConfigError:
        return False


class Session:
    """A config under sliders; asked by the page's threads, and solved in the one of `serve`.

    Attributes:
        sliders: What can be moved.
        run: The first result.

    Args:
        case: The case.
        wanted: Keys of the sliders; default all numbers that the file gives.

    Raises:
        ConfigError: If a key is wrong.
        NotConverged: If the config as it is has no solution.
    """

    def __init__(self, case: Case, wanted: Sequence[str] = ()) -> None:
        self._case, self.sliders = case, sliders(case.config, wanted)
        self._turn, self._ticket, self._newest = threading.Condition(), 0, Values()
        self._asked: tuple[int, int, Values] | None = None
        self._found: tuple[int, Answer | None] = (0, None)
        own = case.config.physics.model == "membrane"
        self._sheet, self._model = dict[str, Any](), "membrane" if own else "solid"
        start = tuple(s.key.value for s in self.sliders)
        found = None if own else self._as_membrane(start)
        self.run: Run = found or self._solve(self.config(start), own)

    @property
    def checks(self) -> bool:
        """Whether the solid checks the membrane that stands for it."""
        return bool(self._sheet)

    def _as_membrane(self, start: Values) -> Run | None:
        """A membrane's answer in place of the solid's, if there is one."""
        self._sheet = {"physics": {"model": "membrane", "formulation": "displacement"}}
        if getattr(self._case.config.geometry, "air_height", 0):
            self._sheet["geometry"] = {"air_height": "0 mm"}
        self._model = "membrane in place of the solid"
        try:
            return self._solve(self.config(start), True)
        except DealibError as error:
            self._sheet, self._model = {}, f"solid (no membrane: {first_line(error)})"
            return None

    def config(self, values: Values, solid: bool = False) -> Config:
        """The config of a position of the sliders.

        Raises:
            ConfigError: If it is none.
        """
        pairs = zip(self.sliders, values, strict=True)
        factors = {s.key: v / s.key.value for s, v in pairs if abs(v / s.key.value - 1) > 1e-9}
        return moved(self._case.config, factors, {} if solid else self._sheet)

    def save(self, values: Values) -> Path:
        """Write the config of a position into the present folder, under a name of its own."""
        config, k = self.config(values), 1
        while Path(f"{config.name}-app-{k}.yaml").exists():
            k += 1
        path = Path(f"{config.name}-app-{k}.yaml")
        output = config.output.model_copy(update={"directory": f"runs/{path.stem}"})
        text = resolved(config.model_copy(update={"output": output}))
        with guarded(path), path.open("x", encoding="utf-8") as file:
            file.write(f"# {config.name} as its sliders stood in dealib app; {self._model}\n{text}")
        return path

    def ask(self, level: int, values: Values) -> Answer | None:
        """Wait for an answer; None once another position is asked for."""
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
            answer = self._answer(level, values, ticket)
            with self._turn:
                self._found = ticket, answer
                self._turn.notify_all()

    def _answer(self, level: int, values: Values, ticket: int) -> Answer | None:
        begin, told = time.perf_counter(), f"{self._model}, {_HOW[level]}"
        if level == QUICK and self._model.startswith("solid"):
            return Answer(self.run, f"{self._model}: is being solved")
        try:
            run = self._solve(self.config(values, level == CHECK), level == QUICK, ticket)
        except DealibError as error:
            return Answer(None, f"{told}: the curves are those of an earlier position", str(error))
        if run is None:
            return None
        told += f", {time.perf_counter() - begin:.2f} s"
        if level == CHECK:
            told += deviation(self.run, run)
        else:
            self.run = run
        return Answer(run, told)

    def _solve(self, config: Config, quick: bool, ticket: int = 0) -> Any:
        """The run of a config; None if it is not wanted any more."""
        if quick:
            columns = min(config.mesh.columns, _COLUMNS)
            mesh = config.mesh.model_copy(update={"columns": columns})
            cut = [s.model_copy(update={"steps": min(s.steps, _STEPS)}) for s in config.program]
            config = config.model_copy(update={"mesh": mesh, "program": tuple(cut)})
        rows, states = list[dict[str, Any]](), list[dict[str, Any]]()
        simulation = Simulation(replace(self._case, config=config), MPI.COMM_SELF)
        for state in simulation:
            rows.append(state.row)
            states.append({"states": state.nodal(), "internal": state.internal()})
            if self._ticket != ticket:
                return None
        return Kept(config, rows, states, simulation.engine)


def deviation(fast: Run, solid: Run) -> str:
    """By how much a membrane is off, of the range of what the device does."""
    told, at = [], solid.history["time_s"]
    for name in motion(solid):
        exact = solid.history[name].to_numpy()
        off = np.abs(np.interp(at, fast.history["time_s"], fast.history[name]) - exact).max()
        if np.ptp(exact) > 1e-9 and off > 1e-6 * np.ptp(exact):  # it is not given
            told.append(f"{split(name)[0].lower()} {100 * off / np.ptp(exact):.2g} %")
    return f"; the membrane is off by {', '.join(told)} of the range" if told else ""
