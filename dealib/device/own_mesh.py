"""A mesh of the user's own, made ready: unit, order, one kind of cell."""

from __future__ import annotations

from typing import Any

import numpy as np

from dealib.config.schema import Config
from dealib.device.shapes import MeshShape
from dealib.errors import ConfigError
from dealib.units import factor

_TRIANGLES, _QUADS = {2, 9}, {3, 10, 16}  # Gmsh's element types


def prepare(gmsh: Any, config: Config, shape: MeshShape) -> None:
    """Make the open Gmsh model fit what is solved on it.

    Lengths become mm. Where triangles and quadrilaterals are mixed, these are cut into triangles.
    Curved cells are straightened if displacements are of first order.

    Raises:
        ConfigError: If there are cells of other kinds, or cells without a region.
    """
    dim = shape.kinematics.dim
    scale = factor(shape.unit, "mm")
    if scale != 1:
        matrix = (np.eye(4) * scale)[:3].ravel()
        gmsh.model.mesh.affineTransform(matrix.tolist())
    kinds = set(map(int, gmsh.model.mesh.getElementTypes(dim)))
    known = _TRIANGLES | _QUADS
    if not kinds or kinds - known:
        names = ", ".join(gmsh.model.mesh.getElementProperties(k)[0] for k in kinds - known)
        raise ConfigError(
            f"geometry.file {shape.file}: cells must be triangles and quadrilaterals of first or "
            f"second order; it has {names or 'none'}"
        )
    tagged = {e for _, t in gmsh.model.getPhysicalGroups(dim)
              for e in gmsh.model.getEntitiesForPhysicalGroup(dim, t)}
    if any(tag not in tagged for _, tag in gmsh.model.getEntities(dim)):
        raise ConfigError(
            f"geometry.file {shape.file}: some of its cells belong to no physical group; give each "
            "surface a physical name"
        )
    gmsh.model.mesh.setOrder(min(config.mesh.order, 2 if kinds & {9, 10, 16} else 1))
    if kinds & _TRIANGLES and kinds & _QUADS:
        gmsh.model.mesh.splitQuadrangles()
