"""A device as an FMU: against dealib along trajectories, its energy, its bounds, wrong use."""

import os
import shutil
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackLoggerTYPE
from fmpy.validation import validate_fmu

import dealib
from dealib.errors import ConfigError
from dealib.export.fmu import write_fmu
from dealib.program.tables import tables_case
from dealib.results.tables import DeviceTables, collect

pytestmark = pytest.mark.once  # C code, from stored tables
STRIP = Path(__file__).parent / "viscous.yaml"
GRID = {"tables.displacement": "[0 mm, -2.5 mm]", "tables.voltage": "[0 V, 3 kV]"}
HEAVY = {"materials.film.density": "960 kg/m^3", "materials.electrode.density": "1100 kg/m^3"}
SETS = GRID | HEAVY | {
    "tables.points": "[11, 7]",
    "output.fields": "none",
    "mounts": "{plate: {on: inner, along: Z, mass: 2 g}}",
    "damping.mass": "20 1/s",
    "materials.electrode.branches": "[{shear_modulus: 200 kPa, relaxation_time: 2 s, "
    "evolution: network}]",
}  # fmt: skip
ELASTIC = {"materials.film.branches": "[]", "materials.electrode.branches": "[]"}
REST = [{"stage": "prestrain"}]
OUTPUTS = ["plate.force", "terminal.charge", "plate.displacement", "plate.displacement_rate"]


def strip(program, **more):
    stages = {"program": program} if program else {}
    return dealib.load(STRIP, set=SETS | more | stages)


