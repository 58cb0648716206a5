"""Maxwell branches in whole runs: limits, energy balance, resumption, formulations, results."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

from mpi4py import MPI

import conftest
import numpy as np
import pandas as pd
import pytest
from test_parallel import SCRIPT, finish, start
from verification import viscous
from watch import At

import dealib
from dealib.__main__ import main
from dealib.config import resolved
from dealib.errors import ConfigError
from dealib.fem.layout import Layout
from dealib.fem.problem import build_problem
from dealib.materials import evolution, invariants_of_stretches, thickness_stretch
from dealib.program.tables import tables_case
from dealib.results.checkpoint import CheckpointFolder
from dealib.results.rows import Transferred

FILE = Path(__file__).with_name("viscous.yaml")


def case(**changes: object) -> dealib.Case:
    return dealib.load(FILE, set={k.replace("__", "."): v for k, v in changes.items()})


def history(**changes: object) -> pd.DataFrame:
    return pd.DataFrame([state.row for state in dealib.Simulation(case(**changes))])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> dealib.Run:
    return dealib.simulate(case(), tmp_path_factory.mktemp("viscous") / "run")


# --- the rule of a point -------------------------------------------------------------------------


def metric(t: float) -> np.ndarray:
    """A large deformation with shear, from rest."""
    F = np.array([[1 + t, 0.8 * t, 0], [-0.3 * t, 1 - 0.4 * t, 0], [0, 0, 1 + 0.2 * t]])
    return evolution.isochoric(F)


def integrate(rule: evolution.Evolution, steps: int, time: float) -> np.ndarray:
    """C_i after the deformation above has been reached in 1 s."""
    internal = evolution.identity()
    for k in range(steps):
        C, D = metric(k / steps), metric((k + 1) / steps)
        internal = rule.end(*rule.step(C, internal, 1 / steps / time), D)
    return internal


RATES = {  # of C_i, over 1 / tau
    "multiplicative": lambda C, x: C - evolution.contract(C, evolution.inverted(x)) / 3 * x,
    "network": lambda C, x: x - packed_product(x, evolution.inverted(C), x),
}


def packed_product(*factors):
    """Symmetric product of packed tensors."""
    return evolution.pack(np.linalg.multi_dot([evolution.unpack(f) for f in factors]))


@pytest.fixture(params=RATES)
def rule(request):
    return evolution.EVOLUTIONS[request.param]


@pytest.mark.once
@pytest.mark.parametrize("time", [0.1, 1.0, 30.0])
@pytest.mark.parametrize("name", RATES)
def test_the_rule_meets_the_differential_equation_with_second_order(name, time):
    from scipy.integrate import solve_ivp

    def rate(t, x):
        return RATES[name](metric(t), x) / time

    exact = solve_ivp(rate, (0, 1), evolution.identity(), rtol=1e-12, atol=1e-13).y[:, -1]
    rule = evolution.EVOLUTIONS[name]
    if name == "multiplicative":
        assert evolution.determinant(exact) == pytest.approx(1, abs=1e-10)
    errors = [np.abs(integrate(rule, n, time) - exact).max() for n in (50, 100)]
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.05)


@pytest.mark.once
@pytest.mark.parametrize("ratio", [1e-14, 1e-3, 1.0, 1e3, 1e14])
def test_any_step_is_stable_and_between_old_and_new(rule, ratio):
    """Frozen in no time, relaxed in a long one, and always a metric."""
    C, internal = metric(0.2), metric(1.0)
    past, weight = rule.step(C, internal, ratio)
    assert (np.linalg.eigvalsh(evolution.unpack(past)) > 0).all()
    end = rule.end(past, weight, metric(0.4))
    assert (np.linalg.eigvalsh(evolution.unpack(end)) > 0).all()
    if isinstance(rule, evolution.Multiplicative):
        assert evolution.determinant(end) == pytest.approx(1, abs=1e-12)
    if ratio == 1e-14:
        assert end == pytest.approx(internal, abs=1e-12)
    if ratio == 1e14:
        assert end == pytest.approx(metric(0.4), abs=1e-12)


def test_power_is_the_rate_of_what_is_released(rule):
    """At a constant deformation the stored energy falls by the dissipated power."""
    C, internal, dt = metric(1.0), metric(0.3), 1e-5  # relaxation times
    after = rule.end(*rule.step(C, internal, dt), C)
    middle = (internal + after) / 2
    lost = rule.stored(C, internal) - rule.stored(C, after)
    assert lost > 0
    assert lost / dt == pytest.approx(float(rule.power(C, middle)), rel=1e-8)


# --- limits --------------------------------------------------------------------------------------

BARE = {"materials__film__prestretch": 1.0}
ELASTIC = {"materials__film__branches": "[]", "materials__electrode__branches": "[]"}


def stiff(film: float, electrode: float) -> dict[str, str]:
    """Neo-Hookean parameters with other shear moduli, MPa, at the bulk moduli of the file."""
    parts = {"film": (film, 50 / 3), "electrode": (electrode, 100 / 3)}
    return {
        f"materials__{name}": "{law: neo_hookean, "
        + ("relative_permittivity: 3, " if name == "film" else "")
        + f"shear_modulus: {G!r} MPa, bulk_modulus: {kappa!r} MPa}}"
        for name, (G, kappa) in parts.items()
    }


@pytest.mark.parametrize(
    ("scale", "moduli"),
    [(1e9, (1 / 3, 2 / 3)), (1e-9, (1 / 3 + 0.15, 2 / 3 + 0.2))],
    ids=["slow", "fast"],
)
def test_very_slow_and_very_fast_runs_are_elastic(scale, moduli):
    """With the law's modulus alone, and with those of the branches added."""
    stages = (
        "[{{stage: push, duration: {0} s, mount: {{displacement: -1 mm}}, steps: 4}},"
        " {{stage: actuate, duration: {0} s, terminal: {{voltage: 2 kV}}, steps: 4}}]"
    )
    viscoelastic = history(program=stages.format(scale), solver__time_tolerance=0, **BARE)
    elastic = history(program=stages.format(1), **stiff(*moduli))
    for name in ("force_N", "charge_uC", "elastic_energy_mJ", "capacitance_pF"):
        expected = elastic[name].to_numpy()
        assert viscoelastic[name].to_numpy() == pytest.approx(
            expected, abs=1e-7 * np.abs(expected).max()
        ), name
    lost = viscoelastic["dissipated_energy_mJ"].iloc[-1]
    coarse = 1e-4 if scale > 1 else 1e-8  # slow: the third power of the increments is left
    assert abs(lost) < coarse * elastic["elastic_energy_mJ"].max()


