"""Estimates of a run's unknowns, memory, time and disk space.

Unknowns of layers and of mesh files are counted, those of free air and blocks estimated, within a
fifth. Time and disk space are linear fits to measurements with 300 to 600,000 unknowns;
`dealib.config.linear` gives the memory. Tests check them to a factor of two.
"""

from __future__ import annotations

import math
import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from dealib.config.linear import choose, is_solid, machine_memory, not_iterative
from dealib.config.schema import Config
from dealib.device.count import of_file, of_layers
from dealib.errors import ConfigError, ValueAt, by_caller

# unknowns per cell of what is not counted, by polynomial order: of a plane, of a solid
_UNKNOWNS = {1: 3.2, 2: 11.0}
_UNKNOWNS_SOLID = {1: 5.3, 2: 37.0}
_LARGE = 30_000_000  # bytes of a mesh file, above which its cells are not counted
_BYTES = {2: 90, 3: 120}  # of such a file per cell, with its nodes
_PER_NODE = 2.4  # unknowns per node of the stored fields
_START = 1.5  # seconds at the start
# seconds per unknown and step: of a plane or a sheet of revolution, a sheet and a solid in space
_PLANE, _SHEET, _SOLID = 2e-5, 6.5e-5, 5e-5
_LOADED = 20  # steps that each driven stage of a solid costs on top: its first ones converge slowly
_RELAXED = 2e-4  # seconds per unknown and step on top, in which a tension field finds its wrinkles
_DISK = 205.0  # bytes per node and stored step
_CHOSEN = 50  # states of a cycle with `steps: auto` that are solved at most, whatever its rows
_STEPS = 1_000_000  # largest number of steps: the history would have 500 MB
_MOST = 10**15  # numbers of a config are capped here, so that products stay finite


@dataclass(frozen=True)
class Size:
    """Estimate of what a run needs.

    Attributes:
        unknowns: Number of unknowns.
        steps: Number of steps, if no increment is halved.
        memory: Bytes.
        seconds: Time on one processor core of 2020, s.
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
        unknowns: Number of unknowns, if it is known.
    """
    if unknowns is None:
        unknowns = _unknowns(config)
    steps, solved = _steps(config), _steps(config, _CHOSEN)
    stored = {"every": solved + 1, "stage": len(config.program), "none": 0}[config.output.fields]
    return Size(
        unknowns,
        steps,
        choose(config, unknowns).memory,
        _START + unknowns * _seconds(config, solved + 1),
        _DISK * unknowns / _PER_NODE * (stored + 1) + 500 * steps,
    )


def refuse_too_large(config: Config) -> None:
    """Refuse a run with too many steps, or one that needs more memory than this machine has.

    Raises:
        ValueAt: With the estimate, at the key that makes the run too large.
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
            + (", or solver.linear: iterative if the device is thick" if other else ""),
        )


def refuse_full_disk(config: Config, directory: Path) -> None:
    """Refuse a run whose results need more space than the disk of its directory has left.

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


def _unknowns(config: Config) -> float:
    """Unknowns of layers or of a mesh file, counted, and those of what Gmsh fills freely."""
    m, device, file = config.mesh, config.device, config.mesh_file
    mixed, laminate = config.physics.formulation == "mixed", device.laminate
    a_cell = (_UNKNOWNS_SOLID if device.kinematics.dim == 3 else _UNKNOWNS)[m.order]
    if file is not None:
        if os.path.getsize(file) > _LARGE:
            a_cell += device.kinematics.dim + 1 if mixed else 0  # the pressure is linear in a cell
            return a_cell * os.path.getsize(file) / _BYTES[device.kinematics.dim]
        return of_file(device, Path(file), m.order, mixed)
    assert laminate is not None
    return of_layers(device, laminate, m, mixed) + a_cell * _around(config)


def _around(config: Config) -> float:
    """Cells of blocks and air."""
    m, laminate = config.mesh, config.device.laminate
    assert laminate is not None
    cells = 800.0 if laminate.blocks is not None else 0.0
    along = float(_capped(m.columns))
    if laminate.sheet:
        return 0.0
    if laminate.solid:
        round_ = laminate.base.along == "R"
        core = _capped(m.sectors) if round_ and laminate.base.limits[0] == 0 else 0  # of a disc
        across = (4 if round_ else 2) * _capped(m.sectors)
        along = (along + core) * across / 2 ** len(laminate.symmetry)
    if height := laminate.air_height:
        first, last = laminate.base.limits
        cells += 9.5 * along + 2 * (last - first) * height / (m.air_size or height / 5) ** 2
    return cells


def _steps(config: Config, chosen: int = _MOST) -> float:
    """Number of steps that the program plans.

    Args:
        config: The config.
        chosen: Largest number in a cycle with `steps: auto`.
    """
    stages = [s for s in config.program if s.stage != "prestrain"]
    counts = ((min(s.count, chosen if s.auto else _MOST), s) for s in stages if s.follow is None)
    ramps = (count * _capped(s.cycles) for count, s in counts)
    paths = (s.follow.states or 10 * s.count for s in stages if s.follow is not None)
    return float(sum(map(_capped, (*ramps, *paths))))


def _seconds(config: Config, steps: float) -> float:
    """Seconds per unknown that a number of steps takes."""
    each = _RELAXED if config.physics.wrinkling == "tension_field" else 0.0
    if is_solid(config):
        driven = sum(bool(stage.inputs or stage.follow) for stage in config.program)
        return (each + _SOLID) * (steps + _LOADED * driven)
    return (each + (_SHEET if config.device.kinematics.dim == 3 else _PLANE)) * steps


def _tables(config: Config) -> float:
    """Number of steps over the grid of the tables."""
    if config.tables is None:
        return 0.0
    return float(_capped(math.prod(map(_capped, config.tables.counts))))


def _capped(number: int) -> int:
    return min(number, _MOST)


def _count(number: float) -> str:
    return f"{number:.2g}" if number >= 1e7 else f"{float(f'{number:.3g}'):,.0f}"


def _bytes(number: float) -> str:
    return _scaled(number, {"TB": 1e12, "GB": 1e9}) or f"{number / 1e6:.0f} MB"


def _time(seconds: float) -> str:
    units = {"years": 3.156e7, "days": 86400, "h": 3600, "min": 60}
    return _scaled(seconds, units, least=2) or f"{seconds:.2g} s"


def _scaled(number: float, units: dict[str, float], least: float = 1) -> str:
    """A number in the first unit of which it has enough; '' if there is none."""
    found = (
        f"{number / size:.3g} {unit}" for unit, size in units.items() if number >= least * size
    )
    return next(found, "")
