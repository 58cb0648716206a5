"""The kinds of load stage: each is a generator of converged states."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from dealib.config.program import Stage
from dealib.device.records import CHAMBER, TERMINAL
from dealib.errors import ConfigError, NotConverged
from dealib.program.chosen import Chosen, to_halve
from dealib.program.engine import Engine
from dealib.program.follow import BIFURCATION, LIMIT_POINT, BranchFollower
from dealib.program.history import History, State
from dealib.program.increments import Increments
from dealib.program.inputs import driven_by, law, milestones, plain_drive
from dealib.program.pair import Pair, PortVariable
from dealib.program.progress import Position

_LIMITS = {  # how the largest value of what is driven is called, and what passes it
    TERMINAL: ("pull-in", "charge or the displacement"),
    CHAMBER: ("the largest pressure", "volume"),
}
_NEAR = 0.8  # use of a limit from which on it is named where a stage stops
log = logging.getLogger(__name__)


def prestrain(of: Engine, history: History, stage: Stage) -> Iterator[State]:
    """Ramp the pre-stretch with the ports at rest; the clock starts when it is reached."""
    of.apply(0.0)

    def apply(fraction: float) -> tuple[Any, ...]:
        of.problem.set_prestretch(fraction)
        return ("prestretch", fraction)

    apply(0.0)
    increments = Increments(of.newton, of.config.solver, of.predictor, watch=of.leaps)
    targets = [k / stage.count for k in range(1, stage.count + 1)]
    for _ in increments.run(targets, {1.0}, apply, partial(_failure, of, stage)):
        pass
    if of.viscosity is not None:
        of.viscosity.rest()
    if of.newton.system.charging is not None:
        of.newton.system.charging.rest()
    yield from _state(of, history, stage, 0.0, last=True)


def ramp(of: Engine, history: History, stage: Stage) -> Iterator[State]:
    """Move the inputs through the stage, or what is left of it."""
    p, clocks = of.progress, of.clocks
    targets, corners = milestones(stage, of.drives)

    def apply(at: float) -> tuple[Any, ...]:
        if at > p.clock.now:
            of.begin((at - p.clock.now) * stage.duration)
        return of.apply(at)

    def time(at: float) -> float:
        return p.stage_start + at * stage.duration

    fine = any(c.bisect for c in (*of.config.stop_when, *stage.stop_when))

    def judge(at: float, step: float) -> tuple[bool, float]:
        """Not to keep a state that meets a condition on a step that is to be halved for it."""
        met = history.met(stage, time(at)) if fine else []
        return (False, step / 2) if to_halve(met, step, stage) else (True, math.inf)

    apply(p.clock.now)
    increments = Increments(of.newton, of.config.solver, of.predictor, p.clock, clocks, of.leaps)
    chosen = None
    if stage.auto:
        chosen = Chosen(of, history, stage, targets, corners, partial(stability, of))
    explain = partial(_failure, of, stage)
    for at in increments.run(
        targets, corners, apply, explain, chosen.judge if chosen else judge, stage.auto
    ):
        for clock in clocks:
            clock.commit()
        last = at == targets[-1]
        if chosen is None:
            yield from _state(of, history, stage, time(at), last)
        else:
            yield from chosen.accept(at, last)
        if p.over:
            return


def follow(of: Engine, history: History, stage: Stage) -> Iterator[State]:
    """Follow the branch of equilibria, or what is left of it."""
    p, given, device = of.progress, stage.follow, of.problem.device
    assert given is not None
    vary, along = (PortVariable.of(device, name) for name in given.pair)
    limits = {PortVariable.of(device, name): limit for name, limit in given.until.items()}
    end = limits[along]
    of.apply(1.0)
    if p.branch is None:
        way = abs(end - _at(p.ports, along))
        if way <= 1e-9 * along.size(of.problem):
            problem = f"begins at the value of {along.name} at which it is to end; change `until`"
            raise ConfigError(f"stage {stage.stage!r} {problem}")
        p.branch = Position((vary.size(of.problem), way))
    pair = Pair(vary, along, p.branch.sizes)
    goal = limits.get(vary)
    branch = BranchFollower(
        of.newton, of.config.solver, of.predictor, pair, end, stage.count, p.branch, goal
    )
    name = vary.name.partition(".")[0]
    try:
        for found in branch.run():
            at, before = p.stage_start + p.branch.length * stage.duration, p.ports
            p.drives[pair.port] = (plain_drive(vary.port, name, (p.branch.point[0],) * 2),)
            of.newton.system.ports[pair.port] = law(p.drives[pair.port], 1.0)  # as it is measured
            full = p.branch.count >= (given.states or 10 * stage.count)
            (state,) = _state(of, history, stage, at, full, found.modes, found.kind)
            p.branch.done |= p.over or any(
                _passed(_at(before, v), _at(p.ports, v), limit) for v, limit in limits.items()
            )
            if full and given.states is None and not p.branch.done:
                log.warning(
                    "stage '%s' ends after %d states, ten times its steps, at %s, not at the end "
                    "of its branch; give it more steps, or `states`",
                    stage.stage,
                    p.branch.count,
                    _where(p.branch, pair),
                )
            p.branch.done |= full
            yield replace(state, end_of_stage=p.branch.done)
    except NotConverged as error:
        raise NotConverged(
            f"stage {stage.stage!r} stopped at {_where(p.branch, pair)}: {error}; "
            "everything up to there is kept"
        ) from None


def _at(ports: dict[str, tuple[float, float]], variable: PortVariable) -> float:
    """A variable in a state's values and duals."""
    return ports[variable.port.name][int(variable.dual)]


