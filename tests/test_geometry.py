"""Meshes of all variants: names, matching edges, grading, files."""

import gmsh
import numpy as np
import pytest
from conftest import case

from dealib.device import grading
from dealib.device.gmsh_model import gmsh_model, write
from dealib.errors import ConfigError

CLAMPS = "{width: 2 mm, height: 1.5 mm}"
VARIANTS = {
    "strips and air": {},
    "no air": {"geometry__air_height": "0 mm"},
    "no electrodes": {"geometry__electrode_thickness": "0 um"},
    "film alone": {"geometry__electrode_thickness": "0 um", "geometry__air_height": "0 mm"},
    "clamps": {"geometry__clamps": CLAMPS},
    "clamps, no air": {"geometry__clamps": CLAMPS, "geometry__air_height": "0 mm"},
    "clamps, no electrodes": {
        "geometry__clamps": CLAMPS,
        "geometry__electrode_thickness": "0 um",
    },
    "narrow strips under high air": {
        "geometry__outer_radius": "9.35 mm",
        "geometry__air_height": "8 mm",
    },
    "uniform": {"mesh__grading": "uniform"},
    "tanh": {"mesh__grading": "tanh"},
}


def cells_of(model):
    """Corner coordinates by region, and all cells' qualities."""
    tags, xyz, _ = model.mesh.getNodes()
    where = np.zeros(int(tags.max()) + 1, int)
    where[tags] = np.arange(len(tags))
    points, found = xyz.reshape(-1, 3)[:, :2], {}
    for _, group in model.getPhysicalGroups(2):
        parts = []
        for surface in model.getEntitiesForPhysicalGroup(2, group):
            kinds, _, nodes = model.mesh.getElements(2, surface)
            assert list(kinds) == [3], "all quadrilaterals"
            parts.append(points[where[nodes[0].reshape(-1, 4)]])
        found[model.getPhysicalName(2, group)] = np.concatenate(parts)
    return found


def area(quads):
    x, y = quads[..., 0], quads[..., 1]
    return 0.5 * (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)


def expected(g):
    """Physical names of annular strips and their dimensions."""
    regions, curves = {"film"}, {"inner", "outer", "film_top", "film_bottom"}
    if g.electrode_thickness > 0:
        regions |= {"top_electrode", "bottom_electrode"}
        curves |= {"top_electrode_top", "bottom_electrode_bottom"}
    if g.clamps is not None:
        regions |= {"mount_block", "frame_block"}
    if g.air_height > 0:
        regions |= {"air"}
        curves |= {"axis_air", "outer_air", "top_air", "bottom_air"}
    return dict.fromkeys(regions, 2) | dict.fromkeys(curves, 1)


@pytest.mark.parametrize("variant", VARIANTS)
def test_variant(variant):
    config = case("benchmark_strip_air", **VARIANTS[variant]).config
    g = config.geometry
    with gmsh_model(config) as session:
        cells = cells_of(session.model)
        found = {
            session.model.getPhysicalName(d, t): d for d, t in session.model.getPhysicalGroups()
        }
    assert found == expected(g)
    assert all((area(q) > 0).all() for q in cells.values())
    # areas of the regions are exact, so nothing overlaps and nothing is missing
    length = g.outer_radius - g.inner_radius
    total = {r: abs(area(q)).sum() for r, q in cells.items()}
    assert total["film"] == pytest.approx(length * g.film_thickness)
    assert len(cells["film"]) == 60 * 4
    solid = length * (g.film_thickness + 2 * g.electrode_thickness)
    if g.electrode_thickness > 0:
        assert total["top_electrode"] == pytest.approx(length * g.electrode_thickness)
    if g.clamps is not None:
        assert total["mount_block"] == pytest.approx(2 * 2 * 1.5)
        assert total["frame_block"] == pytest.approx(2 * 2 * 1.5)
        solid += 2 * 2 * 2 * 1.5
    if g.air_height > 0:
        width = length + (2 * g.clamps.width if g.clamps else 0)
        assert total["air"] == pytest.approx(width * 2 * g.air_height - solid)


@pytest.mark.parametrize("kind", ["ends", "uniform", "tanh"])
def test_columns_have_their_grading(kind):
    config = case("benchmark_strip_air", mesh__grading=kind).config
    with gmsh_model(config) as session:
        film = cells_of(session.model)["film"]
    radii = np.unique(np.round(film[..., 0], 9))
    size = np.diff(radii)
    assert len(radii) == 61
    assert size == pytest.approx(size[::-1], rel=1e-5)  # both ends alike
    if kind == "uniform":
        assert size == pytest.approx(4 / 60, rel=1e-6)
    if kind == "ends":
        assert size[0] == pytest.approx(0.030 / 4, rel=1e-5)  # square cells at the ends
        ratio = size[1:30] / size[:29]
        assert ratio == pytest.approx(ratio[0], rel=1e-4)
    if kind == "tanh":
        s = np.linspace(0, 1, 61)
        R = 8.35 + 4 * 0.5 * (1 + np.tanh(4 * (s - 0.5)) / np.tanh(2))
        assert radii == pytest.approx(R, abs=1e-8)


