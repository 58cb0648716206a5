"""Derivatives by the numbers of a config: against differences of whole runs, and their command."""

from __future__ import annotations

import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import dealib
from dealib.design import sensitivity
from dealib.design.keys import keys, moved
from dealib.design.neighbours import Neighbours

# isort: split
import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS
from typer.testing import CliRunner

from dealib.cli.app import app
from dealib.cli.mpi import environment, mpirun
from dealib.device.plan import tensor
from dealib.fem.reuse import Reuse
from dealib.results import spectra

SMALL, VISCOUS = (Path(__file__).with_name(f"{name}.yaml") for name in ("small", "viscous"))
COLUMNS = ["quantity", "key", "value", "unit", "derivative", "logarithmic"]

# what is solved -> config, changes, quantities, keys
KINDS = {
    "strip": (
        SMALL,
        {"program.1.steps": 4, "program.0.steps": 2},
        ["end(force_N, 'push')", "max(charge_uC)", "max(field_max_MV_per_m)", "max(wrinkling_use)"],
        [
            *("geometry.inner_radius", "geometry.outer_radius", "geometry.film_thickness"),
            *("materials.film.youngs_modulus", "materials.film.bulk_modulus"),
            *("materials.film.relative_permittivity", "materials.film.prestretch"),
            *("program.0.mount.displacement", "program.1.terminal.voltage.1"),
        ],
    ),
    "nearly incompressible, loaded": (
        SMALL,
        {
            "physics": "{formulation: mixed}",
            "geometry.electrode_thickness": "10 um",
            "materials.film.youngs_modulus": "null",
            "materials.film.shear_modulus": "0.3 MPa",
            "materials.film.bulk_modulus": "300 MPa",
            "materials.electrode": "{law: mooney_rivlin, c10: 0.1 MPa, c01: 0.02 MPa, "
            "bulk_modulus: 200 MPa}",
            "program": "[{stage: load, mount: {mass: 10 g}, steps: 2}, "
            "{stage: actuate, terminal: {voltage: 2 kV}, steps: 2}]",
        },
        ["displacement_mm", "stroke('actuate')", "charge_uC", "mount_work_mJ"],
        [
            *("geometry.film_thickness", "geometry.electrode_thickness", "geometry.inner_radius"),
            *("materials.film.shear_modulus", "materials.film.bulk_modulus"),
            *("materials.electrode.c10", "materials.electrode.c01", "program.0.mount.mass"),
            *("materials.film.prestretch", "program.1.terminal.voltage"),
        ],
    ),
    "membrane with a spring": (
        SMALL,
        {
            "physics": "{model: membrane}",
            "program": "[{stage: pull, mount: {spring: {stiffness: 0.2 N/mm, anchor: -3 mm}}}, "
            "{stage: charge, terminal: {charge: 0.5 uC}, steps: 2}]",
        },
        ["displacement_mm", "voltage_kV"],
        [
            *("geometry.inner_radius", "geometry.film_thickness", "materials.film.prestretch"),
            *("materials.film.youngs_modulus", "materials.film.relative_permittivity"),
            *("program.0.mount.spring.stiffness", "program.0.mount.spring.anchor"),
            "program.1.terminal.charge",
        ],
    ),
    "tension field": (  # slack around the axis wherever a difference looks: it is smooth there
        SMALL,
        {
            "physics": "{model: membrane, wrinkling: tension_field}",
            "materials.film.prestretch": "1.03",
            "program": "[{stage: push, mount: {displacement: -2 mm}, steps: 2}, "
            "{stage: actuate, terminal: {voltage: 3.2 kV}, steps: 2}]",
        },
        ["force_N", "charge_uC"],
        [
            *("geometry.inner_radius", "geometry.film_thickness", "materials.film.prestretch"),
            *("materials.film.youngs_modulus", "program.1.terminal.voltage"),
        ],
    ),
    "viscous": (
        VISCOUS,
        {"solver.time_tolerance": 0},
        ["end(force_N, 'hold')", "max(displacement_mm)", "dissipated_energy_mJ"],
        [
            *("materials.film.branches.0.shear_modulus", "program.1.duration"),
            *("materials.film.branches.1.relaxation_time", "geometry.electrode_thickness"),
            *("materials.film.youngs_modulus", "program.2.terminal.voltage.1"),
        ],
    ),
    "in air": (
        SMALL,
        {
            "geometry.air_height": "6 mm",
            "program": "[{stage: push, mount: {displacement: -1 mm}}, "
            "{stage: actuate, terminal: {voltage: 2 kV}}]",
        },
        ["force_N", "charge_uC"],
        [
            "geometry.film_thickness",
            "geometry.outer_radius",
            "materials.film.relative_permittivity",
        ],
    ),
    "plane strain": (
        CONFIGS / "devices" / "pure_shear_strip.yaml",
        {"mesh.columns": 8, "program.2.steps": 2},
        ["displacement_mm", "charge_uC"],
        ["geometry.base.width", "geometry.base.length", "program.1.mount.force"],
    ),
    "tube under pressure": (
        CONFIGS / "devices" / "tube.yaml",
        {"mesh.columns": 4, "program.5.steps": 2},
        ["force_N", "volume_mm3"],
        ["geometry.base.inner_radius", "geometry.layers.0.thickness", "program.4.chamber.pressure"],
    ),
    "tube, a membrane": (
        CONFIGS / "devices" / "tube.yaml",
        {"physics": "{model: membrane}", "mesh.columns": 4, "program.5.steps": 2},
        ["volume_mm3"],
        ["geometry.base.inner_radius", "geometry.layers.0.thickness", "program.4.chamber.pressure"],
    ),
    "gas in a chamber": (
        CONFIGS / "devices" / "annulus_with_chamber.yaml",
        {"mesh.columns": 8, "program.2.steps": 4, "program.3.steps": 2},
        ["max(displacement_mm)", "max(pressure_kPa)"],
        [
            *("program.2.chamber.gas.volume", "program.2.chamber.gas.pressure"),
            "geometry.base.inner_radius",
        ],
    ),
    "bias": (
        CONFIGS / "bias_negative_rate.yaml",
        {"mesh.columns": 8, "mesh.film_rows": 1, "program.3.steps": 4},
        ["stroke('actuate')"],
        [
            *("program.2.mount.bias.0.bistable.rate", "program.2.mount.bias.1.spring.stiffness"),
            *("program.2.mount.bias.1.spring.anchor", "materials.film.youngs_modulus"),
        ],
    ),
    "two terminals": (
        CONFIGS / "devices" / "segmented_annulus.yaml",
        {"mesh.columns": 8, "program.1.steps": 3, "program.2.steps": 2, "program.4.steps": 2},
        ["voltage_kV.sense", "capacitance_pF.sense.sense"],
        ["terminals.sense.within.along.0", "program.4.terminals.sense.charge"],
    ),
    "mesh of its own": (
        CONFIGS / "devices" / "cone.yaml",
        {"program.0.steps": 4, "program.1.steps": 2},
        ["displacement_mm", "charge_uC"],
        ["materials.film.shear_modulus", "program.0.mount.force"],
    ),
}
# With every dolfinx; the equations of the others are solved with each by other tests.
EACH = ("strip", "membrane with a spring", "viscous", "mesh of its own")


