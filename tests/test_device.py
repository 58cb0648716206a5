"""Devices from configs: names of laminates, natural ports and supports, meshes, and messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import case
from laminates import BASES, ELECTRODE, FILM, config, layer, rows, simulation
from test_geometry import area, cells_of

import dealib
from dealib.config import Config
from dealib.device.gmsh_model import gmsh_model
from dealib.device.records import CHAMBER, MOUNT, TERMINAL
from dealib.errors import ConfigError

LOW, HIGH = (
    layer("low", "20 um", material="electrode"),
    layer("high", "10 um", material="electrode"),
)


def ports(given: Config) -> dict[str, tuple[str, tuple[str, ...], str]]:
    """Kind, parts and axis of each port by name."""
    return {p.name: (p.kind.name, p.on, p.along) for p in given.device.ports}


def grounded(given: Config) -> list[str]:
    """Parts at 0 V."""
    supports = given.device.supports
    return [s.where for s in supports if s.quantity == "phi" and not s.port]


def held(given: Config) -> list[tuple[str, str]]:
    """Boundaries that do not move, with the axis."""
    supports = given.device.supports
    return [(s.where, s.quantity) for s in supports if s.quantity != "phi" and not s.port]


# --- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("base", "mount", "fixed"),
    [
        ("annulus", "inner", [("inner", "R"), ("outer", "R"), ("outer", "Z")]),
        ("disc", None, [("outer", "R"), ("outer", "Z")]),
        ("tube", "high", [("high", "R"), ("low", "R"), ("low", "Z")]),
        ("strip", None, [("left", "X"), ("left", "Z")]),
    ],
)
def test_what_a_base_brings(base, mount, fixed):
    """A film alone: its faces are the electrodes, the lower one ground; ends, mount and holds."""
    given = config(base)
    wanted = {"terminal": ("terminal", ("film.top",), "")}
    if mount is not None:
        wanted["mount"] = ("mount", (mount,), "Z")
    assert ports(given) == wanted
    assert grounded(given) == ["film.bottom"]
    assert held(given) == fixed
    ends = {"annulus": ("inner", "outer"), "disc": ("axis", "outer"), "tube": ("low", "high"),
            "strip": ("left", "right")}[base]  # fmt: skip
    assert set(given.device.boundaries) == {*ends, "film.bottom", "film.top"}
    assert [r.name for r in given.device.regions] == ["film"]


@pytest.mark.parametrize(
    ("layers", "terminals", "ground"),
    [
        ([LOW, layer(), HIGH], {"terminal": "high"}, "low"),
        (
            [
                LOW,
                layer(),
                HIGH,
                layer("second", material="film"),
                layer("top", material="electrode"),
            ],
            {"high": "high", "top": "top"},
            "low",
        ),
    ],
    ids=["two", "three"],
)
def test_conducting_layers_are_the_natural_terminals(layers, terminals, ground):
    given = config("strip", *layers)
    assert {name: on for name, (_, on, _) in ports(given).items()} == {
        name: (part,) for name, part in terminals.items()
    }
    assert grounded(given) == [ground]


def test_sections_take_the_place_of_what_the_base_brings():
    """An empty one means none."""
    given = config(
        "annulus",
        mounts={},
        holds=[{"on": ["inner", "outer"], "fix": "R"}, {"on": "film.bottom", "fix": ["Z"]}],
        terminals={"hot": {"on": "film.bottom"}, "cold": {"on": "film.top", "ground": True}},
        chambers={"pump": {"on": "film.bottom"}},
    )
    assert ports(given) == {
        "hot": ("terminal", ("film.bottom",), ""),
        "pump": ("chamber", ("film.bottom",), "Z"),
    }
    assert held(given) == [("inner", "R"), ("outer", "R"), ("film.bottom", "Z")]
    assert grounded(given) == ["film.top"]
    free = config("annulus", mounts={"plate": {"on": "inner", "along": "Z", "free": "R"}})
    assert ("inner", "R") not in held(free)


def test_one_port_of_a_kind_has_plain_columns_and_several_their_names():
    names = {"hot": {"on": "film.top"}, "ground": {"on": "film.bottom", "ground": True}}
    one = config("annulus", terminals=names).device
    assert {p.column(v) for p in one.ports for v in p.kind.variables} == {
        *("displacement_mm", "force_N", "voltage_kV", "charge_uC")
    }
    film = [
        layer(),
        layer("middle", "10 um", material="electrode"),
        layer("upper", material="film"),
    ]
    two = config("annulus", *film, terminals={**names, "hot": {"on": "upper.top"}}).device
    assert [p.suffix for p in two.of(TERMINAL)] == [".hot", ".middle"]
    assert [p.floating for p in two.of(TERMINAL)] == [False, True]
    assert [p.suffix for p in two.of(MOUNT)] == [""]
    assert two.of(CHAMBER) == ()
    assert set(two.variables) == {
        *("displacement", "force", "voltage.hot", "charge.hot", "voltage.middle", "charge.middle")
    }


def test_repeated_layers_are_numbered_from_the_bottom():
    pair = [layer("film", "0.3 mm"), layer("hot", "50 um", material="electrode")]
    given = config("strip", LOW, {"repeat": 3, "layers": pair})
    names = [r.name for r in given.device.regions]
    assert names == ["low", *(f"{part}.{k}" for k in (1, 2, 3) for part in ("film", "hot"))]
    assert [r.material for r in given.device.regions] == ["electrode", *["film", "electrode"] * 3]
    assert [p.name for p in given.device.ports] == ["hot.1", "hot.2", "hot.3"]
    assert given.device.laminate.thickness == pytest.approx(0.02 + 3 * 0.35)
    with gmsh_model(given) as session:
        cells = cells_of(session.model)
    bottom = -given.device.laminate.thickness / 2
    assert min(q[..., 1].min() for q in cells.values()) == pytest.approx(bottom)
    for k in (1, 2, 3):  # each on the one before
        below = bottom + 0.02 + (k - 1) * 0.35
        heights = cells[f"film.{k}"][..., 1]
        assert (heights.min(), heights.max()) == pytest.approx((below, below + 0.3))
        assert area(cells[f"hot.{k}"]).sum() == pytest.approx(10 * 0.05)


def test_a_layer_may_cover_a_part_of_its_base():
    given = config(
        "disc",
        layer(),
        layer("patch", "0.1 mm", material="electrode", within=["2 mm", "8 mm"]),
        layer("cap", "0.2 mm", material="film", within={"R": ["0 mm", "5 mm"]}, rows=3),
    )
    with gmsh_model(given) as session:
        cells = cells_of(session.model)
    for name, span in {"film": (0, 10), "patch": (2, 8), "cap": (0, 5)}.items():
        radii = cells[name][..., 0]
        assert (radii.min(), radii.max()) == pytest.approx(span), name
    sizes = {n: area(q).sum() for n, q in cells.items()}
    assert sizes == pytest.approx({"film": 5.0, "patch": 0.6, "cap": 1.0})
    assert len(np.unique(cells["cap"][..., 1].round(9))) == 3 + 1
    # edges of electrodes are fine on both sides
    radii = np.unique(cells["film"][..., 0].round(9))
    steps = np.diff(radii)
    for edge in (2, 5, 8):
        k = int(np.abs(radii - edge).argmin())
        assert radii[k] == pytest.approx(edge)
        assert steps[k - 1] < steps[k - 2]
        assert steps[k] < steps[k + 1]


def test_parts_of_faces_have_boundaries_of_their_own():
    """Terminals within [from, to]; what else is on the face keeps both names."""
    from dolfinx.mesh import compute_midpoints

    terminals = {
        "left": {"on": "film.top", "within": ["0 mm", "4 mm"]},
        "right": {"on": "film.top", "within": ["6 mm", "10 mm"]},
        "both": {"on": ["film.bottom", "film.top"], "within": ["4.5 mm", "5.5 mm"]},
        "ground": {"on": "film.bottom", "within": ["6 mm", "10 mm"], "ground": True},
    }
    wanted = {
        "left.part": (0, 4), "right.part": (6, 10), "both.1": (4.5, 5.5), "both.2": (4.5, 5.5),
        "ground.part": (6, 10), "film.top": (0, 10), "film.bottom": (0, 10),
    }  # fmt: skip
    probes = {
        f"area_{name.replace('.', '_')}": {"quantity": "J", "on": name, "take": "integral"}
        for name in wanted
    }
    given = config("strip", terminals=terminals, probes=probes)
    parts = {"left.part", "right.part", "both.1", "both.2", "ground.part"}
    assert set(given.device.boundaries) == {"left", "right", "film.bottom", "film.top", *parts}
    run = simulation(given)
    *_, state = run
    domain = run.engine.problem.domain
    for name, (first, last) in wanted.items():
        dim, facets = domain.entities(name)
        middles = compute_midpoints(domain.mesh, dim, facets)[:, 0]
        assert first < middles.min() < middles.max() < last, name
        area_of = state.row[f"area_{name.replace('.', '_')}"]  # the strip is 5 mm wide
        assert area_of == pytest.approx(5 * (last - first)), name


@pytest.mark.parametrize("model", ["solid", "membrane"])
@pytest.mark.parametrize("space", [None, "3d"])
def test_cells_of_first_order_are_of_the_same_device(model, space):
    """A film between plates: its capacitance is exact, in every space."""
    given = config(
        "disc",
        geometry={"space": space},
        mesh={"order": 1, "sectors": 2},
        physics={"model": model},
        program=[{"stage": "prestrain"}],
    )
    (row,) = rows(given)
    area = given.device.sizes.area if space is None else 10**2 * 8 / 2 * np.sin(np.pi / 4)
    plates = 1e3 * 8.8541878128e-6 * 3 * area / 0.5
    # the thickness of a sheet gives way to the voltage that measures it
    assert row["capacitance_pF"] == pytest.approx(plates, rel=1e-6 if model == "solid" else 1e-5)


def test_annular_strips_are_short_for_a_laminate():
    """The same names but of faces, and the same numbers."""
    small = {"mesh__columns": 16, "mesh__film_rows": 2}
    program = [
        {"stage": "prestrain"},
        {"stage": "push", "mount": {"displacement": "-1 mm"}, "steps": 2},
        {"stage": "on", "terminal": {"voltage": "2 kV"}},
    ]
    short = case("benchmark_strip_air", program=program, **small).config
    g = short.geometry
    electrode = {"thickness": f"{g.electrode_thickness!r} mm", "material": "electrode"}
    plain = short.model_dump(exclude_none=True)
    plain["geometry"] = {
        "shape": "laminate",
        "base": {
            "kind": "annulus",
            "inner_radius": f"{g.inner_radius!r} mm",
            "outer_radius": f"{g.outer_radius!r} mm",
        },
        "layers": [
            {"name": "bottom_electrode", **electrode},
            {"name": "film", "thickness": f"{g.film_thickness!r} mm"},
            {"name": "top_electrode", **electrode},
        ],
        "air_height": f"{g.air_height!r} mm",
    }
    full = Config.model_validate(plain)
    assert [r.name for r in full.device.regions] == [r.name for r in short.device.regions]
    for one, other in zip(rows(short), rows(full), strict=True):
        assert list(one) == list(other)
        for name, value in one.items():
            assert other[name] == (value if name == "stage" else pytest.approx(value, rel=1e-9))


@pytest.mark.parametrize("base", BASES)
def test_air_surrounds_any_base(base):
    """What the air and the layers take up together is a box, or all of a tube's surroundings."""
    film = layer(thickness="0.5 mm", rows=2)
    patch = layer("patch", "0.2 mm", material="film", within=["2 mm", "6 mm"])
    if base == "annulus":
        patch["within"] = ["7 mm", "9 mm"]
    given = config(base, film, patch, geometry={"air_height": "3 mm"})
    with gmsh_model(given) as session:
        cells = cells_of(session.model)
    assert set(cells) == {"film", "patch", "air"}
    first, last = given.device.laminate.base.limits
    low, high = (4.35 - 3, 4.35 + 3) if base == "tube" else (-3, 3)
    total = sum(area(q).sum() for q in cells.values())
    assert total == pytest.approx((last - first) * (high - low))
    assert all((area(q) > 0).all() for q in cells.values())


