"""What drivers and sensors see: capacitances, resistance, cycles, displacement from capacitance."""

import json

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS, case, history
from typer.testing import CliRunner
from verification.bench import Bench
from verification.free_block import EPSILON, RADII, THICKNESS, block, charge_at, mooney_rivlin_of

import dealib
from dealib.cli.app import app
from dealib.cli.sense import sense
from dealib.device.bases import Annulus
from dealib.errors import ConfigError
from dealib.fem.differential import port_stiffness
from dealib.report import facts
from dealib.results.cycles import cycles
from dealib.results.electrodes import Rings
from dealib.results.sensing import CapacitanceMap, check_device

SMALL = CONFIGS.parent / "tests" / "small.yaml"


def small(**changes):
    return dealib.load(SMALL, set={k.replace("__", "."): v for k, v in changes.items()})


def rows(given):
    return [state.row for state in dealib.Simulation(given)]


# --- differential capacitance --------------------------------------------------------------------


def test_free_block_by_its_closed_form():
    """Neo-Hooke: phi^2 = l^-2 - l^-8 and Q ~ l^4 phi, so dQ/dV ~ l^4 + 4 l^3 phi dl/dphi."""
    bench = block(mooney_rivlin_of(0.0), 1e5)
    for l in (1.1, 1.2):
        phi = np.sqrt(l**-2 - l**-8)
        bench.load(steps=2, terminal=charge_at(phi, l))
        rest = EPSILON * np.pi * (RADII[1] ** 2 - RADII[0] ** 2) / THICKNESS
        slope = (-2 * l**-3 + 8 * l**-9) / (2 * phi)  # dphi/dl
        expected = rest * (l**4 + 4 * l**3 * phi / slope)
        assert -port_stiffness(bench.newton)[0, 0] == pytest.approx(expected, rel=2e-4)
        assert bench.charge / bench.voltage == pytest.approx(rest * l**4, rel=1e-5)


@pytest.mark.parametrize("air", [False, True])
def test_port_stiffness_by_finite_differences(air):
    changes = {"geometry__air_height": "3 mm"} if air else {}
    bench = Bench(small(**changes).config).move(steps=4, mount=-1.0).move(steps=2, terminal=1.5)
    found, force = port_stiffness(bench.newton), bench.force
    assert bench.force == force == bench.system.internal["mount"]  # the state is as it was
    expected = np.empty((2, 2))
    for k, (port, h) in enumerate((("mount", 0.01), ("terminal", 0.02))):
        at = {"mount": -1.0, "terminal": 1.5}
        ends = []
        for sign in (1, -1):
            bench.move(**{**at, port: at[port] + sign * h})
            ends.append((bench.force, -bench.charge))
        expected[:, k] = np.subtract(*ends) / (2 * h)
        bench.move(**at)
    scale = np.sqrt(np.abs(np.outer(np.diag(expected), np.diag(expected))))
    assert np.abs(found - expected).max() < 3e-4 * scale.max()
    assert found[0, 1] == pytest.approx(found[1, 0], abs=1e-6 * scale.max())  # reciprocity


def test_capacitance_with_a_free_mount_is_larger_than_with_a_blocked_one():
    program = "[{stage: load, mount: {force: -0.1 N}, steps: 4}, {stage: up, duration: 2 s, "
    program += "terminal: {voltage: 2 kV}, steps: 40}]"
    h = rows(small(sensing__differential="true", program=program))[5:]
    V, Q, free, blocked = (
        np.array([r[k] for r in h])
        for k in (
            "voltage_kV",
            "charge_uC",
            "differential_capacitance_pF",
            "blocked_capacitance_pF",
        )
    )
    slopes = 1e3 * (Q[2:] - Q[:-2]) / (V[2:] - V[:-2])
    assert free[1:-1] == pytest.approx(slopes, rel=2e-4)
    assert (free > blocked).all()
    assert free[-1] > 1.02 * blocked[-1]
    at_rest = rows(small(sensing__differential="true", program="[{stage: rest}]"))[0]
    # at 0 V all three are the same
    assert at_rest["differential_capacitance_pF"] == pytest.approx(at_rest["capacitance_pF"])
    assert at_rest["blocked_capacitance_pF"] == pytest.approx(at_rest["capacitance_pF"])


