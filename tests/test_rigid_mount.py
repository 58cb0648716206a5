"""Rigid mounts: shafts and beams in closed form, reciprocity and work of all ports, and rotations.

Bodies have no transverse contraction (E = 2 G) where a beam's theory is to hold up to its clamps.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import gmsh
import numpy as np
import numpy.typing as npt
import pytest
from conftest import history
from laminates import config, rows, simulation
from scipy.spatial.transform import Rotation
from test_parallel import finish, start
from watch import At

import dealib
from dealib.config import resolved
from dealib.config.case import Case
from dealib.errors import DealibError
from dealib.fem.differential import port_stiffness
from dealib.fem.platform import rotation

Array = npt.NDArray[np.float64]
Row = dict[str, Any]

G = 1.0  # MPa
CORK = {
    **{"law": "neo_hookean", "shear_modulus": f"{G} MPa", "bulk_modulus": f"{2 / 3!r} MPa"},
    "relative_permittivity": 3.0,
}
RUBBER = CORK | {"bulk_modulus": "5 MPa"}
AXES = "XYZ"


def shaft(length: float, side: float, program: list[dict[str, Any]], **sections: Any) -> Any:
    """A square shaft along X, its left end held and its right end on a rigid mount."""
    height = sections.pop("height", side)
    given = {
        "geometry": {
            "base": {"kind": "rectangle", "length": f"{length} mm", "width": f"{side} mm"},
            "layers": [{"name": "film", "thickness": f"{height} mm"}],
        },
        "mesh": {"columns": 8, "sectors": 2, "film_rows": 1, "grading": "uniform"},
        "materials": {"film": CORK},
        "mounts": {"plate": {"on": "right", "rigid": True}},
        "holds": [{"on": "left", "fix": list(AXES)}],
        "program": program,
    }
    for name in ("mesh", "materials"):
        given[name] |= sections.pop(name, {})
    return config("strip", **(given | sections))


def placed(
    shifts: Array, turns: Array, mounts: tuple[str, ...] = ("plate",), **more: Any
) -> dict[str, Any]:
    """A stage that leads rigid mounts to displacements (mm) and rotation vectors (rad)."""
    found: dict[str, Any] = {"stage": "go", "mounts": {}, "turns": {}, **more}
    parts = zip(mounts, np.reshape(shifts, (-1, 3)), np.reshape(turns, (-1, 3)), strict=True)
    for name, d, r in parts:
        for k, axis in enumerate(AXES):
            found["mounts"][f"{name}.{axis}"] = {"displacement": f"{float(d[k])!r} mm"}
            found["turns"][f"{name}.about_{axis}"] = {"rotation": f"{float(r[k])!r} rad"}
    return found


def of(row: Row, column: str, mount: str = "plate", about: str = "") -> Array:
    """A column along, or about, each axis."""
    return np.array([row[f"{column}.{mount}.{about}{axis}"] for axis in AXES])


# --- closed forms --------------------------------------------------------------------------------


@pytest.mark.once
def test_a_square_shaft_twists_like_saint_venant_s():
    """M = G J theta / L with J = 0.140577 a^4; the clamps, which hinder warping, cancel out."""
    twist, compliance = np.radians(0.1), {}
    for length in (4.0, 8.0):
        mesh = {"columns": int(2 * length), "sectors": 4, "film_rows": 4}
        stage = {"stage": "twist", "turns": {"plate.about_X": {"rotation": "0.1 deg"}}}
        row = rows(shaft(length, 1.0, [stage], mesh=mesh))[-1]
        assert row["rotation_deg.plate.about_X"] == pytest.approx(0.1, rel=1e-12)
        compliance[length] = twist / row["moment_Nmm.plate.about_X"]
        assert of(row, "force_N") == pytest.approx(0, abs=1e-7)  # it would shorten: second order
    assert 4.0 / (compliance[8.0] - compliance[4.0]) == pytest.approx(G * 0.140577, rel=2e-3)


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_a_pure_moment_bends_a_beam_to_an_arc(axis):
    """M = E I theta / L, whose end goes down by L theta / 2 for a turn about Y."""
    length, width, height = 10.0, 1.0, 0.5
    inertia = {"Y": width * height**3 / 12, "Z": height * width**3 / 12}[axis]
    angle = 0.01
    moment = 2 * G * inertia * angle / length
    free = {f"plate.{a}": {"force": "0 N"} for a in AXES}
    turn = {f"plate.about_{axis}": {"moment": f"{moment!r} N mm"}}
    program = [{"stage": "bend", "mounts": free, "turns": turn}]
    row = rows(shaft(length, width, program, height=height))[-1]
    assert np.radians(row[f"rotation_deg.plate.about_{axis}"]) == pytest.approx(angle, rel=1e-3)
    other, sign = {"Y": ("Z", -1), "Z": ("Y", 1)}[axis]
    assert row[f"displacement_mm.plate.{other}"] == pytest.approx(
        sign * length * angle / 2, rel=1e-3
    )
    assert row["turn_work_mJ.plate.about_" + axis] == pytest.approx(moment * angle / 2, rel=1e-3)


def test_a_cantilever_in_a_plane_has_three_ports():
    """Loaded across its end, which may turn: 3 E I / L^3, and a slope of 3/2 of the deflection."""
    length, width, height, force = 20.0, 5.0, 0.5, 1e-6
    given = config(
        "strip",
        geometry={
            "base": {"kind": "strip", "length": f"{length} mm", "width": f"{width} mm"},
            "layers": [{"name": "film", "thickness": f"{height} mm"}],
        },
        mesh={"columns": 40},
        materials={"film": CORK},
        mounts={"tip": {"on": "right", "rigid": True}},
        holds=[{"on": "left", "fix": ["X", "Z"]}],
        program=[
            {
                "stage": "bend",
                "mounts": {"tip.X": {"force": "0 N"}, "tip.Z": {"force": f"{force} N"}},
                "turn": {"moment": "0 N mm"},
            }
        ],
    )
    row = rows(given)[-1]
    down = force * length**3 / (3 * 2 * G * width * height**3 / 12)
    assert row["displacement_mm.tip.Z"] == pytest.approx(down, rel=2e-3)
    # about Y, Z turns to X: up at the right end is a negative angle
    assert np.radians(row["rotation_deg"]) == pytest.approx(-1.5 * down / length, rel=2e-3)
    columns = [name for name in row if name.startswith(("rotation", "moment", "displacement"))]
    assert columns == [
        "displacement_mm.tip.X", "displacement_mm.tip.Z", "rotation_deg", "moment_Nmm"
    ]  # fmt: skip


def test_the_rotation_and_its_derivatives():
    """Rodrigues' formula, also where the vector vanishes."""
    for r in (
        np.zeros(3),
        np.array([1e-5, 0, 2e-5]),
        np.array([0.3, -0.5, 0.2]),
        np.array([2, 1, -3.0]),
    ):
        R, slopes, bends = rotation(r)
        assert pytest.approx(Rotation.from_rotvec(r).as_matrix(), abs=1e-13) == R
        for k, e in enumerate(1e-5 * np.eye(3)):
            ahead, behind = rotation(r + e), rotation(r - e)
            assert (ahead[0] - behind[0]) / 2e-5 == pytest.approx(slopes[k], abs=1e-9)
            assert (ahead[1] - behind[1]) / 2e-5 == pytest.approx(bends[k], abs=1e-9)


