"""Evaluation of designs: threads of a search ask for them, processes solve them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.cases.job import Ended
from dealib.cases.workers import Pool
from dealib.design import evaluate
from dealib.design.evaluate import Evaluation
from dealib.design.goals import Goals
from dealib.design.plan import DesignPlan, Point
from dealib.design.search import Oracle, Seen
from dealib.errors import ConfigError, PlatformError
from dealib.reading import shown
from dealib.results import spectra
from dealib.units import convert

DESIGNS = "designs.csv"
_STEP = 1e-3  # step of finite differences, as a share of a variable's range


@dataclass(frozen=True)
class Evaluated:
    """A design that was solved: its model, its variables and its quantities."""

    model: str
    point: Point
    found: Evaluation


class Designs:
    """All evaluated designs; several threads may ask for one, which is solved once.

    Attributes:
        seen: The designs in the order of their evaluation.
        solved: Number of designs that had to be solved.
        numbers: Names of the variables that are numbers.
        ranges: Their bounds, (numbers, 2), in their units.

    Args:
        plan: The design.
        goals: Its objectives and limits.
        folder: Folder of the evaluations.
        jobs: Number of processes.
        tell: Called with a line about each design.
    """

    def __init__(
        self, plan: DesignPlan, goals: Goals, folder: Path, jobs: int, tell: Callable[[str], None]
    ) -> None:
        self.plan, self.goals, self.folder, self._tell = plan, goals, folder, tell
        self.seen: list[Evaluated] = []
        self.solved, self._stopped, self._lock = 0, False, threading.RLock()
        self._known: dict[str, threading.Lock] = {}
        self._pools = [Pool(1) for _ in range(jobs)]
        self._free: queue.Queue[Pool] = queue.Queue()
        for pool in self._pools:
            self._free.put(pool)
        self.numbers = [n for n, v in plan.design.variables.items() if v.choices is None]
        self.ranges = np.array([plan.design.variables[n].range for n in self.numbers])

    def __enter__(self) -> Designs:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def together(self, calls: Sequence[Callable[[], Any]]) -> list[Any]:
        """Results of calls that run in parallel threads."""
        with ThreadPoolExecutor(max(1, len(calls))) as threads:
            try:
                return list(threads.map(lambda call: call(), calls))
            except BaseException:
                self.stop()  # this ends the other threads as well
                raise

    def stop(self) -> None:
        """End all processes."""
        self._stopped = True
        for pool in self._pools:
            pool.__exit__()

    def point(self, choice: Point, x: Array) -> Point:
        """The design of a choice and of numbers that are scaled from 0 to 1."""
        low, high = self.ranges.T if len(x) else np.zeros((2, 0))
        values = np.clip(low + x * (high - low), low, high)
        return {**choice, **dict(zip(self.numbers, map(float, values), strict=True))}

    def place(self, point: Point) -> Array:
        """The numbers of a design, scaled from 0 to 1."""
        values = np.array([float(point[name]) for name in self.numbers])
        return (values - self.ranges[:, 0]) / np.ptp(self.ranges, axis=1) if len(values) else values

    def see(self, model: str, point: Point, slopes: bool = True) -> Evaluation:
        """Evaluate a design, unless it was evaluated before.

        Args:
            model: solid or membrane.
            point: Value of each variable.
            slopes: Whether derivatives by the numbers are computed too.

        Raises:
            PlatformError: If a process has ended unexpectedly.
        """
        changes = as_model(self.plan, model)
        ranges = dict(zip(self.numbers, self.ranges, strict=True))
        names = [n for n in self.numbers if abs(float(point[n])) > 1e-6 * np.ptp(ranges[n])]
        try:
            case = self.plan.case(point, **changes)
            label = f"design {len(self.seen) + 1}"
            asked = self.goals.asked
            job = evaluate.job(label, case, self.folder, asked, names if slopes else ())
        except ConfigError as error:
            return self._keep(model, point, Evaluation({}, {}, str(error)))
        with self._lock:
            own = self._known.setdefault(job.key, threading.Lock())
        with own:  # another thread may be solving it
            if (found := evaluate.read(job)) is None:
                pool = self._free.get()
                ended: Ended | None = None
                try:
                    if not self._stopped:
                        ended = next(pool.solve([job]))
                finally:
                    self._free.put(pool)
                if self._stopped or ended is None:
                    raise PlatformError("stopped")
                found = evaluate.read(job) or Evaluation({}, {}, ended.error or "no result")
                with self._lock:
                    self.solved += 1
        return self._keep(model, point, found)

    def _keep(self, model: str, point: Point, found: Evaluation) -> Evaluation:
        with self._lock:
            if not any(one.model == model and one.point == point for one in self.seen):
                self.seen.append(Evaluated(model, point, found))
                self._tell(self._line(self.seen[-1]))
                spectra.write(self.folder.parent / DESIGNS, self.rows())
        return found

    def _line(self, one: Evaluated) -> str:
        said = shown(one.found.error.splitlines()[0]) if one.found.error else ""
        for aim in self.goals.aims if not said else ():
            said += f"{aim.name} = {one.found.values[aim.name]:.6g}, "
        if not one.found.error:
            slack = self.goals.slack(one.found.values)
            said += "within the limits" if slack >= 0 else f"beyond a limit by {-slack:.3g}"
        return f"{len(self.seen):4d}  {one.model:<8}  {said}"

    def rows(self) -> list[dict[str, Any]]:
        """The rows of `designs.csv`."""
        return [self.row(one) | {"number": k + 1} for k, one in enumerate(self.seen)]

    def row(self, one: Evaluated) -> dict[str, Any]:
        """A design as a row of a table."""
        units = {name: v.unit for name, v in self.plan.design.variables.items()}
        named = {f"{n} [{units[n]}]" if units[n] else n: one.point[n] for n in units}
        values = {name: one.found.values.get(name, float("nan")) for name in self.goals.asked}
        row = {"number": 0, "model": one.model, **named, **values}
        return row | {"allowed": self.allowed(one), "error": one.found.error}

    def allowed(self, one: Evaluated) -> bool:
        """Whether a design has values, and is within all limits."""
        return not one.found.error and self.goals.slack(one.found.values) >= 0

    def oracle(self, model: str, choice: Point) -> Oracle:
        """Values and slopes as functions of the scaled numbers, for searches."""

        def see(x: Array) -> Seen | None:
            found = self.see(model, self.point(choice, x))
            if found.error:
                return None
            slopes = np.array([self._slopes(model, choice, x, k, found) for k in range(len(x))])
            return {
                name: (value, slopes[:, i] if len(x) else np.zeros(0))
                for i, (name, value) in enumerate(found.values.items())
            }

        return see

    def _slopes(
        self, model: str, choice: Point, x: Array, k: int, found: Evaluation
    ) -> list[float]:
        """Slopes of all quantities by one number; finite differences if the run gives none."""
        name = self.numbers[k]
        variable, key = self.plan.design.variables[name], self.plan.keys[name]
        if all(name in of for of in found.slopes.values()):
            width = convert((float(np.ptp(self.ranges[k])), variable.unit), key.unit)
            return [of[name] * width for of in found.slopes.values()]
        for step in (_STEP, -_STEP) if x[k] < 0.5 else (-_STEP, _STEP):
            beside = self.see(model, self.point(choice, x + step * np.eye(len(x))[k]), False)
            if not beside.error:
                return [(beside.values[q] - v) / step for q, v in found.values.items()]
        return [0.0] * len(found.values)


def as_model(plan: DesignPlan, model: str) -> dict[str, Any]:
    """Changes of the config that make it a solid, or a membrane without air."""
    if model == plan.config.physics.model:
        return {}
    air = getattr(plan.config.geometry, "air_height", 0.0) if model == "membrane" else 0.0
    return {"physics.model": model} | ({"geometry.air_height": "0 mm"} if air else {})