# --- electrodes ----------------------------------------------------------------------------------


RING = Annulus(kind="annulus", inner_radius="8 mm", outer_radius="12 mm")


def rings(edges, along=1.0, around=1.0, density=1.0):
    edges, one = np.asarray(edges, float), np.ones(len(edges) - 1)
    return Rings(edges, along * one, around * one, density * np.pi * np.diff(edges**2))


def test_resistance_of_a_flat_annulus():
    flat = rings(np.linspace(8, 12, 7))
    assert flat.resistances(10.0, 1, RING).sum() == pytest.approx(10 * np.log(12 / 8) / (2 * np.pi))
    # equal-biaxial l: shape factor as before, sheet resistance times l^(2 n)
    for n in (0, 1):
        stretched = rings([8, 10, 12], along=1.3, around=1.3).resistances(10.0, n, RING).sum()
        expected = 10 * 1.3 ** (2 * n) * np.log(1.5) / (2 * np.pi)
        assert stretched == pytest.approx(expected)
    # along the radius only: longer, and thinner
    pulled = rings([8, 12], along=1.3).resistances(10.0, 1, RING).sum()
    assert pulled == pytest.approx(10 * 1.3**2 * np.log(1.5) / (2 * np.pi))


def test_time_constant_of_a_uniform_line():
    """A narrow annulus is a line: 4 / pi^2 R C with both electrodes in series."""
    line = rings(np.linspace(1000, 1001, 401))
    R = line.resistances(5.0, 1, RING)
    expected = 4 / np.pi**2 * 2 * R.sum() * line.capacitance.sum()
    for at_start in (True, False):
        assert line.time_constant(R, at_start) == pytest.approx(expected, rel=1e-3)


def test_time_constant_of_an_annulus_depends_on_the_contact():
    """Bessel's equation: (r v')' / r + k^2 v = 0, v = 0 at the contact, v' = 0 at the far edge."""
    from scipy.optimize import brentq
    from scipy.special import j0, j1, y0, y1

    a, b, sheet, density = 3.0, 12.0, 2.0, 0.5
    disc = rings(np.linspace(a, b, 801), density=density)
    R = disc.resistances(sheet, 1, RING)
    found = {}
    for contact, (held, free) in {"inner": (a, b), "outer": (b, a)}.items():

        def condition(k, held=held, free=free):
            return j0(k * held) * y1(k * free) - y0(k * held) * j1(k * free)

        grid = np.linspace(0.02, 1, 400)
        values = condition(grid)
        first = np.flatnonzero(values[1:] * values[:-1] < 0)[0]
        k = brentq(condition, grid[first], grid[first + 1])
        found[contact] = disc.time_constant(R, contact == "inner")
        assert found[contact] == pytest.approx(2 * sheet * density / k**2, rel=2e-4)
    assert found["inner"] > 2 * found["outer"]


@pytest.mark.once
def test_columns_of_the_electrodes():
    h = history("harvesting")
    rest = 10 * np.log(12 / 8) / (2 * np.pi)
    assert h["electrode_resistance_kohm"][0] == pytest.approx(rest, rel=1e-9)
    pushed = h["electrode_resistance_kohm"][8]
    # the cone through both edges is longer by l: l^2, and thinner; the strip bends less than that
    l = np.hypot(4, 3) / 4
    assert pushed == pytest.approx(rest * l**2, rel=0.03)
    tau = h["rc_time_us"]
    line = 4 / np.pi**2 * 2 * rest * h["capacitance_pF"][0] * 1e-3  # kohm pF = 1e-3 us
    assert tau[0] == pytest.approx(line, rel=0.2)
    assert tau[8] / tau[0] == pytest.approx(
        pushed / rest * h["capacitance_pF"][8] / h["capacitance_pF"][0], rel=0.02
    )
    fluid = rows(case("harvesting", sensing__area_exponent=0, program="[{stage: rest}]"))[0]
    assert fluid["electrode_resistance_kohm"] == pytest.approx(rest, rel=1e-9)
    assert "rc_time_us" not in history("benchmark_strip")


