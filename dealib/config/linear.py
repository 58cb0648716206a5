"""The choice of the linear solver, by the shape of the device and the size of the run."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from dealib.config.schema import Config
from dealib.device.records import CHAMBER, MOUNT, Sizes
from dealib.errors import ValueAt

MANY = 40_000  # unknowns above which an iterative solver is faster in a thick body
# thickness over span: above THICK an iterative solver is faster, below THIN it converges too slowly
THICK, THIN = 0.1, 0.01
_START = 180e6  # bytes of the program itself
_PLANE, _AIR = 3.3e3, 5.5e3  # bytes per unknown of a plane, without and with air
_TANGENT, _MULTIGRID = 8.0e3, 7.2e3  # bytes per unknown of a solid's tangent, of multigrid
_FACTOR = 11.5  # bytes per entry of a solid's factors, as `_factors` counts them


@dataclass(frozen=True)
class Choice:
    """A linear solver.

    Attributes:
        iterative: FGMRES with multigrid, instead of a factorisation.
        memory: Estimated memory of the run, bytes.
        note: The reason of the choice, if it is not the shape of the device.
    """

    iterative: bool
    memory: float
    note: str = ""


def choose(config: Config, unknowns: float, sizes: Sizes | None = None) -> Choice:
    """Choose the linear solver of a run.

    Args:
        config: The config.
        unknowns: Number of unknowns.
        sizes: Thickness and span of the device, if they are known from a mesh file.
    """
    sizes = sizes or config.device.sizes
    share = sizes.thickness / sizes.span if sizes is not None else 1.0
    direct = Choice(False, _START + unknowns * _bytes_per_unknown(config, unknowns, share))
    iterative = Choice(True, _START + unknowns * (_TANGENT + _MULTIGRID))
    if config.solver.linear == "iterative":
        return iterative
    if config.solver.linear != "auto" or not_iterative(config):
        return direct
    if unknowns > MANY and share >= THICK:
        return iterative
    if direct.memory > machine_memory() and share >= THIN:
        note = f"a factorisation would need {direct.memory / 1e9:.3g} GB, more than the machine has"
        return Choice(True, iterative.memory, note)
    return direct


def check_linear(config: Config) -> None:
    """Raise `ValueAt` if `solver.linear` is iterative but the run needs a direct solver."""
    if config.solver.linear == "iterative" and (reason := not_iterative(config)):
        raise ValueAt(("solver", "linear"), f"iterative: {reason}; choose auto or direct")


def not_iterative(config: Config) -> str:
    """Why a run needs a direct solver; empty if it does not."""
    device = config.device
    if not is_solid(config):
        return "only for solids in three dimensions"
    if any(region.air for region in device.regions):
        return "only without air"
    if any(stage.follow is not None for stage in config.program):
        return "only without stages that follow a branch, on which the device is unstable"
    if config.output.modes:
        return "only without output.modes, which factorises each tangent"
    if any(port.rigid for port in device.ports):
        return "only without rigid mounts"
    if any(port.along not in device.kinematics.axes for port in device.of(MOUNT)):
        return "only with mounts that move along an axis"
    chambers = {port.name for port in device.of(CHAMBER)}
    for stage in config.program:
        for name, given in stage.driven(device).items():
            if name in chambers and given.given[0] != "pressure":
                return "only with chambers whose pressure is prescribed"
    return ""


def is_solid(config: Config) -> bool:
    """Whether the device is a solid in three dimensions."""
    space = config.device.kinematics
    return space.dim == 3 and not space.sheet


def machine_memory() -> float:
    """Physical memory of this machine, bytes."""
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _bytes_per_unknown(config: Config, unknowns: float, share: float) -> float:
    """Memory of a factorised tangent per unknown, bytes."""
    if not is_solid(config):
        return _AIR if any(region.air for region in config.device.regions) else _PLANE
    return _TANGENT + _FACTOR * _factors(unknowns, _through(config, unknowns, share))


def _factors(unknowns: float, through: float) -> float:
    """Entries of the factors per unknown, up to the constant `_FACTOR`.

    With nested dissection, a plate of n columns of b unknowns each has a number of entries in
    proportion to n b^2 log n (A. George, SIAM J. Numer. Anal. 10 (1973) 345). In a body higher
    than wide, b counts the unknowns across its smallest dimension.
    """
    smallest = min(through, 4 * math.sqrt(unknowns / through))
    return smallest * math.log2(max(unknowns / smallest, 2.0))


def _through(config: Config, unknowns: float, share: float) -> float:
    """Unknowns on a line of nodes through the thickness of the body, four per node."""
    m, laminate = config.mesh, config.device.laminate
    if laminate is None:  # a mesh file, assumed to have cells as long as wide
        return 4 * max(3.0, (unknowns / 4 * share**2) ** (1 / 3))
    rows = (x.rows or (m.electrode_rows if x.conducts else m.film_rows) for x in laminate.layers)
    return 4.0 * (m.order * sum(rows) + 1)
