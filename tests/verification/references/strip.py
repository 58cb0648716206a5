"""Pure-shear strip of any law: stretched along X, its width held at lw, a voltage across it.

It is the free block in plane strain (`block`): with E = V/H0 the total nominal stresses are
s_x = W1(l, lw) - eps E^2 l lw^2 and s_w = W2(l, lw) - eps E^2 lw l^2. Held at its length it carries
the force W0 H0 s_x; under a dead load it stretches. For neo-Hooke under a dead load s0 >= 0
eps E^2/G = lw^-2 - l^-4 lw^-4 - s0/(G l lw^2) grows up to E = sqrt(G/eps)/lw: there is no pull-in.
"""

from __future__ import annotations

from dataclasses import dataclass

from verification.references import block
from verification.references.laws import Energy, slope, slopes


@dataclass(frozen=True)
class Strip:
    """Law (MPa), unstretched thickness and width (mm), held stretch of the width, permittivity."""

    law: Energy
    thickness: float = 1.0
    width: float = 1.0
    held: float = 1.0
    permittivity: float = 1.0


@dataclass(frozen=True)
class State:
    """Stretch l, voltage (kV), total nominal stresses along X and the width (MPa), force (N).

    The capacitance (nF/mm) is a unit of unstretched length.
    """

    stretch: float
    voltage: float
    along: float
    across: float
    force: float
    capacitance: float


def at_length(strip: Strip, stretch: float, voltage: float) -> State:
    """The state at a given length."""
    pull = strip.permittivity * (voltage / strip.thickness) ** 2
    first, second = slopes(strip.law, stretch, strip.held)
    along = float(first - pull * stretch * strip.held**2)
    across = float(second - pull * strip.held * stretch**2)
    area = strip.thickness * strip.width
    capacitance = strip.permittivity * strip.width / strip.thickness * (stretch * strip.held) ** 2
    return State(stretch, voltage, along, across, along * area, capacitance)


def at_load(strip: Strip, load: float, voltage: float) -> State | None:
    """The state under a dead load s0 = force/(W0 H0), MPa; None beyond pull-in."""
    found = block.at_voltage(_block(strip, load), voltage)
    return None if found is None else at_length(strip, found.l1, voltage)


def load_of(strip: Strip, stretch: float) -> float:
    """The dead load that stretches the strip at no voltage, MPa."""
    return float(slope(strip.law, stretch, strip.held))


def slack(strip: Strip, stretch: float) -> tuple[float, float]:
    """Voltages (kV) at which a strip held at its length loses its tension along X, and across."""
    pulls = (
        slope(strip.law, stretch, strip.held) / (stretch * strip.held**2),
        slope(strip.law, strip.held, stretch) / (strip.held * stretch**2),
    )
    along, across = (strip.thickness * (max(p, 0.0) / strip.permittivity) ** 0.5 for p in pulls)
    return float(along), float(across)


def limit_point(strip: Strip, load: float) -> State | None:
    """Pull-in under a dead load, by continuation; None if there is none."""
    found = block.limit_point(_block(strip, load))
    return None if found is None else at_length(strip, found.l1, found.voltage)


def _block(strip: Strip, load: float) -> block.Block:
    return block.Block(
        strip.law, "plane_strain", load, strip.thickness, strip.permittivity, strip.held
    )
