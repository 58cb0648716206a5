"""The best design within limits, or the front of two objectives.

Searches go along gradients (`dealib.design.search`), from several starts and in each choice. Where
a membrane is near the solid, they search with the membrane. What it says is then corrected by the
solid, with value and slopes at the best point so far, until that point stays where it is.
"""

from __future__ import annotations

import functools
import itertools
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
from dealib.design.goals import Aim, Goals, Limit, goals
from dealib.design.schema import Plan, Point
from dealib.design.search import Best, Oracle, descend, ranked, scale
from dealib.errors import ConfigError, Interrupted, by_caller
from dealib.files import guarded, write_text
from dealib.results import spectra
from dealib.results.elements import Array
from dealib.units import counted

if TYPE_CHECKING:
    import pandas

BEST, FRONT = "best.yaml", "front.csv"
_NEAR = 0.25  # largest deviation of a membrane that is corrected
_ROUNDS = 5  # most solids that correct it
_STAYS = 2e-3  # of the range: a point that a correction moves by less is there

Start = tuple[Point, Array]


@dataclass(frozen=True, repr=False)
class Optimum:
    """What is found.

    Attributes:
        goals: What was asked.
        designs: A row for each design that was evaluated.
        best: The best one that is allowed; of two objectives, the knee of the front. None if no
            design is allowed.
        nearest: The least violation of limits, where no design is allowed.
        front: Designs that no other one is better than, if there are two objectives.
        solved: How many designs were solved now.
        directory: Where all of it is.
    """

    plan: Plan
    goals: Goals
    designs: list[dict[str, Any]]
    best: Evaluated | None
    nearest: Evaluated | None
    front: list[Evaluated]
    solved: int
    directory: Path

    def __repr__(self) -> str:
        best = "none is allowed" if self.best is None else f"best {self.best.point}"
        return f"<Optimum {self.plan.name}: {counted(len(self.designs), 'design')}, {best}>"

    @property
    def table(self) -> pandas.DataFrame:
        """The designs, as `designs.csv` has them."""
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
    """Find the best design; those that were solved before are not solved again.

    Args:
        path: The design's YAML file.
        out: Directory; default the file's, or runs/NAME-optimum.
        model: solid, membrane or auto; default the file's.
        jobs: Number of processes; default all cores.
        tell: Told of each design in one line.

    Raises:
        ConfigError: If the file is wrong.
        Interrupted: With what is kept.
    """
    plan = Plan(Path(path))
    asked = goals(plan)
    given = out or plan.design.output.directory or f"runs/{plan.name}-optimum"
    directory = Path(given).expanduser()
    folder = directory / "evaluations"
    if directory.exists() and not folder.is_dir() and any(directory.iterdir()):
        raise ConfigError(
            f"{directory} is no directory of an optimum; choose another "
            + by_caller("--out", "directory")
        )
    with guarded(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Designs(plan, asked, folder, jobs or cores(), tell) as designs:
        try:
            fast, last = _models(designs, model or plan.design.model, tell)
            _explore(_Models(designs, fast, last))
        except Interrupted as stop:
            said = f"{stop} after {counted(designs.solved, 'new design')}, which are kept in "
            raise Interrupted(f"{said}{folder}; the same command goes on", stop.signal) from None
    return _ended(designs, last, directory)


def _models(designs: Designs, wanted: str, tell: Callable[[str], None]) -> tuple[str, str]:
    """With which model is searched, and which has the last word."""
    plan, own = designs.plan, designs.plan.config.physics.model
    if wanted != "auto" or own == "membrane":
        plan.case(plan.start, **as_model(plan, own if wanted == "auto" else wanted))
        return (own, own) if wanted == "auto" else (wanted, wanted)
    try:
        plan.case(plan.start, **as_model(plan, "membrane"))
    except ConfigError:
        return own, own
    see = [functools.partial(designs.see, m, plan.start) for m in ("membrane", "solid")]
    thin, solid = designs.together(see)
    if thin.error or solid.error:
        return own, own
    off = {
        name: abs(thin.values[name] - value) / (abs(value) or 1.0)
        for name, value in solid.values.items()
    }
    told = ", ".join(f"{name} {part:.2%}" for name, part in off.items())
    near = max(off.values()) <= _NEAR
    tell(
        f"the membrane is off the solid by {told}: "
        + ("it is searched with the membrane, and corrected by the solid" if near else "no use")
    )
    return ("membrane" if near else "solid"), "solid"


@dataclass(frozen=True)
class _Models:
    """Evaluated designs, the model that is searched with, and the one that has the last word."""

    designs: Designs
    fast: str
    last: str

    def least(self, aim: Aim, limits: Sequence[Limit], starts: Sequence[Start]) -> Start | None:
        """The best point from several starts, by the fast model."""
        designs, search = self.designs, self.designs.plan.design.search

        def one(choice: Point, x: Array) -> Best | None:
            return descend(designs.oracle(self.fast, choice), aim, limits, x, search)

        bests = designs.together([functools.partial(one, *start) for start in starts])
        found = [(best.rank, k, best) for k, best in enumerate(bests) if best is not None]
        if not found:
            return None
        _, k, best = min(found, key=lambda item: item[:2])
        return starts[k][0], best.x

    def settle(self, aim: Aim, limits: Sequence[Limit], start: Start | None) -> None:
        """Correct the fast model by the last one until the best point stays where it is."""
        if start is None or self.fast == self.last:
            return
        choice, x = start
        fast, last = (self.designs.oracle(m, choice) for m in (self.fast, self.last))
        safe = self.designs.place(self.designs.plan.start)
        for _ in range(_ROUNDS):
            corrected = _corrected(fast, last, x)
            if corrected is None:
                x = (x + safe) / 2
                continue
            seen = corrected(x)
            assert seen is not None
            here = ranked(x, seen, aim, limits)
            best = descend(corrected, aim, limits, x, self.designs.plan.design.search)
            if best is None or (not here.beyond and np.abs(best.x - x).max(initial=0) < _STAYS):
                return
            x, safe = best.x, x


def _corrected(fast: Oracle, last: Oracle, x: Array) -> Oracle | None:
    """A fast model that has value and slopes of the last one at a point."""
    thin, solid = fast(x), last(x)
    if thin is None or solid is None:
        return None
    off = {n: (value - thin[n][0], slope - thin[n][1]) for n, (value, slope) in solid.items()}

    def see(y: Array) -> dict[str, tuple[float, Array]] | None:
        seen = fast(y)
        if seen is None:
            return None
        return {
            n: (seen[n][0] + a + float(b @ (y - x)), seen[n][1] + b) for n, (a, b) in off.items()
        }

    return see


def _explore(models: _Models) -> None:
    """Search for the optimum of each objective, and for the front between them."""
    designs = models.designs
    aims, limits = designs.goals.aims, designs.goals.limits
    designs.together([functools.partial(_single, models, aim, limits) for aim in aims])
    ends = [_best(designs, models.last, aim) for aim in aims]
    if len(aims) < 2 or None in ends:
        return
    search, (first, second) = designs.plan.design.search, aims
    points = [one.point for one in ends if one is not None]
    places = [designs.place(point) for point in points]
    values = [one.found.values[second.name] for one in ends if one is not None]

    def between(share: float) -> None:
        bound = values[0] + share * (values[1] - values[0])
        within = (*limits, Limit("the front", second.name, second.sign, bound))
        x = places[0] + share * (places[1] - places[0])
        starts = [(choice, x) for choice in _choices(designs.plan)]
        models.settle(first, within, models.least(first, within, starts))

    shares = np.linspace(0, 1, search.front)[1:-1]
    designs.together([functools.partial(between, share) for share in shares])


def _single(models: _Models, aim: Aim, limits: Sequence[Limit]) -> None:
    """Search from the start in each choice, and from other starts in the best one."""
    from scipy.stats import qmc

    designs, search = models.designs, models.designs.plan.design.search
    choices, x = _choices(designs.plan), designs.place(designs.plan.start)
    halton = qmc.Halton(max(1, len(x)), seed=0).random(search.starts)[1:] if len(x) else []
    starts, best = [(choice, x) for choice in choices], None
    if len(choices) > 1:
        best = models.least(aim, limits, starts)
        choices, starts = (choices, []) if best is None else ([best[0]], [best])
    starts += [(choice, other) for choice in choices for other in halton]
    best = models.least(aim, limits, starts)
    models.settle(aim, limits, best)


def _choices(plan: Plan) -> list[Point]:
    """All combinations of the choices."""
    chosen = {n: list(v.changes) for n, v in plan.design.variables.items() if v.choices is not None}
    return [
        dict(zip(chosen, labels, strict=True)) for labels in itertools.product(*chosen.values())
    ]


def _best(designs: Designs, model: str, aim: Aim) -> Evaluated | None:
    """The best design that is allowed, of those that a model has evaluated."""
    allowed = [one for one in designs.seen if one.model == model and designs.allowed(one)]
    return min(allowed, key=lambda one: aim.sign * one.found.values[aim.name], default=None)


def _ended(designs: Designs, model: str, directory: Path) -> Optimum:
    """Choose the best of what was evaluated, and write it."""
    asked, plan = designs.goals, designs.plan
    valued = [one for one in designs.seen if one.model == model and not one.found.error]
    front = pareto([one for one in valued if designs.allowed(one)], asked.aims)
    best, nearest = _best(designs, model, asked.aims[0]), None
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
    """By how much of each limit a design is beyond it; negative within."""
    seen = {name: (value, np.zeros(0)) for name, value in one.found.values.items()}
    return [(lim, -lim.slack(one.found.values) / scale(lim, seen)) for lim in asked.limits]


def pareto(found: Sequence[Evaluated], aims: Sequence[Aim]) -> list[Evaluated]:
    """Designs that no other one is better than, by the first objective."""
    if len(aims) < 2 or not found:
        return []
    size = np.array([[a.sign * one.found.values[a.name] for a in aims] for one in found])
    order = np.lexsort((size[:, 1], size[:, 0]))
    least = np.minimum.accumulate(np.append(np.inf, size[order, 1]))[:-1]
    return [found[k] for k in order[size[order, 1] < least]]


def _write(path: Path, plan: Plan, best: Evaluated, model: str) -> None:
    """Write the config of a design, with the comments of the base where that means the same."""
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
        pass  # it names files beside the base
    write_text(path, resolved(whole))
