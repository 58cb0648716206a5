"""Names of regions and boundaries: the same in Gmsh, in the config and in the results."""

from __future__ import annotations

from dealib.config.schema import Geometry

# regions
FILM = "film"
TOP_ELECTRODE = "top_electrode"
BOTTOM_ELECTRODE = "bottom_electrode"
AIR = "air"
MOUNT_BLOCK = "mount_block"
FRAME_BLOCK = "frame_block"

# boundaries
INNER = "inner"  # the strips' end at the mount
OUTER = "outer"  # the strips' end at the frame
FILM_TOP = "film_top"  # face of the film to the top electrode (or to the air)
FILM_BOTTOM = "film_bottom"
AXIS_AIR = "axis_air"  # the air's side that faces the axis
OUTER_AIR = "outer_air"  # the air's side away from the axis
TOP_AIR = "top_air"
BOTTOM_AIR = "bottom_air"


def expected(geometry: Geometry) -> dict[str, int]:
    """Names that a mesh of this geometry must have, with their dimension."""
    regions, curves = [FILM], [INNER, OUTER, FILM_TOP, FILM_BOTTOM]
    if geometry.electrode_thickness > 0:
        regions += [TOP_ELECTRODE, BOTTOM_ELECTRODE]
    if geometry.clamps is not None:
        regions += [MOUNT_BLOCK, FRAME_BLOCK]
    if geometry.air_height > 0:
        regions += [AIR]
        curves += [AXIS_AIR, OUTER_AIR, TOP_AIR, BOTTOM_AIR]
    return dict.fromkeys(regions, 2) | dict.fromkeys(curves, 1)
