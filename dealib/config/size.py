"""How large a run will be, before it begins: unknowns, memory, time and disk.

Straight lines through measurements, from 4,000 to 600,000 unknowns; tests hold them to a factor of
two for memory and disk.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from dealib.config.schema import Config
from dealib.errors import ConfigError, ValueAt

_UNKNOWNS = {1: 3.2, 2: 11.0}  # a cell, by the order of u and phi
_PER_NODE = 2.4  # unknowns a node of the results
_MEMORY = 180e6, 3.3e3, 5.5e3  # bytes: of the program, and for each unknown without and with air
_SECONDS = 1.5, 2e-5  # to start, and for each unknown and step: three Newton iterations
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
        unknowns = _UNKNOWNS[config.mesh.order] * _cells(config)
    start, rest = _MEMORY[0], _MEMORY[1 + (config.geometry.air_height > 0)]
    steps = _steps(config)
    stored = {"every": steps + 1, "stage": len(config.program), "none": 0}[config.output.fields]
    return Size(
        unknowns,
        steps,
        start + rest * unknowns,
        _SECONDS[0] + _SECONDS[1] * unknowns * (steps + 1),
        _DISK * unknowns / _PER_NODE * (stored + 1) + 500 * steps,
    )


def refuse_too_large(config: Config) -> None:
    """Refuse what this machine cannot hold.

    Raises:
        ValueAt: With the estimate, at the key that makes it so large.
    """
    found, memory = size(config), _machine_memory()
    for where, steps in ((("program",), found.steps), (("tables", "points"), _tables(config))):
        if steps > _STEPS:
            more = steps / (found.steps + 1)
            seconds, disk = found.seconds * more, found.disk * more
            whole = replace(found, steps=steps, seconds=seconds, disk=disk)
            raise ValueAt(where, f"at most {_count(_STEPS)} steps, not {whole}")
    if found.memory > memory:
        raise ValueAt(
            ("mesh",),
            f"{found}; this machine has {_bytes(memory)} of memory: choose a coarser mesh",
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
            "or none, or another --out"
        )


def _cells(config: Config) -> float:
    g, m = config.geometry, config.mesh
    if m.file is not None:
        return os.path.getsize(m.file) / 90  # bytes a cell, with its nodes
    electrodes = 2 * m.electrode_rows * (g.electrode_thickness > 0)
    cells = float(_capped(m.columns) * (_capped(m.film_rows) + _capped(electrodes)))
    if g.clamps is not None:
        cells += 800
    if g.air_height > 0:
        length, across = g.outer_radius - g.inner_radius, m.air_size or g.air_height / 5
        cells += 9.5 * _capped(m.columns) + 2 * length * g.air_height / across**2
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
    first, second = map(_capped, config.tables.points)
    return float(_capped(first * second))


def _capped(number: int) -> int:
    return min(number, _MOST)


def _machine_memory() -> float:
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


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
