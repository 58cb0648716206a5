"""Values of stored fields along and across layers, by the names that expressions use."""

from __future__ import annotations

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.device.kinematics import SPACES, Kinematics
from dealib.errors import did_you_mean
from dealib.results.local import region_materials
from dealib.results.quantities import SURFACE_CHARGE, quantities
from dealib.results.sampling import LayerStrip

CHARGE, LENGTH = SURFACE_CHARGE.name, "length"


def fields(kinematics: Kinematics) -> list[str]:
    """Names of the fields that can be sampled along a region."""
    return [*quantities(kinematics), CHARGE, LENGTH]


def check(config: Config, name: str, region: str) -> None:
    """Check whether a field can be sampled in a region.

    Raises:
        ValueError: If the field does not exist there, or the device is not a laminate in a plane.
    """
    device = config.device
    if device.laminate is None or device.kinematics.dim == 3:
        raise ValueError(
            f"{name} along {region}: only laminates in a plane have fields along their layers; use "
            "probes"
        )
    known = fields(device.kinematics)
    if name not in known:
        raise ValueError(f"unknown field {name!r}{did_you_mean(name, known)}")
    what = quantities(device.kinematics).get(name, SURFACE_CHARGE)
    carriers = [
        region
        for region, material in region_materials(config).items()
        if material.law is not None and not (what.of_films and material.permittivity == 0)
    ]
    if name != LENGTH and (what.of_solids or what.of_films) and region not in carriers:
        raise ValueError(f"{name} is a field of {', '.join(carriers)}, not of {region}")


def fraction(name: str, value: float) -> float:
    """A fraction of the length or thickness of a region.

    Args:
        name: Name of the argument, for messages.
        value: The fraction.

    Raises:
        ValueError: If it is not between 0 and 1.
    """
    if not (isinstance(value, (int, float, np.ndarray)) and 0 <= float(value) <= 1):
        told = repr(value) if isinstance(value, str) else str(value)
        raise ValueError(f"{name} is a fraction from 0 to 1, not {told}")
    return float(value)


_EVERY = {name: q for k in SPACES.values() for name, q in quantities(k).items() if k.dim == 2}


def _nodal(arrays: dict[str, Array], name: str) -> Array:
    """A scalar nodal field by its name, such as S_RR, or E for its magnitude; mm, kV, MPa."""
    what = _EVERY[name]
    return what.of(arrays) / what.factor


def along(strip: LayerStrip, arrays: dict[str, Array], name: str, across: float) -> Array:
    """A field along a strip, at the positions of its nodes from the inner end outwards, (nodes,).

    Besides the fields there are `length`, the undeformed distance from the inner end (mm), and
    `D_n`, the charge density (C/m^2) on a conductor at the bottom (across 0) or top (across 1).

    Raises:
        ValueError: For D_n if `across` is neither 0 nor 1.
    """
    s = strip.positions
    if name == LENGTH:
        return np.asarray(s * strip.length)
    if name != CHARGE:
        return strip.at(_nodal(arrays, name), s, across)
    if across not in (0, 1):
        raise ValueError("D_n: across must be 0 (bottom face) or 1 (top face)")
    R, density = strip.charge(arrays, 1 if across == 1 else -1)
    return np.interp(strip.start + s * strip.length, R, density)


def across(strip: LayerStrip, arrays: dict[str, Array], name: str, s: float) -> Array:
    """A field through the thickness of a strip at a fraction s of its length, (41,)."""
    t = np.linspace(0, 1, 41)
    return strip.at(_nodal(arrays, name), np.full(len(t), s), t)


def at(strip: LayerStrip, arrays: dict[str, Array], name: str, s: float, across: float) -> float:
    """A field at a fraction of a strip's length and thickness (see `along` for the names)."""
    if name in (LENGTH, CHARGE):
        return float(np.interp(s, strip.positions, along(strip, arrays, name, across)))
    return float(strip.at(_nodal(arrays, name), np.array([s]), across)[0])