def loaded(path: Path, changes: dict[str, object]) -> dealib.Case:
    return dealib.load(path, set={"solver.tolerance": 1e-11} | changes)


def whole_runs(case: dealib.Case, of: list[str], name: str, reuse: Reuse) -> dict[str, float]:
    """Derivatives of quantities by central differences of whole runs, extrapolated to no step.

    Differences need states that are better than their tolerance: none is taken as it was predicted.
    """
    solver = case.config.solver.model_copy(update={"predictor_order": 0})
    case = replace(case, config=case.config.model_copy(update={"solver": solver}))
    (key,) = keys(case.config, [name])
    asked = sensitivity._Quantities(case.config, of, None)

    def values(step: float) -> dict[str, float]:
        config = moved(case.config, {key: 1 + step})
        simulation = dealib.Simulation(replace(case, config=config), reuse=reuse)
        rows = [state.row for state in simulation]
        return {q: asked.value(q, rows, config) for q in of}

    found = {}
    h = 1e-3
    up, down, far, low = (values(k * h) for k in (1, -1, 2, -2))
    for q in of:
        near, wide = (up[q] - down[q]) / (2 * h), (far[q] - low[q]) / (4 * h)
        found[q] = (4 * near - wide) / 3 / key.value
    return found


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=() if k in EACH else pytest.mark.once) for k in KINDS]
)
def test_derivatives_equal_differences_of_whole_runs(kind):
    path, changes, of, names = KINDS[kind]
    of = [text.replace("'", '"') for text in of]
    case = loaded(path, changes)
    found = sensitivity.find(case, of, names)
    rows = {(row["quantity"], row["key"]): row for row in found.rows}
    assert list(rows) == [(q, name) for q in of for name in names]
    reuse = Reuse()  # differences change numbers only
    for name in names:
        expected = whole_runs(case, of, name, reuse)
        for q in of:
            row, value = rows[q, name], found.values[q]
            # of influences that are hardly there: 1e-13 of rounding in states over a change of 1e-5
            least = 2e-8 * abs(value / row["value"])
            assert row["derivative"] == pytest.approx(expected[q], rel=1e-6, abs=least), (name, q)