def _where(branch: Position, pair: Pair) -> str:
    """Values of both variables, for messages."""
    named = zip((pair.vary, pair.along), branch.point, strict=True)
    return ", ".join(
        f"{v.name} = {value * v.variable.factor:.6g} {v.variable.unit}" for v, value in named
    )


def _state(
    of: Engine,
    history: History,
    stage: Stage,
    at: float,
    last: bool,
    modes: int | None = None,
    kind: str = "",
) -> list[State]:
    """Accept the present state."""
    return history.accept(stage, history.draft(at, stability(of, modes, kind)), last)


def stability(of: Engine, modes: int | None = None, kind: str = "") -> dict[str, Any]:
    """Columns of the present state's stability, where branches are followed."""
    more: dict[str, Any] = {}
    if any(s.follow is not None for s in of.config.program):
        more["unstable_modes"] = of.newton.unstable_modes() if modes is None else modes
        more["limit_point"] = int(kind == LIMIT_POINT)
        more["bifurcation"] = int(kind == BIFURCATION)
    return more


def _passed(before: float, now: float, limit: float) -> bool:
    """Whether a variable passed its limit from one state to the next."""
    return before != limit and (now - limit) * (before - limit) <= 0


def _failure(of: Engine, stage: Stage, at: float) -> str:
    """Message that says where the program stopped and what to try."""
    inputs = ", ".join(f"{d.label} = {d.at(at):.6g} {d.unit}" for d in of.drives)
    hint = "give the stage more steps"
    of.newton.system.expand(of.newton.system.q)
    if of.problem.locked(0.9):
        hint = "reduce the load, for a law is stretched to over 90 % of its limit"
    if stage.stage == "prestrain":
        return f"stage 'prestrain' stopped at {at:.4g} of the pre-stretch; {hint}"
    device, drives = of.problem.device, of.progress.drives
    for kind, (limit, instead) in _LIMITS.items():
        if driven_by(device, kind, drives, at):
            hint += (
                f"; if this is {limit}, prescribe the {instead} instead, or follow the branch "
                "(`follow` in configs/REFERENCE.md)"
            )
    shares = (of.progress.row or {}).items()
    used = ", ".join(f"{n} = {v:.3g}" for n, v in shares if n.endswith("_use") and v > _NEAR)
    return (
        f"stage {stage.stage!r} stopped after t = {of.progress.time:.6g} s, "
        f"on the way to {inputs}; everything up to there is kept"
        f"{f', where {used}' if used else ''}. Try: {hint}"
    )
