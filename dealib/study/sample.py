"""Values of stored fields along the strips, by fractions of their length and thickness."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dealib.errors import did_you_mean
from dealib.geometry import names
from dealib.plots.quantities import QUANTITIES
from dealib.results.elements import Array
from dealib.results.mesh import Ints, ResultMesh
from dealib.results.summary import MARGINS

SURFACE_CHARGE, LENGTH = "D_n", "length"
FIELDS = (*QUANTITIES, SURFACE_CHARGE, LENGTH)
SOLIDS = (names.FILM, names.TOP_ELECTRODE, names.BOTTOM_ELECTRODE)  # others carry no stress


def _carriers(name: str) -> tuple[str, ...]:
    """Regions that a field belongs to; none if to all."""
    if name.startswith(("S_", "sigma_")):
        return SOLIDS
    field = QUANTITIES[name].field if name in QUANTITIES else name
    return (names.FILM,) if field in ("tension", SURFACE_CHARGE, *MARGINS) else ()


def check(name: str, region: str) -> None:
    """Raise if a region does not carry a field.

    Raises:
        ValueError: If so, or if there is no such field.
    """
    if name not in FIELDS:
        raise ValueError(f"unknown field {name!r}{did_you_mean(name, FIELDS)}")
    carriers = _carriers(name)
    if carriers and region not in carriers:
        raise ValueError(f"{name} is a field of {', '.join(carriers)}, not of {region}")


def fraction(name: str, value: float) -> float:
    """A fraction of a region's length or thickness.

    Raises:
        ValueError: If it is not from 0 to 1.
    """
    if not (isinstance(value, (int, float, np.ndarray)) and 0 <= float(value) <= 1):
        told = repr(value) if isinstance(value, str) else str(value)
        raise ValueError(f"{name} is a fraction from 0 to 1, not {told}")
    return float(value)


def component(arrays: dict[str, Array], name: str) -> Array:
    """A scalar nodal field by its short name, such as S_RR, E_Z, E (length), phi, J; mm, kV, MPa.

    Raises:
        ValueError: If the name is unknown.
    """
    if name not in QUANTITIES:
        raise ValueError(f"unknown field {name!r}{did_you_mean(name, FIELDS)}")
    what = QUANTITIES[name]
    return what.of(arrays) / what.factor


def regions(mesh: ResultMesh) -> list[str]:
    """Names of the regions that have cells."""
    return [name for i, name in enumerate(mesh.names) if (mesh.region == i).any()]


class Strip:
    """A rectangular region of the mesh.

    Args:
        mesh: The mesh.
        region: Name of the region.

    Raises:
        ValueError: If there is no such region.
    """

    def __init__(self, mesh: ResultMesh, region: str) -> None:
        known = regions(mesh)
        if region not in known:
            raise ValueError(f"there is no region {region!r} here{did_you_mean(region, known)}")
        self.mesh = mesh
        self.cells: Ints = mesh.in_region(region)
        self.nodes: Ints = np.unique(mesh.cells[self.cells])
        self.low = mesh.points[self.nodes].min(axis=0)
        self.size = mesh.points[self.nodes].max(axis=0) - self.low

    @cached_property
    def _triangulation(self) -> object:
        from scipy.spatial import Delaunay

        return Delaunay((self.mesh.points[self.nodes] - self.low) / self.size)

    @cached_property
    def positions(self) -> Array:
        """Fractions of the length at which there are nodes, from the inner end."""
        s = (self.mesh.points[self.nodes, 0] - self.low[0]) / self.size[0]
        return np.asarray(np.unique(s.round(9)))

    def at(self, values: Array, along: Array, across: float) -> Array:
        """A nodal field at fractions of the length and of the thickness (0: bottom, 1: top).

        Exact at nodes, linear between them.
        """
        from scipy.interpolate import LinearNDInterpolator

        s = np.atleast_1d(along)
        points = np.clip(np.column_stack([s, np.full(len(s), across)]), 1e-12, 1 - 1e-12)
        linear = LinearNDInterpolator(self._triangulation, values[self.nodes])
        return np.asarray(linear(points))


def along(strip: Strip, arrays: dict[str, Array], name: str, across: float) -> Array:
    """A field along a strip, at the positions of its nodes from the inner end outwards.

    Besides the fields there are `length` (distance from the inner end on the mesh, mm) and
    `D_n`: the charge density (C/m^2) on a conductor that touches the strip's bottom
    (across 0) or top (across 1), which is -D.n with the strip's outward normal n in the deformed
    body.

    Raises:
        ValueError: If the name is unknown.
    """
    s = strip.positions
    if name == LENGTH:
        return np.asarray(s * strip.size[0])
    if name != SURFACE_CHARGE:
        return strip.at(component(arrays, name), s, across)
    if across not in (0, 1):
        raise ValueError("D_n: across must be 0 (bottom face) or 1 (top face)")
    u_r, u_z, d_r, d_z = (
        strip.at(component(arrays, n), s, across) for n in ("u_R", "u_Z", "D_R", "D_Z")
    )
    dr, dz = np.gradient(s * strip.size[0] + u_r), np.gradient(u_z)
    outward = (1 if across == 1 else -1) / np.hypot(dr, dz)
    return np.asarray(-(d_z * dr - d_r * dz) * outward)


def across(strip: Strip, arrays: dict[str, Array], name: str, s: float) -> Array:
    """A field through a strip at a fraction of its length, at equal distances from the bottom.

    Raises:
        ValueError: If the name is unknown.
    """
    values = component(arrays, name)
    return np.array([strip.at(values, np.array([s]), t)[0] for t in np.linspace(0, 1, 41)])


def at(strip: Strip, arrays: dict[str, Array], name: str, s: float, across: float) -> float:
    """A field at a fraction of a strip's length and thickness (see `along` for the names).

    Raises:
        ValueError: If the name is unknown.
    """
    if name in (LENGTH, SURFACE_CHARGE):
        return float(np.interp(s, strip.positions, along(strip, arrays, name, across)))
    return float(strip.at(component(arrays, name), np.array([s]), across)[0])
