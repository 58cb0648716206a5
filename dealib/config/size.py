"""How large a run will be, before it begins: unknowns, memory, time and disk.

Straight lines through measurements, from 4,000 to 600,000 unknowns; the linear solver's memory is
that of `dealib.config.linear`. Tests hold them to a factor of two.
"""

from __future__ import annotations

import math
import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from dealib.config.linear import choose, machine_memory, not_iterative
from dealib.config.schema import Config
from dealib.errors import ConfigError, ValueAt, by_caller

# a cell, by the order of u and phi: of a plane, of a solid, of a line and of a sheet
_UNKNOWNS = {1: 3.2, 2: 11.0}
_UNKNOWNS_SOLID = {1: 5.3, 2: 37.0}
_UNKNOWNS_LINE, _UNKNOWNS_SHEET = {1: 2.0, 2: 4.0}, {1: 3.0, 2: 12.0}
_PER_NODE = 2.4  # unknowns a node of the results
_SECONDS = 1.5, 2e-5  # to start, and for each unknown and step: Newton's iterations
_DISK = 205.0  # bytes a node and stored step
_STEPS = 1_000_000  # most of a run: its history would have 500 MB
_MOST = 10**15  # what is counted to; a config may have more


@dataclass(frozen=True)
class Size:
    """What a run takes, about.

    Attributes:
        unknowns: That are solved for.
        steps: If no increment is cut.
        memory: Bytes.
        seconds: On one core of 2020.
        disk: Bytes.
    """

    unknowns: float
    steps: float
    memory: float
    seconds: float
    disk: float

    def __str__(self) -> str:
        return (
            f"about {_count(self.unknowns)} unknowns, {_count(self.steps)} steps, "
            f"{_bytes(self.memory)} of memory, {_time(self.seconds)}, {_bytes(self.disk)} of disk"
        )


def size(config: Config, unknowns: float | None = None) -> Size:
    """Estimate the size of a run.

    Args:
        config: The config.
        unknowns: Their number, if it is known.
    """
    if unknowns is None:
        unknowns = _a_cell(config) * _cells(config)
    steps = _steps(config)
    stored = {"every": steps + 1, "stage": len(config.program), "none": 0}[config.output.fields]
    return Size(
        unknowns,
        steps,
        choose(config, unknowns).memory,
        _SECONDS[0] + _SECONDS[1] * unknowns * (steps + 1),
        _DISK * unknowns / _PER_NODE * (stored + 1) + 500 * steps,
    )


def refuse_too_large(config: Config) -> None:
    """Refuse what this machine cannot hold.

    Raises:
        ValueAt: With the estimate, at the key that makes it so large.
    """
    found, memory = size(config), machine_memory()
    for where, steps in ((("program",), found.steps), (("tables", "points"), _tables(config))):
        if steps > _STEPS:
            more = steps / (found.steps + 1)
            seconds, disk = found.seconds * more, found.disk * more
            whole = replace(found, steps=steps, seconds=seconds, disk=disk)
            raise ValueAt(where, f"at most {_count(_STEPS)} steps, not {whole}")
    if found.memory > memory:
        other = config.solver.linear in ("direct", "lu") and not not_iterative(config)
        raise ValueAt(
            ("mesh",),
            f"{found}; this machine has {_bytes(memory)} of memory: choose a coarser mesh"
            + (", or solver.linear: iterative if the body is thick" if other else ""),
        )


def refuse_full_disk(config: Config, directory: Path) -> None:
    """Refuse what the disk of a directory cannot hold.

    Raises:
        ConfigError: With the estimate.
    """
    there = next(p for p in (directory, *directory.absolute().parents) if p.is_dir())
    found, free = size(config), shutil.disk_usage(there).free
    if found.disk > free:
        raise ConfigError(
            f"{directory}: {found}; the disk has {_bytes(free)} left: choose output.fields: stage "
            f"or none, or another {by_caller('--out', 'directory')}"
        )


def _a_cell(config: Config) -> float:
    """Unknowns a cell; the pressure of the mixed form is linear in each."""
    space, order = config.device.kinematics, config.mesh.order
    if space.sheet:
        return (_UNKNOWNS_SHEET if space.dim == 3 else _UNKNOWNS_LINE)[order]
    mixed = space.dim + 1 if config.physics.formulation == "mixed" else 0
    return (_UNKNOWNS_SOLID if space.dim == 3 else _UNKNOWNS)[order] + mixed


def _cells(config: Config) -> float:
    m, laminate = config.mesh, config.device.laminate
    file = config.mesh_file
    if file is not None:
        return os.path.getsize(file) / 90  # bytes a cell, with its nodes
    assert laminate is not None
    along = float(_capped(m.columns))
    if laminate.solid:
        round_ = laminate.base.along == "R"
        core = _capped(m.sectors) if round_ and laminate.base.limits[0] == 0 else 0  # of a disc
        across = (4 if round_ else 2) * _capped(m.sectors)
        along = (along + core) * across / 2 ** len(laminate.symmetry)
    if laminate.sheet:
        return along
    rows = (x.rows or (m.electrode_rows if x.conducts else m.film_rows) for x in laminate.layers)
    cells = along * sum(map(_capped, rows))
    if laminate.blocks is not None:
        cells += 800
    if height := laminate.air_height:
        first, last = laminate.base.limits
        cells += 9.5 * along + 2 * (last - first) * height / (m.air_size or height / 5) ** 2
    return cells


def _steps(config: Config) -> float:
    """Rows of the history that the program plans."""
    stages = [s for s in config.program if s.stage != "prestrain"]
    ramps = (_capped(s.steps) * _capped(s.cycles) for s in stages if s.follow is None)
    paths = (s.follow.states or 10 * s.steps for s in stages if s.follow is not None)
    return float(sum(map(_capped, (*ramps, *paths))))


def _tables(config: Config) -> float:
    """The same of the walk that makes the tables."""
    if config.tables is None:
        return 0.0
    return float(_capped(math.prod(map(_capped, config.tables.counts))))


def _capped(number: int) -> int:
    return min(number, _MOST)


def _count(number: float) -> str:
    return f"{number:.2g}" if number >= 1e7 else f"{float(f'{number:.3g}'):,.0f}"


def _bytes(number: float) -> str:
    for unit, factor in (("TB", 1e12), ("GB", 1e9)):
        if number >= factor:
            return f"{number / factor:.3g} {unit}"
    return f"{number / 1e6:.0f} MB"


def _time(seconds: float) -> str:
    for unit, factor in (("years", 3.156e7), ("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * factor:
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds:.2g} s"
