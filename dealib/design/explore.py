"""The search for an optimum, or for the front of two objectives.

Gradient-based searches (`dealib.design.search`) begin at several starts and in each choice. If a
membrane agrees well enough with the solid, they use the membrane. Its quantities are then corrected
by value and slope of the solid at the best point, until that point no longer moves.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array
from dealib.design.designs import Designs, Evaluated, as_model
from dealib.design.goals import Aim, Limit
from dealib.design.plan import DesignPlan, Point
from dealib.design.search import Best, Oracle, descend, ranked
from dealib.errors import ConfigError

_NEAR = 0.25  # largest relative deviation of a membrane that is corrected by the solid
_ROUNDS = 5  # largest number of corrections
_STAYS = 2e-3  # change of a point, as a share of the ranges, below which corrections end

Start = tuple[Point, Array]


def explore(designs: Designs, wanted: str, tell: Callable[[str], None]) -> str:
    """Search for the optimum of each objective, and for the front of two.

    Args:
        designs: Evaluates designs and keeps them.
        wanted: solid, membrane or auto.
        tell: Called with a line about the choice of the model.

    Returns:
        The model whose designs count.
    """
    fast, last = _models(designs, wanted, tell)
    _explore(_Models(designs, fast, last))
    return last


def _models(designs: Designs, wanted: str, tell: Callable[[str], None]) -> tuple[str, str]:
    """The model that searches use, and the one whose designs count."""
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
        f"the membrane deviates from the solid by {told}: "
        + ("searching with the membrane, corrected by the solid" if near else "it is not used")
    )
    return ("membrane" if near else "solid"), "solid"


@dataclass(frozen=True)
class _Models:
    """Evaluated designs, the model that searches use, and the one whose designs count."""

    designs: Designs
    fast: str
    last: str

    def least(self, aim: Aim, limits: Sequence[Limit], starts: Sequence[Start]) -> Start | None:
        """The best point of searches with the fast model from several starts."""
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
        """Correct the fast model by the last one until the best point no longer moves."""
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
    """The fast model, corrected to the value and slopes of the last one at a point."""
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
    """Search for the optimum of each objective, and for points of the front between them."""
    designs = models.designs
    aims, limits = designs.goals.aims, designs.goals.limits
    designs.together([functools.partial(_single, models, aim, limits) for aim in aims])
    ends = [best_of(designs, models.last, aim) for aim in aims]
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
    """Search from the given start in each choice, then from other starts in the best choice."""
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


def _choices(plan: DesignPlan) -> list[Point]:
    """All combinations of the choices."""
    chosen = {n: list(v.changes) for n, v in plan.design.variables.items() if v.choices is not None}
    return [
        dict(zip(chosen, labels, strict=True)) for labels in itertools.product(*chosen.values())
    ]


def best_of(designs: Designs, model: str, aim: Aim) -> Evaluated | None:
    """The best design within all limits among those of a model; None if there is none."""
    allowed = [one for one in designs.seen if one.model == model and designs.allowed(one)]
    return min(allowed, key=lambda one: aim.sign * one.found.values[aim.name], default=None)
