"""Damaged run directories: each command says which file it is, and goes on with the rest."""

import json
import random
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from watch import At

import dealib
from dealib.__main__ import main
from dealib.errors import ConfigError
from dealib.program.recorder import Recorder
from dealib.results.history import HISTORY
from dealib.results.info import INFO
from dealib.results.reader import CONFIG
from dealib.results.store import STATES
from dealib.results.tables import DeviceTables

pytestmark = pytest.mark.once  # files

SMALL = Path(__file__).parent / "small.yaml"
CODES = {0, 2, 3, 4}  # documented, and of no signal
GIVEN, MESH = "config.yaml", "mesh.msh"
VALUES, STATE = "checkpoint/program.json", "checkpoint/state_00008.npy"

OTHER_KIND = {
    INFO: b"[]",
    HISTORY: b"a,b\n1,2\n",
    CONFIG: b"- a\n- b\n",
    GIVEN: b"5\n",
    MESH: b"hello\n",
    VALUES: b'{"mesh": 1, "values": {"progress": {"step": 8}, "predictor": {"known": [1]}}}',
    STATE: b"\x93NUMPY\x01\x00",
    "fields.xdmf": b"<a/>",
    "run.log": b"{}",
}
WAYS = ("removed", "emptied", "truncated", "random", "another kind")