# --- messages ------------------------------------------------------------------------------------

TEXT = """\
name: case
geometry:
  shape: laminate
  base: {kind: strip, length: 10 mm, width: 5 mm}
  layers:
    - {name: film, thickness: 0.5 mm}
    - {name: upper, thickness: 0.1 mm, material: electrode}
mesh: {columns: 8, film_rows: 1}
materials:
  film: {law: neo_hookean, youngs_modulus: 1 MPa, relative_permittivity: 3.0}
  electrode: {law: neo_hookean, youngs_modulus: 1 MPa}
terminals:
  hot: {on: upper}
  ground: {on: film.bottom, ground: true}
program:
  - {stage: on, terminal: {voltage: 1 kV}}
"""
TERMINALS = TEXT[TEXT.index("  hot") : TEXT.index("program")]
STAGE = "terminal: {voltage: 1 kV}"

# (what, text in TEXT, its replacement, message without the file's name, text at the caret)
EDITS: list[tuple[str, str, str, str | list[str], str]] = [
    # the base and its layers
    ("unknown base", "kind: strip", "kind: stripe",
     "4:16: geometry.base.kind: unknown kind 'stripe'; did you mean 'strip'?", "stripe"),
    ("base without a kind", "kind: strip, ", "",
     "4:9: geometry.base: the key 'kind' is missing; one of annulus, disc, tube, strip, rectangle",
     "{length"),
    ("key of another base", "width: 5 mm", "radius: 5 mm",
     ["4:3: geometry.base.width: this key is missing: width along Y, out of the plane; such as "
      "'30 um'",
      "4:38: geometry.base.radius: unknown key; known: kind, length, width"], "radius"),
    ("radii", "kind: strip, length: 10 mm, width: 5 mm",
     "kind: annulus, inner_radius: 5 mm, outer_radius: 4 mm",
     "4:59: geometry.base.outer_radius: 4 mm must exceed inner_radius (5 mm)", "4 mm"),
    ("duplicate layers", "name: upper", "name: film",
     "7:7: geometry.layers.1: there are two layers 'film'; give them different names", "{name"),
    ("duplicate in a repeated layer", "    - {name: upper, thickness: 0.1 mm, material: electrode}",
     "    - repeat: 2\n      layers: [{name: film, thickness: 1 mm}]",
     "7:7: geometry.layers.1: there are two layers 'film'; give them different names", "repeat"),
    ("name of a layer", "name: upper", "name: up.per",
     "7:14: geometry.layers.1.name: 'up.per' is not a name; use a letter, then letters, digits, "
     "'_' and '-'", "up.per"),
    ("no layers", TEXT[TEXT.index("  layers") : TEXT.index("mesh")], "  layers: []\n",
     "5:11: geometry.layers: must not be empty", "[]"),
    ("layer beyond the base", "thickness: 0.1 mm,", "thickness: 0.1 mm, within: [5 mm, 14 mm],",
     "7:48: geometry.layers.1.within: 5 to 14 mm is no part of the base, which goes from 0 to 10 "
     "mm along X", "[5 mm"),
    ("layer that ends before it begins", "thickness: 0.1 mm,",
     "thickness: 0.1 mm, within: [5 mm, 4 mm],",
     "7:48: geometry.layers.1.within: 5 to 4 mm is no part of the base, which goes from 0 to 10 "
     "mm along X", "[5 mm"),
    ("layer on nothing", "    - {name: upper, thickness: 0.1 mm,",
     "    - {name: low, thickness: 1 mm, material: film, within: [0 mm, 4 mm]}\n"
     "    - {name: upper, thickness: 0.1 mm, within: [5 mm, 8 mm],",
     "8:48: geometry.layers.2.within: 'upper' lies on nothing: it and 'low', the layer below, do "
     "not overlap", "[5 mm"),
    ("part along another axis", "thickness: 0.1 mm,",
     "thickness: 0.1 mm, within: {R: [1 mm, 4 mm]},",
     "7:48: geometry.layers.1.within: the base has no axis R; it has X", "{R"),
    ("material of a layer", "material: electrode", "material: elektrode",
     "10:3: materials: there is no 'elektrode', the material of layer 'upper'; did you mean "
     "'electrode'?", "film"),
    ("no dielectric", ", relative_permittivity: 3.0", "",
     "3:3: geometry: all layers conduct: at least one needs a material with relative_permittivity",
     "shape"),
    ("regions of a laminate", "program:", "regions: {film: film}\nprogram:",
     "15:10: regions: only for geometry.shape: mesh; layers name their material", "{film"),
    ("low air", "  layers:", "  air_height: 0.2 mm\n  layers:",
     "5:15: geometry.air_height: 0.2 mm must exceed the solid below it (0.3 mm), or be 0 mm",
     "0.2 mm"),
    ("a mesh file for a laminate", "film_rows: 1", "file: none.msh",
     "8:26: mesh.file: only for annular_strips; otherwise use geometry.shape: mesh", "none.msh"),
    # terminals
    ("unknown region", "on: upper", "on: uper",
     "13:13: terminals.hot.on: the device has no 'uper'; did you mean 'upper'?", "uper"),
    ("terminal on nothing", "on: upper", "on: []",
     "13:13: terminals.hot.on: must not be empty", "[]"),
    ("terminal without a place", "{on: upper}", "{ground: false}",
     "13:3: terminals.hot.on: this key is missing: regions and faces that form the electrode",
     "hot"),
    ("face that another layer covers", "on: upper", "on: upper.bottom",
     "13:13: terminals.hot.on: the device has no 'upper.bottom'; did you mean 'upper.top'?",
     "upper.bottom"),
    ("terminal beyond the face", "on: upper", "on: film.top, within: [2 mm, 12 mm]",
     "13:31: terminals.hot.within: 2 to 12 mm is no part of the base, which goes from 0 to 10 mm "
     "along X", "[2 mm"),
    ("part of a layer", "on: upper", "on: film, within: [2 mm, 3 mm]",
     "13:13: terminals.hot.on: `within` needs faces of layers, and 'film' is none; did you mean "
     "'film.top'?", "film"),
    ("the same face twice", "  hot: {on: upper}", "  hot: {on: film.top}\n  hut: {on: film.top}",
     "14:13: terminals.hut.on: 'film.top' is a part of terminal 'hot' already", "film.top"),
    ("no ground", ", ground: true", "",
     "13:3: terminals: no terminal is ground; give one of them `ground: true`", "hot"),
    ("no terminals", f"terminals:\n{TERMINALS}", "terminals: {}\n",
     "12:12: terminals: no terminal is ground; give one of them `ground: true`", "{}"),
    ("all ground", "{on: upper}", "{on: upper, ground: true}",
     "16:27: program.0.terminal: all terminals are ground, at 0 V; to drive one, take `ground: "
     "true` away from it, or add a terminal on the other side of the film", "{volt"),
    # mounts, holds, chambers
    ("mount along no axis", "program:", "mounts: {bar: {on: right, along: Y}}\nprogram:",
     "15:34: mounts.bar.along: there is no axis 'Y' here; known: X, Z", "Y"),
    ("mount free along no axis", "program:",
     "mounts: {bar: {on: right, along: X, free: R}}\nprogram:",
     "15:43: mounts.bar.free: there is no axis 'R' here; known: X, Z", "R"),
    ("mount on nothing", "program:", "mounts: {bar: {on: rihgt, along: X}}\nprogram:",
     "15:20: mounts.bar.on: the device has no 'rihgt'; did you mean 'right'?", "rihgt"),
    ("hold on nothing", "program:", "holds: [{on: lft, fix: [X, Z]}]\nprogram:",
     "15:14: holds.0.on: the device has no 'lft'; did you mean 'left'?", "lft"),
    ("hold along no axis", "program:", "holds: [{on: left, fix: [X, R]}]\nprogram:",
     "15:25: holds.0.fix: there is no axis 'R' here; known: X, Z", "[X"),
    ("part of two mounts", "program:",
     "mounts: {bar: {on: right, along: X}, rod: {on: right, along: Z}}\nprogram:",
     "15:48: mounts.rod.on: 'right' is a part of mount 'bar' already", "right"),
    ("mount that is held", "program:",
     "mounts: {bar: {on: right, along: X}}\nholds: [{on: right, fix: [X, Z]}]\nprogram:",
     "16:26: holds.0.fix: the mount 'bar' moves 'right' along X; remove one of the two", "[X"),
    ("mount that the base holds", "program:", "mounts: {bar: {on: left, along: X}}\nprogram:",
     "15:20: mounts.bar.on: the base holds 'left' by default; give `holds` with other parts",
     "left"),
    ("face of two chambers", "program:",
     "chambers: {one: {on: film.bottom}, two: {on: film.bottom}}\nprogram:",
     "15:46: chambers.two.on: 'film.bottom' is a face of chamber 'one' already", "film.bottom"),
    ("two ports of one name", "program:", "mounts: {hot: {on: right, along: X}}\nprogram:",
     "13:8: terminals.hot: there is a mount 'hot' too; give them different names", "{on"),
    ("chamber on a region", "program:", "chambers: {pump: {on: film}}\nprogram:",
     "15:23: chambers.pump.on: 'film' is no boundary; known: left, right, film.bottom, film.top, "
     "upper.top", "film"),
    ("chamber along no axis", "program:",
     "chambers: {pump: {on: film.bottom, along: R}}\nprogram:",
     "15:43: chambers.pump.along: there is no axis 'R' here; known: X, Z", "R"),
    # stages
    ("stage of no mount", STAGE, "mount: {displacement: 1 mm}",
     "16:24: program.0.mount: the device has no mount", "{disp"),
    ("stage of an unknown terminal", STAGE, "terminals: {hotter: {voltage: 1 kV}}",
     "16:37: program.0.terminals.hotter: there is no terminal 'hotter'; did you mean 'hot'?",
     "{volt"),
    ("stage of the ground", STAGE, "terminals: {ground: {voltage: 1 kV}}",
     "16:37: program.0.terminals.ground: there is no terminal 'ground'; known: hot", "{volt"),
    ("terminal driven twice", STAGE, STAGE + ", terminals: {hot: {voltage: 1 kV}}",
     "16:61: program.0.terminals.hot: the terminal 'hot' is driven twice", "{volt"),
    ("which of several", "  hot: {on: upper}",
     "  hot: {on: upper, within: [0 mm, 4 mm]}\n  hut: {on: film.top}".replace(
         "upper, within", "upper.top, within"),
     "17:27: program.0.terminal: there are several: hot, hut; name them under `terminals`",
     "{volt"),
    ("stage of a floating layer", TERMINALS + "program:\n  - {stage: on, " + STAGE + "}",
     "  hot: {on: film.top, within: [0 mm, 4 mm]}\n  ground: {on: film.bottom, ground: true}\n"
     "program:\n  - {stage: on, terminals: {upper: {voltage: 1 kV}}}",
     "16:36: program.0.terminals.upper: 'upper' floats: nothing is connected to it; add it to "
     "`terminals` to drive it", "{volt"),
    # what has no meaning here
    ("a contact that is no end", "program:",
     "sensing: {contact: outer, sheet_resistance: 1 kohm}\nprogram:",
     "15:20: sensing.contact: the base has no end 'outer'; known: left, right", "outer"),
    ("loads of annular strips", "program:", "physics: {coupling: pelrine}\nprogram:",
     "15:21: physics.coupling: only energy unless the shape is annular_strips", "pelrine"),
    # found as the mesh is there
    ("nothing holds it", "program:", "holds: []\nprogram:",
     "15:8: holds: nothing holds the device against motion along X; fix a part of it here, or "
     "drive a mount by its displacement or a spring", "[]"),
    ("it may turn", "program:",
     "holds: [{on: film.bottom, fix: X}, {on: left, fix: Z}]\nprogram:",
     "15:8: holds: nothing holds the device against motion about Y; fix a part of it here, or "
     "drive a mount by its displacement or a spring", "[{on"),
    ("chamber on an inner face", "program:", "chambers: {pump: {on: film.top}}\nprogram:",
     "15:23: chambers.pump.on: the face 'film.top' lies between two solids, so that no "
     "chamber can be there; choose a face of the outer surface", "film.top"),
    ("terminals that touch", TERMINALS + "program:\n  - {stage: on, terminal: {voltage: 1 kV}}",
     "  hot: {on: film.bottom, within: [0 mm, 4 mm]}\n"
     "  hut: {on: film.bottom, within: [4 mm, 9 mm]}\n"
     "  ground: {on: upper, ground: true}\n"
     "program:\n  - {stage: on, terminals: {hot: {voltage: 1 kV}}}",
     "14:8: terminals.hut: it touches 'hot'; leave a gap between them, or make them one", "{on"),
    ("a terminal that touches ground", "on: film.bottom", "on: [film.bottom, right]",
     "13:8: terminals.hot: it touches 'ground'; leave a gap between them, or make them one", "{on"),
]  # fmt: skip