@pytest.mark.once
def test_forces_scale_with_the_modulus_and_reciprocity_holds():
    table = dealib.sensitivities(dealib.load(SMALL), ['end(force_N, "push")'])
    slopes = table.set_index("key")["logarithmic"]
    assert slopes["materials.film.youngs_modulus"] == pytest.approx(1, abs=1e-8)
    assert slopes["materials.film.relative_permittivity"] == 0
    coupled = dealib.load(SMALL, set={"program.1.terminal.voltage": "2 kV"})
    table = dealib.sensitivities(coupled, key=["program"]).set_index(["quantity", "key"])
    pushed = dealib.sensitivities(dealib.load(VISCOUS), key=["program.0.mount"], at="push")
    assert pushed["quantity"].tolist() == ["force_N", "charge_uC"]  # the mount is free at the end
    by_voltage = table.loc[("force_N", "program.1.terminal.voltage"), "derivative"]
    by_travel = table.loc[("charge_uC", "program.0.mount.displacement"), "derivative"]
    assert by_voltage == pytest.approx(-by_travel, rel=1e-7)  # both are the potential's


@pytest.mark.once
def test_the_stroke_is_that_of_dealib_info(tmp_path):
    changes = {"program.1.mount": "{force: -0.05 N}"}
    case = dealib.load(SMALL, set=changes)
    run = dealib.simulate(case, tmp_path / "run")
    from dealib.results.summary import actuations

    (told,) = (a for a in actuations(run) if a.what == "stroke")
    found = sensitivity.find(case, ['stroke("actuate")'], ["program.1.terminal"])
    assert found.values['stroke("actuate")'] == pytest.approx(told.value, rel=1e-9)


@pytest.mark.once
def test_the_run_itself_is_not_disturbed():
    case = dealib.load(VISCOUS)
    plain = [state.row for state in dealib.Simulation(case)]
    base, rows = dealib.Simulation(case), []
    chosen = keys(case.config, ["geometry", "materials.film.branches"])
    near = Neighbours(base, chosen, {"force_N"}, 1e-5)
    for state in base:
        rows.append(state.row)
        near.follow()
    assert len(rows) == len(plain)
    for one, other in zip(rows, plain, strict=True):
        for name in ("time_s", "displacement_mm", "force_N", "charge_uC", "dissipated_energy_mJ"):
            assert one[name] == pytest.approx(other[name], rel=1e-8, abs=1e-10), name


def test_conditions_end_stages_where_the_config_itself_meets_them():
    stop = "[{when: force_N < -0.1 N}]"
    case = dealib.load(SMALL, set={"program.0.stop_when": stop, "solver.tolerance": 1e-11})
    step = [s.row["step"] for s in dealib.Simulation(case) if s.row["stage"] == "push"][-1]
    assert 0 < step < 8
    table = dealib.sensitivities(case, ['end(force_N, "push")'], ["program.0.mount.displacement"])
    cut = dealib.load(SMALL, set={"program.0.steps": 8, "solver.tolerance": 1e-11})
    (key,) = keys(cut.config, ["program.0.mount.displacement"])
    ends = []
    for sign in (1, -1):
        other = replace(cut, config=moved(cut.config, {key: 1 + sign * 1e-4}))
        rows = [s.row for s in dealib.Simulation(other) if s.row["stage"] == "push"]
        ends.append(rows[step - 1]["force_N"])
    assert table["derivative"][0] == pytest.approx(-(ends[0] - ends[1]) / 2e-4, rel=1e-6)


