"""Natural frequencies and modes about static states: against closed forms, and as a command."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case
from laminates import config, simulation
from ruamel.yaml import YAML
from test_parallel import PATIENCE
from typer.testing import CliRunner
from verification.references import balloon, frequencies
from verification.references.laws import neo_hooke

import dealib
from dealib.cli.app import app
from dealib.cli.mpi import environment, mpirun
from dealib.errors import ConfigError
from dealib.program.modes import ModesWatch, at_rest
from dealib.units import EPSILON_0

G, RHO = 0.02, 960e-12  # MPa, t/mm^3
EPSILON = 4.7 * EPSILON_0
SOFT = {
    **{"law": "neo_hookean", "shear_modulus": "20 kPa", "bulk_modulus": "2 GPa"},
    **{"relative_permittivity": 4.7, "density": "960 kg/m^3"},
}


def found(given: Any, count: int = 8) -> pd.DataFrame:
    """The modes at the end of a program, as `modes.csv` has them."""
    watch = ModesWatch((), None, count)
    for state in simulation(given):
        watch(state)
    return pd.DataFrame(watch.rows)


def film(base: dict[str, Any], lp: float, thickness: float, **sections: Any) -> Any:
    """A membrane of soft rubber, held at all its ends."""
    ends = {"annulus": ["inner", "outer"], "disc": ["outer"]}[base["kind"]]
    given: dict[str, Any] = {
        "geometry": {"base": base, "layers": [{"name": "film", "thickness": f"{thickness} mm"}]},
        "materials": {"film": SOFT | {"prestretch": lp}},
        "physics": {"model": "membrane"},
        "mounts": {},
        "holds": [{"on": ends, "fix": ["R", "Z"]}],
        "mesh": {"columns": 16, "sectors": 4},
    }
    given["geometry"] |= sections.pop("geometry", {})
    if given["geometry"].get("space") == "3d":
        given["holds"] = [{"on": ends, "fix": ["X", "Y", "Z"]}]
    return config("disc", **(given | sections))


def hertz(k: Any, lp: float, thickness: float, volts: float = 0.0) -> Any:
    """Frequencies of a flat membrane."""
    tension = thickness * (G * (lp**2 - lp**-4) - EPSILON * (volts / thickness) ** 2)
    return k * np.sqrt(tension / (RHO * thickness)) / (2 * np.pi)


def nearest(table: pd.DataFrame, exact: Any) -> Any:
    """The frequency found next to each exact one."""
    f = table["frequency_Hz"].to_numpy()
    return np.array([f[np.abs(f - e).argmin()] for e in np.ravel(exact)])


# --- membranes -----------------------------------------------------------------------------------


def test_an_annulus_vibrates_on_bessel_functions():
    """The first three modes around the axis, at a/b = 1/4."""
    base = {"kind": "annulus", "inner_radius": "5 mm", "outer_radius": "20 mm"}
    exact = hertz(frequencies.annulus(0, 3, 5.0, 20.0), 1.2, 0.25)
    table = found(film(base, 1.2, 0.25, mesh={"columns": 32}))
    assert nearest(table, exact) == pytest.approx(exact, rel=1e-3)
    assert table["frequency_Hz"][0] == pytest.approx(exact[0], rel=1e-3)


@pytest.mark.parametrize(("kind", "volts"), [("disc", 0.0), ("disc", 2.19226), ("annulus", 1.0)])
def test_half_a_film_in_space_has_modes_around_it_too(kind, volts):
    """With 0, 1 and 2 nodal diameters, under voltage: it lowers the tension."""
    base = {"kind": "disc", "radius": "20 mm"}
    k = [frequencies.disc(n, 1, 20.0)[0] for n in range(3)]
    if kind == "annulus":
        base = {"kind": "annulus", "inner_radius": "5 mm", "outer_radius": "20 mm"}
        k = [frequencies.annulus(n, 1, 5.0, 20.0)[0] for n in range(3)]
    exact = hertz(np.array(k), 1.2, 0.25, volts)
    half = {"space": "3d", "symmetry": ["Y"]}
    program = [{"stage": "charge", "terminal": {"voltage": f"{volts} kV"}}]
    table = found(film(base, 1.2, 0.25, geometry=half, program=program))
    assert nearest(table, exact) == pytest.approx(exact, rel=1e-3)
    if kind == "disc":  # as printed in the references' tables
        printed = {0.0: [85.4827, 136.2031, 182.5526], 2.19226: [78.0164, 124.3066, 166.6077]}
        assert exact == pytest.approx(printed[volts], rel=1e-5)


def test_a_platform_on_an_annulus_moves_and_rocks():
    """A rigid plate as heavy as ten times the film that it takes the place of, without its turns.

    They are held, as the plate's inertia against turning is none of its config's.
    """
    base = {"kind": "annulus", "inner_radius": "10 mm", "outer_radius": "20 mm"}
    film_mass = RHO * 0.25 * np.pi * 10.0**2
    plate = {"on": "inner", "along": "Z", "mass": f"{10 * film_mass * 1e6:.17g} g"}
    exact = hertz(frequencies.plunging_plate(2, 10.0, 20.0, 10 * np.pi * 10.0**2), 1.2, 0.25)
    given = film(
        base,
        1.2,
        0.25,
        mounts={"plate": plate},
        holds=[{"on": "outer", "fix": ["R", "Z"]}],
        mesh={"columns": 32},
        program=[{"stage": "let go", "mount": {"force": "0 N"}}],
    )
    table = found(given)
    assert nearest(table, exact) == pytest.approx(exact, rel=1e-3)
    first = table.iloc[0]
    assert first["frequency_Hz"] == pytest.approx(exact[0], rel=1e-3)
    assert first["displacement_mm_per_mm"] == pytest.approx(1.0, rel=1e-6)  # all of the mode
    omega = 2 * np.pi * first["frequency_Hz"]  # the film's force accelerates the plate
    assert first["force_N_per_mm"] == pytest.approx(omega**2 * 10 * film_mass, rel=0.02)
    assert 1 < first["modal_mass_g"] / (10 * film_mass * 1e6) < 1.3


# --- solids --------------------------------------------------------------------------------------


@pytest.mark.once
def test_a_cantilever_of_two_layers():
    """Plane strain, L/h = 20: shear and rotary inertia lower the third mode."""
    layers = [
        {"name": "low", "thickness": "1 mm", "material": "stiff"},
        {"name": "film", "thickness": "1 mm"},
    ]
    given = config(
        "strip",
        *layers,
        geometry={"base": {"kind": "strip", "length": "40 mm", "width": "10 mm"}},
        mesh={"columns": 24, "film_rows": 1},
        physics={"formulation": "mixed"},
        materials={"film": SOFT, "stiff": SOFT | {"shear_modulus": "60 kPa"}},
    )
    stiffness = frequencies.bilayer_stiffness(3 * G, G, 1.0, 1.0)
    exact = frequencies.cantilever(3, 40.0, stiffness, RHO * 2.0) / (2 * np.pi)
    assert exact == pytest.approx([2.34978, 14.72579, 41.23264], rel=1e-5)
    f = found(given, 3)["frequency_Hz"].to_numpy()
    assert (np.abs(f / exact - 1) < [0.005, 0.015, 0.04]).all()
    assert (f[1:] < exact[1:]).all()


def test_a_balloon_breathes_slower_under_voltage(tmp_path):
    """Half a thin sphere, H/A = 1/100; of its many modes the one that displaces most volume."""
    sys.path.insert(0, str(CONFIGS.parent / "meshes"))
    try:
        import make
    finally:
        del sys.path[0]
    mesh = make.write(tmp_path / "thin.msh", lambda: make.balloon(9.95, 0.1))
    A, H = 10.0, 0.1
    thin = balloon.Balloon(neo_hooke(G), A, H, EPSILON, density=RHO)
    shares = (0.0, 0.1, 0.3)
    unit = H * np.sqrt(G / EPSILON)
    stages = [
        {"stage": f"{v}", "terminal": {"voltage": f"{v * unit:.17g} kV"}, "steps": 1}
        for v in shares
    ]
    text = YAML(typ="safe").load((CONFIGS / "devices/balloon.yaml").read_text())
    text["geometry"]["file"] = str(mesh)
    text["materials"] = {"film": SOFT}
    text["program"] = stages
    path = tmp_path / "balloon.yaml"
    YAML().dump(text, path)
    run = dealib.Simulation(at_rest(dealib.load(path), ()))
    watch = ModesWatch([f"{v}" for v in shares], None, 60)
    for state in run:
        watch(state)
    table = pd.DataFrame(watch.rows)
    breathing = []
    for _, part in table.groupby("stage"):
        k = (part["volume_mm3_per_mm"].abs() / np.sqrt(part["modal_mass_g"])).idxmax()
        breathing.append(part["frequency_Hz"][k])
        assert abs(part["volume_mm3_per_mm"][k]) == pytest.approx(2 * np.pi * A**2, rel=0.1)
    exact = np.array([
        balloon.angular_frequency(thin, balloon.at(thin, 0.0, v * unit), v * unit) for v in shares
    ]) / (2 * np.pi)  # fmt: skip
    assert exact == pytest.approx(np.array([3.464102, 3.440852, 3.242281]) * 72.6440, rel=1e-5)
    assert breathing == pytest.approx(exact, rel=0.02)
    assert np.array(breathing) / breathing[0] == pytest.approx(exact / exact[0], rel=1e-3)


def loaded(mass: str, **sections: Any) -> Any:
    """The benchmark's strips with a mass that hangs on the mount, at 2 mm and 2.5 kV."""
    film = {
        **{"law": "neo_hookean", "shear_modulus": "0.334 MPa", "bulk_modulus": "16.67 MPa"},
        **{"relative_permittivity": 3.0, "prestretch": 1.15, "density": "1100 kg/m^3"},
    }
    electrode = {
        **{"law": "neo_hookean", "shear_modulus": "1 MPa", "bulk_modulus": "50 MPa"},
        "density": "1100 kg/m^3",
    }
    layers = [
        {"name": "low", "thickness": "10 um", "material": "electrode"},
        {"name": "film", "thickness": "30 um"},
        {"name": "high", "thickness": "10 um", "material": "electrode"},
    ]
    base = {"kind": "annulus", "inner_radius": "8.35 mm", "outer_radius": "12.35 mm"}
    given = {
        "geometry": {"base": base, "layers": layers},
        "materials": {"film": film, "electrode": electrode},
        "mounts": {"plate": {"on": "inner", "along": "Z", "mass": mass}},
        "mesh": {"columns": 60, "film_rows": 2, "grading": "tanh"},
        "program": [
            {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
            {"stage": "charge", "terminal": {"voltage": "2.5 kV"}, "steps": 3},
        ],
    }
    return config("annulus", **(given | sections))


@pytest.mark.once
def test_a_mass_on_a_film_under_voltage():
    """As a spring and a mass; stiffer at constant charge, by the share of the capacitances."""
    held = loaded("3 g", sensing={"differential": True})
    *_, last = (state.row for state in simulation(held))
    assert found(held, 1)["frequency_Hz"][0] == pytest.approx(1807.0, rel=1e-3)  # mount held
    k = last["mount_stiffness_N_per_mm"]
    spring = np.sqrt(k / 3e-6) / (2 * np.pi)
    assert spring == pytest.approx(57.006, rel=2e-4)
    free = loaded(
        "3 g",
        sensing={"differential": True},
        program=[
            {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
            {"stage": "charge", "terminal": {"voltage": "2.5 kV"}, "steps": 3},
            {"stage": "let go", "mount": {"force": f"{last['force_N']:.17g} N"}},
        ],
    )
    rows = [state.row for state in simulation(free)]
    mode = found(free, 1).iloc[0]
    assert rows[-1]["displacement_mm"] == pytest.approx(-2.0, abs=1e-6)
    assert mode["frequency_Hz"] == mode["short_circuit_Hz"] == pytest.approx(56.968, rel=2e-4)
    assert mode["open_circuit_Hz"] == pytest.approx(61.81, rel=2e-4)
    # of one degree of freedom it is the share of the capacitance that motion adds
    added = 1 - rows[-1]["blocked_capacitance_pF"] / rows[-1]["differential_capacitance_pF"]
    assert mode["coupling_squared"] == pytest.approx(added, rel=2e-3)
    # the other way round: a terminal whose charge is given is open
    charge = rows[-1]["charge_uC"]
    open_ = loaded(
        "3 g",
        program=[
            {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
            {"stage": "charge", "terminal": {"charge": f"{charge:.17g} uC"}, "steps": 3},
            {"stage": "let go", "mount": {"force": f"{last['force_N']:.17g} N"}},
        ],
    )
    other = found(open_, 1).iloc[0]
    assert other["frequency_Hz"] == other["open_circuit_Hz"]
    assert other["frequency_Hz"] == pytest.approx(mode["open_circuit_Hz"], rel=1e-6)
    assert other["short_circuit_Hz"] == pytest.approx(mode["short_circuit_Hz"], rel=1e-6)
    assert other["charge_uC_per_mm"] == pytest.approx(0, abs=1e-12)
    assert abs(other["voltage_kV_per_mm"]) > 0.01


CORK = {
    **{"law": "neo_hookean", "shear_modulus": "1 MPa", "bulk_modulus": f"{2 / 3:.17g} MPa"},
    **{"relative_permittivity": 3.0, "density": "1e-3 kg/m^3"},
}


def beam(**sections: Any) -> Any:
    """A strip of cork, 10 mm by 1 mm, 5 mm wide, held on its left."""
    given = {
        "geometry": {"layers": [{"name": "film", "thickness": "1 mm"}]},
        "mesh": {"columns": 12, "film_rows": 2, "grading": "uniform"},
        "materials": {"film": CORK},
    }
    given["materials"] = {"film": CORK | sections.pop("film", {})}
    return config("strip", **(given | sections))


def test_a_rigid_mount_swings_on_its_stiffness():
    """A plate on a beam without mass: its frequencies are those of the stiffness at its ports."""
    plate = {"plate": {"on": "right", "rigid": True, "mass": "2 g"}}
    free = {f"plate.{axis}": {"force": "0 N"} for axis in "XZ"}
    let_go = {"stage": "go", "mounts": free, "turns": {"plate.about_Y": {"moment": "0 N mm"}}}
    given = beam(mounts=plate, program=[let_go])
    table = found(given, 2)
    small, moved = 1e-4, ["displacement_mm.plate.X", "displacement_mm.plate.Z"]
    compliance = np.empty((2, 2))
    for k, axis in enumerate("XZ"):
        pull = {"stage": "go", "mounts": free | {f"plate.{axis}": {"force": f"{small} N"}}}
        pull["turns"] = let_go["turns"]
        *_, row = (state.row for state in simulation(beam(mounts=plate, program=[pull])))
        compliance[:, k] = [row[name] / small for name in moved]
    k = np.sort(1 / np.linalg.eigvalsh(compliance))
    exact = np.sqrt(k / 2e-6) / (2 * np.pi)
    assert table["frequency_Hz"].to_numpy() == pytest.approx(exact, rel=1e-4)
    reached = np.hypot(*(table[f"displacement_mm_per_mm.plate.{axis}"] for axis in "XZ"))
    assert table["modal_mass_g"].to_numpy() == pytest.approx(2 * reached**2, rel=1e-4)


def test_branches_do_not_relax_within_a_period():
    """So they add to the stiffness, whatever the time of the state that is looked at."""
    branch = {"shear_modulus": "0.5 MPa", "relaxation_time": "1 ms"}
    slow = found(beam(film={"bulk_modulus": "1 GPa"}, physics={"formulation": "mixed"}), 3)
    relaxed = {"bulk_modulus": "1 GPa", "branches": [branch]}
    fast = found(beam(film=relaxed, physics={"formulation": "mixed"}), 3)
    ratio = (fast["frequency_Hz"] / slow["frequency_Hz"]).to_numpy()
    assert ratio == pytest.approx(np.sqrt(1.5), rel=2e-3)


def test_a_mode_that_grows_has_a_negative_frequency():
    """A strip between clamps, pressed to 1.5 times its buckling load: -sqrt(0.5) of its own."""
    h, length, permittivity = 0.3, 20.0, 3 * EPSILON_0
    euler = 4 * np.pi**2 / length**2 * (4 * h**3 / 12)  # N/mm, incompressible with G = 1 MPa
    volts = float(np.sqrt(1.5 * euler * h / permittivity))
    base = {"kind": "strip", "length": f"{length} mm", "width": "5 mm"}
    given = beam(
        film={"bulk_modulus": "10 GPa"},
        geometry={"base": base, "layers": [{"name": "film", "thickness": f"{h} mm"}]},
        mesh={"columns": 32, "film_rows": 1, "grading": "uniform"},
        physics={"formulation": "mixed"},
        mounts={},
        holds=[{"on": ["left", "right"], "fix": ["X", "Z"]}],
        program=[
            {"stage": "rest"},
            {"stage": "press", "terminal": {"voltage": f"{volts:.17g} kV"}, "steps": 2},
        ],
    )
    watch = ModesWatch(["rest", "press"], None, 2)
    for state in simulation(given):
        watch(state)
    rest, _, pressed, second = (row["frequency_Hz"] for row in watch.rows)
    assert pressed / rest == pytest.approx(-np.sqrt(0.5), rel=0.03)
    assert second > 0
    told = list(watch.told())
    assert "unstable: grows by e in " in told[2]
    assert "unstable" not in told[3]


def test_air_hardly_matters():
    """It has no mass, and its field is weak."""
    thin = {"geometry": {"layers": [{"name": "film", "thickness": "0.1 mm"}], "air_height": "0 mm"}}
    f = []
    for height in ("0 mm", "3 mm"):
        given = config(
            "annulus",
            geometry=thin["geometry"] | {"air_height": height},
            materials={"film": SOFT | {"prestretch": 1.2, "bulk_modulus": "20 MPa"}},
            program=[{"stage": "charge", "terminal": {"voltage": "1 kV"}, "steps": 2}],
        )
        f.append(found(given, 3)["frequency_Hz"].to_numpy())
    assert f[1] == pytest.approx(f[0], rel=5e-3)
    assert not np.array_equal(f[1], f[0])


@pytest.mark.once
def test_the_resonance_of_the_gallery():
    """A plate of 3 g on its film: a spring and a mass, softer under voltage."""
    given = case("dynamics/resonance", sensing__differential=True, mesh__columns=20)
    watch = ModesWatch(["hang"], "bias", 1)
    for state in dealib.Simulation(at_rest(given, ["hang", "bias"])):
        if watch(state).modes is not None:
            k = state.row["mount_stiffness_N_per_mm"]
    f = [watch.rows[0]["frequency_Hz"], *(row["frequency_Hz.1"] for row in watch.curve)]
    assert f[0] == pytest.approx(np.sqrt(k / 3e-6) / (2 * np.pi), rel=2e-3)
    assert f[0] == pytest.approx(32.50, rel=2e-3)
    assert f[-1] == pytest.approx(26.54, rel=2e-3)
    assert (np.diff(f) < 0).all()


def test_modes_keep_their_numbers_where_frequencies_cross():
    """A pulled strip: bending gets stiffer, and motion along it softer."""
    given = beam(
        geometry={"layers": [{"name": "film", "thickness": "0.7 mm"}]},
        mounts={"grip": {"on": "right", "along": "X"}},
        holds=[{"on": "left", "fix": ["X", "Z"]}, {"on": "right", "fix": "Z"}],
        program=[{"stage": "pull", "mount": {"displacement": "2 mm"}, "steps": 6}],
    )
    watch = ModesWatch((), "pull", 5)
    for state in simulation(given):
        watch(state)
    curve = pd.DataFrame(watch.curve)
    f = curve[[f"frequency_Hz.{k}" for k in range(1, 6)]].to_numpy()
    assert (np.sign(np.diff(f, axis=0)) == [1, 1, 1, -1, 1]).all()
    assert f[0, 2] < f[0, 3]
    assert f[1, 2] > f[1, 3]
    assert [row["frequency_Hz"] for row in watch.rows] == pytest.approx(np.sort(f[-1]), rel=1e-9)


# --- the command ---------------------------------------------------------------------------------

SMALL = """\
name: small
geometry:
  shape: laminate
  base: {kind: annulus, inner_radius: 6 mm, outer_radius: 10 mm}
  layers: [{name: film, thickness: 0.2 mm}]
mesh: {columns: 8, film_rows: 1}
materials:
  film: {law: neo_hookean, youngs_modulus: 1 MPa, relative_permittivity: 3, prestretch: 1.2}
program:
  - {stage: push, mount: {displacement: -1 mm}, steps: 2}
  - {stage: charge, terminal: {voltage: 3 kV}, steps: 3}
"""
DENSITY = "materials.film.density=1000 kg/m^3"


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


def command(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def test_no_stage_after_the_last_one_asked_for_is_solved(small):
    moves = ["program.1.dynamic=true", "stop_when=[kinetic_energy_mJ > 1 mJ]"]
    given = dealib.load(small, set=[DENSITY, *moves])  # what only moves has, is not asked
    cut = [
        [s.stage for s in at_rest(given, stages, along).config.program]
        for stages, along in (
            ([], None),
            (["push"], None),
            (["push"], "charge"),
            ([], "push"),
            (["prestrain"], None),
        )
    ]
    whole = ["push", "charge"]
    assert cut == [whole, ["push"], whole, whole, ["prestrain"]]
    states = dealib.Simulation(at_rest(given, ["prestrain"]))
    assert [state.row["stage"] for state in states] == ["prestrain"]


@pytest.mark.once
def test_the_command_writes_what_it_finds(small, tmp_path):
    out = tmp_path / "modes"
    given = ["modes", small, "--set", DENSITY, "--out", out, "--count", "3"]
    done = command(*given, "--at", "push", "--at", "charge", "--along", "charge")
    assert done.exit_code == 0, done.output + repr(done.exception)
    table = pd.read_csv(out / "modes.csv")
    assert list(zip(table["stage"], table["step"], table["mode"], strict=True)) == [
        (stage, step, k) for stage, step in (("push", 2), ("charge", 5)) for k in (1, 2, 3)
    ]
    assert (table["frequency_Hz"] > 0).all()
    curve = pd.read_csv(out / "frequencies.csv")
    assert curve["voltage_kV"].to_list() == pytest.approx([1, 2, 3])
    assert curve["frequency_Hz.1"].is_monotonic_decreasing
    last = table[table["stage"] == "charge"]["frequency_Hz"].to_list()
    assert curve.iloc[-1][[f"frequency_Hz.{k}" for k in (1, 2, 3)]].to_list() == last
    for name in ("frequencies.png", "modes-step00002.png", "modes-step00005.png"):
        assert (out / "plots" / name).is_file()
    run = dealib.open(out)
    assert run.status == "done"
    shapes = run.modes(-1)
    assert shapes.shape == (3, len(run.mesh.points), 2)
    assert np.linalg.norm(shapes, axis=2).max(axis=1) == pytest.approx(1)
    assert (out / "modes.xdmf").read_text().count('<Grid Name="step">') == 6
    for line in ("push         mode  1", "charge       mode  3"):
        assert line in done.output
    film = command("animate", out, "--field", "mode2", "--seconds", "0.5", "--out", out / "a.gif")
    assert film.exit_code == 0, film.output + repr(film.exception)
    whole = (out / "modes.csv").read_text()
    for damaged in ("", "stage,step\n1,2\n", whole.replace("frequency_Hz", "f"), "\0\xff\n"):
        (out / "modes.csv").write_text(damaged)
        lost = command("animate", out, "--field", "mode", "--out", out / "b.gif")
        assert isinstance(lost.exception, ConfigError)
        assert "modes.csv: damaged" in str(lost.exception)
    (out / "modes.csv").write_text(whole)
    lost = command("animate", out, "--field", "mode9", "--out", out / "b.gif")
    assert "has no mode9: mode, mode2, mode3" in str(lost.exception)
    # never overwritten unless asked
    again = command(*given)
    assert isinstance(again.exception, ConfigError)
    assert str(again.exception).endswith("; choose another --out, or --overwrite it")
    assert pd.read_csv(out / "modes.csv").equals(table)
    assert command(*given, "--overwrite").exit_code == 0
    assert not (out / "frequencies.csv").exists()
    assert len(pd.read_csv(out / "modes.csv")) == 3


@pytest.mark.once
def test_what_it_refuses(small, tmp_path):
    lacking = command("modes", small)
    assert isinstance(lacking.exception, ConfigError)
    assert f"{small}:8:3" in str(lacking.exception)
    assert "materials.film.density: this key is missing" in str(lacking.exception)
    unknown = command("modes", small, "--set", DENSITY, "--at", "chrge")
    assert "there is no stage 'chrge'; did you mean 'charge'?" in str(unknown.exception)
    pelrine = case("benchmark_strip", physics__coupling="pelrine")
    with pytest.raises(ConfigError, match=r"vibrations need physics\.coupling: energy"):
        at_rest(pelrine, ())
    given = ["modes", small, "--set", DENSITY, "--at", "charge"]
    stopped = command(*given, "--set=stop_when=[voltage_kV > 1.5 kV]", "--out", tmp_path / "a")
    assert stopped.exit_code == 0, repr(stopped.exception)  # its stage ends there
    stopped = command(
        *given, "--set=stop_when=[displacement_mm < -0.4 mm]", "--out", tmp_path / "b"
    )
    assert "the run ended before the end of 'charge'" in str(stopped.exception)


@pytest.mark.once
def test_nothing_flows_through_openings_within_a_period():
    """So that frequencies do not depend on how long the step before was."""
    blow_up = {"stage": "blow up", "chamber": {"pressure": "1 kPa"}, "steps": 4}
    base = {"kind": "disc", "radius": "10 mm"}

    def given(openings: Any, *others: dict[str, Any]) -> Any:
        chambers = {"air": {"on": "film.bottom", "openings": openings}}
        return film(base, 1.5, 0.5, chambers=chambers, program=[blow_up, *others])

    def frequencies(*of: Any) -> Any:
        return found(given(*of), 3)["frequency_Hz"].to_numpy()

    hole = {"hole": {"conductance": "40 mm^3/s/kPa", "pressure": "1 kPa"}}
    water = {"stage": "close", "chamber": {"liquid": {"density": "1000 kg/m^3"}}}
    slow, quick = (
        frequencies(hole, water | {"duration": "10 s", "steps": steps}) for steps in (1, 20)
    )
    assert slow == pytest.approx(quick, rel=1e-7)
    *_, end = simulation(given(None))
    shut = {"stage": "close", "chamber": {"volume": f"{end.row['volume_mm3']!r} mm^3"}}
    assert slow == pytest.approx(frequencies(None, shut), rel=1e-6)
    assert slow[0] > 1.1 * frequencies(None)[0]  # than at a given pressure


@pytest.mark.once
@pytest.mark.mpi
def test_on_two_ranks_as_on_one(small, tmp_path):
    tables = []
    for ranks in (1, 2):
        out = tmp_path / f"on{ranks}"
        line = [mpirun(), "-n", str(ranks), sys.executable, "-m", "dealib", "modes", str(small)]
        line += ["--set", DENSITY, "--out", str(out), "--count", "4"]
        done = subprocess.run(
            line, env=environment(), capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        assert done.returncode == 0, done.stderr
        tables.append(pd.read_csv(out / "modes.csv"))
    assert list(tables[0]) == list(tables[1])
    for name in tables[0].select_dtypes("number"):
        scale = 1.0 if "coupling" in name else float(tables[0][name].abs().max())
        one, two = (table[name].to_numpy() for table in tables)
        assert two == pytest.approx(one, rel=1e-8, abs=1e-8 * max(scale, 1e-6)), name
