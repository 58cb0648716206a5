"""Meshes of the user's own: every kind of cell is read, checked, and solved to the same numbers."""

from dataclasses import replace

import gmsh
import numpy as np
import pytest

import dealib
from dealib.device import msh, sound
from dealib.errors import ConfigError
from dealib.units import EPSILON_0

TEXT = """\
name: own
geometry: {shape: mesh, file: m.msh, space: axisymmetric}
regions: {rubber: film}
materials:
  film: {law: neo_hookean, youngs_modulus: 1 MPa, relative_permittivity: 3.0}
terminals: {top: {on: above}, bottom: {on: below, ground: true}}
mounts: {mount: {on: inner, along: Z}}
holds: [{on: outer, fix: [R, Z]}]
program:
  - {stage: prestrain}
  - {stage: push, mount: {displacement: -0.5 mm}}
"""
# kind -> triangles, quadrilaterals or both, order, and whether second order has no node inside
PLANE = {
    "3-node triangles": ("triangles", 1, 0),
    "6-node triangles": ("triangles", 2, 0),
    "4-node quadrilaterals": ("quads", 1, 0),
    "8-node quadrilaterals": ("quads", 2, 1),
    "9-node quadrilaterals": ("quads", 2, 0),
    "both of first order": ("both", 1, 0),
    "both of second order": ("both", 2, 0),
    "both of second order, 8 nodes": ("both", 2, 1),
}
SOLID = {
    "4-node tetrahedra": (False, 1, 0),
    "10-node tetrahedra": (False, 2, 0),
    "8-node hexahedra": (True, 1, 0),
    "20-node hexahedra": (True, 2, 1),
    "27-node hexahedra": (True, 2, 0),
}


