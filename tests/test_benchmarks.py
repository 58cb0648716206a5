"""The benchmarks run, and their settings do not change results."""

import json
import shutil
from pathlib import Path

import pytest
from benchmarks import run
from conftest import history

TIGHT = {"solver__tolerance": 1e-11, "solver__predictor_order": 0, "solver__linear": "lu"}
ABSOLUTE = {"energy_residual_mJ", "newton_iterations"}  # a difference; a count


@pytest.mark.parametrize(
    "name",
    [
        "benchmark_strip",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("benchmark_strip_air", "deap100")),
    ],
)
def test_fast_settings_give_the_history_of_a_tight_plain_solve(name):
    fast, tight = history(name), history(name, **TIGHT)
    assert fast["newton_iterations"].sum() < 0.8 * tight["newton_iterations"].sum()
    for column in fast.columns.difference([*ABSOLUTE, "stage"]):
        scale = tight[column].abs().max()
        assert fast[column].to_numpy() == pytest.approx(tight[column], rel=0, abs=1e-6 * scale)


@pytest.mark.parametrize(("name", "most"), [("deap100", 1.1), ("benchmark_strip", 1.4)])
def test_tangents_a_step(name, most):
    iterations = history(name)["newton_iterations"]
    assert iterations.sum() / (len(iterations) - 1) <= most


def test_some_groups_alone_leave_the_results_of_all(tmp_path, monkeypatch, capsys):
    kept = tmp_path / "results.json"
    kept.write_text("all of them")
    monkeypatch.setattr(run, "RESULTS", kept)
    monkeypatch.setattr(run, "repeat", lambda todo, _: [])
    for arguments in (["--quick"], ["--only", "strip"]):
        run.main([*arguments, "--repeat", "1"])
        assert kept.read_text() == "all of them"
    run.main(["--repeat", "1"])
    assert json.loads(kept.read_text())["records"] == []
    assert "medians of 1" in capsys.readouterr().out


def test_benchmarks_run_and_tell(tmp_path, capsys, monkeypatch):
    results = tmp_path / "results.json"
    run.main(["--quick", "--repeat", "1", "--out", str(results)])
    found = json.loads(results.read_text())
    ours, plain = found["records"]
    assert [ours["variant"], plain["variant"]] == ["dealib", "plain"]
    assert ours["unknowns"] == plain["unknowns"] > 200
    assert ours["steps"] == plain["steps"] == 2
    assert 0 < ours["assembly"] + ours["factorisation"] < ours["solve"] < ours["wall"]
    assert 50 < ours["memory_MB"] < 2000
    shown = run.table(found)
    assert shown in capsys.readouterr().out
    assert "| quick, plain |" in shown
    page = Path("tests", "benchmarks", "README.md")
    (tmp_path / page.parent).mkdir(parents=True)
    shutil.copy(run.ROOT / page, tmp_path / page)
    monkeypatch.setattr(run, "ROOT", tmp_path)
    run.main(["--readme", "--out", str(results)])
    assert shown in (tmp_path / page).read_text()
