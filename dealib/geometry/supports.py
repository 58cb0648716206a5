"""What holds and drives a device: which unknowns, on which named part, follow what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dealib.config.schema import Geometry
from dealib.geometry import names

Quantity = Literal["u_R", "u_Z", "phi"]
Target = Literal["zero", "mount", "terminal"]


@dataclass(frozen=True)
class Support:
    """All unknowns of one quantity on a named region or boundary follow a target.

    Attributes:
        quantity: Displacement component or potential.
        where: Name of the region or boundary.
        target: 'zero', or the port whose value they take.
    """

    quantity: Quantity
    where: str
    target: Target = "zero"


def supports(geometry: Geometry) -> list[Support]:
    """Supports of the strips; where two meet, the later one holds.

    The outer end is fixed, the inner end moves axially with the mount, the top electrode has the
    terminal's potential, the bottom one is ground (thesis, sections 3.2.1 and 3.2.2).
    """
    found: list[Support] = []
    if geometry.air_height > 0:  # the air's mesh slides along its sides
        found += [Support("u_R", names.AXIS_AIR)]
        for side in (names.OUTER_AIR, names.TOP_AIR, names.BOTTOM_AIR):
            found += [Support("u_R", side), Support("u_Z", side)]
    if geometry.clamps is not None:
        found += [Support("u_R", names.MOUNT_BLOCK), Support("u_Z", names.MOUNT_BLOCK, "mount")]
        found += [Support("u_R", names.FRAME_BLOCK), Support("u_Z", names.FRAME_BLOCK)]
    found += [Support("u_R", names.INNER), Support("u_Z", names.INNER, "mount")]
    found += [Support("u_R", names.OUTER), Support("u_Z", names.OUTER)]
    bodies = geometry.electrode_thickness > 0
    top = names.TOP_ELECTRODE if bodies else names.FILM_TOP
    bottom = names.BOTTOM_ELECTRODE if bodies else names.FILM_BOTTOM
    found += [Support("phi", top, "terminal"), Support("phi", bottom)]
    return found
