"""Closed cycles of a history: the work at the ports in each of them, and its efficiency."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.device.records import CHAMBER, KIND_OF, MOUNT, TERMINAL, TURN, PortKind
from dealib.results import stages
from dealib.results.reader import Run

if TYPE_CHECKING:
    import pandas

    from dealib.config.program import Stage
    from dealib.device.device import Device

_CLOSED = 1e-6  # of a column's largest value
_LEAST = 1e-3  # of the columns' units: smallest such value, above the solver's tolerance


@dataclass(frozen=True)
class Cycle:
    """Work in one cycle, mJ; work done on the device is positive.

    Attributes:
        name: Names of its stages.
        first: Step with which it begins.
        last: Step with which it ends.
        electrical_in: Sum of the increments of work that the terminals did on the device.
        electrical_out: Sum of the increments of work that the device did on the terminals.
        mechanical_in: The same as `electrical_in` for mounts and chambers.
        mechanical_out: The same as `electrical_out` for mounts and chambers.
        dissipated: Energy dissipated in the device.
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
        """Net work of the terminals."""
        return self.electrical_in - self.electrical_out

    @property
    def mechanical(self) -> float:
        """Net work of mounts and chambers."""
        return self.mechanical_in - self.mechanical_out

    @property
    def transfer(self) -> float:
        """Work done at the mounts over the electrical energy delivered; NaN in a generator."""
        if self.electrical_in == 0 or self.electrical < -1e-6 * self.electrical_in:
            return np.nan
        return self.mechanical_out / self.electrical_in

    @property
    def efficiency(self) -> float:
        """Net output of one kind of port over the gross input of the other; NaN without input."""
        out, source = -self.mechanical, self.electrical_in
        if self.electrical < 0:  # a generator
            out, source = -self.electrical, self.mechanical_in
        return max(0.0, out) / source if source > 0 else np.nan


def cycles(run: Run) -> list[Cycle]:
    """The cycles of a run, in order.

    A stage at whose end all its inputs have their initial values is one cycle, or several if it is
    repeated. Otherwise a cycle is a sequence of stages at whose end displacements, voltages and
    pressures have the values that they had before it.
    """
    h, device = run.history, run.config.device
    ports = [port.column(port.kind.primal) for port in device.ports]
    open_since, found = [(0, "")], []
    for stage, title, ends in _boundaries(run):
        driven = _driven(stage, device)
        for k, row in enumerate(ends):
            before = open_since[-1][0]
            name = f"{title} {k + 1}" if stage.cycles > 1 else title
            passed = slice(before, row + 1)
            back = bool(driven) and _same(h, before, row, driven)
            returns = back and not _same(h, before, passed, driven)
            starts = [before] if returns else [r for r, _ in open_since]
            start = next((r for r in starts if returns or _same(h, r, row, ports)), None)
            still = _same(h, before, passed, ports)
            if start is not None and not still:
                names = [n for r, n in open_since if r > start and n] + [name]
                found.append(_cycle(h, device, " - ".join(names), start, row))
                open_since = [(row, "")]
            else:
                open_since.append((row, name))
    return found


def _boundaries(run: Run) -> Iterator[tuple[Stage, str, list[int]]]:
    """Stages, titles, and rows at which their cycles end; the last one may be cut short."""
    h, program = run.history, run.config.program
    time = h["time_s"].to_numpy()
    number = stages.numbers(h, program, run.info.get("stops", ()))
    for k, (stage, title) in enumerate(zip(program, stages.titles(program), strict=True)):
        rows = np.flatnonzero(number[1:] == k) + 1
        if stage.stage == "prestrain" or len(rows) == 0:
            continue
        ends = time[rows[0] - 1] + stage.duration * np.arange(1, stage.cycles)
        within = [t for t in ends if t < time[rows[-1]] * (1 - 1e-12)]
        yield stage, title, [*(int(np.abs(time - t).argmin()) for t in within), int(rows[-1])]


def _driven(stage: Stage, device: Device) -> list[str]:
    """Columns that a stage drives; for a spring or an enclosed gas both columns of the port."""
    found = []
    for name, given in stage.driven(device).items():
        port, what = device.by_name[name], given.given[0]
        what = "force" if what == "mass" else what
        both = port.kind.variables
        found += [port.column(v) for v in both if v.name == what or what not in KIND_OF]
    return found


def _same(history: Any, row: int, others: int | slice, columns: list[str]) -> bool:
    """Whether columns have the values of a row in other rows too."""
    values = history[columns].to_numpy()
    sizes = np.maximum(np.abs(values).max(axis=0), _LEAST)
    return bool((np.abs(values[others] - values[row]) <= _CLOSED * sizes).all())


def _cycle(history: pandas.DataFrame, device: Device, name: str, first: int, last: int) -> Cycle:
    part = history.iloc[first : last + 1]

    def flows(*kinds: PortKind) -> tuple[float, float]:
        names = [p.named(f"{kind.name}_work_mJ") for kind in kinds for p in device.of(kind)]
        d = np.diff(part[names].sum(axis=1))
        return float(d[d > 0].sum()), float(np.abs(d[d < 0]).sum())

    lost = part.get("dissipated_energy_mJ")
    return Cycle(
        name,
        int(part["step"].iloc[0]),
        int(part["step"].iloc[-1]),
        *flows(TERMINAL),
        *flows(MOUNT, TURN, CHAMBER),
        0.0 if lost is None else float(lost.iloc[-1] - lost.iloc[0]),
    )