def test_the_mounted_state_is_relaxed():
    """Pre-stretch loads no branch: the state at rest is the elastic one."""
    first, elastic = history().iloc[0], history(**ELASTIC).iloc[0]
    for name in ("force_N", "elastic_energy_mJ", "capacitance_pF", "thickness_stretch_min"):
        assert first[name] == pytest.approx(elastic[name], rel=1e-9, abs=1e-12), name
    assert first["dissipated_energy_mJ"] == first["dissipated_power_mW"] == 0
    fresh = history(materials__film__mounted="fresh", program="[{stage: rest}]").iloc[0]
    assert fresh["elastic_energy_mJ"] > 1.1 * first["elastic_energy_mJ"]


@pytest.mark.once
def test_a_fresh_film_carries_the_prestretch_and_relaxes():
    """Its branches store G/2 (I1 - 3) at first, and dissipate it at rest."""
    film = {
        "geometry__electrode_thickness": "0 um",
        "materials__film__prestretch": 1.2,
        "program": "[{stage: hold, duration: 1000 s}]",
        "solver__time_tolerance": 1e-4,
    }
    relaxed, fresh = history(**film), history(materials__film__mounted="fresh", **film)
    law = case(**film).config.materials["film"]
    i = invariants_of_stretches(1.2, thickness_stretch(law, 1.2, 1.2), 1.2)
    volume = np.pi * (12**2 - 8**2) * 0.05 / i.J  # mm^3, unstretched
    stored = 0.15 / 2 * (i.I1 - 3) * volume
    energy = fresh["elastic_energy_mJ"]
    assert energy[0] - relaxed["elastic_energy_mJ"][0] == pytest.approx(stored, rel=2e-2)
    assert energy.iloc[-1] == pytest.approx(relaxed["elastic_energy_mJ"].iloc[-1], rel=1e-6)
    lost = fresh["dissipated_energy_mJ"].iloc[-1]
    assert lost == pytest.approx(energy.iloc[0] - energy.iloc[-1], rel=1e-3)


