"""The kinds of load stage: each is a generator of converged states."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from dealib.config.columns import COLUMNS
from dealib.config.follow import Until, Variable
from dealib.config.program import Stage
from dealib.errors import ConfigError, NotConverged
from dealib.program.follow import BIFURCATION, LIMIT_POINT, Branch
from dealib.program.increments import Increments
from dealib.program.inputs import Drive, law, milestones, plain_drive
from dealib.program.pair import COLUMN, Pair, size
from dealib.program.progress import Position
from dealib.program.states import State

if TYPE_CHECKING:
    from dealib.program.simulation import Simulation

log = logging.getLogger(__name__)


def prestrain(of: Simulation, stage: Stage) -> Iterator[State]:
    """Ramp the pre-stretch with the ports at rest; the clock starts when it is reached."""

    def apply(fraction: float) -> tuple[Any, ...]:
        of.problem.set_prestretch(fraction)
        return ("prestretch", fraction)

    apply(0.0)
    increments = Increments(of.newton, of.case.config.solver, of.predictor)
    targets = [k / stage.steps for k in range(1, stage.steps + 1)]
    for _ in increments.run(targets, {1.0}, apply, partial(_failure, of, stage)):
        pass
    if of.viscosity is not None:
        of.viscosity.rest()
    yield _state(of, stage, 0.0, last=True)


def ramp(of: Simulation, stage: Stage) -> Iterator[State]:
    """Move the inputs through the stage, or what is left of it."""
    p, viscosity = of.progress, of.viscosity
    targets, corners = milestones(stage, _drives(of))

    def apply(at: float) -> tuple[Any, ...]:
        for port, drives in p.drives.items():
            of.newton.system.ports[port] = law(drives, at)
        if viscosity is not None and at > p.place.now:
            viscosity.begin((at - p.place.now) * stage.duration)
        return tuple(x for d in _drives(of) for x in (d.label, d.at(at)))

    def time(at: float) -> float:
        return p.stage_start + at * stage.duration

    fine = any(c.bisect for c in (*of.case.config.stop_when, *stage.stop_when))

    def too_far(at: float, step: float) -> bool:
        """Whether a condition is met on a step that is to be halved for it."""
        halvings = [c.bisect for c in of.book.met(of, stage, time(at))] if fine else []
        return bool(halvings) and step > 0.5 ** max(halvings) / stage.steps * (1 + 1e-9)

    apply(p.place.now)
    error = None if viscosity is None else viscosity.error
    increments = Increments(of.newton, of.case.config.solver, of.predictor, p.place, error)
    for at in increments.run(targets, corners, apply, partial(_failure, of, stage), too_far):
        if viscosity is not None:
            viscosity.commit()
        yield _state(of, stage, time(at), last=at == targets[-1])
        if p.over:
            return


def follow(of: Simulation, stage: Stage) -> Iterator[State]:
    """Follow the branch of equilibria, or what is left of it."""
    p, given = of.progress, stage.follow
    assert given is not None
    assert p.row is not None
    (vary, along), until = given.pair, given.until
    end = getattr(until, along)
    for port, drives in p.drives.items():
        of.newton.system.ports[port] = law(drives, 1.0)
    if p.branch is None:
        way = abs(end - p.row[COLUMN[along]])
        if way <= 1e-9 * size(of.problem, along):
            raise ConfigError(f"stage {stage.stage!r} begins at the end of its {along}")
        p.branch = Position((size(of.problem, vary), way))
    pair = Pair(vary, along, p.branch.sizes)
    settings, goal = of.case.config.solver, getattr(until, vary)
    branch = Branch(of.newton, settings, of.predictor, pair, end, stage.steps, p.branch, goal)
    try:
        for found in branch.run():
            at, before = p.stage_start + p.branch.length * stage.duration, p.row
            p.drives[pair.port] = (plain_drive(vary, (p.branch.point[0],) * 2),)
            of.newton.system.ports[pair.port] = law(p.drives[pair.port], 1.0)  # as it is measured
            full = p.branch.count >= (given.states or 10 * stage.steps)
            state = _state(of, stage, at, full, found.modes, found.kind)
            p.branch.done |= p.over or _passed(before, state.row, until)
            if full and given.states is None and not p.branch.done:
                log.warning(
                    "stage '%s' ends after %d states, ten times its steps, at %s, not at the end "
                    "of its branch; give it more steps, or `states`",
                    stage.stage,
                    p.branch.count,
                    _where(p.branch, vary, along),
                )
            p.branch.done |= full
            yield State(state.row, p.branch.done, of)
    except NotConverged as error:
        raise NotConverged(
            f"stage {stage.stage!r} stopped at {_where(p.branch, vary, along)}: {error}; "
            "everything up to there is kept"
        ) from None


def _where(branch: Position, *names: Variable) -> str:
    """Both variables in words."""
    named = zip(names, branch.point, strict=True)
    return ", ".join(f"{name} = {value:.6g} {COLUMNS[COLUMN[name]]}" for name, value in named)


def _state(
    of: Simulation, stage: Stage, at: float, last: bool, modes: int | None = None, kind: str = ""
) -> State:
    """Accept the present state; where branches are followed, with its stability."""
    more: dict[str, Any] = {}
    if any(s.follow is not None for s in of.case.config.program):
        more["unstable_modes"] = of.newton.unstable_modes() if modes is None else modes
        more["limit_point"] = int(kind == LIMIT_POINT)
        more["bifurcation"] = int(kind == BIFURCATION)
    return of.book.accept(of, stage, at, last, more)


def _passed(before: dict[str, Any], row: dict[str, Any], until: Until) -> bool:
    """Whether a variable passed its limit from one row to the next."""
    limits = ((COLUMN[name], limit) for name, limit in until if limit is not None)
    return any(
        before[c] != limit and (row[c] - limit) * (before[c] - limit) <= 0 for c, limit in limits
    )


def _drives(of: Simulation) -> list[Drive]:
    return [drive for drives in of.progress.drives.values() for drive in drives]


def _failure(of: Simulation, stage: Stage, at: float) -> str:
    """Where the program stopped and what to try."""
    drives = _drives(of)
    inputs = ", ".join(f"{d.label} = {d.at(at):.6g} {d.unit}" for d in drives)
    hint = "give the stage more steps"
    voltage = any(
        d.kind == "value" and d.label == "terminal.voltage" and d.at(at) != 0 for d in drives
    )
    of.newton.system.map.expand(of.newton.system.q, of.problem.spaces.w)
    if of.problem.locked(0.9):
        hint = "less load, for a law is stretched to over 90 % of its limit"
    if stage.stage == "prestrain":
        return f"stage 'prestrain' stopped at {at:.4g} of the pre-stretch; {hint}"
    if voltage:
        hint += (
            "; if this is pull-in, prescribe the charge or the displacement instead, or follow "
            "the branch (`follow` in configs/REFERENCE.md)"
        )
    return (
        f"stage {stage.stage!r} stopped after t = {of.progress.time:.6g} s, "
        f"on the way to {inputs}; everything up to there is kept. Try: {hint}"
    )
