"""Solves what the sliders of a page ask for: the newest position wins."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pandas as pd

from dealib.config.case import Case, resolved
from dealib.config.schema import Config
from dealib.design.keys import Key, changed, keys, moved
from dealib.errors import ConfigError, DealibError
from dealib.files import guarded
from dealib.plots.curves import label
from dealib.program import Simulation
from dealib.program.margins import table
from dealib.results.reader import Run
from dealib.results.summary import GIVEN, MARGINS, motion

_COLUMNS, _STEPS = 12, 3  # of a quick answer: elements along the film, steps of a stage
_REACH = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of a slider, of the number that the file gives
QUICK, FULL, CHECK = 0, 1, 2  # what is asked for
Values = tuple[float, ...]


@dataclass(frozen=True)
class Slider:
    """A number of the config that can be moved, and how far."""

    key: Key
    low: float
    high: float


@dataclass(frozen=True)
class Answer:
    """What was found for a position of the sliders.

    Attributes:
        run: The last good result.
        level: How it was found: `QUICK`, `FULL` or `CHECK`, the solid's.
        seconds: That took so long.
        problem: What went wrong; the run is then that of an earlier position.
        note: How far the membrane is off.
    """

    run: Run | None
    level: int
    seconds: float = 0.0
    problem: str = ""
    note: str = ""


class Kept(Run):
    """A run in memory."""

    def __init__(self, config: Config, rows: list[dict[str, Any]], last: Any) -> None:
        self.directory, self._told = Path(config.directory), set()
        self._states: list[dict[str, Any]] = []
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
        why: Why there is no membrane model in place of the solid; empty if there is one.

    Args:
        case: The case.
        wanted: Keys of the sliders; default all numbers that the file gives.
    """

    def __init__(self, case: Case, wanted: Sequence[str] = ()) -> None:
        self._case, self.sliders = case, sliders(case.config, wanted)
        self.why, self._sheet = "", dict[str, Any]()
        self._own = case.config.physics.model == "membrane"
        if not self._own:
            self._sheet = {"physics": {"model": "membrane", "formulation": "displacement"}}
            if getattr(case.config.geometry, "air_height", 0):
                self._sheet["geometry"] = {"air_height": "0 mm"}
            try:
                self.config(tuple(s.key.value for s in self.sliders))
            except ConfigError as error:
                self._no_membrane(error)
        self._turn, self._ticket = threading.Condition(), 0
        self._asked: tuple[int, int, Values] | None = None
        self._newest: Values = ()
        self._found: tuple[int, Answer] | None = None
        self._good: Run | None = None

    @property
    def membrane(self) -> bool:
        """Whether answers are those of a membrane."""
        return self._own or bool(self._sheet)

    @property
    def checks(self) -> bool:
        """Whether the solid checks the membrane."""
        return bool(self._sheet)

    def _no_membrane(self, error: Exception) -> None:
        self.why, self._sheet = str(error).splitlines()[0], {}

    def config(self, values: Values, solid: bool = False) -> Config:
        """The config of a position of the sliders.

        Raises:
            ConfigError: If it is none.
        """
        factors = {s.key: v / s.key.value for s, v in zip(self.sliders, values, strict=True)}
        factors = {key: f for key, f in factors.items() if abs(f - 1) > 1e-9}
        return moved(self._case.config, factors, {} if solid else self._sheet)

    def save(self, values: Values) -> Path:
        """Write the config of a position into the present folder, under a name of its own."""
        config = self.config(values)
        for k in range(1, 10_000):
            path = Path(f"{config.name}-app-{k}.yaml")
            output = config.output.model_copy(update={"directory": f"runs/{path.stem}"})
            text = resolved(config.model_copy(update={"output": output}))
            with guarded(path):
                try:
                    with path.open("x", encoding="utf-8") as file:
                        file.write(f"# {config.name}, as its sliders stood in dealib app\n{text}")
                    return path
                except FileExistsError:
                    continue
        raise ConfigError("there are 9999 files of this name already")

    def ask(self, level: int, values: Values) -> Answer | None:
        """Wait for an answer; None once another position is asked for."""
        with self._turn:
            if level == QUICK:
                self._newest = values
            elif values != self._newest:
                return None
            self._ticket += 1
            mine, self._asked = self._ticket, (self._ticket, level, values)
            self._turn.notify_all()
            self._turn.wait_for(lambda: self._ticket != mine or self._done(mine))
            return self._found[1] if self._found and self._done(mine) else None

    def _done(self, ticket: int) -> bool:
        return self._found is not None and self._found[0] == ticket

    def serve(self) -> None:
        """Answer until a signal comes."""
        while True:
            with self._turn:
                self._turn.wait_for(lambda: self._asked is not None)
                assert self._asked is not None
                (ticket, level, values), self._asked = self._asked, None
            answer = self._answer(ticket, level, values)
            with self._turn:
                if answer is not None:
                    self._found = ticket, answer
                self._turn.notify_all()

    def _answer(self, ticket: int, level: int, values: Values) -> Answer | None:
        begin = time.perf_counter()
        try:
            if level == QUICK and not self.membrane:
                return Answer(self._good, level)
            run = self._solve(self.config(values, level == CHECK), ticket, level == QUICK)
        except DealibError as error:
            if self._good is None and self._sheet and level < CHECK:
                self._no_membrane(error)  # at rest already, the solid may well have a state
                return self._answer(ticket, level, values)
            return Answer(self._good, level, time.perf_counter() - begin, str(error))
        if run is None:
            return None
        note, seconds = "", time.perf_counter() - begin
        if level == CHECK and self._good is not None:
            note = deviation(self._good, run)
        elif level < CHECK:
            self._good = run
        return Answer(run, level, seconds, "", note)

    def _solve(self, config: Config, ticket: int, quick: bool) -> Run | None:
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
        found = Kept(config, rows, simulation.engine)
        found._states = states
        return found


def deviation(fast: Run, solid: Run) -> str:
    """The largest difference of what the device does, of its range, by quantity."""
    import numpy as np

    told = []
    for name in motion(solid):
        a, b = (np.interp(solid.history["time_s"], r.history["time_s"], r.history[name])
                for r in (fast, solid))  # fmt: skip
        span = max(np.ptp(b), 1e-12)
        if span > 1e-9 * max(1.0, np.abs(b).max()):
            told.append(f"{label(name)} {100 * np.abs(a - b).max() / span:.2g} %")
    uses = [c for c in MARGINS if c in fast.history and c in solid.history and c in GIVEN]
    for name in uses:
        a, b = (r.history[name].max() for r in (fast, solid))
        told.append(f"{MARGINS[name][0]} {100 * abs(a / b - 1):.2g} %")
    return "the membrane is off by " + ", ".join(told) if told else ""
