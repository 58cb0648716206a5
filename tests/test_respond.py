"""Small-signal spectra about static states: limits, closed forms, circuits, and the command."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case
from laminates import config, simulation
from test_modes import DENSITY, SOFT, beam, command, loaded, small  # noqa: F401 - a fixture
from test_own_mesh import film, written
from test_parallel import PATIENCE
from verification.references import line, oscillator
from verification.references import sound as references

import dealib
from dealib.cli.mpi import environment, mpirun
from dealib.config import Config
from dealib.errors import ConfigError, ValueAt
from dealib.fem.response import Response, relaxed_state
from dealib.plots.response import draw_bode, plt
from dealib.plots.style import LIGHT
from dealib.program.modes import ModesWatch, at_rest
from dealib.program.response import Driver, SpectrumWatch
from dealib.results import circuit, sound
from dealib.units import EPSILON_0


def spectrum(given: Any, hertz: Any, **keys: Any) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The spectrum at the end of a program, and the row of its state."""
    found = SpectrumWatch(None, keys.pop("of", "terminal"), hertz, **keys)
    for state in simulation(given):
        found(state)
    return pd.DataFrame(found.rows), state.row


def complex_of(table: pd.DataFrame, size: str, phase: str) -> Any:
    """A column with its phase."""
    return (table[size] * np.exp(1j * np.radians(table[phase]))).to_numpy()


# --- limits --------------------------------------------------------------------------------------