# --- all ports are derivatives of one potential --------------------------------------------------

D, R = np.array([0.3, -0.2, 0.1]), np.array([0.4, -0.6, 0.3])
KEYS = [f"displacement_mm.plate.{a}" for a in AXES] + [
    f"rotation_deg.plate.about_{a}" for a in AXES
]
FORCES = [f"force_N.plate.{a}" for a in AXES] + [f"moment_Nmm.plate.about_{a}" for a in AXES]
MODELS = {
    "solid": {},
    "mixed": {"physics": {"formulation": "mixed"}},
    "membrane": {
        "physics": {"model": "membrane"},
        "materials": {"film": RUBBER | {"prestretch": [1.5, 1.5]}},
    },
}


def body(program: list[dict[str, Any]], model: str = "solid", **more: Any) -> Any:
    """A soft film between a held end and a rigid mount, with a chamber below and a terminal."""
    sections = {
        "materials": {"film": RUBBER},
        "mesh": {"columns": 4, "sectors": 2},
        "chambers": {"below": {"on": "film.bottom"}},
    }
    return shaft(3.0, 2.0, program, height=0.5, **(sections | MODELS[model] | more))


def duals(row: Row) -> Array:
    """Derivatives of the potential by the ports' values, in the order of `POINT`."""
    moved = [row[name] for name in FORCES]
    return np.array([*moved, -row["charge_uC"], -row["volume_mm3"]])