def export(out, *options, env=None):
    sets = [f"--set={key}={value}" for key, value in SETS.items()]
    command = [sys.executable, "-m", "dealib", "export", str(STRIP), *sets, "--out", str(out)]
    return subprocess.run(
        [*command, *options], capture_output=True, text=True, cwd=CONFIGS.parent, env=env
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """FMUs of the strip with branches, from the command line, and of the elastic one."""
    folder = tmp_path_factory.mktemp("fmu") / "tables"
    done = export(folder, "--fmu")
    assert done.returncode == 0, done.stderr
    run = dealib.open(folder)
    tables = collect(run)
    write_fmu(folder / "elastic.fmu", run, tables, strip(None, **ELASTIC).config)
    return folder / "viscous.fmu", folder / "elastic.fmu", tables, done.stdout


class Slave:
    """An instance of an FMU, its variables by their names."""

    def __init__(self, path):
        self.folder, self.told = extract(path), []
        model = read_model_description(path)
        self.of = {v.name: v.valueReference for v in model.modelVariables}
        name = model.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(
            guid=model.guid, unzipDirectory=self.folder, modelIdentifier=name, instanceName="one"
        )
        logger = fmi2CallbackLoggerTYPE(lambda *told: self.told.append((told[2], told[4].decode())))
        self.calls = type(defaultCallbacks).from_buffer_copy(defaultCallbacks)
        self.calls.logger = self.logger = logger
        self.fmu.instantiate(callbacks=self.calls)
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def set(self, **values):
        for name, value in values.items():
            of = [self.of[name.replace("__", ".")]]
            (self.fmu.setBoolean if isinstance(value, bool) else self.fmu.setReal)(of, [value])

    def get(self, *names):
        return np.array(self.fmu.getReal([self.of[name] for name in names]))

    def step(self, h, **rates):
        for name, rate in rates.items():
            self.fmu.setRealInputDerivatives([self.of[name.replace("__", ".")]], [1], [rate])
        return self.fmu.fmi2DoStep(self.fmu.component, 0.0, h, 1)


@contextmanager
def slave(path, **values):
    one = Slave(path)
    try:
        one.set(**values)
        yield one
    finally:
        one.fmu.freeInstance()
        shutil.rmtree(one.folder)


def follow(path, t, inputs, outputs=OUTPUTS, parts=1, **parameters):
    """Outputs along straight inputs between times, (times, outputs)."""
    first = {name: values[0] for name, values in inputs.items()}
    with slave(path, **parameters, **first) as one:
        one.fmu.exitInitializationMode()
        rows = [one.get(*outputs)]
        for k, h in enumerate(np.diff(t)):
            one.set(**{name: values[k] for name, values in inputs.items()})
            rates = {n: (v[k + 1] - v[k]) / h if h > 0 else 0.0 for n, v in inputs.items()}
            for _ in range(parts):
                one.step(h / parts, **rates)
            one.set(**{name: values[k + 1] for name, values in inputs.items()})
            rows.append(one.get(*outputs))
    return np.array(rows)


def history(case):
    return pd.DataFrame([state.row for state in dealib.Simulation(case)])


def driven(h):
    """Inputs of a history whose ports are prescribed."""
    return {
        "plate__displacement_in": h["displacement_mm"].to_numpy() / 1e3,
        "terminal__voltage": h["voltage_kV"].to_numpy() * 1e3,
    }


def test_file_is_valid_and_tells_units(made):
    path, *_, said = made
    assert validate_fmu(str(path)) == []
    assert "viscous.fmu: branches at" in said
    with zipfile.ZipFile(path) as file:
        assert set(file.namelist()) == {
            "modelDescription.xml", "binaries/linux64/viscous.so", "sources/device.c",
            "sources/tables.h",
        }  # fmt: skip
    model = read_model_description(path)
    units = {v.name: (v.unit, v.causality) for v in model.modelVariables}
    assert units == {
        "plate.displacement_in": ("m", "input"),
        "plate.force_in": ("N", "input"),
        "plate.force": ("N", "output"),
        "plate.displacement": ("m", "output"),
        "plate.displacement_rate": ("m/s", "output"),
        "plate.mass": ("kg", "parameter"),
        "plate.damping": ("N.s/m", "parameter"),
        "plate.displacement_start": ("m", "parameter"),
        "plate.force_driven": (None, "parameter"),
        "terminal.voltage": ("V", "input"),
        "terminal.charge": ("C", "output"),
        "energy": ("J", "output"),
    }
    # of a truss between two walls of which one moves, a third of the mass follows
    start = {v.name: v.start for v in model.modelVariables}
    film = np.pi * (12**2 - 8**2) * (0.05 * 960 + 2 * 0.01 * 1100) * 1e-9
    assert 0.25 * film < float(start["plate.mass"]) - 2e-3 < 0.35 * film
    assert float(start["plate.damping"]) == pytest.approx(20 * float(start["plate.mass"]))


def test_sources_compile_without_a_warning(made, tmp_path):
    path, *_ = made
    with zipfile.ZipFile(path) as file:
        file.extractall(tmp_path)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror", "-O1", "-c"]
    subprocess.run(["cc", *flags, "device.c"], check=True, cwd=tmp_path / "sources")


@pytest.mark.parametrize("duration", [0.4, 20])
def test_viscous_cycles_fast_and_slow(made, duration):
    """Force and charge of a displacement cycle under a voltage, and what it loses."""
    program = [
        {"stage": "on", "duration": "5 s", "terminal": {"voltage": "2 kV"}, "steps": 4},
        {
            "stage": "cycle",
            "duration": f"{duration} s",
            "mount": {"displacement": ["0 mm", "-2.2 mm", "-0.2 mm"]},
            "terminal": {"voltage": ["2 kV", "2.9 kV", "0.5 kV"]},
            "steps": 40,
        },
        {"stage": "hold", "duration": "5 s", "steps": 10},
    ]
    h = history(strip(program))
    found = follow(made[0], h["time_s"].to_numpy(), driven(h))
    elastic = follow(made[1], h["time_s"].to_numpy(), driven(h))
    for k, name in enumerate(["force_N", "charge_uC"]):
        exact = h[name] * (1e-6 if k else 1)
        assert np.abs(found[:, k] - exact).max() < 3e-3 * np.ptp(exact), name
    viscous = np.abs(elastic[:, 0] - h["force_N"]).max()
    assert viscous > 0.08 * np.ptp(h["force_N"])
    assert np.abs(found[:, 0] - h["force_N"]).max() < 0.03 * viscous


def test_elastic_trajectory_and_the_tables_themselves(made):
    program = [
        {"stage": "push", "mount": {"displacement": "-1.93 mm"}, "steps": 7},
        {"stage": "on", "terminal": {"voltage": "2.7 kV"}, "steps": 6},
        {"stage": "back", "mount": {"displacement": "-0.37 mm"}, "steps": 6},
    ]
    h = history(strip(program, **ELASTIC))
    found = follow(made[1], h["time_s"].to_numpy(), driven(h))
    assert np.abs(found[:, 0] - h["force_N"]).max() < 5e-4 * np.ptp(h["force_N"])
    assert np.abs(found[:, 1] * 1e6 - h["charge_uC"]).max() < 1e-4 * np.ptp(h["charge_uC"])
    at = h["displacement_mm"].to_numpy(), h["voltage_kV"].to_numpy()
    assert found[:, 0] == pytest.approx(made[2].force(*at), abs=1e-12)
    assert found[:, 1] * 1e6 == pytest.approx(made[2].charge(*at), abs=1e-12)


def test_an_elastic_cycle_does_no_net_work(made):
    """Around a closed path between two nodes, by Gauss points on which the forces are exact."""
    x, w = np.polynomial.legendre.leggauss(20)
    corners = np.array([[-1.0, 0.5], [-1.24, 0.5], [-1.24, 0.99], [-1.0, 0.99], [-1.0, 0.5]])
    work = largest = 0.0
    with slave(made[1]) as one:
        for a, b in pairwise(corners):
            part = 0.0
            for s, weight in zip((1 + x) / 2, w / 2, strict=True):
                u, V = a + s * (b - a)
                one.set(plate__displacement_in=1e-3 * u, terminal__voltage=1e3 * V)
                F, Q = one.get("plate.force", "terminal.charge")
                part += weight * (F * (b - a)[0] * 1e-3 - Q * (b - a)[1] * 1e3)
            work, largest = work + part, max(largest, abs(part))
    assert abs(work) < 1e-12 * largest


def test_a_free_vibration_keeps_its_energy(made):
    given = {"plate__force_driven": True, "plate__damping": 0.0, "plate__mass": 3e-3}
    given |= {"plate__displacement_start": -1.5e-3, "terminal__voltage": 1500.0}
    names = ["energy", "plate.displacement", "plate.displacement_rate"]
    E, u, v = follow(made[1], np.linspace(0, 0.5, 501), {"plate__force_in": np.zeros(501)},
                     names, **given).T  # fmt: skip
    assert np.ptp(u) > 2.5e-3  # to the other side of zero, where the tables go on
    total = E + 3e-3 / 2 * v**2
    assert np.ptp(total) < 1e-3 * np.ptp(E)
    assert abs(np.mean(total[-100:]) - np.mean(total[:100])) < 1e-4 * np.ptp(E)


def test_motion_under_a_weight_after_a_step_of_the_voltage(made):
    """A plate that hangs on the film, with branches, its own mass and that of the film."""
    weight = {"mount": {"mass": "3 g"}}
    volt = {"terminal": {"voltage": {"to": "2.5 kV", "rise": "1 ms"}}}
    program = [
        {"stage": "pull", "duration": "100 s", "mount": {"force": "-0.25 N"}, "steps": 5},
        {"stage": "hang", "duration": "1000 s", **weight, "steps": 5},
        {"stage": "switch on", "dynamic": True, "duration": "0.1 s", "steps": 100, **volt},
    ]
    h = history(strip(program))
    start = h.index[h["stage"] == "hang"][-1]
    h = h.iloc[start:].reset_index(drop=True)
    (path, *_) = made
    model = read_model_description(path)
    mass = next(float(v.start) for v in model.modelVariables if v.name == "plate.mass") + 3e-3
    inputs = {"plate__force_in": np.full(len(h), h["force_N"][0])}
    inputs["terminal__voltage"] = h["voltage_kV"].to_numpy() * 1e3
    found = follow(
        path, h["time_s"].to_numpy(), inputs, parts=1, plate__force_driven=True,
        plate__mass=mass, plate__damping=20 * mass,
        plate__displacement_start=h["displacement_mm"][0] / 1e3,
    )  # fmt: skip
    u = h["displacement_mm"].to_numpy()
    assert np.ptp(u) > 0.1
    assert np.abs(found[:, 2] * 1e3 - u).max() < 0.01 * np.ptp(u)


def test_a_tool_simulates_it(made):
    t = np.linspace(0, 1, 11)
    columns = [(name, float) for name in ("time", "plate.displacement_in", "terminal.voltage")]
    course = np.array([(x, -1e-3 * x, 2000 * x) for x in t], dtype=columns)
    result = simulate_fmu(
        str(made[1]), stop_time=1.0, output_interval=0.1, input=course, set_input_derivatives=True,
        output=["plate.force"], start_values={"plate.force_in": 0.0},
    )  # fmt: skip
    assert result["plate.force"][-1] == pytest.approx(made[2].force(-1.0, 2.0), rel=1e-6)


def test_beyond_the_tables_it_goes_on_straight_and_says_so_once(made):
    with slave(made[0], terminal__voltage=1000.0) as one:
        one.fmu.exitInitializationMode()
        for u in (-2.4e-3, -2.5e-3):
            one.set(plate__displacement_in=u)
            assert one.step(1e6) == 0
        forces = []
        for k, u in enumerate((-2.6e-3, -2.7e-3, -2.8e-3)):
            one.set(plate__displacement_in=u)
            assert one.step(1e-9) == (1 if k == 0 else 0)
            forces.append(one.get("plate.force")[0])
        assert one.told == [(1, "plate is beyond the tables: the answers are extrapolated")]
        one.fmu.reset()
        assert one.step(1e-9) == 0
    with slave(made[1], terminal__voltage=1000.0) as one:
        forces = []
        for u in (-2.5e-3, -2.6e-3, -2.9e-3, -3.2e-3):
            one.set(plate__displacement_in=u)
            forces.append(one.get("plate.force")[0])
        slopes = np.diff(forces) / [1e-4, 3e-4, 3e-4]
        assert slopes == pytest.approx(slopes[0], rel=1e-9)
        assert -slopes[0] == pytest.approx(1e3 * made[2].stiffness(-2.5, 1.0), rel=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_is_no_number_is_an_error(made, value):
    with slave(made[0]) as one:
        one.fmu.exitInitializationMode()
        one.set(plate__displacement_in=value)
        with pytest.raises(Exception, match="fmi2DoStep failed with status 3"):
            one.step(1e-3)
        assert (3, "a value is infinite or not a number") in one.told


def test_a_force_needs_a_mass(made):
    with slave(made[1], plate__force_driven=True, plate__mass=0.0) as one:
        with pytest.raises(Exception, match="fmi2ExitInitializationMode failed with status 3"):
            one.fmu.exitInitializationMode()
        assert one.told == [(3, "plate is driven by its force, which needs a mass above zero")]


def test_a_speck_of_dust_takes_no_ages(made):
    with slave(made[1], plate__force_driven=True, plate__mass=1e-15) as one:
        one.fmu.exitInitializationMode()
        with pytest.raises(Exception, match="fmi2DoStep failed with status 3"):
            one.step(1.0)
        assert one.told == [(3, "a mass is too small for its stiffness and this step")]


def test_state_is_kept_and_given_back(made):
    """Also as bytes: the branches go with it."""
    with slave(made[0]) as one:
        one.fmu.exitInitializationMode()
        one.step(1.0, plate__displacement_in=-2e-3)
        state = one.fmu.getFMUstate()
        data = one.fmu.serializeFMUstate(state)
        one.step(2.0)
        first = one.get(*OUTPUTS)
        one.fmu.setFMUstate(state)
        before = one.get(*OUTPUTS)
        one.step(2.0)
        assert (one.get(*OUTPUTS) == first).all()
        one.fmu.freeFMUstate(state)
        again = one.fmu.deSerializeFMUstate(data)
        one.fmu.setFMUstate(again)
        assert (one.get(*OUTPUTS) == before).all()
        assert before[0] != pytest.approx(first[0], rel=1e-3)
        one.fmu.freeFMUstate(again)


@pytest.mark.parametrize(
    ("name", "sets", "axes"),
    [
        (
            "segmented_annulus",
            {
                "tables.displacement": "[0 mm, -1 mm]",
                "tables.voltage": "{drive: [0 kV, 1 kV], sense: [0 kV, 1 kV]}",
            },
            {"displacement_mm": (1e-3, "mount.displacement_in", "mount.force", 1.0),
             "voltage_kV.drive": (1e3, "drive.voltage", "drive.charge", 1e-6),
             "voltage_kV.sense": (1e3, "sense.voltage", "sense.charge", 1e-6)},
        ),
        (
            "annulus_with_chamber",
            {"tables.pressure": "[0 kPa, 1 kPa]", "tables.voltage": "[0 kV, 1 kV]"},
            {"voltage_kV": (1e3, "terminal.voltage", "terminal.charge", 1e-6),
             "pressure_kPa": (1e3, "below.pressure", "below.volume", 1e-9)},
        ),
    ],
)  # fmt: skip
def test_other_ports_and_three_of_them(tmp_path, name, sets, axes):
    """Of a cubic energy, which the interpolant holds exactly: values, units, signs."""
    given = dealib.load(CONFIGS / "devices" / f"{name}.yaml", set=sets)
    grids = {
        given.config.device.column(n): np.sort(g) for n, g in given.config.tables.grids.items()
    }
    columns = {
        "displacement_mm": "force_N",
        "pressure_kPa": "volume_mm3",
        "voltage_kV": "charge_uC",
    }
    grids = {n: g / (1e-3 if n.startswith("pressure") else 1) for n, g in grids.items()}
    X = np.meshgrid(*grids.values(), indexing="ij")
    weight = [0.3, 0.7, 1.1][: len(X)]
    s = 1 + sum(w * x for w, x in zip(weight, X, strict=True))
    values = {"potential_mJ": s**3}
    for n, w in zip(grids, weight, strict=True):
        stem, dot, port = n.partition(".")
        sign = {"displacement_mm": 1.0, "voltage_kV": -1.0, "pressure_kPa": -1e3}[stem]
        values[columns[stem] + dot + port] = sign * 3 * w * s**2
    tables = DeviceTables({**grids, **values})
    write_fmu(tmp_path / "d.fmu", None, tables, given.config)
    at = [-0.37, 0.61, 0.83][-len(X) :] if len(X) == 3 else [0.61, 0.83]
    with slave(tmp_path / "d.fmu") as one:
        for n, x in zip(grids, at, strict=True):
            scale, variable, *_ = axes[n]
            one.set(**{variable.replace(".", "__"): x * scale})
        for n in grids:
            _, _, variable, unit = axes[n]
            stem, dot, port = n.partition(".")
            dual = {"displacement_mm": "force", "pressure_kPa": "volume", "voltage_kV": "charge"}
            exact = tables.dual(dual[stem] + dot + port, *at)
            assert one.get(variable)[0] == pytest.approx(exact * unit, rel=1e-12)
        s = 1 + sum(w * x for w, x in zip(weight, at, strict=True))
        assert one.get("energy")[0] == pytest.approx(1e-3 * s**3, rel=1e-3)


@pytest.mark.parametrize("name", ["left-top", 'a "b"}; x', "50 %s%n", "ü\\u", "<&>"])
def test_names_are_nothing_but_names(tmp_path, name):
    """In C, XML and the log."""
    mounts = {name: {"on": "inner", "along": "Z"}}
    given = dealib.load(CONFIGS / "tables.yaml", set={"mounts": mounts, "program": REST})
    x, y = np.linspace(-2.5, -0.5, 3), np.linspace(0, 2.5, 3)
    U, V = np.meshgrid(x, y, indexing="ij")
    duals = {"potential_mJ": U**2 - V**2, "force_N": 2 * U, "charge_uC": 2 * V}
    tables = DeviceTables({"displacement_mm": x, "voltage_kV": y, **duals})
    write_fmu(tmp_path / "d.fmu", None, tables, given.config)
    assert validate_fmu(str(tmp_path / "d.fmu")) == []
    with slave(tmp_path / "d.fmu", **{f"{name}.displacement_in": -3e-3}) as one:
        assert one.get(f"{name}.force") == pytest.approx(-6.0)
        one.fmu.exitInitializationMode()
        told = f"{name} is beyond the tables: the answers are extrapolated".replace("%", "_")
        assert one.told == [(1, told)]


def test_wrong_use_is_told(made, tmp_path):
    out = tmp_path / "t"
    done = export(out, "--fmu", env=os.environ | {"CC": "no-such-cc"})
    assert done.returncode == 4
    assert "an FMU needs a C compiler, and there is no no-such-cc: install gcc" in done.stderr
    assert not out.exists()
    folder = made[0].parent
    before = made[0].read_bytes()
    done = export(folder, "--fmu")
    assert done.returncode == 2
    assert "exists and is not empty" in done.stderr
    assert made[0].read_bytes() == before
    with pytest.raises(ConfigError, match="tables need two or three variables, not 1"):
        dealib.load(CONFIGS / "deap100.yaml", set={"tables.voltage": "[0 V, 2 kV]"})
    with pytest.raises(ConfigError, match="the key tables is missing"):
        tables_case(dealib.load(CONFIGS / "deap100.yaml"), fmu=True)
    told = r"materials.\w+ has branches: its force depends on time, which tables lack; fmu=True"
    with pytest.raises(ConfigError, match=told):
        tables_case(strip(None))
    voltages = {"tables.voltage": "{drive: [0 kV, 1 kV], sense: [0 kV, 1 kV]}"}
    law = {"materials.film.branches": "[{shear_modulus: 10 kPa, relaxation_time: 1 s}]"}
    path = CONFIGS / "devices" / "segmented_annulus.yaml"
    with pytest.raises(ConfigError, match="in an FMU only displacements and rotations strain them"):
        tables_case(dealib.load(path, set=voltages | law), fmu=True)


def test_states_that_are_not_stored_are_missed(made, tmp_path):
    """As after `dealib export` without --fmu."""
    folder = tmp_path / "t"
    shutil.copytree(made[0].parent, folder)
    with h5py.File(folder / "results.h5", "a") as file:
        for name in list(file["states"])[1:]:
            del file["states"][name]
    run = dealib.open(folder)
    with pytest.raises(
        ConfigError, match="its fields are not stored; solve it again by overwrite=True"
    ):
        write_fmu(folder / "viscous.fmu", run, collect(run), strip(None).config)