@pytest.mark.once
def test_wrinkling_of_a_fresh_film_counts_from_the_tension_with_its_branches():
    """At first nothing is lost; in the long run the branches' share G_i / (G + sum of G_i)."""
    film = {
        "geometry__electrode_thickness": "0 um",
        "materials__film__mounted": "fresh",
        "mesh__columns": 32,
    }
    h = history(program="[{stage: hold, duration: 1000 s}]", **film)
    assert h["wrinkling_use"].iloc[0] == pytest.approx(0, abs=5e-3)  # clamped ends
    assert h["wrinkling_use"].iloc[-1] == pytest.approx(0.15 / (1 / 3 + 0.15), abs=1e-2)
    incompressible = stiff(1 / 3, 2 / 3)["materials__film"].replace(
        f"{50 / 3!r} MPa", "1e6 MPa, prestretch: 1.2, mounted: fresh, branches: "
        "[{shear_modulus: 0.15 MPa, relaxation_time: 1 s}]"
    )  # fmt: skip
    found = conftest.film_of(case(materials__film=incompressible).config)
    assert found.tension == pytest.approx((1 / 3 + 0.15) * (1.2**2 - 1.2**-4), rel=1e-5)
    relaxed = conftest.film_of(
        case(materials__film=incompressible.replace("fresh", "relaxed")).config
    )
    assert relaxed.tension == pytest.approx((1.2**2 - 1.2**-4) / 3, rel=1e-5)


@pytest.mark.once
def test_without_branches_nothing_is_added():
    columns = set(history(**ELASTIC))
    assert set(history()) - columns == {"dissipated_energy_mJ", "dissipated_power_mW"}
    assert not build_problem(case(**ELASTIC).config, MPI.COMM_SELF).branches


# --- energy and time -----------------------------------------------------------------------------

CYCLE = (
    "[{{stage: push, duration: 2 s, mount: {{displacement: -1 mm}}, steps: {n}}},"
    " {{stage: actuate, duration: 4 s, terminal: {{voltage: [0 V, 2 kV, 0 V]}}, steps: {n2}}},"
    " {{stage: back, duration: 2 s, mount: {{displacement: 0 mm}}, steps: {n}}}]"
)


def cycle(n: int, **changes: object) -> pd.DataFrame:
    return history(program=CYCLE.format(n=n, n2=2 * n), solver__tolerance=1e-12, **changes)


@pytest.mark.once
def test_energy_balance_closes_with_second_order():
    runs = [cycle(n, solver__time_tolerance=0) for n in (8, 16, 32)]
    left = [abs(h["energy_residual_mJ"].iloc[-1]) for h in runs]
    lost = runs[-1]["dissipated_energy_mJ"]
    assert lost.is_monotonic_increasing
    assert left[2] < 5e-3 * lost.iloc[-1]
    assert np.log2(left[0] / left[1]) == pytest.approx(2, abs=0.15)
    assert np.log2(left[1] / left[2]) == pytest.approx(2, abs=0.15)
    # the power's integral is the energy
    fine = runs[-1]
    power, time = fine["dissipated_power_mW"], fine["time_s"]
    integral = ((power + power.shift()) / 2 * time.diff()).sum()
    assert integral == pytest.approx(lost.iloc[-1], rel=5e-3)


@pytest.mark.once
def test_a_tighter_time_tolerance_gives_proportionally_smaller_errors():
    reference = cycle(256, solver__time_tolerance=0).iloc[-1]
    steps, errors = [], []
    for tolerance in (4e-3, 1e-3, 2.5e-4):
        h = cycle(1, solver__time_tolerance=tolerance)
        assert {2.0, 4.0, 6.0, 8.0} <= set(h["time_s"].round(12))  # as asked for
        steps.append(len(h))
        errors.append(abs(h["force_N"].iloc[-1] - reference["force_N"]))
    assert errors[1] < 2e-3 * abs(reference["force_N"])
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
    assert steps[0] < steps[1] < steps[2] < 5 * steps[0]


