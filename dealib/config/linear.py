"""Which linear solver a run takes: its shape and its size decide."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from dealib.config.schema import Config
from dealib.device.records import CHAMBER, MOUNT, Sizes
from dealib.errors import ValueAt

MANY = 40_000  # unknowns above which iterations pay in a thick body
THICK, THIN = 0.1, 0.01  # thickness over span: where they pay, and where they are too many
# bytes of the program, and for each unknown: of a plane without and with air, of a solid's tangent,
# of its factorisation (see `_factors`), and of multigrid
_START, _PLANE, _AIR, _TANGENT, _FACTOR, _MULTIGRID = 180e6, 3.3e3, 5.5e3, 8.0e3, 11.5, 7.2e3


@dataclass(frozen=True)
class Choice:
    """A linear solver.

    Attributes:
        iterative: FGMRES with multigrid, instead of a factorisation.
        memory: Bytes that the run takes with it, about.
        note: What decided, where it is not the body's shape.
    """

    iterative: bool
    memory: float
    note: str = ""


def choose(config: Config, unknowns: float, sizes: Sizes | None = None) -> Choice:
    """Choose the linear solver of a run.

    Args:
        config: The config.
        unknowns: Their number.
        sizes: Of the device, if its mesh has been measured.
    """
    sizes = sizes or config.device.sizes
    share = sizes.thickness / sizes.span if sizes is not None else 1.0
    direct = Choice(False, _START + unknowns * _for_each(config, unknowns, share))
    iterative = Choice(True, _START + unknowns * (_TANGENT + _MULTIGRID))
    if config.solver.linear == "iterative":
        return iterative
    if config.solver.linear != "auto" or not_iterative(config):
        return direct
    if unknowns > MANY and share >= THICK:
        return iterative
    if direct.memory > machine_memory() and share >= THIN:
        note = f"a factorisation would take {direct.memory / 1e9:.3g} GB, more than there is"
        return Choice(True, iterative.memory, note)
    return direct


def check_linear(config: Config) -> None:
    """Raise `ValueAt` if `solver.linear: iterative` is asked of what it does not solve."""
    if config.solver.linear == "iterative" and (reason := not_iterative(config)):
        raise ValueAt(("solver", "linear"), f"iterative: {reason}; choose auto or direct")


def not_iterative(config: Config) -> str:
    """Why a run must factorise; empty if it need not."""
    device, physics = config.device, config.physics
    if not is_solid(config):
        return "only of solids in three dimensions"
    if physics.formulation != "displacement" or physics.coupling != "energy":
        return "only with formulation: displacement and coupling: energy"
    if any(region.air for region in device.regions):
        return "only without air"
    if any(stage.follow is not None for stage in config.program):
        return "no stage may follow a branch, on which the body is unstable"
    if config.output.modes:
        return "without output.modes, which factorises each tangent"
    if any(port.rigid for port in device.ports):
        return "no mount may be rigid"
    if any(port.along not in device.kinematics.axes for port in device.of(MOUNT)):
        return "mounts only along an axis"
    chambers = {port.name for port in device.of(CHAMBER)}
    for stage in config.program:
        for name, given in stage.driven(device).items():
            if name in chambers and given.given[0] != "pressure":
                return "chambers only with a given pressure"
    return ""


def is_solid(config: Config) -> bool:
    """Whether the device is a solid in three dimensions."""
    space = config.device.kinematics
    return space.dim == 3 and not space.sheet


def machine_memory() -> float:
    """Memory of this machine, bytes."""
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _for_each(config: Config, unknowns: float, share: float) -> float:
    """Bytes an unknown of a factorised tangent."""
    if not is_solid(config):
        return _AIR if any(region.air for region in config.device.regions) else _PLANE
    return _TANGENT + _FACTOR * _factors(unknowns, _through(config, unknowns, share))


def _factors(unknowns: float, through: float) -> float:
    """Entries of the factors for each unknown, but for a constant.

    Nested dissection of a plate of n columns with b unknowns each leaves entries in proportion to
    n b^2 log n (A. George, SIAM J. Numer. Anal. 10 (1973) 345); a tower is a plate as well.
    """
    smallest = min(through, 4 * math.sqrt(unknowns / through))
    return smallest * math.log2(max(unknowns / smallest, 2.0))


def _through(config: Config, unknowns: float, share: float) -> float:
    """Unknowns on a line of nodes through the body's thickness, four each."""
    m, laminate = config.mesh, config.device.laminate
    if laminate is None:  # cells as long as wide
        return 4 * max(3.0, (unknowns / 4 * share**2) ** (1 / 3))
    rows = (x.rows or (m.electrode_rows if x.conducts else m.film_rows) for x in laminate.layers)
    return 4.0 * (m.order * sum(rows) + 1)