@pytest.mark.parametrize("free", [True, False])
def test_it_begins_with_the_small_signal_columns(free):
    """Differential capacitance at low frequency, the mount free or held."""
    program = [
        {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
        {"stage": "charge", "terminal": {"voltage": "2.5 kV"}, "steps": 3},
    ]
    if free:
        program.append({"stage": "let go", "mount": {"force": "-0.356 N"}})
    given = loaded(
        "3 g", sensing={"differential": True}, program=program, mesh={"columns": 20, "film_rows": 1}
    )
    table, row = spectrum(given, [1e-3])
    C = row["differential_capacitance_pF"]
    assert table["parallel_capacitance_pF"][0] == pytest.approx(C, rel=1e-6)
    assert table["charge_uC_per_kV"][0] == pytest.approx(1e-3 * C, rel=1e-6)
    Z = 1e6 / (2 * np.pi * 1e-3 * C)
    assert table["impedance_Mohm"][0] == pytest.approx(Z, rel=1e-6)
    assert table["impedance_phase_deg"][0] == pytest.approx(-90, abs=1e-6)
    moved = "displacement_mm_per_kV" if free else "force_N_per_kV"
    h = 1e-3
    ends = []
    for sign in (1, -1):
        program[1]["terminal"] = {"voltage": f"{2.5 + sign * h:.17g} kV"}
        other = loaded("3 g", program=program, mesh={"columns": 20, "film_rows": 1})
        *_, end = (state.row for state in simulation(other))
        ends.append(end["displacement_mm" if free else "force_N"])
    slope = (ends[0] - ends[1]) / (2 * h)
    sign = np.cos(np.radians(table["phase_deg" if free else "force_phase_deg"][0]))
    assert sign * table[moved][0] == pytest.approx(slope, rel=1e-4)


@pytest.mark.once
def test_a_mass_on_a_film_with_a_branch_is_an_oscillator():
    """A bar that carries a mass, pulled by its Maxwell stress: one degree of freedom."""
    branch = {"shear_modulus": "0.3 MPa", "relaxation_time": "2 ms"}
    mass = 0.5e-3  # kg
    plate = {"plate": {"on": "right", "along": "X", "mass": f"{mass} kg", "free": ["Z"]}}
    given = beam(
        film={"branches": [branch]},
        mounts=plate,
        holds=[{"on": "left", "fix": ["X"]}, {"on": "film.bottom", "fix": ["Z"]}],
        damping={"stiffness": "20 us", "mass": "3 1/s"},
        program=[
            {"stage": "go", "mount": {"force": "0 N"}, "terminal": {"voltage": "1 kV"}, "steps": 2}
        ],
    )
    hertz = np.geomspace(1, 1000, 25)
    table, _ = spectrum(given, hertz)
    u = complex_of(table, "displacement_mm_per_kV", "phase_deg")
    # the plate's force and that on the faces: sx + w^2 m u/A = eps e de, sz = -eps e de; ey = 0
    omega, length, section = 2 * np.pi * hertz, 10.0, 5.0
    pull = 3 * EPSILON_0 * 1.0  # eps e of 1 kV/mm, a kV/mm more
    K, z = 2 / 3, 1j * omega * 2e-3 / (1 + 1j * omega * 2e-3)
    lost = 1j * omega * 20e-6
    bulk, shear = K * (1 + lost), 1.0 * (1 + lost) + 0.3 * z
    one, other = bulk + 4 / 3 * shear, bulk - 2 / 3 * shear
    inertia = 1e-3 * mass * (omega**2 - 3j * omega) * length / section
    strain = [
        np.linalg.solve([[p - m, q], [q, p]], [pull, -pull])[0]
        for p, q, m in zip(one, other, inertia, strict=True)
    ]
    assert u == pytest.approx(length * np.array(strain), rel=1e-3)
    assert np.abs(u).max() > 1.5 * np.abs(u[0])  # there is a resonance


def test_an_oscillator_of_the_references_is_what_the_closed_form_gives():
    """The same numbers where the branch pulls as the law does."""
    o = oscillator.Oscillator(mass=2.0, stiffness=3.0, branch=0.5, tau=0.4)
    z = 1j * 0.7 * 0.4 / (1 + 1j * 0.7 * 0.4)
    assert oscillator.harmonic(o, 0.7) == pytest.approx(1 / (3 + 0.5 * z - 2 * 0.49))


@pytest.mark.slow
def test_a_small_motion_in_time_has_the_same_spectrum():
    """A bar with a mass, a branch and damping after seven periods of a small voltage."""
    branch = {"shear_modulus": "0.3 MPa", "relaxation_time": "2 ms"}
    hertz, periods, per = 180.0, 9, 60
    wave = {"mean": "5 kV", "amplitude": "50 V", "frequency": f"{hertz} Hz", "rise": "10 ms"}
    swing = {"stage": "swing", "dynamic": True, "duration": f"{periods / hertz:.17g} s"}
    swing |= {"terminal": {"voltage": wave}, "steps": periods * per}
    pull = {"stage": "pull", "mount": {"force": "0 N"}, "terminal": {"voltage": "5 kV"}}
    still = {"stage": "still", "duration": "1 s", "steps": 2}
    given = {
        "film": {"branches": [branch], "density": "1000 kg/m^3"},
        "mesh": {"columns": 4, "film_rows": 1, "grading": "uniform"},
        "mounts": {"plate": {"on": "right", "along": "X", "mass": "0.5 g", "free": ["Z"]}},
        "holds": [{"on": "left", "fix": ["X"]}, {"on": "film.bottom", "fix": ["Z"]}],
        "damping": {"mass": "400 1/s", "stiffness": "20 us"},
        "solver": {"time_tolerance": 0.0, "rho": 1.0},
    }
    table, _ = spectrum(beam(**given, program=[pull, still]), [hertz])
    rows = [s.row for s in simulation(beam(**given, program=[pull, still, swing]))]
    history = pd.DataFrame(rows)[-2 * per :]
    t, u = history["time_s"].to_numpy() - 1 - 1, history["displacement_mm"].to_numpy()
    turns = 2 * np.pi * hertz * t
    _, up, across = np.linalg.lstsq(
        np.column_stack([np.ones_like(t), np.sin(turns), np.cos(turns)]), u, rcond=None
    )[0]
    seen = (up + 1j * across) / 0.05
    expected = complex_of(table, "displacement_mm_per_kV", "phase_deg")[0]
    assert abs(seen / expected - 1) < 0.01


def test_what_is_in_a_chamber_flows_through_its_opening():
    """p = -b/(S + g/(i omega)): b the volume a voltage, S that a pressure, g the flow a pressure.

    The disc is taut and light, so that its inertia does not show.
    """
    hertz = np.array([0.02, 0.3, 5.0])

    def at(conductance: float, **inside: Any) -> tuple[pd.DataFrame, dict[str, Any]]:
        opening = {"conductance": f"{conductance} mm^3/s/kPa", "pressure": "1 kPa"}
        close = {"stage": "close", "chamber": inside, "duration": "100 s", "steps": 10}
        settle = {"stage": "settle", "duration": "100 s", "steps": 10}
        given = config(
            "disc",
            materials={"film": SOFT | {"prestretch": 1.5, "density": "1 kg/m^3"}},
            physics={"formulation": "mixed"},
            chambers={"air": {"on": "film.bottom", "openings": {"hole": opening}}},
            program=[
                {"stage": "blow up", "chamber": {"pressure": "1 kPa"}, "steps": 4},
                {"stage": "charge", "terminal": {"voltage": "2 kV"}, "steps": 2},
                *([close, settle] if inside else []),
            ],
        )
        return spectrum(given, hertz)

    def pressure(*given: Any, **inside: Any) -> Any:
        return complex_of(at(*given, **inside)[0], "pressure_kPa_per_kV", "pressure_phase_deg")

    table, state = at(40)
    b = complex_of(table, "volume_mm3_per_kV", "volume_phase_deg")
    water = {"density": "1000 kg/m^3"}
    S = -b / pressure(1e-12, liquid=water)
    flow = 40 / (2j * np.pi * hertz)
    assert abs(flow[0]) > abs(S[0])
    assert pressure(40, liquid=water) == pytest.approx(-b / (S + flow), rel=1e-4)
    # a gas that has got the pressure beyond the opening, 100 kPa, gives way besides
    gas = (2000 + state["volume_mm3"]) / 100
    assert gas > 0.1 * abs(S[0])
    found = pressure(40, gas={"volume": "2 ml", "pressure": "99 kPa"})
    assert found == pytest.approx(-b / (S + gas + flow), rel=1e-4)


@pytest.mark.once
def test_branches_have_relaxed_before():
    """However short the program was: the static limit is that of the law alone."""
    branch = {"shear_modulus": "0.5 MPa", "relaxation_time": "1000 s"}
    program = [
        {"stage": "push", "mount": {"force": "-0.1 N"}, "steps": 3},
        {"stage": "charge", "terminal": {"voltage": "3 kV"}, "steps": 3},
    ]
    tables = []
    for branches in ([], [branch]):
        rubber = SOFT | {"shear_modulus": "0.3 MPa", "bulk_modulus": "20 MPa", "prestretch": 1.2}
        given = config(
            "annulus",
            {"name": "film", "thickness": "0.2 mm"},
            materials={"film": rubber | {"branches": branches}},
            program=program,
        )
        tables.append(spectrum(given, [1e-7, 1e3])[0])
    slow, fast = (table["displacement_mm_per_kV"].to_numpy() for table in tables)
    assert fast[0] == pytest.approx(slow[0], rel=1e-6)
    assert fast[1] != pytest.approx(slow[1], rel=1e-2)


@pytest.mark.parametrize("damped", [False, True])
def test_what_holds_a_mount_feels_all_that_moves(damped):
    """A mount of a thousand tonnes moves by the force that holds one which cannot move."""
    damping = {"damping": {"mass": "400 1/s", "stiffness": "20 us"}} if damped else {}
    sections = {"mesh": {"columns": 12, "film_rows": 1}} | damping
    hertz, heavy = np.array([900.0, 2500.0]), 1e6  # beside modes of the film, kg
    push = [
        {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
        {"stage": "charge", "terminal": {"voltage": "2.5 kV"}, "steps": 3},
    ]
    held, row = spectrum(loaded(f"{heavy} kg", program=push, **sections), hertz)
    force = f"{row['force_N']:.17g} N"
    push.append({"stage": "let go", "mount": {"force": force}})
    free, _ = spectrum(loaded(f"{heavy} kg", program=push, **sections), hertz)
    moved = complex_of(free, "displacement_mm_per_kV", "phase_deg")
    omega, rate = 2 * np.pi * hertz, 400 if damped else 0.0
    weight = (omega**2 - 1j * omega * rate) * heavy * 1e-3  # t
    found = complex_of(held, "force_N_per_kV", "force_phase_deg")
    assert found == pytest.approx(weight * moved, rel=1e-5)


# --- resistive electrodes ------------------------------------------------------------------------

RHO, CAPACITANCE = 10e3, 1e-7  # ohm a square, F/m^2
THICKNESS = 4.7 * 8.8541878128e-12 / CAPACITANCE * 1e3  # mm


def plates(base: dict[str, Any], contact: str, electrode: str = "", **sections: Any) -> Any:
    """A flat film with resistive electrodes, without voltage."""
    film = {"name": "film", "thickness": f"{THICKNESS:.17g} mm"}
    layers, materials = [film], {"film": SOFT | {"bulk_modulus": "1 MPa"}}
    if electrode:
        sheet = {"thickness": electrode, "material": "electrode"}
        layers = [sheet | {"name": "low"}, film, sheet | {"name": "high"}]
        rubber = {"law": "neo_hookean", "youngs_modulus": "1 MPa", "density": "1000 kg/m^3"}
        materials["electrode"] = rubber
    given: dict[str, Any] = {
        "geometry": {"base": base, "layers": layers} | sections.pop("geometry", {}),
        "materials": materials,
        "mesh": {"columns": 40, "film_rows": 1},
        "sensing": {"sheet_resistance": f"{RHO} ohm", "contact": contact},
    }
    return config(base["kind"], **(given | sections))


STRIP = {"kind": "strip", "length": "100 mm", "width": "20 mm"}
ANNULUS = {"kind": "annulus", "inner_radius": "10 mm", "outer_radius": "40 mm"}
DISC = {"kind": "disc", "radius": "40 mm"}
SHEETS = line.Sheets(RHO, RHO, CAPACITANCE)


@pytest.mark.parametrize(
    ("base", "contact", "electrode", "expected"),
    [
        (STRIP, "left", "", lambda w: line.strip(SHEETS, w, 0.1, 0.02)),
        (STRIP, "right", "20 um", lambda w: line.strip(SHEETS, w, 0.1, 0.02)),
        (ANNULUS, "outer", "", lambda w: line.annulus_from_outside(SHEETS, w, 0.01, 0.04)),
        (ANNULUS, "inner", "20 um", lambda w: line.annulus_from_inside(SHEETS, w, 0.01, 0.04)),
        (DISC, "outer", "", lambda w: line.annulus_from_outside(SHEETS, w, 0.0, 0.04)),
    ],
)
def test_a_resistive_electrode_is_a_transmission_line(base, contact, electrode, expected):
    """Fed at one end on both faces: coth(x)/x and Bessel functions, from far below to far above."""
    tau = 2 * RHO * CAPACITANCE * 0.1**2
    omega = np.array([0.3, 3.0, 30.0]) / tau
    table, _ = spectrum(plates(base, contact, electrode), omega / (2 * np.pi))
    Z = 1e6 * complex_of(table, "impedance_Mohm", "impedance_phase_deg")
    exact = np.array([expected(w) for w in omega])
    assert np.abs(Z / exact - 1).max() < 1e-3
    assert Z.real == pytest.approx(exact.real, rel=1e-3)
    if base is STRIP and contact == "left":  # as printed in the references' tables
        assert Z[[0, 2]] == pytest.approx(
            [3.331430e4 - 3.339994e5j, 1.290004e4 - 1.292225e4j], rel=1e-3
        )


@pytest.mark.once
def test_in_three_dimensions_it_is_the_same_line():
    """A strip fed at one end conducts along itself only."""
    tau = 2 * RHO * CAPACITANCE * 0.1**2
    omega = np.array([0.3, 3.0, 30.0]) / tau
    mesh = {"columns": 20, "film_rows": 1, "sectors": 2}
    given = plates(STRIP, "left", mesh=mesh, geometry={"space": "3d"})
    table, _ = spectrum(given, omega / (2 * np.pi))
    Z = 1e6 * complex_of(table, "impedance_Mohm", "impedance_phase_deg")
    assert np.abs(Z / [line.strip(SHEETS, w, 0.1, 0.02) for w in omega] - 1).max() < 1e-3


def test_terminals_of_a_stack_couple_through_the_electrode_between_them():
    """Two films on one resistive ground: reciprocal, and in sum what both wired together are."""
    films = [
        {"name": name, "thickness": f"{THICKNESS:.17g} mm", "material": "film"}
        for name in ("film", "second")
    ]
    ground = {"ground": {"on": "film.top", "ground": True}}
    hertz = np.array([1.0, 10.0]) / (2 * RHO * CAPACITANCE * 0.1**2) / (2 * np.pi)
    wired = {"both": {"on": ["film.bottom", "second.top"]}} | ground
    apart = {"low": {"on": "film.bottom"}, "high": {"on": "second.top"}} | ground

    def charges(terminals, of):
        given = plates(STRIP, "left", geometry={"layers": films}, terminals=terminals)
        table, _ = spectrum(given, hertz, of=of)
        return {
            name: complex_of(table, f"charge_uC_per_kV{end}", f"charge_phase_deg{end}")
            for name in terminals
            for end in ["." + name if len(terminals) > 2 else ""]
            if name != "ground"
        }

    one, other, both = charges(apart, "low"), charges(apart, "high"), charges(wired, "both")
    assert np.abs(one["high"]).min() > 0.1 * np.abs(both["both"]).min()
    assert one["high"] == pytest.approx(other["low"], rel=1e-9)
    total = sum(one.values()) + sum(other.values())
    assert total == pytest.approx(both["both"], rel=1e-9)


def test_faces_of_a_mesh_file_conduct_from_a_boundary(tmp_path):
    """The ring of `film`, fed at its outer edge."""
    written(tmp_path / "m.msh", film("quads"), 1, 0)
    given = {
        **{"name": "own", "mesh": {"order": 2}, "program": [{"stage": "rest"}]},
        "geometry": {"shape": "mesh", "file": str(tmp_path / "m.msh"), "space": "axisymmetric"},
        "materials": {"rubber": SOFT | {"bulk_modulus": "1 MPa"}},
        "terminals": {"hot": {"on": "above"}, "ground": {"on": "below", "ground": True}},
        **{"mounts": {}, "holds": [{"on": "outer", "fix": ["R", "Z"]}]},
    }
    sensing = {"sheet_resistance": f"{RHO} ohm"}
    with pytest.raises(ValueError, match="name the boundary of the mesh at which the electrodes"):
        Config.model_validate(given | {"sensing": sensing}).check_device()
    whole = Config.model_validate(given | {"sensing": sensing | {"contact": "outer"}})
    sheets = line.Sheets(RHO, RHO, 4.7 * 8.8541878128e-12 / 0.5e-3)
    # charge reaches far against the thickness, as a line assumes
    omega = np.array([0.1, 1.0]) / (2 * RHO * sheets.capacitance * 0.004**2)
    table, _ = spectrum(whole, omega / (2 * np.pi), of="hot")
    Z = 1e6 * complex_of(table, "impedance_Mohm", "impedance_phase_deg")
    exact = [line.annulus_from_outside(sheets, w, 0.008, 0.012) for w in omega]
    assert np.abs(Z / exact - 1).max() < 1e-3


def test_a_driver_in_series():
    """Resistance and inductance add to the impedance, and take their share of the voltage."""
    given = plates(STRIP, "left")
    given = given.model_copy(update={"sensing": type(given.sensing)()})
    hertz = np.array([1e3, 1e5])
    driver = Driver(resistance=5e-6, inductance=2e-12)  # 5 kohm, 2 mH
    alone, _ = spectrum(given, hertz)
    table, _ = spectrum(given, hertz, driver=driver)
    Z = complex_of(alone, "impedance_Mohm", "impedance_phase_deg")
    C = 1e-7 * 0.1 * 0.02
    exact = 1 / (2j * np.pi * hertz * C) / 1e6
    assert np.abs(Z / exact - 1).max() < 1e-6
    more = 5e-3 + 2j * np.pi * hertz * 2e-9
    seen = complex_of(table, "impedance_Mohm", "impedance_phase_deg")
    assert seen == pytest.approx(Z + more, rel=1e-9)
    charge = complex_of(table, "charge_uC_per_kV", "charge_phase_deg")
    assert charge == pytest.approx(
        complex_of(alone, "charge_uC_per_kV", "charge_phase_deg") * Z / seen, rel=1e-9
    )
    current = complex_of(table, "current_uA_per_kV", "current_phase_deg")
    assert current == pytest.approx(1e3 / seen, rel=1e-9)  # 1 kV over Mohm


def test_an_electrode_must_reach_its_contact():
    given = plates(
        STRIP,
        "left",
        terminals={
            "hot": {"on": "film.top", "within": ["10 mm", "90 mm"]},
            "ground": {"on": "film.bottom", "ground": True},
        },
    )
    with pytest.raises(ValueAt, match=r"of terminal 'hot' does not reach 'left'"):
        spectrum(given, [100.0], of="hot")


# --- between the frequencies that are solved ----------------------------------------------------


def test_frequencies_in_between_are_as_good_as_solved_ones():
    """On a film with modes in the band, a branch, damping, and resistive electrodes."""
    given = case("dynamics/spectrum", mesh__columns=12)
    *_, state = dealib.Simulation(at_rest(given, []))
    of = state.engine
    hertz = np.geomspace(1, 3e4, 60)
    with relaxed_state(of.newton, of.viscosity):
        response = Response(of.newton, of.viscosity, "terminal")
        solved, solve = [], response._pairs.solve

        def count(factors, right):
            solved.append(factors)
            return solve(factors, right)

        response._pairs.solve = count
        swept = [(c.values["plate"], c.duals["terminal"]) for c in response.at(hertz)]
        assert len(solved) < 40
        alone = [
            (c.values["plate"], c.duals["terminal"]) for f in hertz[::6] for c in response.at([f])
        ]
    ratio = np.array(swept)[::6] / np.array(alone)
    assert np.abs(ratio - 1).max() < 1e-8


def test_a_resonance_is_resolved():
    """Twenty frequencies miss it; with as many more the peak is that of a fine sweep."""
    given = loaded(
        "3 g",
        mesh={"columns": 12, "film_rows": 1},
        damping={"mass": "5 1/s"},
        program=[
            {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
            {"stage": "charge", "terminal": {"voltage": "2.5 kV"}, "steps": 3},
            {"stage": "let go", "mount": {"force": "-0.356 N"}},
        ],
    )
    even = np.geomspace(10, 1000, 20)
    coarse, more = (spectrum(given, even, more=n)[0] for n in (0, 20))
    near = even[coarse["displacement_mm_per_kV"].argmax()]
    fine, _ = spectrum(given, np.linspace(0.8 * near, 1.25 * near, 1000))
    most = [t["displacement_mm_per_kV"].max() for t in (coarse, more, fine)]
    assert most[0] < 0.5 * most[2]
    assert most[1] == pytest.approx(most[2], rel=0.1)
    assert len(more) <= 40
    assert set(even) <= set(more["frequency_Hz"])
    # what was asked for does not depend on what was added
    same = more.set_index("frequency_Hz").loc[even].to_numpy()
    assert same == pytest.approx(coarse.set_index("frequency_Hz").to_numpy(), rel=1e-6)


# --- sound ---------------------------------------------------------------------------------------

DOME = ("dynamics/loudspeaker", {"mesh.columns": 24})


def test_a_piston_in_a_wall():
    """On its axis rho c w (exp(-ikz) - exp(-ik s)); the power of any profile of the references."""
    r, omega, z = np.linspace(2.0, 20.0, 7), 2 * np.pi * 4e3, 50.0
    k, air = omega / sound.SPEED, references.Air(sound.DENSITY, sound.SPEED)
    w = np.full(7, 3.0 + 1j)
    exact = sound.DENSITY * sound.SPEED * w[0]
    exact *= np.exp(-1j * k * z) - np.exp(-1j * k * np.hypot(20.0, z))
    assert sound.on_axis(r, w, omega, z) == pytest.approx(exact, rel=1e-9)
    fine = np.linspace(0, 20.0, 400)
    bulge = 1 - (fine / 20.0) ** 2
    given = (lambda x: 1 - (x / 20.0) ** 2), 20.0, omega
    assert sound.power(fine, bulge, omega) == pytest.approx(references.power(*given, air), rel=1e-4)
    assert sound.on_axis(fine, bulge, omega, z) == pytest.approx(
        references.on_axis(*given, z, air), rel=1e-4
    )


def test_a_loudspeaker_sounds_by_the_volume_that_it_moves():
    """Where it is small against the wave, and the point far away; it resonates as its dome does."""
    given = at_rest(case(DOME[0], **{k.replace(".", "__"): v for k, v in DOME[1].items()}), [])
    modes = ModesWatch((), None, 1)
    for state in dealib.Simulation(given):
        modes(state)
    hertz, far = np.array([20.0, 100.0, modes.rows[0]["frequency_Hz"]]), 2000.0
    found = SpectrumWatch(None, "terminal", hertz, distance=far)
    for state in dealib.Simulation(given):
        found(state)
    table = pd.DataFrame(found.rows)
    omega = 2 * np.pi * hertz
    volume = complex_of(table, "volume_mm3_per_kV", "volume_phase_deg")
    k = omega / sound.SPEED
    exact = -sound.DENSITY * omega**2 * volume * np.exp(-1j * k * far) / (2 * np.pi * far) * 1e6
    heard = complex_of(table, "sound_pressure_Pa_per_kV", "sound_phase_deg")
    assert np.abs(heard / exact - 1).max() < 0.01
    power = sound.DENSITY * omega**4 * np.abs(volume) ** 2 / (4 * np.pi * sound.SPEED)
    assert table["sound_power_mW_per_kV2"].to_numpy() == pytest.approx(power, rel=0.01)
    assert table["apex_mm_per_kV"][2] > 20 * table["apex_mm_per_kV"][0]
    # the column of the probe is the displacement that a little voltage gives
    assert table["apex_phase_deg"][0] == pytest.approx(0, abs=2)


def test_sound_is_that_of_flat_bodies_of_revolution():
    with pytest.raises(ConfigError, match="sound: only for a disc or an annulus"):
        spectrum(beam(), [10.0], distance=100.0)


# --- circuits ------------------------------------------------------------------------------------

PARTS = {"C": 400e-12, "Rs": 12e3, "Rp": 5e9, "Cm": 40e-12, "Lm": 2.5e5, "Rm": 4e6}


@pytest.mark.once
@pytest.mark.parametrize(
    "kept", [("C",), ("C", "Rs"), ("C", "Rs", "Rp"), ("C", "Rs", "Cm", "Lm", "Rm"), tuple(PARTS)]
)
def test_a_circuit_is_found_again(kept):
    """Its parts, and no others, within their intervals."""
    parts = {name: PARTS[name] for name in kept}
    hertz = np.geomspace(0.5, 1e5, 300)
    noise = np.random.default_rng(3).normal(0, 1e-4, (2, 300))
    Z = circuit.impedance(parts, hertz) * np.exp(noise[0] + 1j * noise[1])
    found = circuit.fit(hertz, Z)
    assert {v.name for v in found.values} == set(kept)
    for v in found.values:
        assert v.value == pytest.approx(parts[v.name], rel=0.02)
        assert v.low < v.high
        width = np.log(v.high / v.low) / 2  # a parameter may be off by twice its interval
        assert abs(np.log(v.value / parts[v.name])) < 2 * width
    assert found.misfit == pytest.approx(1.4e-4, rel=0.2)


# --- the command and its example -----------------------------------------------------------------

SPRING = "--set=program.0={stage: push, mount: {force: -0.05 N}, steps: 2}"


@pytest.mark.once
def test_the_spectrum_of_the_gallery():
    """A resonance on a capacitor; far above it the electrodes keep the charge out."""
    given = at_rest(case("dynamics/spectrum", mesh__columns=20), [])
    found = SpectrumWatch(None, "terminal", np.geomspace(1, 1e6, 121))
    for state in dealib.Simulation(given):
        found(state)
    table = pd.DataFrame(found.rows)
    k = table["displacement_mm_per_kV"].argmax()
    assert 28 < table["frequency_Hz"][k] < 32
    C = table["parallel_capacitance_pF"].to_numpy()
    assert C[0] == pytest.approx(724.4, rel=0.01)
    assert C[0] > 1.01 * C[60]  # which does not move any more
    assert (np.diff(C[80:]) < 0).all()
    phase = table["impedance_phase_deg"].to_numpy()
    assert phase[60] == pytest.approx(-89, abs=1.5)
    assert phase[-1] == pytest.approx(-45, abs=3)  # a diffusion


@pytest.mark.once
def test_phases_are_drawn_as_they_are_with_gaps_where_they_jump():
    """Points are far apart: no turn is added that none of them tells of."""
    table = pd.DataFrame(
        {
            "frequency_Hz": [1.0, 10.0, 100.0, 1000.0],
            "displacement_mm_per_kV": 1.0,
            "phase_deg": [-170.0, 170.0, 20.0, -175.0],
        }
    )
    figure = draw_bode(table, "", LIGHT)
    (line,) = figure.axes[1].lines
    plt.close(figure)
    assert line.get_ydata() == pytest.approx([-170, np.nan, 170, 20, np.nan, -175], nan_ok=True)
    assert np.isfinite(line.get_xdata()).sum() == 4


@pytest.mark.once
def test_the_command(small, tmp_path):  # noqa: F811 - the fixture
    out = tmp_path / "response"
    given = ["respond", small, "--set", DENSITY, SPRING, "--from", "1 Hz", "--to", "2 kHz"]
    given += ["--out", out, "--points", "30"]
    done = command(*given, "--series-resistance", "10 kohm", "--series-inductance", "1 mH")
    assert done.exit_code == 0, done.output + repr(done.exception)
    table = pd.read_csv(out / "response.csv")
    even = np.geomspace(1, 2000, 30)
    assert 30 < len(table) <= 60  # and a resonance or two
    assert np.isin(even.round(6), table["frequency_Hz"].round(6)).all()
    assert table["frequency_Hz"].is_monotonic_increasing
    assert table["frequency_Hz"].iloc[[0, -1]].to_list() == pytest.approx([1, 2000])
    for name in ("displacement_mm_per_kV", "phase_deg", "impedance_Mohm", "loss_tangent"):
        assert np.isfinite(table[name]).all()
    for name in ("circuit.csv", "plots/bode.png", "plots/nyquist.png", "history.csv"):
        assert (out / name).is_file()
    assert "equivalent circuit" in done.output
    assert "displacement_mm_per_kV: largest" in done.output
    parts = pd.read_csv(out / "circuit.csv").set_index("part")
    assert parts["value"]["Rs"] == pytest.approx(1e4, rel=0.2)
    again = command(*given)
    assert isinstance(again.exception, ConfigError)
    assert command(*given, "--overwrite", "--no-refine").exit_code == 0
    assert len(pd.read_csv(out / "response.csv")) == 30
    assert "--overwrite" in str(again.exception)


@pytest.mark.once
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--from", "5 Hz", "--to", "1 Hz"], "two frequencies above zero, the lower first"),
        (["--from", "1", "--to", "1 Hz"], "--from: expected a frequency with its unit"),
        (["--from", "1 Hz", "--to", "1 mm"], "'mm' is not a unit of that kind"),
        (["--from", "1 Hz", "--to", "9 Hz", "--of", "terminl"], "did you mean 'terminal'?"),
        (["--from", "1 Hz", "--to", "9 Hz", "--at", "psh"], "did you mean 'push'?"),
        (["--from", "1 Hz", "--to", "9 Hz", "--series-resistance", "1 N"], "--series-resistance: "),
    ],
)
def test_what_it_refuses(small, options, said):  # noqa: F811
    done = command("respond", small, "--set", DENSITY, *options)
    assert isinstance(done.exception, ConfigError)
    assert said in str(done.exception)


@pytest.mark.once
@pytest.mark.mpi
def test_on_two_ranks_as_on_one(tmp_path):
    tables = []
    for ranks in (1, 2):
        out = tmp_path / f"on{ranks}"
        path = CONFIGS / "dynamics/spectrum.yaml"
        line = [mpirun(), "-n", str(ranks), sys.executable, "-m", "dealib", "respond", str(path)]
        line += ["--set", "mesh.columns=12", "--out", str(out), "--from", "1 Hz", "--to", "10 kHz"]
        line += ["--points", "20"]
        done = subprocess.run(
            line, env=environment(), capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        assert done.returncode == 0, done.stderr
        tables.append(pd.read_csv(out / "response.csv"))
    assert tables[1]["frequency_Hz"].to_list() == tables[0]["frequency_Hz"].to_list()
    one, other = (complex_of(t, "displacement_mm_per_kV", "phase_deg") for t in tables)
    far = np.abs(one) < 3 * np.abs(one[0])  # rounding of the stiffness counts Q times at resonance
    assert far.sum() > 20
    for name in ("impedance_Mohm", "charge_uC_per_kV", "parallel_capacitance_pF"):
        expected, found = (table[name].to_numpy() for table in tables)
        assert found[far] == pytest.approx(expected[far], rel=1e-8), name
        assert found == pytest.approx(expected, rel=1e-6), name
    assert np.abs(other - one)[far].max() < 1e-8 * np.abs(one[far]).max()
    assert np.abs(other / one - 1).max() < 1e-6


@pytest.mark.once
@pytest.mark.slow
def test_a_fit_to_a_spectrum_finds_what_it_was_made_with(small, tmp_path):  # noqa: F811
    """Stiffness and damping from the resonance of a plate, as a vibrometer sees it."""
    text = small.read_text().replace("prestretch: 1.2}", "prestretch: 1.2, density: 1000 kg/m^3}")
    text = text.replace("mount: {displacement: -1 mm}", "mount: {mass: 5 g}")
    text += "damping: {mass: 30 1/s}\n"
    small.write_text(text.replace("youngs_modulus: 1 MPa", "youngs_modulus: 1.1 MPa"))
    hertz = ["--from", "10 Hz", "--to", "100 Hz", "--points", "60"]
    made = command("respond", small, *hertz, "--at", "charge", "--out", tmp_path / "true")
    assert made.exit_code == 0, repr(made.exception)
    table = pd.read_csv(tmp_path / "true" / "response.csv")[["frequency_Hz"]]
    table["displacement [um/kV]"] = (
        1e3 * pd.read_csv(tmp_path / "true" / "response.csv")["displacement_mm_per_kV"]
    )
    table.to_csv(tmp_path / "vibrometer.csv", index=False)
    (tmp_path / "fit.yaml").write_text(
        "name: fit\nbase: small.yaml\nset: {materials.film.youngs_modulus: 1 MPa}\n"
        "parameters:\n"
        "  materials.film.youngs_modulus: {start: 1 MPa, min: 0.7 MPa, max: 1.5 MPa}\n"
        "  damping.mass: {start: 20 1/s, min: 5 1/s, max: 100 1/s}\n"
        "data:\n  - {file: vibrometer.csv, stage: charge,"
        " spectrum: {band: [10 Hz, 100 Hz], points: 200}}\n"
    )
    given = ["calibrate", tmp_path / "fit.yaml", "--out", tmp_path / "fit", "-j", "1"]
    done = command(*given, "--cache", tmp_path / "cases")
    assert done.exit_code == 0, done.output + repr(done.exception)
    found = pd.read_csv(tmp_path / "fit" / "parameters.csv", index_col=0).iloc[:, 0]
    assert float(found["materials.film.youngs_modulus"]) == pytest.approx(1.1, rel=2e-3)
    assert float(found["damping.mass"]) == pytest.approx(30, rel=0.02)