def test_cut_back_steps_leave_no_trace():
    """Halved by failures, the steps are those of a run that was given the halves."""
    given = "[{{stage: push, duration: 2 s, mount: {{displacement: -2 mm}}, steps: {}}}]"
    off = {"solver__time_tolerance": 0, "solver__predictor_order": 0, "mesh__columns": 16}
    cut = history(program=given.format(1), solver__max_iterations=4, **off)
    assert len(cut) > 3
    simulation = dealib.Simulation(case(program=given.format(1), **off))
    times = cut["time_s"].tolist()
    stages = ", ".join(
        f"{{stage: s, duration: {b - a!r} s, mount: {{displacement: {-b!r} mm}}}}"
        for a, b in itertools.pairwise(times)
    )
    whole = history(program=f"[{stages}]", **off)
    assert simulation.steps_planned == 1
    assert whole["force_N"].to_numpy() == pytest.approx(cut["force_N"].to_numpy(), rel=1e-9)
    lost = "dissipated_energy_mJ"
    assert whole[lost].to_numpy() == pytest.approx(cut[lost].to_numpy(), rel=1e-9)


STOP = (
    "[{{stage: push, duration: 8 s, mount: {{displacement: -1 mm}}, steps: 8,"
    " stop_when: [{{when: {}, bisect: 8}}]}}]"
)


@pytest.mark.parametrize("tolerance", [0, 1e-3])
@pytest.mark.parametrize(
    ("column", "limit"), [("dissipated_energy_mJ", "3e-4 mJ"), ("dissipated_power_mW", "2.2e-4 mW")]
)
def test_conditions_see_the_branches_of_the_present_state(column, limit, tolerance):
    """What C_i brings counts in the step on which a condition is met: bisected to its 1/256."""
    h = history(program=STOP.format(f"{column} > {limit}"), solver__time_tolerance=tolerance)
    before, last = h.iloc[-2], h.iloc[-1]
    value = float(limit.split()[0])
    assert before[column] <= value < last[column]
    assert last["time_s"] - before["time_s"] == pytest.approx(2**-8)
    assert last[column] == pytest.approx(value, rel=5e-3)


@pytest.mark.once
def test_a_look_ahead_leaves_no_trace():
    """A condition that is looked at in each step, but never met, changes nothing."""
    watched = history(stop_when="[{when: dissipated_energy_mJ > 1 J, bisect: 4}]")
    plain = history()
    for name in plain.columns.drop("stage"):
        assert watched[name].to_numpy() == pytest.approx(plain[name].to_numpy(), rel=1e-12), name


# --- formulations and ranks ----------------------------------------------------------------------


@pytest.mark.once
def test_the_mixed_form_agrees():
    """On a homogeneous state, exactly."""
    found = []
    for formulation in ("displacement", "mixed"):
        bench = viscous.Viscous(
            viscous.LAW, viscous.BRANCHES, viscous.CONFINED, formulation, tolerance=1e-12
        )
        bench.through(1.0, 4, mount=0.3 * viscous.THICKNESS).through(2.0, 4)
        found.append((bench.force, bench.viscosity.stored, bench.viscosity.dissipated))
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@pytest.mark.slow
def test_other_couplings_have_branches_too():
    one, other = cycle(4), cycle(4, physics__coupling="maxwell_traction")
    before = one["time_s"] <= 2  # no voltage yet
    assert other["force_N"][before].to_numpy() == pytest.approx(
        one["force_N"][before].to_numpy(), rel=1e-8, abs=1e-10
    )
    assert other["dissipated_energy_mJ"].iloc[-1] > 0


@pytest.mark.once
@pytest.mark.mpi
def test_two_ranks_agree(run, tmp_path):
    path = tmp_path / "viscous.yaml"
    path.write_text(resolved(case().config))
    code, errors = finish(start(2, "-m", "mpi4py", SCRIPT, tmp_path, path))
    assert code == 0, errors
    one, other = run, dealib.open(tmp_path / "viscous")
    for name in one.history.columns.drop(["stage", "newton_iterations"]):
        expected = one.history[name].to_numpy()
        size = max(np.abs(expected).max(), 1e-9)
        assert other.history[name].to_numpy() == pytest.approx(expected, abs=1e-8 * size), name
    internal = other.internal()
    assert internal == pytest.approx(one.internal(), abs=1e-8)


# --- results -------------------------------------------------------------------------------------


def assert_same(resumed, run, within=1e-10):
    assert len(resumed.history) == len(run.history)
    for name in run.history.columns.drop(["stage", "newton_iterations"]):
        expected = run.history[name].to_numpy()
        size = max(np.abs(expected).max(), 1e-9)
        assert resumed.history[name].to_numpy() == pytest.approx(expected, abs=within * size), name
    assert resumed.internal() == pytest.approx(run.internal(), abs=within)
    assert len(resumed.stored_steps) == len(resumed.history)