def test_air_cells_are_well_shaped():
    config = case("benchmark_strip_air").config
    with gmsh_model(config) as session:
        model = session.model
        air = [
            s
            for _, t in model.getPhysicalGroups(2)
            if model.getPhysicalName(2, t) == "air"
            for s in model.getEntitiesForPhysicalGroup(2, t)
        ]
        quality = np.concatenate(
            [model.mesh.getElementQualities(model.mesh.getElements(2, s)[1][0]) for s in air]
        )
    assert quality.min() > 0.2
    assert np.median(quality) > 0.7


def test_air_with_triangles_left_is_refused(monkeypatch):
    """Gmsh leaves some at very fine sizes; which ones depends on its version."""
    monkeypatch.setattr(gmsh.model.mesh, "getElementTypes", lambda _: [2, 3])
    with pytest.raises(ConfigError) as error, gmsh_model(case("benchmark_strip_air").config):
        pass
    assert str(error.value) == (
        "Gmsh leaves triangles among the quadrilaterals of the air; choose another mesh.air_size"
    )


def test_geometric_grading_reaches_its_end():
    x = grading.geometric(10, 0.01)
    assert x[0] == 0
    assert x[-1] == pytest.approx(1)
    assert np.diff(x)[0] == pytest.approx(0.01)
    assert grading.geometric(4, 0.5) == pytest.approx([0, 0.25, 0.5, 0.75, 1])


def test_written_mesh_is_read_back(tmp_path):
    counts = write(case("benchmark_strip_air").config, tmp_path / "m.msh")
    config = case("benchmark_strip_air", mesh__file=str(tmp_path / "m.msh")).config
    with gmsh_model(config) as session:
        cells = cells_of(session.model)
    assert {k: len(v) for k, v in cells.items()} == counts


def test_mesh_without_a_name_is_refused(tmp_path):
    write(case("benchmark_strip_air", geometry__air_height="0 mm").config, tmp_path / "m.msh")
    config = case("benchmark_strip_air", mesh__file=str(tmp_path / "m.msh")).config
    with (
        pytest.raises(ConfigError, match="no physical group named air, axis_air"),
        gmsh_model(config),
    ):
        pass


def test_mesh_of_another_size_is_refused(tmp_path):
    write(case("benchmark_strip_air").config, tmp_path / "m.msh")
    config = case(
        "benchmark_strip_air", mesh__file=str(tmp_path / "m.msh"), geometry__outer_radius="13 mm"
    ).config
    with (
        pytest.raises(ConfigError, match=r"film spans R = 8\.35\.\.12\.35"),
        gmsh_model(config),
    ):
        pass


def test_electrodes_that_are_thinner_in_the_middle_are_taken(tmp_path):
    """Only extents are compared: the shape in between is the user's."""
    same = {"geometry__air_height": "0 mm", "mesh__columns": 8}
    with gmsh_model(case("benchmark_strip_air", **same).config) as session:
        for tag, xyz in zip(*_nodes(session.model.mesh), strict=True):
            beyond = max(abs(xyz[1]) - 0.015, 0)
            thinner = 0.5 * beyond * (1 - ((xyz[0] - 10.35) / 2) ** 2)
            session.model.mesh.setNode(tag, [xyz[0], xyz[1] - np.copysign(thinner, xyz[1]), 0], [])
        session.write(str(tmp_path / "m.msh"))
    with gmsh_model(
        case("benchmark_strip_air", mesh__file=str(tmp_path / "m.msh"), **same).config
    ) as own:
        electrode = area(cells_of(own.model)["top_electrode"]).sum()
    assert 0.65 < electrode / (4 * 0.010) < 0.68  # 1 - 1/2 (1 - 1/3) = 2/3 of the full one


def _nodes(mesh):
    tags, xyz, _ = mesh.getNodes()
    return tags, xyz.reshape(-1, 3)


def test_gmsh_is_closed_after_an_error(tmp_path):
    (tmp_path / "m.msh").write_text("no mesh")
    config = case("benchmark_strip_air").config  # loading one with such a file would refuse it
    mesh = config.mesh.model_copy(update={"file": tmp_path / "m.msh"})
    config = config.model_copy(update={"mesh": mesh})
    with pytest.raises(ConfigError, match="no mesh of Gmsh's"), gmsh_model(config):
        pass
    assert not gmsh.isInitialized()