def written(path, build, order, incomplete, version=4.1):
    """Write what is built in Gmsh, and read it."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        dim = build(gmsh.model)
        gmsh.model.mesh.generate(dim)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return msh.read(path)


def film(cells, scale=1.0):
    """A film of 4 mm x 0.5 mm in two parts, R from 8 to 12 mm."""

    def build(model):
        geo = model.geo
        corners = [(R, Z) for Z in (-0.25, 0.25) for R in (8, 10, 12)]
        p = [geo.addPoint(scale * R, scale * Z, 0) for R, Z in corners]
        pairs = [(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5)]
        lines = [geo.addLine(p[a], p[b]) for a, b in pairs]
        b1, b2, t1, t2, inner, middle, outer = lines
        for line in (b1, b2, t1, t2):
            geo.mesh.setTransfiniteCurve(line, 9)
        for line in (inner, middle, outer):
            geo.mesh.setTransfiniteCurve(line, 3)
        parts = []
        for loop in ([b1, middle, -t1, -inner], [b2, outer, -t2, -middle]):
            parts.append(geo.addPlaneSurface([geo.addCurveLoop(loop)]))
            geo.mesh.setTransfiniteSurface(parts[-1])
        for part in {"triangles": [], "quads": parts, "both": parts[:1]}[cells]:
            geo.mesh.setRecombine(2, part)
        geo.synchronize()
        model.addPhysicalGroup(2, parts, name="rubber")
        for name, curves in (
            ("below", [b1, b2]),
            ("above", [t1, t2]),
            ("inner", [inner]),
            ("outer", [outer]),
        ):
            model.addPhysicalGroup(1, curves, name=name)
        return 2

    return build


def block(hexahedra):
    """A block of 2 x 2 x 1 mm."""

    def build(model):
        model.occ.addBox(0, 0, 0, 2, 2, 1)
        model.occ.synchronize()
        if hexahedra:
            for _, curve in model.getEntities(1):
                model.mesh.setTransfiniteCurve(curve, 3)
            for _, face in model.getEntities(2):
                model.mesh.setTransfiniteSurface(face)
                model.mesh.setRecombine(2, face)
            model.mesh.setTransfiniteVolume(1)
        model.addPhysicalGroup(3, [1], name="block")
        return 3

    return build


def solved(folder, text=TEXT, **changes):
    (folder / "own.yaml").write_text(text)
    case = dealib.load(
        folder / "own.yaml", set={k.replace("__", "."): v for k, v in changes.items()}
    )
    return [state.row for state in dealib.Simulation(case)]


@pytest.fixture(scope="module")
def laminate(tmp_path_factory):
    """Rows of the same film as a laminate."""
    text = TEXT.replace(
        "regions: {rubber: film}\n", "mesh: {columns: 16, film_rows: 2, grading: uniform}\n"
    )
    text = text.replace(
        "{shape: mesh, file: m.msh, space: axisymmetric}",
        "{shape: laminate, base: {kind: annulus, inner_radius: 8 mm, outer_radius: 12 mm}, "
        "layers: [{name: film, thickness: 0.5 mm}]}",
    )
    text = text.replace("above", "film.top").replace("below", "film.bottom")
    return solved(tmp_path_factory.mktemp("laminate"), text)


@pytest.mark.parametrize("kind", PLANE)
def test_cells_of_every_kind_are_solved(tmp_path, laminate, kind):
    """Capacitance of the plates at rest, and the force of the laminate with as many cells."""
    cells, order, incomplete = PLANE[kind]
    written(tmp_path / "m.msh", film(cells), order, incomplete)
    rest, pushed = solved(tmp_path)
    plates = 1e3 * EPSILON_0 * 3 * np.pi * (12**2 - 8**2) / 0.5
    assert rest["capacitance_pF"] == pytest.approx(plates, rel=1e-7)
    assert laminate[0]["capacitance_pF"] == pytest.approx(plates, rel=1e-7)
    assert pushed["force_N"] == pytest.approx(
        laminate[1]["force_N"], rel=1e-8 if cells == "quads" else 0.005
    )


@pytest.mark.parametrize("kind", ["6-node triangles", "8-node quadrilaterals"])
def test_cells_of_second_order_serve_the_first_too(tmp_path, kind):
    cells, order, incomplete = PLANE[kind]
    written(tmp_path / "m.msh", film(cells), order, incomplete)
    _, pushed = solved(tmp_path, mesh__order=1)
    written(tmp_path / "m.msh", film(cells), 1, 0)
    _, same = solved(tmp_path, mesh__order=1)
    assert pushed["force_N"] == pytest.approx(same["force_N"], rel=1e-9)


def test_coordinates_may_have_another_unit(tmp_path):
    written(tmp_path / "m.msh", film("quads", 1e-3), 1, 0)
    in_metres = solved(tmp_path, geometry__unit="m")
    written(tmp_path / "m.msh", film("quads"), 1, 0)
    for row, same in zip(in_metres, solved(tmp_path), strict=True):
        for column in ("capacitance_pF", "force_N"):
            assert row[column] == pytest.approx(same[column], rel=1e-9, abs=1e-12)


@pytest.mark.once
@pytest.mark.parametrize("version", [4.1, 2.2])
@pytest.mark.parametrize("kind", [*PLANE, *SOLID])
def test_both_formats_hold_the_same_cells(tmp_path, kind, version):
    build = film(PLANE[kind][0]) if kind in PLANE else block(SOLID[kind][0])
    dim, (_, order, incomplete) = (2, PLANE[kind]) if kind in PLANE else (3, SOLID[kind])
    found = written(tmp_path / "m.msh", build, order, incomplete, version)
    assert sound.fault(found, dim) == ""
    wanted = {"film": 2.0, "block": 4.0}["film" if dim == 2 else "block"]
    assert size(found, dim) == pytest.approx(wanted)
    other = written(tmp_path / "n.msh", build, order, incomplete, 6.3 - version)
    key = lambda mesh: sorted(  # noqa: E731 - whatever the order of entities
        tuple(map(tuple, mesh.points[cell].round(9))) for cell in cells_of(mesh, dim)
    )
    assert key(found) == key(other)


def cells_of(mesh, dim):
    return [cell for (d, _, _), cells in mesh.elements.items() if d == dim for cell in cells]


def size(mesh, dim):
    """Area or volume of the cells, by their corners."""
    total = 0.0
    for (d, _, kind), cells in mesh.elements.items():
        if d != dim:
            continue
        x = mesh.points[cells[:, : msh.TYPES[kind][2]]]
        if dim == 2:
            a, b = x[..., 0], x[..., 1]
            total += abs((a * np.roll(b, -1, 1) - b * np.roll(a, -1, 1)).sum(axis=1) / 2).sum()
        elif x.shape[1] == 4:
            total += abs(np.linalg.det(x[:, 1:] - x[:, :1])).sum() / 6
        else:  # these hexahedra are boxes
            total += np.ptp(x, axis=1).prod(axis=1).sum()
    return total


# --- what is not sound ---------------------------------------------------------------------------


def mesh_of(path, kind):
    """A mesh, its dimension, and the key of its cells."""
    if kind in PLANE:
        found = written(path, film(PLANE[kind][0]), *PLANE[kind][1:])
    else:
        found = written(path, block(SOLID[kind][0]), *SOLID[kind][1:])
    dim = 2 if kind in PLANE else 3
    return found, dim, next(key for key in found.elements if key[0] == dim)


@pytest.mark.once
@pytest.mark.parametrize("kind", [*PLANE, *SOLID])
def test_a_crack_is_found(tmp_path, kind):
    """The cells of one part have nodes of their own where they meet the others."""
    mesh, dim, key = mesh_of(tmp_path / "m.msh", kind)
    cells = mesh.elements[key].copy()
    torn = cells[0]
    own = len(mesh.points) + np.arange(len(torn))
    points = np.concatenate([mesh.points, mesh.points[torn]])
    cells[0] = own
    cracked = replace(mesh, points=points, elements=mesh.elements | {key: cells})
    assert "several nodes are at (" in sound.fault(cracked, dim)
    assert sound.fault(cracked, dim).endswith("the cells there are not connected; merge the nodes")


@pytest.mark.once
@pytest.mark.parametrize("kind", ["6-node triangles", "9-node quadrilaterals", "27-node hexahedra"])
def test_a_node_beside_the_one_of_the_middle_is_a_crack_too(tmp_path, kind):
    mesh, dim, key = mesh_of(tmp_path / "m.msh", kind)
    cells, corners = mesh.elements[key].copy(), msh.TYPES[key[2]][2]
    middles, counts = np.unique(cells[:, corners:], return_counts=True)
    shared = middles[counts > 1][0]
    (row, *_), (column, *_) = np.nonzero(cells == shared)
    points = np.concatenate([mesh.points, mesh.points[[shared]]])
    cells[row, column] = len(points) - 1
    cracked = replace(mesh, points=points, elements=mesh.elements | {key: cells})
    place = ", ".join(f"{x:.6g}" for x in mesh.points[shared, :dim].round(9))
    assert sound.fault(cracked, dim) == (
        f"several nodes are at ({place}) mm: the cells there are not connected; merge the nodes"
    )


@pytest.mark.once
@pytest.mark.parametrize("kind", [k for k, (_, order, _) in (PLANE | SOLID).items() if order == 1])
def test_a_folded_cell_is_found(tmp_path, kind):
    """One corner lies beyond the opposite side."""
    mesh, dim, key = mesh_of(tmp_path / "m.msh", kind)
    points = mesh.points.copy()
    points[inside(mesh, key), :dim] += 3.0
    told = sound.fault(replace(mesh, points=points), dim)
    # triangles and tetrahedra that are turned over lie upon others
    simplices = msh.TYPES[key[2]][2] == dim + 1
    assert told.startswith("cells overlap at (" if simplices else "the cell at ("), told


@pytest.mark.once
@pytest.mark.parametrize(
    "kind", [k for k in PLANE | SOLID if k.startswith(("4-node q", "8-", "9", "2"))]
)
def test_a_cell_of_which_two_corners_are_exchanged_is_found(tmp_path, kind):
    mesh, dim, key = mesh_of(tmp_path / "m.msh", kind)
    cells = mesh.elements[key].copy()
    cells[0, [0, 1]] = cells[0, [1, 0]]
    turned = replace(mesh, elements=mesh.elements | {key: cells})
    assert sound.fault(turned, dim).endswith(" mm is flat or folded")


@pytest.mark.once
@pytest.mark.parametrize("kind", [*PLANE, *SOLID])
def test_cells_may_be_numbered_either_way_round(tmp_path, kind):
    mesh, dim, _ = mesh_of(tmp_path / "m.msh", kind)
    mirrored = replace(mesh, points=mesh.points * [1, -1, 1])
    assert sound.fault(mirrored, dim) == ""


def inside(mesh, key):
    """A corner that the most cells share."""
    nodes, counts = np.unique(mesh.elements[key][:, : msh.TYPES[key[2]][2]], return_counts=True)
    return nodes[counts.argmax()]


@pytest.mark.once
@pytest.mark.parametrize("kind", [k for k, (_, order, _) in (PLANE | SOLID).items() if order == 2])
def test_a_middle_that_is_not_between_its_ends_is_found(tmp_path, kind):
    """Curved sides are welcome, sides that turn back are not."""
    mesh, dim, key = mesh_of(tmp_path / "m.msh", kind)
    cells, corners = mesh.elements[key], msh.TYPES[key[2]][2]
    a, b, middle = mesh.points[cells[0, [0, 1, corners]]]
    assert np.allclose(middle, (a + b) / 2)
    for share, wrong in ((0.2, False), (0.3, True)):
        points = mesh.points.copy()
        points[cells[0, corners]] += share * (b - a)
        told = sound.fault(replace(mesh, points=points), dim)
        assert told.endswith(" mm is not in the middle of its side") == wrong, told
    across = np.cross(b - a, [0.3, 0.2, 1.0] if dim == 3 else [0, 0, 1.0])
    points = mesh.points.copy()
    points[cells[0, corners]] += 0.1 * across
    assert sound.fault(replace(mesh, points=points), dim) == ""


@pytest.mark.once
@pytest.mark.parametrize("kind", [*PLANE, *SOLID])
def test_a_cell_that_is_there_twice_is_found(tmp_path, kind):
    mesh, dim, key = mesh_of(tmp_path / "m.msh", kind)
    cells = np.concatenate([mesh.elements[key], mesh.elements[key][:1]])
    twice = replace(mesh, elements=mesh.elements | {key: cells})
    assert sound.fault(twice, dim).startswith("cells overlap at (")


def test_triangles_of_both_orders_do_not_fit_together(tmp_path):
    mesh, *_ = mesh_of(tmp_path / "m.msh", "6-node triangles")
    (first, *_) = (key for key in mesh.elements if key[0] == 2)
    cells = {key: c for key, c in mesh.elements.items() if key != first}
    cells[2, first[1], 2] = mesh.elements[first][:, :3]
    assert sound.fault(replace(mesh, elements=cells)) == (
        "it has cells of first and of second order, which do not fit together"
    )


def test_what_no_solver_takes_is_named(tmp_path):
    written(tmp_path / "m.msh", block(hexahedra=False), 1, 0)
    text = (tmp_path / "m.msh").read_text()
    (tmp_path / "m.msh").write_text(text.replace("\n3 1 4 ", "\n3 1 7 "))
    with pytest.raises(ConfigError, match="cells must be triangles, quadrilaterals, tetrahedra"):
        msh.read(tmp_path / "m.msh")


FREE = """\
name: free
geometry: {shape: mesh, file: m.msh, space: 3d}
materials:
  block: {law: neo_hookean, shear_modulus: 1 MPa, bulk_modulus: 2 GPa, relative_permittivity: 3.0}
