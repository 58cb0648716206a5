"""Free block of film under a voltage across it and dead loads in its plane, of any law.

The state is homogeneous. With E = V/H0 and e2 = eps E^2 the total nominal stresses are

    s1 = W1 - e2 l1 l2^2,    s2 = W2 - e2 l2 l1^2.

Modes: `biaxial` (s1 = s2 = s, l1 = l2), `uniaxial` (s1 = s, s2 = 0: without a load it is biaxial),
`plane_strain` (s1 = s, l2 held). Along the path of growing l1 the voltage is explicit.
Zhao and Suo, Appl. Phys. Lett. 91 (2007) 061921.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from verification.references import continuation
from verification.references.laws import Energy, in_range, slope, slopes, unit_voltage
from verification.references.wrinkling import natural_width

Mode = Literal["biaxial", "uniaxial", "plane_strain"]


@dataclass(frozen=True)
class Block:
    """A film and its load.

    Attributes:
        law: MPa.
        mode: See the module.
        load: Nominal stress s, MPa: force over the unstretched cross-section.
        thickness: Unstretched, mm.
        permittivity: N/kV^2.
        width: The held stretch l2 of plane strain.
    """

    law: Energy
    mode: Mode = "biaxial"
    load: float = 0.0
    thickness: float = 1.0
    permittivity: float = 1.0
    width: float = 1.0


@dataclass(frozen=True)
class State:
    """Equilibrium; charge (uC/mm^2) and capacitance (nF/mm^2) are a unit of unstretched area."""

    voltage: float
    l1: float
    l2: float
    charge: float
    capacitance: float


def at_stretch(block: Block, l1: float) -> State:
    """The state at a stretch l1, of any point of the path; its voltage is NaN if there is none."""
    l2 = _across(block, l1)
    pull = (slope(block.law, l1, l2) - block.load) / (l1 * l2**2)
    voltage = block.thickness * np.sqrt(pull / block.permittivity) if pull >= 0 else np.nan
    capacitance = block.permittivity / block.thickness * (l1 * l2) ** 2
    return State(float(voltage), l1, l2, float(capacitance * voltage), float(capacitance))


def unloaded(block: Block) -> float:
    """l1 at no voltage."""

    def miss(l1: float) -> float:
        l2 = {"biaxial": l1, "plane_strain": block.width}.get(block.mode)
        if l2 is None:
            l2 = natural_width(block.law, l1)
        return float(slope(block.law, l1, l2) - block.load)

    if block.mode == "uniaxial" and block.load == 0:
        return 1.0
    down = -0.02 if miss(1.0) > 0 else 0.02
    found = continuation.first_root(miss, 1.0, down, 1.0 + 400 * down if down > 0 else 0.1)
    if found is None:
        raise ArithmeticError("the law does not carry the load")
    return found


def at_voltage(block: Block, voltage: float, step: float = 0.01) -> State | None:
    """The state reached by raising the voltage; None if pull-in comes before.

    Args:
        block: The block.
        voltage: kV.
        step: Of l1, relative, in looking for the first maximum of the voltage.
    """
    start = unloaded(block)
    if voltage == 0:
        return at_stretch(block, start)

    def excess(l1: float) -> float:
        return _squared(block, l1) - voltage**2

    before = here = start
    while here < 20 * start:
        after = here * (1 + step)
        value = excess(after)
        if not np.isfinite(value):  # beyond the limit of the law
            step /= 2
            if step < 1e-12:
                return None
            continue
        if value < excess(here):  # the maximum is between
            top = minimize_scalar(
                lambda l1: -excess(l1), bounds=(before, after), method="bounded",
                options={"xatol": 1e-10},
            ).x  # fmt: skip
            if excess(top) < 0:
                return None
            return at_stretch(block, float(brentq(excess, start, top, xtol=1e-15)))
        if value >= 0:
            return at_stretch(block, float(brentq(excess, here, after, xtol=1e-15)))
        before, here = here, after
    return None


def limit_point(block: Block, step: float = 0.1, count: int = 60) -> State | None:
    """The first limit point of the voltage by continuation; None if there is none on the path.

    The path is that of the two (three) balances in l1, l2 and the voltage, not the explicit one.
    """
    unit = unit_voltage(block.law, block.permittivity, block.thickness)
    scale = block.permittivity * (unit / block.thickness) ** 2

    def residual(x: np.ndarray) -> list[float]:
        l1, l2, v = x
        W1, W2 = slopes(block.law, l1, l2)
        first = (W1 - block.load) / scale - v**2 * l1 * l2**2
        second = {
            "biaxial": (W2 - block.load) / scale - v**2 * l2 * l1**2,
            "uniaxial": W2 / scale - v**2 * l2 * l1**2,
            "plane_strain": l2 - block.width,
        }[block.mode]
        return [first, second]

    start = at_voltage(block, 0.02 * unit)
    if start is None:
        return None

    def inside(x: np.ndarray) -> bool:
        return in_range(block.law, x[0], x[1])

    path = [start.l1, start.l2, 0.02]
    x = next(continuation.limit_points(residual, path, step, count, inside), None)
    return None if x is None else at_stretch(block, float(x[0]))


def _across(block: Block, l1: float) -> float:
    if block.mode == "biaxial":
        return l1
    if block.mode == "plane_strain":
        return block.width
    if block.load == 0:
        return l1

    def miss(l2: float) -> float:  # without e2: l1 s1 - l2 s2
        W1, W2 = slopes(block.law, l1, l2)
        return float(l1 * (W1 - block.load) - l2 * W2)

    natural = natural_width(block.law, l1)
    if miss(natural) <= 0:
        return natural
    return float(brentq(miss, natural, l1, xtol=1e-15, rtol=1e-13))


def _squared(block: Block, l1: float) -> float:
    """V^2, negative where the load stretches the film less."""
    l2 = _across(block, l1)
    pull = (slope(block.law, l1, l2) - block.load) / (l1 * l2**2)
    return float(block.thickness**2 * pull / block.permittivity)