# --- cycles --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def generator(tmp_path_factory):
    return dealib.simulate(case("harvesting"), tmp_path_factory.mktemp("run") / "generator")


@pytest.mark.once
def test_a_generator_cycle(generator, tmp_path):
    """Charged at large capacitance, discharged at small: about V^2/2 (C_large - C_small) gained."""
    (found,) = cycles(generator)
    h = generator.history
    assert (found.first, found.last) == (8, 56)
    assert found.name == "charge - release - discharge - stretch"
    large, small_ = h["capacitance_pF"][16], h["capacitance_pF"][32]
    gain = 2.0**2 / 2 * (large - small_) * 1e-3
    assert found.electrical == pytest.approx(-gain, rel=5e-3)
    balance = abs(found.electrical + found.mechanical)
    assert balance < 2e-3 * gain  # the trapezoidal rule
    assert found.efficiency == pytest.approx(-found.electrical / found.mechanical_in)
    assert 0 < found.efficiency < 1
    assert np.isnan(found.transfer)  # what the mount gives back here was stored in the film
    fine = {f"program__{k}__steps": n for k, n in enumerate((8, 16, 32, 16, 32))}
    (finer,) = cycles(dealib.simulate(case("harvesting", **fine), tmp_path / "fine"))
    assert abs(finer.electrical + finer.mechanical) < 0.3 * balance  # second order: a quarter
    ((name, *numbers),) = facts.cycle_table(generator)
    assert name == found.name
    assert numbers[1] == f"{found.electrical:.5g}".replace("-", "−")
    assert numbers[-2:] == ["–", f"{100 * found.efficiency:.3g} %"]
    shown = CliRunner().invoke(app, ["info", str(generator.directory)]).stdout
    assert "charge - release - discharge - stretch" in shown


@pytest.mark.once
def test_repeated_actuation_against_a_weight_gives_back_what_it_took(tmp_path):
    program = "[{stage: load, mount: {mass: 10 g}, steps: 3}, {stage: actuate, duration: 4 s, "
    program += "terminal: {voltage: [0 V, 2 kV, 0 V]}, steps: 8, cycles: 2}]"
    run = dealib.simulate(small(program=program), tmp_path / "run")
    one, two = cycles(run)
    assert [row[-1] for row in facts.cycle_table(run)] == ["0 %", "0 %"]  # no trace of rounding
    assert (one.name, one.first, one.last) == ("actuate 1", 3, 11)
    assert (two.name, two.first, two.last) == ("actuate 2", 11, 19)
    for found in (one, two):
        assert found.mechanical_out > 0
        assert abs(found.electrical) < 1e-9
        assert abs(found.mechanical) < 1e-9
        assert found.efficiency < 1e-6
        assert found.transfer == pytest.approx(found.mechanical_out / found.electrical_in)
    assert one.transfer == pytest.approx(two.transfer, rel=1e-6)


@pytest.mark.once
def test_a_cycle_that_does_no_work_at_the_mount_has_no_signed_zeros(tmp_path):
    program = "[{stage: push, mount: {displacement: -1 mm}}, {stage: actuate, duration: 4 s, "
    program += "terminal: {voltage: [0 V, 2 kV, 0 V]}, steps: 4}]"
    viscous = dealib.load(SMALL.with_name("viscous.yaml"), set={"program": program})
    (row,) = facts.cycle_table(dealib.simulate(viscous, tmp_path / "held"))
    assert row[0] == "actuate"
    assert row[3:] == ("0", "0", "0 %", "0 %")


@pytest.mark.once
def test_no_cycle_without_a_return(tmp_path):
    program = "[{stage: push, mount: {displacement: -1 mm}, steps: 2}, {stage: hold}, "
    program += "{stage: up, terminal: {voltage: 1 kV}}]"
    run = dealib.simulate(small(program=program), tmp_path / "run")
    assert cycles(run) == []
    assert "energy, mJ" not in CliRunner().invoke(app, ["info", str(run.directory)]).stdout


