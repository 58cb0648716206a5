"""Critical states of a run: limit points, bifurcations and losses of stability."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.device.records import MOUNT, TERMINAL
from dealib.observe.columns import columns
from dealib.results import stages
from dealib.results.reader import Run

_LOSS = "loss of stability"


@dataclass(frozen=True)
class CriticalPoint:
    """A limit point or bifurcation of a followed branch, or a loss of stability.

    Attributes:
        stage: Name of the stage, numbered if several stages have this name.
        what: 'limit point', 'bifurcation' or 'loss of stability'.
        vary: Name of the variable that was unknown or driven, such as 'voltage'.
        value: Value of that variable.
        unit: Unit of `value`, such as kV.
        at: Value of a second variable, such as the displacement of the mount.
        at_unit: Unit of `at`.
        modes: Number of unstable modes before and after; None after it if the branch ends there.
    """

    stage: str
    what: str
    vary: str
    value: float
    unit: str
    at: float
    at_unit: str
    modes: tuple[int, int | None]

    @property
    def name(self) -> str:
        """What to call it, such as 'limit voltage (pull-in)'."""
        if self.what == _LOSS:
            return self.what
        lost = self.modes[0] == 0 and self.what == "limit point"
        if not lost:
            return f"{self.what} of {self.vary}"
        return f"limit {self.vary}" + (" (pull-in)" if self.vary.startswith("voltage") else "")

    @property
    def text(self) -> str:
        """Value, place and stability."""
        before, after = self.modes
        change = "" if after is None else f"; unstable modes {before} -> {after}"
        return f"{self.value:.7g} {self.unit} at {self.at:.6g} {self.at_unit}{change}"


def critical_points(run: Run) -> list[CriticalPoint]:
    """Limit points and bifurcations of the stages that follow a branch; losses of stability."""
    return _on_branches(run) + _losses(run)


def lost_at(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """The columns at the state at which the stiffness of the softest mode is zero.

    They are interpolated over the stiffness: linearly between the last two rows, or by a parabola
    through three rows if the stiffness falls in both intervals and the parabola stays between the
    last two values.

    Args:
        rows: Rows of the history: an unstable state, after up to two others.
    """
    stiffness = [float(row["softest_mode_N_per_mm"]) for row in rows]
    if len(rows) == 1 or not stiffness[-2] > 0 > stiffness[-1]:
        rows, stiffness = rows[-1:], stiffness[-1:]
    elif not stiffness[0] > stiffness[-2]:
        rows, stiffness = rows[-2:], stiffness[-2:]
    found = {}
    for name in (n for n, value in rows[-1].items() if isinstance(value, float)):
        values = [row[name] for row in rows]
        at, ends = _at_zero(stiffness, values), sorted(values[-2:])
        found[name] = at if ends[0] <= at <= ends[-1] else _at_zero(stiffness[-2:], values[-2:])
    return found


def _at_zero(x: Sequence[float], y: Sequence[float]) -> float:
    """Value at x = 0 of Lagrange's polynomial through points."""
    weights = [math.prod(b / (b - a) for b in x if b != a) for a in x]
    return sum(w * value for w, value in zip(weights, y, strict=True))


def _losses(run: Run) -> list[CriticalPoint]:
    """Losses of stability in stages that follow no branch."""
    h, program, device = run.history, run.config.program, run.config.device
    if "softest_mode_N_per_mm" not in h:
        return []
    number, titles = stages.numbers(h, program, run.info.get("stops", ())), stages.titles(program)
    driven, known, found = stages.drives(program, device), columns(run.config), []
    modes = h["unstable_modes"].to_numpy()
    for k in np.flatnonzero(np.diff(modes, prepend=0) > 0):
        n = int(number[k])
        if program[n].follow is not None:
            continue
        rows: list[Any] = h.iloc[max(k - 2, 0) : k + 1].to_dict("records")
        at, before, row = lost_at(rows), rows[-2 if k else -1], rows[-1]
        moved = [  # variables that changed: driven ones first, among them voltages first
            (driven[n][port.name] != v.name, port.kind != TERMINAL, port.column(v), port)
            for port in device.ports
            for v in port.kind.variables
            if before[port.column(v)] != row[port.column(v)]
        ]
        if not moved:
            continue
        *_, column, port = min(moved, key=lambda m: m[:2])
        others = [p.column(v) for p in (*device.of(MOUNT), port) for v in p.kind.variables]
        other = next(name for name in others if name != column)
        told = [(at[name], known[name].unit) for name in (column, other)]
        change = int(modes[k - 1]) if k else 0, int(modes[k])
        label = known[column].quantity.label
        found.append(CriticalPoint(titles[n], _LOSS, label, *told[0], *told[1], change))
    return found


def _on_branches(run: Run) -> list[CriticalPoint]:
    history, program = run.history, run.config.program
    if "limit_point" not in history:
        return []
    number = stages.numbers(history, program, run.info.get("stops", ()))
    titles, device = stages.titles(program), run.config.device
    known = columns(run.config)
    mounts = [port.column(MOUNT.primal) for port in device.of(MOUNT)]
    found = []
    for k in history.index[(history["limit_point"] + history["bifurcation"]) > 0]:
        row, stage = history.loc[k], number[k]
        follow = program[stage].follow
        assert follow is not None
        column, along = (device.column(name) for name in follow.pair)
        at = mounts[0] if mounts else along
        modes = history["unstable_modes"]
        limit = bool(row["limit_point"])
        before = int(modes[k] if limit else modes[k - 1])
        goes_on = k + 1 in modes and number[k + 1] == stage
        after = (int(modes[k + 1]) if goes_on else None) if limit else int(modes[k])
        found.append(
            CriticalPoint(
                titles[stage],
                "limit point" if limit else "bifurcation",
                follow.vary,
                *(float(row[column]), known[column].unit),
                *(float(row[at]), known[at].unit),
                (before, after),
            )
        )
    return found