physics: {formulation: mixed}
terminals: {hot: {on: high}, ground: {on: low, ground: true}}
mounts: {plate: {on: right, along: X, free: [Y, Z]}}
holds: [{on: left, fix: X}, {on: front, fix: Y}, {on: low, fix: Z}]
program:
  - {stage: release, mount: {force: 0 N}}
  - {stage: actuate, terminal: {voltage: 100 kV}, steps: 2}
"""


def named(hexahedra):
    """The block with names for its sides."""

    def build(model):
        dim = block(hexahedra)(model)
        for face, name in enumerate(("left", "right", "front", "back", "low", "high"), start=1):
            model.addPhysicalGroup(2, [face], name=name)
        return dim

    return build


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(k, marks=pytest.mark.slow) if k.startswith("10-node") else k
        for k in SOLID
        if k != "20-node hexahedra"
    ],
)
def test_a_free_block_of_any_solid_cells_is_that_of_the_closed_form(tmp_path, kind):
    """Incompressible neo-Hooke, free in the plane: eps E0^2 = G (1 - l^-6) / l^2."""
    hexahedra, order, incomplete = SOLID[kind]
    written(tmp_path / "m.msh", named(hexahedra), order, incomplete)
    end = solved(tmp_path, FREE)[-1]
    l = 1 + end["displacement_mm"] / 2
    field = EPSILON_0 * 3 * 100**2
    assert (1 - l**-6) / l**2 == pytest.approx(field, rel=2e-3)
    assert end["charge_uC"] == pytest.approx(EPSILON_0 * 3 * 4 * 100 * l**4, rel=1e-3)


def test_hexahedra_of_twenty_nodes_are_refused_with_what_to_do(tmp_path):
    written(tmp_path / "m.msh", named(hexahedra=True), 2, 1)
    with pytest.raises(ConfigError, match="hexahedra of second order need 27 nodes"):
        solved(tmp_path, FREE)


def test_a_run_is_read_where_its_mesh_is_away(tmp_path, monkeypatch):
    """From another folder, or after the mesh is gone: the run has a copy, in mm."""
    written(tmp_path / "m.msh", film("quads", scale=1e-3), 1, 0)
    (tmp_path / "own.yaml").write_text(TEXT.replace("space:", "unit: m, space:"))
    monkeypatch.chdir(tmp_path)
    dealib.simulate("own.yaml", "run")
    (tmp_path / "m.msh").unlink()
    monkeypatch.chdir("/")
    run = dealib.open(tmp_path / "run")
    assert run.config.geometry.file == str(tmp_path / "run" / "mesh.msh")
    assert run.config.geometry.unit == "mm"
    assert [region.name for region in run.config.device.solids] == ["rubber"]
    points = run.mesh.points
    assert [points[:, 0].min(), points[:, 0].max()] == pytest.approx([8, 12])