def stage(point: Array, **more: Any) -> dict[str, Any]:
    """To displacements, rotations, a voltage (kV) and a pressure (MPa)."""
    return placed(
        *(point[:3], point[3:6]),
        **{"terminal": {"voltage": f"{float(point[6])!r} kV"}},
        **{"chamber": {"pressure": f"{float(point[7])!r} MPa"}, **more},
    )


POINT = np.array([*D, *R, 8.0, 5e-3])
SIZES = np.array([*[0.02] * 3, *[0.02] * 3, 0.2, 2e-4])


@pytest.mark.parametrize(
    "model", [m if m == "membrane" else pytest.param(m, marks=pytest.mark.slow) for m in MODELS]
)
def test_the_matrix_of_second_derivatives_is_symmetric(model):
    """At finite rotations, from the tangent and from differences of solved states."""
    weights = {1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
    moves = [(k, sign * n) for k in range(8) for n in weights for sign in (1, -1)]
    points = [*(POINT + n * SIZES * np.eye(8)[k] for k, n in moves), POINT]
    program = [
        stage(p, steps=4 if not k else 1) | {"stage": f"to{k}"} for k, p in enumerate(points)
    ]
    run = simulation(body(program, model))
    ends = {state.row["stage"]: state.row for state in run}
    found = np.zeros((8, 8))
    for j, (k, n) in enumerate(moves):
        found[:, k] += np.sign(n) * weights[abs(n)] * duals(ends[f"to{j}"]) / SIZES[k]
    order = [list(run.engine.newton.system.ports).index(name) for name in (
        *(f"plate.{a}" for a in AXES), *(f"plate.about_{a}" for a in AXES), "terminal", "below"
    )]  # fmt: skip
    tangent = port_stiffness(run.engine.newton)[np.ix_(order, order)]
    scale = np.sqrt(np.abs(np.outer(np.diag(tangent), np.diag(tangent))))
    assert np.abs(tangent - tangent.T).max() < 1e-6 * scale.max()
    assert (np.abs(tangent - tangent.T) / scale).max() < 1e-6
    assert (np.abs(tangent - found) / scale).max() < 1e-5
    assert (np.abs(tangent) > 1e-3 * scale).sum() > 40  # of 64: nearly all are coupled
    assert run.engine.newton.system.matrix.getInfo()["mallocs"] == 0
    assert run.engine.newton.unstable_modes() == 0


@pytest.mark.once
def test_a_closed_cycle_over_all_ports_does_no_work():
    """And on each of its edges the work is what the potential gains, by Gauss's rule."""
    corners = [
        np.zeros(8), POINT * [1, 0, 0, 1, 0, 0, 1, 0], POINT,
        POINT * [0, 1, 1, -0.5, 1, 0.5, 0.5, 1], np.zeros(8),
    ]  # fmt: skip
    places, weights = np.polynomial.legendre.leggauss(8)
    points = []
    for a, b in pairwise(corners):
        points += [a + s * (b - a) for s in (1 + places) / 2] + [b]
    program = [stage(p) | {"stage": f"to{k}"} for k, p in enumerate(points)]
    ends = {row["stage"]: row for row in rows(body(program))}
    states = [ends[f"to{k}"] for k in range(len(points))]
    work, gained, last = [], [], 0.0
    for k, (a, b) in enumerate(pairwise(corners)):
        part = states[9 * k : 9 * k + 9]
        work.append(weights @ [duals(row) @ (b - a) for row in part[:8]] / 2)
        end = part[-1]
        stored = end["elastic_energy_mJ"] - end["electric_energy_mJ"]
        potential = stored - 1e-3 * end["pressure_kPa"] * end["volume_mm3"]
        gained.append(potential - last)
        last = potential
    size = max(row["elastic_energy_mJ"] + row["electric_energy_mJ"] for row in states)
    assert np.abs(gained).min() > 1e-3 * size
    assert work == pytest.approx(gained, abs=1e-7 * size)
    assert abs(sum(work)) < 1e-7 * size


@pytest.mark.once
def test_what_a_moment_drives_is_where_a_rotation_leads():
    """Values led and duals loaded are two ways to the same state."""
    (_, led) = rows(body([stage(POINT, steps=4)]))[::4]
    loads = {
        "mounts": {f"plate.{a}": {"force": f"{led[f'force_N.plate.{a}']!r} N"} for a in AXES},
        "turns": {
            f"plate.about_{a}": {"moment": f"{led[f'moment_Nmm.plate.about_{a}']!r} N mm"}
            for a in AXES
        },
    }
    back = rows(
        body(
            [
                stage(POINT, steps=4),
                {"stage": "loaded", **loads},
                {"stage": "off", "terminal": {"voltage": "0 kV"}},
                {"stage": "on", "terminal": {"voltage": "8 kV"}, "steps": 2},
            ]
        )
    )
    off, on = (next(r for r in reversed(back) if r["stage"] == name) for name in ("off", "on"))
    assert max(abs(off[k] - led[k]) for k in KEYS) > 1e-3
    assert [on[k] for k in KEYS] == pytest.approx([led[k] for k in KEYS], abs=1e-6)


@pytest.mark.once
def test_the_stage_of_the_gallery():
    """Free in its plane: it neither turns nor goes aside, and goes the other way likewise."""
    h = history("devices/positioning_stage")
    assert (h["displacement_mm.disc.X"].diff()[2:] > 0).all()
    end = h.iloc[-1]
    assert end["displacement_mm.disc.X"] == pytest.approx(0.261, abs=0.003)
    for name in ("displacement_mm.disc.Y", "rotation_deg.disc.about_Z", "moment_Nmm.disc.about_X"):
        assert end[name] == pytest.approx(0, abs=1e-9)
    for name in ("force_N.disc.X", "moment_Nmm.disc.about_Z"):
        assert end[name] == pytest.approx(0, abs=1e-8)
    other = history(
        "devices/positioning_stage", program__2__terminals="{right: {voltage: 0.8 kV}}"
    ).iloc[-1]
    assert other["displacement_mm.disc.X"] == pytest.approx(
        -end["displacement_mm.disc.X"], rel=1e-6
    )


# --- rotation of the whole device ----------------------------------------------------------------


@pytest.mark.once
def test_a_device_that_turns_as_a_whole_feels_nothing():
    """Fixed to nothing else than its mount, it follows that by a third of a turn."""
    turn = 2 * np.pi / 3 * np.array([1.0, 2.0, -2.0]) / 3
    volts = {"stage": "charge", "terminal": {"voltage": "8 kV"}, "steps": 2}
    given = body([volts, placed(np.array([5.0, 2.0, 1.0]), turn, steps=4)], holds=[])
    states = [row for row in rows(given) if row["stage"] != "prestrain"]
    charged, turned = states[1], states[-1]
    for name in ("charge_uC", "elastic_energy_mJ", "electric_energy_mJ", "volume_mm3"):
        if name != "volume_mm3":
            assert turned[name] == pytest.approx(charged[name], rel=1e-9)
    assert of(turned, "force_N") == pytest.approx(0, abs=1e-9)
    assert of(turned, "moment_Nmm", about="about_") == pytest.approx(0, abs=1e-9)


BLOCK = """\
name: block
geometry: {{shape: mesh, file: m.msh, space: 3d}}
materials:
  block: {{law: neo_hookean, shear_modulus: 1 MPa, bulk_modulus: 5 MPa, relative_permittivity: 3.0}}
terminals: {{hot: {{on: high}}, ground: {{on: low, ground: true}}}}
mounts: {{plate: {{on: right, rigid: true, centre: [{} mm, {} mm, {} mm]}}}}
holds: [{{on: left, fix: [X, Y, Z]}}]
chambers: {{below: {{on: low}}}}
program: []
"""
SIDES = ("left", "right", "front", "back", "low", "high")


def turned_block(path: Any, Q: Array, d: Array, r: Array) -> Row:
    """The last state of a block of tetrahedra, turned by Q with all that drives it."""
    path.mkdir()
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        model = gmsh.model
        model.occ.addBox(0, 0, 0, 2, 1, 0.5)
        model.occ.synchronize()
        model.addPhysicalGroup(3, [1], name="block")
        for face, name in enumerate(SIDES, start=1):
            model.addPhysicalGroup(2, [face], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
        model.mesh.generate(3)
        affine = np.eye(4)
        affine[:3, :3] = Q
        model.mesh.affineTransform(affine[:3].ravel().tolist())
        gmsh.write(str(path / "m.msh"))
    finally:
        gmsh.finalize()
    centre = Q @ [2.0, 0.3, 0.2]
    text = BLOCK.format(*map(float, centre))
    program = placed(Q @ d, Q @ r, steps=3, terminal={"voltage": "10 kV"})
    (path / "block.yaml").write_text(text.replace("program: []", f"program: [{program}]"))
    return [state.row for state in dealib.Simulation(dealib.load(path / "block.yaml"))][-1]


@pytest.mark.slow
def test_a_device_on_a_turned_mesh_is_the_same(tmp_path):
    """By 30 degrees about an oblique axis: forces and moments turn with it, to 1e-9."""
    Q = Rotation.from_rotvec(np.radians(30) * np.array([2.0, -1.0, 2.0]) / 3).as_matrix()
    d, r = np.array([0.3, 0.2, -0.1]), np.array([0.2, -0.3, 0.4])
    here = turned_block(tmp_path / "here", np.eye(3), d, r)
    there = turned_block(tmp_path / "there", Q, d, r)
    for column, about in (("force_N", ""), ("moment_Nmm", "about_")):
        found, wanted = of(there, column, about=about), Q @ of(here, column, about=about)
        assert found == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    for name in ("charge_uC", "elastic_energy_mJ", "electric_energy_mJ", "field_max_MV_per_m"):
        assert there[name] == pytest.approx(here[name], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["solid", "membrane"])
def test_two_mounts_that_turn_together_turn_their_forces(model):
    """A film stretched between two rigid mounts, which then turn by 30 degrees as one."""
    ends = {"mounts": {n: {"on": n, "rigid": True} for n in ("left", "right")}, "holds": []}
    names, e = ("left", "right"), np.array([1.5, 0.0, 0.0])
    pull = np.array([[0, 0, 0], [0.4, 0.1, 0]])
    r = np.radians(30) * np.array([2.0, -1.0, 2.0]) / 3
    Q = Rotation.from_rotvec(r).as_matrix()
    centres = np.array([-e, e])
    moved = (centres + pull) @ Q.T - centres
    volts = {"terminal": {"voltage": "8 kV"}}
    still, turn = np.zeros((2, 3)), np.array([r, r])
    program = [
        placed(pull, still, names, steps=2, **volts) | {"stage": "pull"},
        placed(moved, turn, names, steps=4) | {"stage": "turn"},
    ]
    states = rows(body(program, model, chambers={}, **ends))
    pulled = next(row for row in reversed(states) if row["stage"] == "pull")
    turned = states[-1]
    for name in names:
        wanted = Q @ of(pulled, "force_N", name)
        assert of(turned, "force_N", name) == pytest.approx(wanted, abs=1e-9 * abs(wanted).max())
    for name in ("charge_uC", "elastic_energy_mJ"):
        assert turned[name] == pytest.approx(pulled[name], rel=1e-9)


# --- what goes on with it ------------------------------------------------------------------------


@pytest.mark.once
def test_a_run_goes_on_where_it_was_stopped(tmp_path):
    given = body([stage(POINT, steps=4)])
    case = Case(given, resolved(given), tmp_path)
    whole = dealib.simulate(case, tmp_path / "whole").history

    class Enough(DealibError):
        pass

    with pytest.raises(Enough):
        dealib.simulate(case, tmp_path / "run", observers=[At(2, Enough("enough"))])
    again = dealib.simulate(case, tmp_path / "run", resume=True).history
    for name in (*KEYS, *FORCES):
        assert again[name].to_numpy() == pytest.approx(whole[name].to_numpy(), abs=1e-12)


@pytest.mark.once
@pytest.mark.mpi
def test_two_ranks_share_a_mount_and_its_modes(tmp_path):
    """A column that is twisted, and pressed until it buckles."""
    press = {
        **{"stage": "press", "mounts": {"plate.X": {"displacement": "-0.04 mm"}}, "steps": 2},
        **{"turns": {"plate.about_X": {"rotation": "20 deg"}}},
    }
    mesh = {"columns": 12, "sectors": 2, "film_rows": 2}
    given = shaft(20.0, 0.5, [press], height=0.3, mesh=mesh, output={"modes": 2})
    path = tmp_path / "column.yaml"
    path.write_text(resolved(given))
    one = dealib.simulate(path, tmp_path / "one")
    code, errors = finish(start(2, "-m", "dealib", "run", path, "--out", tmp_path / "two"))
    assert code == 0, errors
    two = dealib.open(tmp_path / "two")
    assert two.info["ranks"] == 2
    assert one.history["unstable_modes"].tolist() == two.history["unstable_modes"].tolist()
    assert one.history["unstable_modes"].iloc[-1] > 0
    for name in ("softest_mode_N_per_mm", "force_N.plate.X", "moment_Nmm.plate.about_X"):
        wanted = one.history[name].to_numpy()
        size = np.abs(wanted).max()
        assert two.history[name].to_numpy() == pytest.approx(wanted, abs=1e-7 * size)
    lost = int(np.flatnonzero(one.history["unstable_modes"])[0])
    assert two.modes(lost)[0] == pytest.approx(one.modes(lost)[0], abs=1e-5)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"mounts": {"plate": {"on": "right"}}}, "give the axis of its motion"),
        ({"mounts": {"plate": {"on": "right", "rigid": True, "along": "X"}}}, "or `rigid: true`"),
        ({"mounts": {"plate": {"on": "right", "rigid": True, "free": "X"}}}, "holds its part"),
        (
            {"mounts": {"plate": {"on": "right", "along": "X", "centre": ["1 mm", "0 mm"]}}},
            "only for a rigid mount",
        ),
        (
            {"mounts": {"plate": {"on": "right", "rigid": True, "centre": ["1 mm", "0 mm"]}}},
            "expected one coordinate for each of X, Y, Z",
        ),
        (
            {"holds": [{"on": ["left", "right"], "fix": "Y"}]},
            "the mount 'plate' moves 'right' along Y; remove one of the two",
        ),
        (
            {"program": [{"stage": "go", "turn": {"rotation": "5 deg"}}]},
            "there are several: plate.about_X, plate.about_Y, plate.about_Z; name them under "
            "`turns`",
        ),
        (
            {"program": [{"stage": "go", "turns": {"plate.about_X": {"rotation": "5 mm"}}}]},
            "expected an angle with its unit, such as '10 deg'",
        ),
    ],
)
def test_wrong_mounts_are_told(changes, expected):
    with pytest.raises(ValueError, match=re.escape(expected)):
        shaft(3.0, 1.0, **({"program": [{"stage": "rest"}]} | changes))


def test_where_a_mount_cannot_be_rigid():
    plate = {"plate": {"on": "outer", "rigid": True}}
    with pytest.raises(ValueError, match="an axisymmetric device moves along Z only"):
        config("disc", mounts=plate, holds=[])
    solid = {"geometry": {"space": "3d", "symmetry": ["X"]}}
    with pytest.raises(ValueError, match=r"turn out of the planes of symmetry; leave geometry\.s"):
        config("disc", mounts=plate, holds=[], **solid)
    air = {"geometry": {"air_height": "2 mm"}}
    with pytest.raises(ValueError, match="needs a device without air around it; set its air_heig"):
        config("strip", mounts={"plate": {"on": "right", "rigid": True}}, **air)


def test_a_device_that_nothing_holds_is_refused():
    loose = [{"stage": "go", "turns": {"plate.about_X": {"moment": "0 N mm"}}}]
    with pytest.raises(DealibError, match="nothing holds the device against motion about X"):
        rows(body(loose, holds=[]))