def test_coinciding_nodes_are_one_however_they_are_rounded():
    lines = np.array([0.0, 1.0])
    for shift in np.linspace(0, 1e-9, 11):  # the grid on which coordinates were rounded once
        one = tensor(lines, lines)
        two = tensor(lines + 1, lines)
        plan = type(one)(
            np.concatenate([one.points, two.points + 1e-16]) + shift,
            np.concatenate([one.cells, two.cells + len(one.points)]),
        )
        assert len(plan.merged().points) == 15


# --- what is refused, or left out -----------------------------------------------------------------

REFUSED = {
    "follow": (
        CONFIGS / "pull_in.yaml",
        {},
        "program.{k}.follow",
        "sensitivities need given loads, which states on a branch do not have",
    ),
    "dynamic": (
        CONFIGS / "dynamics" / "step_response.yaml",
        {},
        "program.{k}.dynamic",
        "sensitivities need a program in equilibrium",
    ),
    "charging": (
        SMALL,
        {"sensing.sheet_resistance": "10 kohm", "sensing.charging": True},
        "sensing.charging",
        "sensitivities need a program in equilibrium",
    ),
    "softening": (
        CONFIGS / "softening.yaml",
        {},
        "materials.film.mullins",
        "there are no sensitivities with a softening law, whose stress has a kink at the largest "
        "energy so far",
    ),
    "second film": (
        CONFIGS / "bias_double_cone.yaml",
        {},
        "program.{k}.mount.bias.0.film",
        "there are no sensitivities with a second film, which is solved alone",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_programs_of_other_kinds_are_refused_before_anything_is_solved(kind, monkeypatch):
    path, changes, where, said = REFUSED[kind]
    case = dealib.load(path, set=changes)
    monkeypatch.setattr(sensitivity, "Simulation", None)
    with pytest.raises(dealib.ConfigError) as error:
        dealib.sensitivities(case)
    head, _, rest = str(error.value).splitlines()[0].partition(": ")
    if changes:
        assert head == f"set {where}=true"
        assert rest == said
        return
    assert head.startswith(str(path))
    place, _, message = rest.partition(": ")
    assert place in [where.format(k=k) for k in range(9)]
    assert message == said


MISTAKES = [
    ({"of": ["force"]}, "of: unknown name 'force'; did you mean 'force_N'?"),
    ({"of": ["open('x')"]}, "of: unknown function 'open'"),
    ({"of": ['end(force_N, "psh")']}, "of: there is no stage 'psh'; did you mean 'push'?"),
    ({"of": ["force_N / (time_s - time_s)"]}, "of: 'force_N / (time_s - time_s)' is infinite"),
    ({"at": "psh"}, "at: there is no stage 'psh'; did you mean 'push'?"),
    ({"key": ["geometry.radius"]}, "the config has no number 'geometry.radius'"),
    (
        {"key": ["geometry.electrode_thickness"]},
        "geometry.electrode_thickness is 0 and cannot be changed by a share of itself",
    ),
]


@pytest.mark.once
@pytest.mark.parametrize(("asked", "said"), MISTAKES)
def test_mistakes_are_told(asked, said):
    with pytest.raises(dealib.ConfigError) as error:
        dealib.sensitivities(dealib.load(SMALL), **asked)
    assert str(error.value).startswith(said)


@pytest.mark.once
def test_numbers_that_the_mesh_does_not_follow_are_told(tmp_path):
    case = dealib.load(CONFIGS / "devices" / "segmented_annulus.yaml", set={"mesh.columns": 8})
    where = "geometry.base.inner_radius"
    said = "8 to 13 mm is no part of the base, which goes from 8.00008 to 20 mm along R"
    with pytest.raises(dealib.ConfigError, match=f"^{where}: {said}$"):
        dealib.sensitivities(case, key=[where])
    found = sensitivity.find(case, ["force_N"])
    assert found.left_out[where] == said
    assert found.left_out["geometry.base.outer_radius"] == (
        "a small change would alter the mesh's cells, as where a part ends at an edge"
    )
    assert where not in [row["key"] for row in found.rows]
    own = dealib.load(CONFIGS / "own_mesh.yaml")
    with pytest.raises(dealib.ConfigError) as error:
        dealib.sensitivities(own, key=["geometry.film_thickness"])
    assert str(error.value) == (
        "geometry.film_thickness: the shape is that of mesh.file, not of this number"
    )
    cone = dealib.load(CONFIGS / "devices" / "cone.yaml")
    with pytest.raises(dealib.ConfigError, match="the config has no number"):
        dealib.sensitivities(cone, key=["geometry.radius"])
    ogden = {
        "materials.film": "{law: ogden, mu: [0.3 MPa], alpha: [2.0], bulk_modulus: 20 MPa, "
        "relative_permittivity: 3}"
    }
    with pytest.raises(dealib.ConfigError, match="it is an exponent, for which the equations are"):
        dealib.sensitivities(dealib.load(SMALL, set=ogden), key=["materials.film.alpha"])


# --- the command ----------------------------------------------------------------------------------


def printed(done: Any) -> list[str]:
    """What a command has printed, without what it says on a busy machine, such as 'meshing ...'."""
    return [line for line in done.output.splitlines() if not line.endswith(" ...")]


@pytest.mark.once
def test_the_command_writes_draws_and_prints(tmp_path):
    out = tmp_path / "found"
    line = ["sensitivity", str(SMALL), "--of", "force_N", "--at", "push", "--out", str(out)]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    table = spectra.read(out / "sensitivity.csv", "derivative")
    assert list(table) == COLUMNS
    again = dealib.sensitivities(dealib.load(SMALL), ["force_N"], at="push")
    pd.testing.assert_frame_equal(table.fillna(""), again.fillna(""), rtol=1e-6, atol=1e-9)
    lines = printed(done)
    assert lines[0] == "force_N = -0.154764"
    assert lines[1].split() == ["key", "value", "unit", "derivative", "d", "ln", "/", "d", "ln"]
    sizes = [abs(float(text.split()[-1])) for text in lines[2:8]]
    assert sizes == sorted(sizes, reverse=True)
    told = [text.split() for text in lines]
    assert ["materials.film.youngs_modulus", "1", "MPa", "-0.15476", "1.0000"] in told
    assert lines[-3].startswith("  without influence: ")
    assert lines[-2:] == [str(out / "sensitivity.csv"), str(out / "sensitivity.png")]
    assert (out / "sensitivity.png").read_bytes().startswith(b"\x89PNG")
    done = CliRunner().invoke(app, line)
    assert done.exit_code != 0
    assert str(done.exception) == (
        f"{out / 'sensitivity.csv'} exists; choose another --out, or --overwrite it"
    )


@pytest.mark.once
def test_the_guide_shows_what_the_command_prints(tmp_path):
    page = CONFIGS.parent / "notebooks" / "guide" / "design.md"
    section = page.read_text(encoding="utf-8").partition("\n## Design\n")[2].partition("\n## ")[0]
    line = shlex.split(section.strip().splitlines()[0])
    assert line[:3] == [".venv/bin/dealib", "sensitivity", "configs/deap100.yaml"]
    path = CONFIGS / "deap100.yaml"
    done = CliRunner().invoke(app, ["sensitivity", str(path), *line[3:], "--out", str(tmp_path)])
    assert done.exit_code == 0, repr(done.exception)
    shown = section.partition("```text\n")[2].partition("```")[0].splitlines()
    for one, other in zip(shown, printed(done), strict=False):
        for a, b in zip(one.split(), other.split(), strict=True):
            assert a == b or float(a) == pytest.approx(float(b), rel=1e-4, abs=1e-4), (one, other)


@pytest.mark.once
@pytest.mark.mpi
def test_two_ranks_give_what_one_does(tmp_path):
    of = ["--of", "max(charge_uC)", "--of", "max(wrinkling_use)", "--key", "geometry"]
    tables = []
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        line = [mpirun(), "-n", str(ranks), sys.executable, "-m", "dealib", "sensitivity"]
        line += [str(SMALL), *of, "--key", "materials", "--out", str(out)]
        subprocess.run(line, check=True, env=environment(), timeout=300)
        tables.append(pd.read_csv(out / "sensitivity.csv"))
    pd.testing.assert_frame_equal(*tables, rtol=1e-6, atol=1e-8)
