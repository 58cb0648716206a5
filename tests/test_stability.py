"""Loss of stability along a stage: loads and shapes against closed forms."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from conftest import case, history
from laminates import config, simulation
from typer.testing import CliRunner

import dealib
from dealib.cli.app import app
from dealib.config import resolved
from dealib.config.case import Case
from dealib.errors import ConfigError
from dealib.report import facts
from dealib.results.critical import critical_points, lost_at
from dealib.units import EPSILON_0

L, H, G = 20.0, 0.3, 1.0  # mm, mm, MPa
EPSILON = 3 * EPSILON_0
FILM = {
    **{"law": "neo_hookean", "shear_modulus": "1 MPa", "bulk_modulus": "10 GPa"},
    "relative_permittivity": 3.0,
}
STRIP = {"kind": "strip", "length": f"{L} mm", "width": "10 mm"}
SQUARE = {"kind": "rectangle", "length": f"{L} mm", "width": f"{L} mm"}
PLANE, SPACE = ["X", "Z"], ["X", "Y", "Z"]
EULER = 4 * np.pi**2 / L**2  # load over bending stiffness, of a beam with clamped ends


def device(base: dict[str, Any], **sections: Any) -> Any:
    """A config of a film of 0.3 mm that is held at all ends; it is mixed, and modes are watched."""
    ends = {"strip": ["left", "right"], "rectangle": ["left", "right", "front", "back"]}
    axes = PLANE if base["kind"] == "strip" else SPACE
    given = {
        "geometry": {"base": base, "layers": [{"name": "film", "thickness": f"{H} mm"}]},
        "materials": {"film": FILM},
        "mounts": {},
        "holds": [{"on": ends[base["kind"]], "fix": axes}],
        "physics": {"formulation": "mixed"},
        "output": {"modes": 3},
    }
    given["geometry"] |= sections.pop("geometry", {})
    return config("strip", **(given | sections))


def charged(volts: float, steps: int) -> list[dict[str, Any]]:
    """A stage up to a voltage."""
    return [{"stage": "go", "terminal": {"voltage": f"{volts!r} kV"}, "steps": steps}]


def buckling_voltage(factor: float) -> float:
    """At which a film presses its frame with `factor` bending stiffnesses, kV.

    The Maxwell stress of an incompressible film between electrodes is eps (V/H)^2 in its plane.
    """
    stiffness = 4 * G * H**3 / 12  # E / (1 - nu^2) = 4 G
    return float(np.sqrt(H / EPSILON * factor * stiffness))


def lost(rows: list[dict[str, Any]]) -> tuple[int, dict[str, float]]:
    """Index of the first unstable row, and what is interpolated before it."""
    k = next(k for k, row in enumerate(rows) if row["unstable_modes"])
    assert all(row["softest_mode_N_per_mm"] > 0 for row in rows[:k])
    assert all(row["softest_mode_N_per_mm"] < 0 for row in rows[k:])
    return k, lost_at(rows[max(k - 2, 0) : k + 1])


@pytest.mark.once
def test_a_strip_buckles_at_its_voltage(tmp_path):
    """Between clamps: at 4 pi^2 D / L^2, in the shape 1 - cos; told, stored and drawn."""
    exact = buckling_voltage(EULER)
    given = device(STRIP, mesh={"columns": 40}, program=charged(1.25 * exact, 6))
    run = dealib.simulate(Case(given, resolved(given), tmp_path), tmp_path / "run")
    h = run.history
    assert h["unstable_modes"].tolist() == [0, 0, 0, 0, 0, 1, 1]
    (point,) = critical_points(run)
    assert (point.name, point.stage, point.vary) == ("loss of stability", "go", "voltage")
    assert point.value == pytest.approx(exact, rel=0.004)
    assert point.modes == (0, 1)
    assert ("loss of stability in “go”") in dict(map(reversed, facts.headline(run)))
    # free vibration of a beam with clamped ends, of 1 mm root mean square on 10 mm by L
    beam = 4 * G * H**3 / 12 * (4.730041 / L) ** 4 * 10 * L
    assert h["softest_mode_N_per_mm"][0] == pytest.approx(beam, rel=0.002)
    unused, warning = run.info["warnings"]
    assert unused.startswith("materials.electrode: ")  # `config` gives every device one
    assert re.search(rf"loses its stability at V {point.value:.4f}\d* kV .* step 5 \(go\)", warning)
    assert [run.modes(k) is not None for k in range(7)] == [k == 5 for k in range(7)]
    modes, x = run.modes(5), run.mesh.points[:, 0]
    assert modes.shape == (3, len(x), 2)
    bent = modes[0, :, 1]
    assert np.abs(bent - (1 - np.cos(2 * np.pi * x / L)) / 2).max() < 0.01
    assert np.corrcoef(modes[1, :, 1], np.sin(2 * np.pi * x / L))[0, 1] ** 2 > 0.9
    grid = run.fields(5)
    assert grid.point_data["mode"][:, 1] == pytest.approx(bent)
    told = CliRunner().invoke(app, ["info", str(run.directory)])
    assert f"{point.value:.7g} kV" in told.output
    for command in (["plot", "--field", "mode"], ["plot", "--field", "mode2"], ["report"]):
        done = CliRunner().invoke(app, [command[0], str(run.directory), *command[1:]])
        assert done.exit_code == 0, done.output
    assert (run.directory / "plots/field-mode-step00005.png").is_file()
    assert 'alt="The softest mode' in (run.directory / "report.html").read_text()
    none = CliRunner().invoke(app, ["plot", str(run.directory), "--field", "mode", "--step", "2"])
    assert isinstance(none.exception, ConfigError)
    assert "modes exist where stability is lost, with output.modes" in str(none.exception)


@pytest.mark.slow
def test_a_plate_wrinkles_at_its_voltage():
    """A quarter of a clamped square plate, pressed alike along both axes: 5.304 pi^2 D / L^2."""
    exact = buckling_voltage(5.304 * np.pi**2 / L**2)
    given = device(
        SQUARE,
        geometry={"symmetry": ["X", "Y"]},
        mesh={"columns": 12},
        program=charged(1.2 * exact, 4),
    )
    run = simulation(given)
    rows, modes = [], []
    for state in run:
        rows.append(state.row)
        modes += [] if state.modes is None else [state.modes]
    k, at = lost(rows)
    assert k == 4
    assert at["voltage_kV"] == pytest.approx(exact, rel=0.01)
    (shapes,) = modes
    x = run.engine.layout.mesh.points
    highest = x[np.linalg.norm(shapes[0], axis=1).argmax(), :2]
    assert highest == pytest.approx([0, 0], abs=1e-9)
    assert np.abs(shapes[0, :, :2]).max() < 0.1  # upwards


@pytest.mark.once
def test_the_film_of_the_gallery():
    """In displacements, on a coarser mesh; its mode is a field of the last step."""
    rows = history("devices/wrinkling_film").to_dict("records")
    k, at = lost(rows)
    assert k == 5
    assert at["voltage_kV"] == pytest.approx(buckling_voltage(5.304 * np.pi**2 / L**2), rel=0.02)


@pytest.mark.once
def test_a_slender_column_buckles_at_euler_s_load():
    """In space, clamped, one end led towards the other.

    Without transverse contraction, which clamps would hinder: they would stiffen the ends. Shear
    takes 0.18 % of the load, and the column is shorter by half of that.
    """
    width = 0.5
    given = device(
        {"kind": "rectangle", "length": f"{L} mm", "width": f"{width} mm"},
        mesh={"columns": 48, "sectors": 2, "grading": "uniform"},
        materials={"film": FILM | {"bulk_modulus": f"{2 / 3!r} MPa"}},
        physics={},
        mounts={"end": {"on": "right", "along": "X"}},
        holds=[{"on": "left", "fix": SPACE}],
        program=[{"stage": "press", "mount": {"displacement": "-0.02 mm"}, "steps": 5}],
    )
    rows = [state.row for state in simulation(given)]
    _, at = lost(rows)
    load = EULER * 2 * G * width * H**3 / 12
    assert -at["force_N"] == pytest.approx(load, rel=0.002)


@pytest.mark.parametrize("volts", [0.0, 20.0])
def test_the_softest_modes_of_a_taut_film(volts):
    """Of a square membrane under a tension T: 2 pi^2 T, then 5 pi^2 T twice, 8 pi^2 T."""
    stretch = 1.05
    given = device(
        SQUARE,
        mesh={"columns": 16, "sectors": 8},
        physics={"model": "membrane"},
        materials={"film": FILM | {"prestretch": [stretch, stretch]}},
        output={"modes": 4},
        program=charged(volts, 1),
    )
    run = simulation(given)
    for state in run:
        assert state.row["unstable_modes"] == 0
    tension = G * (stretch**2 - stretch**-4) * H - EPSILON * volts**2 / H
    found = run.engine.newton.softest_modes(4).values
    assert found == pytest.approx(np.pi**2 * tension * np.array([2, 5, 5, 8]), rel=0.002)
    assert state.row["softest_mode_N_per_mm"] == pytest.approx(found[0], rel=1e-6)


def test_a_film_under_tension_wrinkles_where_that_ends():
    """A membrane does so in many modes at once; the lowest is found among all of them."""
    stretch = 1.02
    slack = float(np.sqrt(G * (stretch**2 - stretch**-4) / EPSILON) * H)
    given = device(
        SQUARE,
        geometry={"symmetry": ["X", "Y"]},
        mesh={"columns": 8, "sectors": 4},
        physics={"model": "membrane"},
        materials={"film": FILM | {"prestretch": [stretch, stretch]}},
        program=charged(1.02 * slack, 8),
    )
    run = simulation(given)
    rows = [state.row for state in run]
    k, _ = lost(rows)
    assert k == 8
    assert rows[k]["unstable_modes"] > 10
    newton = run.engine.newton
    modes, negative = newton.softest_modes(rows[k]["unstable_modes"] + 2), newton.unstable_modes()
    assert (modes.values < 0).sum() == negative == rows[k]["unstable_modes"]
    assert modes.values[0] == pytest.approx(rows[k]["softest_mode_N_per_mm"], rel=1e-6)


def test_each_mode_that_gets_unstable_is_counted():
    """A strip far above the load of its second mode, which is 8.183 pi^2 D / L^2."""
    second = buckling_voltage(8.183 * np.pi**2 / L**2)
    given = device(STRIP, mesh={"columns": 40}, program=charged(1.05 * second, 2))
    run = simulation(given)
    states = [(s.row["unstable_modes"], s.lost) for s in run]
    assert states == [(0, False), (0, False), (2, True)]
    modes = run.engine.newton.softest_modes(3)
    assert modes.values[0] < modes.values[1] < 0 < modes.values[2]


def test_numbers_are_interpolated_where_the_stiffness_falls():
    """Over three rows, two, or one; a history that is stable loses nothing."""

    def row(volts: float, stiffness: float) -> dict[str, Any]:
        return {"step": 1, "voltage_kV": volts, "softest_mode_N_per_mm": stiffness}

    def of(volts: float) -> dict[str, Any]:
        return row(volts, 1 - (volts / 3) ** 2)

    assert lost_at([of(2.0), of(2.5), of(3.2)])["voltage_kV"] == pytest.approx(3.0, abs=0.01)
    assert lost_at([row(0.0, 1.0), row(2.0, 3.0), row(4.0, -1.0)])["voltage_kV"] == 3.5
    # another mode, which nothing has shown before: between the last two in any case
    jump = lost_at([row(2.0, 1.0), row(2.9, 0.9), row(3.0, -0.9)])["voltage_kV"]
    assert jump == pytest.approx(2.95, abs=0.05)
    assert lost_at([row(2.0, -0.5)])["voltage_kV"] == 2.0
    assert lost_at([row(1.0, -0.1), row(2.0, -0.5)])["voltage_kV"] == 2.0


def test_without_it_nothing_is_told():
    rows = [state.row for state in simulation(device(STRIP, output={}, program=charged(1.0, 1)))]
    assert not {"softest_mode_N_per_mm", "unstable_modes"} & set(rows[0])


def test_a_stage_ends_where_stability_is_lost():
    """Closer by halving the step."""
    exact = buckling_voltage(EULER)
    program = charged(1.25 * exact, 2)
    program[0]["stop_when"] = [{"when": "unstable_modes > 0", "bisect": 5}]
    rows = [state.row for state in simulation(device(STRIP, mesh={"columns": 40}, program=program))]
    assert [row["unstable_modes"] for row in rows][-2:] == [0, 1]
    low, high = (row["voltage_kV"] for row in rows[-2:])
    assert low < exact * 1.005
    assert high > exact * 0.995
    assert high - low < 0.03 * exact


def test_loads_without_a_potential_have_no_modes():
    with pytest.raises(ConfigError, match=r"output\.modes=2: needs physics\.coupling: energy"):
        case("benchmark_strip", output__modes=2, physics__coupling="pelrine")