def message(tmp_path: Any, text: str, files: dict[str, str] | None = None) -> list[str]:
    """Lines of what is wrong with a config, without the file's name; its run is begun."""
    path = tmp_path / "case.yaml"
    path.write_text(text)
    for name, content in (files or {}).items():
        (tmp_path / name).write_text(content)
    with pytest.raises(ConfigError) as caught:
        dealib.Simulation(dealib.load(path))
    return [line.removeprefix(f"{path}:") for line in str(caught.value).splitlines()]


@pytest.mark.once
@pytest.mark.parametrize(("old", "new", "expected", "at"), [e[1:] for e in EDITS],
                         ids=[e[0] for e in EDITS])  # fmt: skip
def test_wrong_devices_are_told(tmp_path, old, new, expected, at):
    assert old in TEXT
    *heads, line, caret = message(tmp_path, TEXT.replace(old, new, 1))
    assert heads[::3] == ([expected] if isinstance(expected, str) else expected)
    assert line[caret.index("^") :].startswith(at)


def test_a_mount_that_a_force_or_a_spring_holds(tmp_path):
    """Nothing else holds the bar: a spring will do, a force will not."""
    text = TEXT.replace("program:", "holds: [{on: film.bottom, fix: Z}]\n"
                        "mounts: {bar: {on: right, along: X, free: Z}}\nprogram:")  # fmt: skip
    spring = "mount: {spring: {stiffness: 1 N/mm, anchor: 0 mm}}"
    path = tmp_path / "case.yaml"
    path.write_text(text.replace("stage: on, ", f"stage: on, {spring}, "))
    assert [s.row["step"] for s in dealib.Simulation(dealib.load(path))] == [0, 1]
    path.write_text(text.replace("stage: on, ", "stage: on, mount: {force: 0 N}, "))
    with pytest.raises(ConfigError, match="nothing holds the device against motion along X"):
        list(dealib.Simulation(dealib.load(path)))


