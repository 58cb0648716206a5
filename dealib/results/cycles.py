"""Closed cycles of a history: the work of both ports in each, and what became of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.results.reader import Run

if TYPE_CHECKING:
    from dealib.config.program import Stage

_CLOSED = 1e-6  # of the largest displacement and voltage


@dataclass(frozen=True)
class Cycle:
    """Work in one cycle, mJ; what is done on the device is positive.

    Attributes:
        name: Its stages.
        first: Step with which it begins.
        last: Step with which it ends.
        electrical_in: What the terminal delivered, before anything came back.
        electrical_out: What came back through it.
        mechanical_in: What the mount delivered, before anything came back.
        mechanical_out: What came back through it.
        dissipated: In the device.
    """

    name: str
    first: int
    last: int
    electrical_in: float
    electrical_out: float
    mechanical_in: float
    mechanical_out: float
    dissipated: float

    @property
    def electrical(self) -> float:
        """Net work of the terminal."""
        return self.electrical_in - self.electrical_out

    @property
    def mechanical(self) -> float:
        """Net work of the mount."""
        return self.mechanical_in - self.mechanical_out

    @property
    def transfer(self) -> float:
        """Work done at the mount over the electrical energy delivered; NaN in a generator."""
        if self.electrical_in == 0 or self.electrical < -1e-6 * self.electrical_in:
            return np.nan
        return self.mechanical_out / self.electrical_in

    @property
    def efficiency(self) -> float:
        """Net output of one port over the gross input of the other; NaN if nothing is driven."""
        out, source = -self.mechanical, self.electrical_in
        if self.electrical < 0:  # a generator
            out, source = -self.electrical, self.mechanical_in
        return max(out, 0.0) / source if source > 0 else np.nan


def cycles(run: Run) -> list[Cycle]:
    """The cycles of a run, in order.

    A stage whose driven inputs end where they began is one cycle, or several if it is repeated;
    other cycles are stages at whose end displacement and voltage are those at the end of an
    earlier one.
    """
    h = run.history
    where = h[["displacement_mm", "voltage_kV"]].to_numpy()
    sizes = np.abs(where).max(axis=0)
    sizes[sizes == 0] = 1.0
    open_since, found = [(0, "")], []
    for stage, ends in _boundaries(run):
        for k, row in enumerate(ends):
            before = open_since[-1][0]
            name = f"{stage.stage} {k + 1}" if len(ends) > 1 else stage.stage
            driven = (stage.mount, stage.terminal)
            returns = any(p is not None and _returns(p) for p in driven)
            starts = [before] if returns else [r for r, _ in open_since]
            start = next((r for r in starts if returns or _same(where, r, row, sizes)), None)
            still = np.ptp(where[before : row + 1] / sizes, axis=0).max() < _CLOSED
            if start is not None and not still:
                names = [n for r, n in open_since if r > start and n] + [name]
                found.append(_cycle(h, " - ".join(names), start, row))
                open_since = [(row, "")]
            else:
                open_since.append((row, name))
    return found


def _boundaries(run: Run) -> Iterator[tuple[Stage, list[int]]]:
    """Stages with the rows at which each of their cycles ends."""
    time = run.history["time_s"].to_numpy()
    stops = [s["time_s"] for s in run.info.get("stops", ())]
    begin = 0.0
    for stage in run.config.program:
        if stage.stage == "prestrain":
            continue
        ends = [begin + stage.duration * (k + 1) for k in range(stage.cycles)]
        early = [t for t in stops if begin < t < ends[-1] * (1 - 1e-12)]
        ends = [t for t in ends if not early or t <= early[0]] + early[:1]
        rows = [int(np.abs(time - t).argmin()) for t in ends if t <= time[-1] * (1 + 1e-9)]
        yield stage, rows
        begin = ends[-1]


def _returns(port: Any) -> bool:
    return any(len(knots) > 1 and knots[0] == knots[-1] for _, knots in port.polylines)


def _same(where: Any, a: int, b: int, sizes: Any) -> bool:
    return bool((np.abs(where[a] - where[b]) <= _CLOSED * sizes).all())


def _cycle(history: Any, name: str, first: int, last: int) -> Cycle:
    part = history.iloc[first : last + 1]

    def flows(column: str) -> tuple[float, float]:
        d = np.diff(part[column])
        return float(d[d > 0].sum()), float(-d[d < 0].sum())

    lost = part.get("dissipated_energy_mJ")
    return Cycle(
        name,
        int(part["step"].iloc[0]),
        int(part["step"].iloc[-1]),
        *flows("terminal_work_mJ"),
        *flows("mount_work_mJ"),
        0.0 if lost is None else float(lost.iloc[-1] - lost.iloc[0]),
    )