def damage(run, name, way):
    """Damage a file of a run in one of the ways."""
    path = run / name
    whole = path.read_bytes()
    if way == "removed":
        path.unlink()
    elif way == "another kind":
        if path.name == STATES:
            with h5py.File(path, "w") as file:
                file["history"], file["states"] = [1, 2], "none"
        else:
            path.write_bytes(OTHER_KIND.get(name, b"5"))
    else:
        noise = random.Random(path.name).randbytes(len(whole))
        parts = {"emptied": b"", "truncated": whole[: len(whole) // 2], "random": noise}
        path.write_bytes(parts[way])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A finished run, one that was killed, and data to compare with."""
    folder = tmp_path_factory.mktemp("made")
    case = dealib.load(SMALL, set={"program.1.steps": 4})
    dealib.simulate(case, folder / "done" / "run")
    stop = At(8, ZeroDivisionError("enough"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Recorder, "stop", lambda self, error: None)
        with pytest.raises(ZeroDivisionError):
            dealib.simulate(case, folder / "killed" / "run", observers=[stop])
    (folder / "data.csv").write_text("displacement [mm],force [N]\n-0.2,-0.02\n-0.9,-0.13\n")
    return folder


@pytest.fixture
def call(made, tmp_path, monkeypatch, capfd):
    """Runs a command on a copy of a run in which a file is damaged."""
    monkeypatch.chdir(tmp_path)

    def run(which, name, way, *arguments):
        shutil.rmtree("run", ignore_errors=True)
        shutil.copytree(made / which / "run", "run")
        damage(tmp_path / "run", name, way)
        monkeypatch.setattr(sys, "argv", ["dealib", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capfd.readouterr()
        assert stop.value.code in CODES, (name, way, arguments, err)
        assert "Traceback" not in out + err
        return stop.value.code, out, err

    return run


READING = {
    "info": ("info", "run"),
    "compare": ("compare", "run", "DATA"),
    "sense": ("sense", "run"),
    "plot": ("plot", "run"),
    "field": ("plot", "run", "--field", "E"),
    "animate": ("animate", "run", "--seconds", "0.5", "--out", "a.gif", "--overwrite"),
    "report": ("report", "run"),
}
# what each of them reads, and what it can do without: it is there elsewhere, or left out
NEEDED = {
    "info": ((INFO, HISTORY, CONFIG, STATES), (INFO, HISTORY, CONFIG, STATES)),
    "compare": ((HISTORY,), (HISTORY,)),
    "sense": ((INFO, HISTORY, CONFIG), (INFO, HISTORY, CONFIG)),
    "plot": ((INFO, HISTORY), (INFO, HISTORY)),
    "field": ((INFO, HISTORY, CONFIG, STATES), (INFO, HISTORY, CONFIG)),
    "animate": ((INFO, HISTORY, CONFIG, STATES), (INFO, HISTORY, CONFIG)),
    "report": ((INFO, HISTORY, CONFIG, STATES, MESH), (INFO, HISTORY, CONFIG, STATES, MESH)),
}


def check(call, made, command, name, way):
    arguments = [str(made / "data.csv") if a == "DATA" else a for a in READING[command]]
    code, out, err = call("done", name, way, *arguments)
    reads, spared = NEEDED[command]
    told = out + err
    if command == "report" and code == 0:
        told += Path("run/report.html").read_text()
    if name in reads and not (command == "report" and (name, way) == (MESH, "removed")):
        assert f"run/{name}:" in told, (command, name, way, told)
    assert code == (2 if name in reads and name not in spared else 0), (command, name, way, told)


FILES = (INFO, HISTORY, CONFIG, GIVEN, STATES, MESH, "fields.xdmf", "run.log", VALUES)


@pytest.mark.parametrize("name", FILES)
def test_what_is_damaged_is_told_and_the_rest_is_read(call, made, name):
    for way in WAYS:
        for command in ("info", "compare"):
            check(call, made, command, name, way)


PICTURES = [
    (command, name)
    for command in ("plot", "field", "sense", "animate", "report")
    for name in NEEDED[command][0]
    if command != "report" or name in (STATES, MESH)  # the others are slow
]


@pytest.mark.parametrize(("command", "name"), PICTURES)
def test_pictures_of_what_is_left(call, made, command, name):
    check(call, made, command, name, WAYS[PICTURES.index((command, name)) % len(WAYS)])


@pytest.mark.slow
@pytest.mark.parametrize("command", READING)
def test_every_command_on_every_damage(call, made, command):
    for name in FILES:
        for way in WAYS:
            check(call, made, command, name, way)


RESUMED = (INFO, HISTORY, CONFIG, STATES, VALUES, STATE, "states/00003.h5", "fields.xdmf")


@pytest.mark.parametrize("name", RESUMED)
def test_resuming_what_is_damaged(call, made, tmp_path, name):
    """It goes on, with the same result, or says which file is at fault and touches nothing."""
    whole = dealib.open(made / "done" / "run")
    resume = ("run", SMALL, "--set", "program.1.steps=4", "--out", "run", "--resume")
    lost = name in (STATES, VALUES, STATE, "states/00003.h5")
    for way in WAYS if lost else WAYS[::2]:
        code, _, err = call("killed", name, way, *resume)
        assert code == (2 if lost else 0), (name, way, err)
        told = {STATE: "checkpoint: ", VALUES: "checkpoint", "states/00003.h5": f"{STATES}: "}
        assert told.get(name, f"run/{name}:") in err, (name, way, err)
        if lost:
            assert "start anew with --overwrite" in err
            continue
        run = dealib.open(tmp_path / "run")
        assert run.status == "done"
        assert run.stored_steps == whole.stored_steps
        for column in whole.history.columns.drop("stage"):
            scale = whole.history[column].abs().max()
            np.testing.assert_allclose(
                run.history[column], whole.history[column], rtol=0, atol=1e-10 * scale
            )


def test_numbers_of_a_damaged_state_do_not_pass_for_true_ones(made, tmp_path):
    copied = Path(shutil.copytree(made / "done" / "run", tmp_path / "run"))
    with h5py.File(copied / STATES, "r") as file:
        chunk = file["states/00004"].id.get_chunk_info(0)
    with (copied / STATES).open("r+b") as file:
        file.seek(chunk.byte_offset + 64)
        file.write(b"\x00\x01\x02\x03")
    run = dealib.open(copied)
    with pytest.raises(ConfigError, match=r"results.h5: damaged .*still readable: run.json, hist"):
        run.state(4)
    assert np.array_equal(run.state(3), dealib.open(made / "done" / "run").state(3))


def test_deep_damage_of_the_record_costs_no_more_than_what_is_damaged(made, tmp_path, caplog):
    copied = Path(shutil.copytree(made / "done" / "run", tmp_path / "run"))
    whole = json.loads((copied / INFO).read_text())
    wrong = {"margins": {"wrinkling_use": {"use": "much"}}, "stops": [1], "ranks": "two", "argv": 5}
    (copied / INFO).write_text(json.dumps(whole | wrong))
    run = dealib.open(copied)
    assert run.status == "done"
    assert run.info["versions"] == whole["versions"]
    assert "margins" not in run.info
    assert (run.info["ranks"], run.info["argv"]) == (1, [])
    assert caplog.text.count("run.json: damaged (argv, margins, ranks, stops)") == 1


@pytest.mark.parametrize("suffix", ["csv", "h5", "mat"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.filterwarnings("ignore:genfromtxt")
def test_damaged_tables_are_refused_by_name(tmp_path, suffix, way):
    u, v = np.linspace(-1, 0, 5), np.linspace(0, 2, 4)
    U, V = np.meshgrid(u, v, indexing="ij")
    columns = {"displacement_mm": u, "voltage_kV": v, "force_N": 2 * U, "charge_uC": 3 * V}
    columns |= {"capacitance_pF": 3 + 0 * V, "potential_mJ": U**2 - 1.5 * V**2}
    DeviceTables(columns).save(tmp_path)
    path = tmp_path / f"tables.{suffix}"
    assert float(dealib.tables(path).force(-0.3, 1.1)) == pytest.approx(-0.6)
    if way == "truncated":  # within a row
        path.write_bytes(path.read_bytes()[: len(path.read_bytes()) // 2 + 3])
    else:
        damage(tmp_path, path.name, way)
    with pytest.raises(ConfigError, match=rf"{path}: no tables"):
        dealib.tables(path)