@pytest.mark.parametrize(("holds", "stage", "told"), [
    ("[]", "", "motion along X"),
    ("[{on: film.bottom, fix: X}]", "", "motion along Z"),
    ("[{on: film.bottom, fix: Z}]\nmounts: {bar: {on: right, along: X, free: Z}}",
     "mount: {mass: 1 g}, ", "motion along X"),
    ("[{on: film.bottom, fix: Z}]\nmounts: {bar: {on: right, along: X, free: Z}}", "", ""),
    ("[]\nmounts: {bar: {on: right, rigid: true}}", "", ""),
    ("[]\nmounts: {bar: {on: right, rigid: true}}",
     "mounts: {bar.Z: {force: 1 N}}, ", "motion along Z"),
])  # fmt: skip
def test_what_nothing_holds_is_told_without_a_mesh(tmp_path, holds, stage, told):
    """Along each axis the names of supports and the program tell."""
    path = tmp_path / "case.yaml"
    text = TEXT.replace("program:", f"holds: {holds}\nprogram:")
    path.write_text(text.replace("stage: on, ", f"stage: on, {stage}"))
    if not told:
        dealib.load(path)
        return
    with pytest.raises(ConfigError, match=rf"case\.yaml:15:8: holds: .* {told}; fix"):
        dealib.load(path)