def cycle_rows(program, folder):
    found = cycles(dealib.simulate(small(program=program), folder / "run"))
    return [(c.name, c.first, c.last) for c in found]


@pytest.mark.once
def test_every_input_of_a_cycle_comes_back_to_where_it_was(tmp_path):
    push = "[{stage: push, mount: {displacement: -1 mm}, %s, steps: 4}]"
    assert cycle_rows(push % "terminal: {voltage: [0 V, 2 kV, 0 V]}", tmp_path / "a") == []
    push = push.replace("-1 mm", "[0 mm, -1 mm, 0 mm]")
    found = cycle_rows(push % "terminal: {voltage: [0 V, 2 kV, 0 V]}", tmp_path / "b")
    assert found == [("push", 0, 4)]
    # from 0 V a list that begins elsewhere is reached first: only its second round is closed
    elsewhere = "[{stage: dip, terminal: {voltage: [2 kV, 1 kV, 2 kV]}, steps: 6, cycles: %d}]"
    assert cycle_rows(elsewhere % 1, tmp_path / "c") == []
    (found,) = cycle_rows(elsewhere % 2, tmp_path / "d")
    assert found == ("dip 2", 6, 12)
    # a weight that was there before does not keep a voltage from closing its cycle
    load = "mount: {mass: 10 g}, steps: 2"
    program = f"[{{stage: load, {load}}}, {{stage: on, {load}, terminal: {{voltage: [0 V, 1 kV, "
    assert cycle_rows(f"{program}0 V]}}}}]", tmp_path / "e") == [("on", 2, 4)]


@pytest.mark.once
def test_creep_at_rest_is_no_cycle(tmp_path):
    """A voltage of 0 V that stays 0 V does not come back, whatever the film does meanwhile."""
    creeping = "branches: [{shear_modulus: 0.2 MPa, relaxation_time: 1 s}]"
    film = "law: neo_hookean, youngs_modulus: 1 MPa, relative_permittivity: 3, prestretch: 1.1"
    program = (
        "[{stage: hang, duration: 0.1 s, mount: {force: -0.05 N}},"
        " {stage: wait, duration: 3 s, terminal: {voltage: 0 V}},"
        " {stage: on, terminal: {voltage: [0 V, 1 kV, 0 V]}, steps: 2}]"
    )
    given = small(program=program, materials__film=f"{{{film}, {creeping}}}")
    run = dealib.simulate(given, tmp_path / "run")
    waited = run.history.query("stage == 'wait'")
    assert np.ptp(waited["displacement_mm"]) > 0.003  # and it goes on
    (found,) = cycles(run)
    assert (found.name, found.first) == ("on", waited["step"].iloc[-1])


@pytest.mark.once
def test_cycles_after_a_branch_that_is_followed(tmp_path):
    """Its stage lasts as long as its path; a killed run says nothing of stops."""
    program = (
        "[{stage: load, mount: {force: -0.02 N}, steps: 2}, {stage: NA, duration: 3 s, steps: 2,"
        " follow: {vary: force, until: {displacement: -1 mm}}},"
        " {stage: go on, steps: 4, duration: 4 s, cycles: 2,"
        " terminal: {voltage: [0 V, 1 kV, 0 V]}},"
        " {stage: part, duration: 4 s, terminal: {voltage: [0 V, 1 kV]}, steps: 8,"
        " stop_when: [voltage_kV > 0.3 kV]},"
        " {stage: same, terminal: {voltage: [1 kV, 0.3 kV, 1 kV]}, steps: 4},"
        " {stage: same, terminal: {voltage: [1 kV, 0 V, 1 kV]}, steps: 4}]"
    )
    run = dealib.simulate(small(program=program), tmp_path / "run")
    h = run.history
    begin = int(np.flatnonzero(h["stage"] == "NA")[-1])
    time = h["time_s"][begin]
    assert abs(time - (1 + 3)) > 1e-3  # not where the duration would have it
    assert h["time_s"][begin + 8] == pytest.approx(time + 8)
    same = begin + 8 + 3 + 6  # with its corners
    expected = [
        ("go on 1", begin, begin + 4),
        ("go on 2", begin + 4, begin + 8),
        ("same (2)", same, same + 4),
    ]
    assert [(c.name, c.first, c.last) for c in cycles(run)] == expected
    info = {k: v for k, v in run.info.items() if k != "stops"} | {"status": "running"}
    (run.directory / "run.json").write_text(json.dumps(info))
    again = dealib.open(run.directory)
    assert [(c.name, c.first, c.last) for c in cycles(again)] == expected


