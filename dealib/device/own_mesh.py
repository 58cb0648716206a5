"""Prepares a user's own mesh: its unit, its order, and one kind of cell."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.device.shapes import MeshShape
from dealib.errors import ConfigError
from dealib.units import factor

if TYPE_CHECKING:
    from dealib.config.schema import Config

log = logging.getLogger(__name__)

# Gmsh's element types by their nodes: triangles, and quadrilaterals with the triangles that they
# make; the last node of a second-order quadrilateral is its centre
_TRIANGLES = {3: 2, 6: 9}
_QUADS = {4: 3, 8: 16, 9: 10}
_SOLIDS = {4: 4, 10: 11, 8: 5, 27: 12}  # tetrahedra and hexahedra, alike
_FIRST_ORDER = {2, 3, 4, 5}
_AXIS = 1e-9  # how far rounding may put nodes beyond the axis, of the largest radius
_SPLIT = {4: [[0, 1, 2], [0, 2, 3]], 9: [[0, 1, 2, 4, 5, 8], [0, 2, 3, 8, 6, 7]]}


def prepare(gmsh: Any, config: Config, shape: MeshShape) -> None:
    """Make the open Gmsh model fit the solver.

    Lengths become mm. If there are triangles too, quadrilaterals are cut into triangles. Curved
    cells are straightened if displacements are of first order.

    Raises:
        ConfigError: If there are cells of other kinds, or cells without a region.
    """
    mesh, dim, file = gmsh.model.mesh, shape.kinematics.dim, shape.file
    scale = factor(shape.unit, "mm")
    if scale != 1:
        mesh.affineTransform((np.eye(4) * scale)[:3].ravel().tolist())
    kinds = set(map(int, mesh.getElementTypes(dim)))
    _check_kinds(mesh, dim, kinds, file)
    tagged = {
        entity
        for _, tag in gmsh.model.getPhysicalGroups(dim)
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
    }
    if any(tag not in tagged for _, tag in gmsh.model.getEntities(dim)):
        raise ConfigError(
            f"{file}: some of its cells belong to no physical group; give each a name"
        )
    radii = mesh.getNodes()[1][::3]
    if shape.kinematics.revolved and radii.min() < -_AXIS * radii.max():
        raise ConfigError(
            f"{file}: it reaches R = {radii.min():g} mm, beyond the axis; an axisymmetric mesh "
            "lies at R >= 0, its first coordinate"
        )
    if config.mesh.order == 1 and kinds - _FIRST_ORDER:
        mesh.setOrder(1)
        kinds = set(map(int, mesh.getElementTypes(dim)))
    if dim == 3:
        return
    if len(kinds) > 1:
        log.info("%s: its quadrilaterals are cut into triangles, since it has both", file)
        for _, tag in gmsh.model.getEntities(dim):
            _quads(mesh, dim, tag, cut=True)
        mesh.reclassifyNodes()
    elif kinds == {_QUADS[8]}:
        for _, tag in gmsh.model.getEntities(dim):
            _quads(mesh, dim, tag, cut=False)


def _check_kinds(mesh: Any, dim: int, kinds: set[int], file: str) -> None:
    plane = {*_TRIANGLES.values(), *_QUADS.values()}
    other = kinds - (plane if dim == 2 else set(_SOLIDS.values()))
    names = " and ".join(sorted(mesh.getElementProperties(k)[0] for k in other or kinds))
    if dim == 2 and (other or not kinds):
        raise ConfigError(
            f"{file}: cells must be triangles and quadrilaterals of first or second order; it has "
            f"{names or 'none'}"
        )
    if dim == 3 and (other or len(kinds) != 1):
        raise ConfigError(
            f"{file}: cells must be all tetrahedra or all hexahedra, of first or second order; it "
            f"has {names or 'none'} (hexahedra of second order need 27 nodes: in Gmsh "
            "Mesh.SecondOrderIncomplete = 0)"
        )


def _quads(mesh: Any, dim: int, entity: int, cut: bool) -> None:
    """Give the quadrilaterals of a surface their centres; cut them into triangles if wanted."""
    for kind, elements, nodes in zip(*mesh.getElements(dim, entity), strict=True):
        count = len(nodes) // len(elements)
        if kind not in _QUADS.values():
            continue
        quads = nodes.reshape(-1, count)
        if count == 8:
            quads = np.column_stack([quads, _centres(mesh, dim, entity, quads)])
            count = 9
        parts, kinds = quads, _QUADS
        if cut:
            parts, kinds = np.concatenate([quads[:, part] for part in _SPLIT[count]]), _TRIANGLES
        mesh.removeElements(dim, entity, elements)
        mesh.addElementsByType(entity, kinds[parts.shape[1]], [], parts.ravel())


def _centres(mesh: Any, dim: int, entity: int, quads: Any) -> Any:
    """New nodes at the centres of quadrilaterals with eight nodes."""
    tags, positions, _ = mesh.getNodes()
    order = np.argsort(tags)
    x = positions.reshape(-1, 3)[order][np.searchsorted(tags, quads, sorter=order)]
    at = x[:, 4:].sum(axis=1) / 2 - x[:, :4].sum(axis=1) / 4
    new = np.arange(len(quads)) + int(tags.max()) + 1
    mesh.addNodes(dim, entity, new, at.ravel())
    return new
