"""The best design within limits, or the front of two objectives.

`dealib.design.explore` searches; here the best of what was evaluated is chosen and written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.cases.cache import key
from dealib.cases.workers import cores
from dealib.config.case import commented, load, resolved
from dealib.config.schema import Config
from dealib.design.designs import DESIGNS, Designs, Evaluated, as_model
from dealib.design.explore import best_of, explore
from dealib.design.goals import Aim, Goals, Limit, goals
from dealib.design.plan import DesignPlan
from dealib.design.search import scale
from dealib.errors import ConfigError, Interrupted, by_caller
from dealib.files import guarded, write_text
from dealib.results import spectra
from dealib.units import counted

if TYPE_CHECKING:
    import pandas

BEST, FRONT = "best.yaml", "front.csv"


@dataclass(frozen=True, repr=False)
class Optimum:
    """Result of an optimisation.

    Attributes:
        plan: The design.
        goals: Its objectives and limits.
        designs: A row for each design that was evaluated.
        best: The best design within all limits; for two objectives, the knee of the front. None
            if there is no such design.
        nearest: The design with the smallest violation of a limit, if `best` is None.
        front: Pareto front, if there are two objectives.
        solved: Number of designs that were solved now.
        directory: Directory of the results.
    """

    plan: DesignPlan
    goals: Goals
    designs: list[dict[str, Any]]
    best: Evaluated | None
    nearest: Evaluated | None
    front: list[Evaluated]
    solved: int
    directory: Path

    def __repr__(self) -> str:
        best = "none within limits" if self.best is None else f"best {self.best.point}"
        return f"<Optimum {self.plan.name}: {counted(len(self.designs), 'design')}, {best}>"

    @property
    def table(self) -> pandas.DataFrame:
        """The table of `designs.csv`."""
        return spectra.read(self.directory / DESIGNS)

    @property
    def config(self) -> Config:
        """The config of the best design."""
        return load(self.directory / BEST).config


def optimise(
    path: Path | str,
    out: Path | str | None = None,
    model: str | None = None,
    jobs: int | None = None,
    tell: Callable[[str], None] = lambda line: None,
) -> Optimum:
    """Find the best design; designs that were solved before are not solved again.

    Args:
        path: The YAML file of the design.
        out: Directory; default that of the file, or runs/NAME-optimum.
        model: solid, membrane or auto; default that of the file.
        jobs: Number of processes; default all cores.
        tell: Called with a line about each design.

    Raises:
        ConfigError: If the file is wrong.
        Interrupted: With what is kept and how to continue.
    """
    plan = DesignPlan(Path(path))
    asked = goals(plan)
    given = out or plan.design.output.directory or f"runs/{plan.name}-optimum"
    directory = Path(given).expanduser()
    folder = directory / "evaluations"
    if directory.exists() and not folder.is_dir() and any(directory.iterdir()):
        raise ConfigError(
            f"{directory} is not the directory of an optimum; choose another "
            + by_caller("--out", "directory")
        )
    with guarded(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Designs(plan, asked, folder, jobs or cores(), tell) as designs:
        try:
            last = explore(designs, model or plan.design.model, tell)
        except Interrupted as stop:
            said = f"{stop} after {counted(designs.solved, 'new design')}, which are kept in "
            raise Interrupted(f"{said}{folder}; the same command goes on", stop.signal) from None
    return _ended(designs, last, directory)


def _ended(designs: Designs, model: str, directory: Path) -> Optimum:
    """Choose the best of the evaluated designs, and write it with the front."""
    asked, plan = designs.goals, designs.plan
    valued = [one for one in designs.seen if one.model == model and not one.found.error]
    front = pareto([one for one in valued if designs.allowed(one)], asked.aims)
    best, nearest = best_of(designs, model, asked.aims[0]), None
    if best is not None and len(asked.aims) > 1:
        size = np.array([[a.sign * one.found.values[a.name] for a in asked.aims] for one in front])
        spread = np.ptp(size, axis=0)
        best = front[int(((size - size.min(axis=0)) / np.where(spread, spread, 1)).sum(1).argmin())]
        spectra.write(
            directory / FRONT, [designs.row(one) | {"number": k + 1} for k, one in enumerate(front)]
        )
    if best is not None:
        _write(directory / BEST, plan, best, model)
    elif valued:
        nearest = min(valued, key=lambda one: max(b for _, b in beyond(asked, one)))
    rows, solved = designs.rows(), designs.solved
    return Optimum(plan, asked, rows, best, nearest, front, solved, directory)


def beyond(asked: Goals, one: Evaluated) -> list[tuple[Limit, float]]:
    """Relative distance by which a design is beyond each limit; negative within."""
    seen = {name: (value, np.zeros(0)) for name, value in one.found.values.items()}
    return [(lim, -lim.slack(one.found.values) / scale(lim, seen)) for lim in asked.limits]


def pareto(found: Sequence[Evaluated], aims: Sequence[Aim]) -> list[Evaluated]:
    """The Pareto front of two objectives, sorted by the first one."""
    if len(aims) < 2 or not found:
        return []
    size = np.array([[a.sign * one.found.values[a.name] for a in aims] for one in found])
    order = np.lexsort((size[:, 1], size[:, 0]))
    least = np.minimum.accumulate(np.append(np.inf, size[order, 1]))[:-1]
    return [found[k] for k in order[size[order, 1] < least]]


def _write(path: Path, plan: DesignPlan, best: Evaluated, model: str) -> None:
    """Write the config of a design: the base with changes and comments, if that reads the same."""
    case = plan.case(best.point, **as_model(plan, model))
    name = f"{plan.name}-best"
    output = case.config.output.model_copy(update={"directory": f"runs/{name}"})
    whole = case.config.model_copy(update={"name": name, "output": output})
    changes = (*case.overrides, f"name={name}", f"output.directory=runs/{name}")
    write_text(path, commented(case.path, changes))
    try:
        if key(load(path).config, "") == key(whole, ""):
            return
    except ConfigError:
        pass  # the base names files relative to its own folder
    write_text(path, resolved(whole))