# --- the map -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    return dealib.simulate(case("sensing"), tmp_path_factory.mktemp("run") / "sensing")


@pytest.mark.once
def test_displacement_from_capacitance_against_direct_solves(swept):
    found = CapacitanceMap.of([swept.history])
    assert [s.voltage for s in found.sweeps] == [0, 1, 1.6, 2]
    assert (found.low, found.high) == (-2.4, -0.4)
    for u, V in ((-1.37, 1.3), (-0.55, 0.4), (-2.31, 1.9)):
        program = f"[{{stage: there, mount: {{displacement: {u} mm}}, steps: 6}}, "
        program += f"{{stage: up, terminal: {{voltage: {V} kV}}, steps: 2}}]"
        C = rows(case("sensing", program=program))[-1]["capacitance_pF"]
        assert float(found.capacitance(u, V)) == pytest.approx(C, rel=1e-6)
        assert found.displacement(C, V) == pytest.approx(u, abs=2e-4)  # 0.2 um
    # the error that it states itself, from half of the points, is no smaller
    errors = dict(found.errors())
    assert max(errors.values()) < 1e-4
    with pytest.raises(ValueError, match=r"no displacement from -2.4 to -0.4 mm has 100 pF"):
        found.displacement(100.0, 1.0)
    slope = (found.capacitance(-1.501, 1.2) - found.capacitance(-1.499, 1.2)) / -0.002
    assert float(found.sensitivity(-1.5, 1.2)) == pytest.approx(float(slope), rel=1e-5)


@pytest.mark.once
def test_the_command_draws_and_inverts(swept, strip_run):
    def call(*arguments):
        return CliRunner().invoke(app, ["sense", *map(str, arguments)])

    done = call(swept.directory)
    assert done.exit_code == 0, done.output
    *table, path = done.stdout.splitlines()
    assert (swept.directory / "plots" / "sensing.png").samefile(path)
    assert [float(line.split()[0]) for line in table[3:]] == [0, 1, 1.6, 2]
    C = float(swept.history["capacitance_pF"][5])
    done = call(swept.directory, "--at", f"{C!r},0")
    assert done.stdout.split()[1] == "mm"
    assert float(done.stdout.split()[0]) == pytest.approx(swept.history["displacement_mm"][5])
    for wrong, message in (("250", "expected pF,kV"), ("99,1", "no displacement")):
        with pytest.raises(ConfigError, match=message):
            sense([swept.directory], wrong, None, False, False)
    with pytest.raises(ConfigError, match="no map: it needs at least 6 displacements"):
        CapacitanceMap.of([strip_run.history.iloc[13:]])


@pytest.mark.once
def test_states_that_nearly_coincide_are_one():
    """A parabola C(u), whose states repeat within rounding: the spline must not see that."""
    u = np.linspace(-2, 0, 11)
    u = np.concatenate([u, u[::-1] + 1e-9, u + 1e-7])
    C = 240 + 10 * u**2
    table = pd.DataFrame({"displacement_mm": u, "voltage_kV": 0.0, "capacitance_pF": C})
    held = table.iloc[:8].assign(displacement_mm=-1 + 1e-9 * np.arange(8), voltage_kV=2.0)
    held["capacitance_pF"] = 250.0
    found = CapacitanceMap.of([table, held])
    assert len(found.sweeps[0].displacement) == 11
    assert found.sensitivity(np.array([-2.0, -1.0]), 0.0) == pytest.approx([-40, -20], rel=1e-5)
    assert found.displacement(250.0, 0.0) == pytest.approx(-1, abs=1e-7)
    assert found.left_out == [2.0]  # eight states, one displacement
    loop = table.iloc[11:].assign(capacitance_pF=C[11:] + 0.02)
    message = "at -2 mm and 0 kV there are both 280 and 280.02 pF"
    with pytest.raises(ConfigError, match=message):
        CapacitanceMap.of([table.iloc[:11], loop])