@pytest.mark.once
def test_messages_of_a_run_count_overrides(tmp_path):
    """What was wrong in an override is told as such."""
    path = tmp_path / "case.yaml"
    path.write_text(TEXT)
    with pytest.raises(ConfigError) as caught:
        dealib.Simulation(dealib.load(path, set=["chambers={pump: {on: film.top}}"]))
    assert str(caught.value) == (
        "set chambers={pump: {on: film.top}}: chambers.pump.on: the face 'film.top' lies between "
        "two solids, so that no chamber can be there; choose a face of the outer surface"
    )


def test_materials_share_their_energies_whatever_their_regions():
    """Ten layers compile no more forms than one: layers of one material are one group."""
    pair = [layer("film", "0.3 mm"), layer("hot", "50 um", material="electrode")]
    materials = {"stiff": FILM | {"youngs_modulus": "3 MPa"}, "electrode": ELECTRODE}
    stacked = config(
        "strip", LOW, {"repeat": 5, "layers": pair}, layer("cover", material="stiff"),
        materials=materials,
    )  # fmt: skip
    groups = simulation(stacked).engine.problem.groups
    assert [(g.name, len(g.regions)) for g in groups] == [
        ("film", 5),
        ("stiff", 1),
        ("electrode", 6),
    ]


def test_a_device_that_nothing_drives_is_solved():
    """All grounded and nothing mounted: no ports; the pre-stretch alone does what it does."""
    held = [{"on": end, "fix": ["X", "Z"]} for end in ("left", "right")]
    given = {"holds": held, "mounts": {}, "materials": {"film": FILM | {"prestretch": 1.2}}}
    alone = {"ground": {"on": "film.bottom", "ground": True}}
    without = config("strip", terminals=alone, **given)
    assert without.device.ports == ()
    found, expected = (rows(c)[-1] for c in (without, config("strip", **given)))
    for name in ("elastic_energy_mJ", "thickness_stretch_min", "stretch_max"):
        assert found[name] == pytest.approx(expected[name], rel=1e-9), name
    assert found["elastic_energy_mJ"] > 0.1