@pytest.mark.parametrize("stop", [3, *(pytest.param(k, marks=pytest.mark.once) for k in (10, 17))])
def test_resume_goes_on_as_if_never_stopped(run, tmp_path, stop):
    with pytest.raises(KeyboardInterrupt):
        dealib.simulate(case(), tmp_path / "run", observers=[At(stop, KeyboardInterrupt())])
    assert_same(dealib.simulate(case(), tmp_path / "run", resume=True), run)


@pytest.mark.once
@pytest.mark.mpi
@pytest.mark.slow
def test_resume_on_two_ranks(run, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        dealib.simulate(case(), tmp_path / "run", observers=[At(7, KeyboardInterrupt())])
    code, errors = finish(
        start(2, "-m", "dealib", "run", FILE, "--out", tmp_path / "run", "--resume")
    )
    assert code == 0, errors
    assert_same(dealib.open(tmp_path / "run"), run, 1e-8)  # as on other numbers of ranks


def test_one_internal_state_is_kept_beside_the_checkpoint(run):
    folder = run.directory / "checkpoint"
    assert len(list(folder.glob("internal_*.npy"))) == 1
    saved = CheckpointFolder(run.directory).read()
    cells = 8 * (1 + 2)  # of film and electrodes
    assert saved.beside["internal"].shape == (cells, 9, 2, 4)
    assert evolution.determinant(saved.beside["internal"]) == pytest.approx(1, abs=1e-10)


def test_stress_fields_hold_the_branches(run):
    """In the film's middle the membrane force is that of the whole section's stress."""
    fields = run.arrays(-1)
    bare = dealib.results.fields.fields(run.config, run.mesh, run.state(-1))
    film = run.mesh.in_region("film")
    nodes = np.unique(run.mesh.cells[film])
    difference = fields["second_pk_stress"] - bare["second_pk_stress"]
    assert np.abs(difference[nodes]).max() > 1e-4
    J = fields["J"][nodes]
    trace = np.trace(fields["cauchy_stress"] - bare["cauchy_stress"], axis1=1, axis2=2)[nodes]
    assert np.abs(trace * J).max() < 2e-2 * np.abs(difference[nodes]).max()  # a change of shape


@pytest.mark.parametrize("name", RATES)
def test_stress_of_the_results_is_that_of_the_equilibrium(name):
    """Confined block: S of the fields gives the force that Newton balanced."""
    branches = [(*b, name) for b in viscous.BRANCHES]
    bench = viscous.Viscous(viscous.LAW, branches, viscous.CONFINED)
    bench.through(0.5, 5, mount=0.1 * viscous.THICKNESS)
    layout = Layout.of(bench.problem)
    internal = Transferred(bench.viscosity.gather(), bench.viscosity.weights())
    found = dealib.results.fields.fields(
        bench.problem.config, layout.mesh, layout.gather(), internal
    )
    stress = found["cauchy_stress"][:, 1, 1]  # times the area, which the walls keep
    assert viscous.AREA * stress == pytest.approx(bench.force, rel=1e-9)


def test_the_tangent_is_symmetric():
    """One potential stands behind a step, however large."""
    simulation = dealib.Simulation(case(solver__time_tolerance=0))
    assert simulation.engine.problem.symmetric
    for state in simulation:
        system = state.engine.newton.system
        system.residual(system.q, system.residual_vector)
        system.tangent(system.matrix)
        assert system.matrix.isSymmetric(1e-13 * system.matrix.norm())


def test_a_second_film_has_no_branches():
    film = "{stage: release, mount: {bias: [{film: {distance: 2 mm%s}}]}}"
    with pytest.raises(ConfigError, match="a second film is elastic, without viscosity"):
        case(program=f"[{film % ''}]")
    plain = ", set: {materials.film.branches: [], materials.electrode.branches: []}"
    assert case(program=f"[{film % plain}]").config.materials["film"].branches


# --- shipped configs ------------------------------------------------------------------------------


@pytest.mark.once
def test_hysteresis_loses_energy_in_each_loop():
    h = conftest.history("hysteresis")
    ends = [h.index[np.isclose(h["time_s"], t)][0] for t in (0, 20, 40, 60)]
    lost = h["dissipated_energy_mJ"].loc[ends].diff().to_numpy()[1:]
    assert lost[0] > lost[1] > lost[2] > 0.98 * lost[1]  # soon steady
    loop = h.loc[ends[2] : ends[3]]
    moved = loop["displacement_mm"].diff()
    force = (loop["force_N"] + loop["force_N"].shift()) / 2
    kept = loop["elastic_energy_mJ"].iloc[-1] - loop["elastic_energy_mJ"].iloc[0]
    assert (force * moved).sum() == pytest.approx(lost[2] + kept, rel=2e-2)  # the loop's area
    turn = loop["displacement_mm"].idxmin()
    x, F = -loop["displacement_mm"], loop["force_N"]
    down = np.interp(2, x.loc[:turn], F.loc[:turn])
    up = np.interp(2, x.loc[turn:][::-1], F.loc[turn:][::-1])
    assert -0.8 < F.min() < down < 0.95 * up < 0  # within the axis of Figs. 3 and 20
    stored = h["elastic_energy_mJ"].max()
    assert h["energy_residual_mJ"].abs().max() < 5e-3 * stored


@pytest.mark.once
def test_creep_tends_to_the_elastic_stroke_and_back():
    h = conftest.history("creep")
    for stage in ("creep", "recovery"):
        u = h.loc[h["stage"] == stage, "displacement_mm"].to_numpy()
        direction = -1 if stage == "creep" else 1
        assert (direction * np.diff(u) > 0).all()
    ends = h.groupby("stage")["displacement_mm"].last()
    fast, slow = ends["on"] - ends["rest"], ends["creep"] - ends["rest"]
    elastic = conftest.history("creep", **ELASTIC).groupby("stage")["displacement_mm"].last()
    assert 0.5 < fast / slow < 0.8
    assert slow == pytest.approx(elastic["creep"] - elastic["rest"], rel=3e-2)
    assert ends["recovery"] == pytest.approx(elastic["recovery"], rel=1e-2)
    assert h["force_N"].iloc[7:].to_numpy() == pytest.approx(-0.30, abs=1e-8)
    assert h["dissipated_energy_mJ"].is_monotonic_increasing


@pytest.mark.slow
def test_loop_area_has_one_maximum_over_the_rate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    study = conftest.CONFIGS / "studies" / "rates.yaml"
    monkeypatch.setattr(sys, "argv", ["dealib", "study", str(study), "--out", "out"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0
    assert "3 of 3 windows hold" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "out" / "rates.csv")
    for loop, part in table.groupby("loop"):
        lost = part.sort_values("cycles_per_second")["lost"].to_numpy()
        signs = np.sign(np.diff(lost))
        assert list(signs) == sorted(signs, reverse=True), loop  # up, then down
        assert signs[0] == 1
        assert signs[-1] == -1


def test_tension_counts_the_branches(run):
    """The film's tension in the history is that of the stored fields, branches included."""
    relaxed = history(materials__film__branches="[]")
    step = int(run.history.index[run.history["time_s"] == 2][0])
    row, (_, without) = run.history.loc[step], *relaxed[relaxed["time_s"] == 2].iterrows()
    stored = run.arrays(run.stored_steps.index(step))["wrinkling_use"]
    film = run.mesh.cells[run.mesh.in_region("film")]
    assert stored[film].max() == pytest.approx(row["wrinkling_use"], rel=1e-3, abs=1e-3)
    assert row["tension_min_MPa"] > 1.02 * without["tension_min_MPa"]


@pytest.mark.parametrize(
    "part",
    [
        {"tables": "{displacement: [0 mm, -1 mm], voltage: [0 V, 1 kV]}"},
        {"program": "[{stage: path, follow: {vary: voltage, until: {charge: 0.1 uC}}}]"},
    ],
)
def test_branches_of_electrodes_without_thickness_do_not_count(part):
    """Tables and paths ask for elastic materials, of what is in the device."""
    small = FILE.with_name("small.yaml")
    branch = "branches: [{shear_modulus: 1 MPa, relaxation_time: 1 s}]"
    given = {
        "materials.electrode": f"{{law: neo_hookean, youngs_modulus: 1 MPa, {branch}}}",
        **part,
    }
    thin = dealib.load(small, set=given)
    assert set(thin.config.solids) == {"film"}
    if "tables" in part:
        tables_case(thin)
    with pytest.raises(ConfigError, match=r"materials\.electrode"):
        tables_case(dealib.load(small, set={**given, "geometry.electrode_thickness": "10 um"}))