@pytest.mark.once
@pytest.mark.filterwarnings("error")
def test_a_map_of_one_voltage_and_what_is_left_out(tmp_path):
    """The minimum of C at 0 mm is an end of the sweep: a half map need not know its value."""
    program = "[{stage: down, mount: {displacement: -2 mm}, steps: 10}, {stage: up, duration: 1 s, "
    program += "terminal: {voltage: [0 kV, 2 kV, 0 kV]}, steps: 8}]"
    run = dealib.simulate(small(program=program), tmp_path / "run")
    *lines, _ = sense([run.directory], None, None, False, False).splitlines()
    assert lines[0] == "-2 .. 0 mm"
    slopes = lines[3].split()[-4:]
    assert float(slopes[0]) == pytest.approx(-31.9, abs=2)
    assert abs(float(slopes[2])) < 0.1
    assert float(slopes[3]) < 0.5  # um
    assert lines[4:] == ["not on the map, with too few displacements: 0.5, 1, 1.5, 2 kV"]
    with pytest.raises(ConfigError, match=r"^--at 250,1: 1 kV is not on the map, which ends at 0"):
        sense([run.directory], "250,1", None, False, False)


@pytest.mark.once
def test_a_map_ends_at_its_largest_voltage(swept):
    message = "--at 270,13: 13 kV is not on the map, which ends at 2 kV"
    with pytest.raises(ConfigError, match=f"^{message}$"):
        sense([swept.directory], "270,13", None, False, False)
    found = CapacitanceMap.of([swept.history[swept.history["voltage_kV"] > 0]])
    with pytest.raises(ValueError, match=r"^0.5 kV is not on the map, which begins at 1 kV$"):
        found.capacitance(-1.0, 0.5)


@pytest.mark.once
def test_runs_of_different_devices_are_no_map(tmp_path):
    rest = "[{stage: rest}]"
    a = dealib.simulate(small(program=rest, name="other", solver__max_cuts=3), tmp_path / "a")
    b = dealib.simulate(small(program=rest), tmp_path / "b")
    check_device([a, b])
    thick = {"geometry__film_thickness": "60 um", "materials__film__relative_permittivity": 4}
    c = dealib.simulate(small(program=rest, **thick), tmp_path / "c")
    message = f"no map: {a.directory} and {c.directory} differ in geometry.film_thickness "
    message += "(0.05 mm, 0.06 mm), materials.film.relative_permittivity (3.0, 4.0)"
    with pytest.raises(ConfigError) as caught:
        sense([a.directory, b.directory, c.directory], None, None, False, False)
    assert str(caught.value) == message


@pytest.mark.once
def test_maxwell_branches_allow_no_map(tmp_path):
    given = dealib.load(SMALL.with_name("viscous.yaml"), set={"program": "[{stage: rest}]"})
    run = dealib.simulate(given, tmp_path / "run")
    with pytest.raises(ConfigError) as caught:
        sense([run.directory], None, None, False, False)
    assert str(caught.value) == (
        f"{run.directory}: no map: materials.film.branches make the capacitance depend on what "
        "came before; run it without them"
    )


@pytest.mark.once
def test_a_capacitance_that_turns_has_two_ways_back(tmp_path):
    program = "[{stage: down, mount: {displacement: [0 mm, -2 mm, 2 mm]}, steps: 18}]"
    run = dealib.simulate(small(program=program), tmp_path / "run")
    *lines, _ = sense([run.directory], None, None, False, False).splitlines()
    assert (
        lines[4]
        == "not unique: the capacitance has an extremum; --at gives the lowest displacement"
    )
    found = CapacitanceMap.of([run.history])
    ((_, error),) = found.errors()  # to the nearer one, not to the other side
    assert error < 1e-3
    C = float(found.capacitance(1.0, 0.0))
    assert found.displacement(C, 0.0) == pytest.approx(-1, abs=1e-4)  # the same up and down