LEFT = {"X": ["-6 mm", "-2 mm"]}
ROUND = {"centre": ["-3 mm", "0 mm"], "radius": "1 mm"}


@pytest.mark.parametrize("model", ["solid", "membrane"])
@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        (LEFT, {"X": ["-3 mm", "5 mm"]}, False),
        (LEFT, {"X": ["-2 mm", "5 mm"]}, False),
        (LEFT, None, False),
        (LEFT | {"Y": ["-3 mm", "-1 mm"]}, {"X": ["-3 mm", "5 mm"], "Y": ["1 mm", "3 mm"]}, True),
        (ROUND, {"X": ["-2 mm", "5 mm"]}, False),
        (ROUND, {"X": ["-1.9 mm", "5 mm"], "Y": ["-1 mm", "1 mm"]}, True),
        (ROUND, {"X": ["-2.2 mm", "5 mm"], "Y": ["0.8 mm", "3 mm"]}, True),
    ],
)
def test_terminals_on_one_face_keep_apart(model, one, other, apart):
    """A membrane, whose potential has no nodes, had been solved with one of both in vain."""
    inside = [{} if within is None else {"within": within} for within in (one, other)]
    terminals = {name: {"on": "film.top"} | w for name, w in zip("ab", inside, strict=True)}
    base = {"kind": "rectangle", "length": "20 mm", "width": "10 mm"}
    sections = {
        "geometry": {"base": base, "space": "3d"},
        "terminals": terminals | {"g": {"on": "film.bottom", "ground": True}},
        "physics": {"model": model},
    }
    if apart:
        assert [port.name for port in config("strip", **sections).device.of(TERMINAL)] == ["a", "b"]
        return
    with pytest.raises(ValueError, match="it touches 'a'; leave a gap between them"):
        config("strip", **sections)


def test_faces_that_lie_on_each_other_have_one_terminal():
    two = [layer("low", material="film"), layer("high", material="film")]
    terminals = {"a": {"on": "low.top"}, "b": {"on": "high.bottom"}}
    terminals["g"] = {"on": ["low.bottom", "high.top"], "ground": True}
    for model in ("solid", "membrane"):
        given = config("annulus", *two, terminals=terminals, physics={"model": model})
        with pytest.raises(ConfigError, match="it touches 'a'; leave a gap between them"):
            simulation(given)
