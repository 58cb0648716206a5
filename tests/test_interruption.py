"""No interruption costs a converged step: kills, signals, refusing disks, and going on."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import said
from watch import At

import dealib
from dealib import files
from dealib.errors import ConfigError, PlatformError
from dealib.program import run as program_run
from dealib.results import store, xdmf
from dealib.results.history import HISTORY
from dealib.results.info import INFO
from dealib.results.lock import Lock
from dealib.versions import git_hash

SMALL = Path(__file__).parent / "small.yaml"
STEPS = 24
PATIENCE = 300  # seconds for a run that takes two: other tests may keep the machine busy
ROOT = os.geteuid() == 0


def small(*changes):
    return dealib.load(SMALL, set=changes)


def in_child(*arguments, limit=None, alone=False):
    """Start a run in a process of its own, which may write files up to a limit, or writes them all.

    Not by a fork: MPICH shares memory with a forked child, whose writes break this process.
    """
    code = "import resource; import dealib.program; from dealib.__main__ import main; "
    if alone:  # as on one processor
        code += "from dealib.results.beside import Beside; Beside.useful = lambda: False; "
    if limit is not None:  # not before MPI has started: it writes files as well
        code += f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit})); "
    return subprocess.Popen(
        [sys.executable, "-c", code + "main()", *command(*arguments)[3:]],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def exit_code(job):
    job.communicate(timeout=PATIENCE)
    return job.returncode


def wait_for(path, lines=0):
    """Wait until a file or a folder is there, and the file has a number of lines."""
    deadline = time.monotonic() + PATIENCE
    while not path.exists() or (lines and lines > path.read_bytes().count(b"\n")):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{path} did not come")
        time.sleep(0.002)


@pytest.fixture(scope="module")
def commit():
    """The checkout's commit before `whole` ran: others may commit while the tests run."""
    if not shutil.which("git"):
        return None
    head = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    return subprocess.run(head, capture_output=True, text=True).stdout.strip() or None


@pytest.fixture(scope="module")
def whole(tmp_path_factory, commit):
    """The run that nobody interrupts, and how long it takes from its directory on."""
    directory = tmp_path_factory.mktemp("whole") / "run"
    assert exit_code(in_child("--out", directory)) == 0
    shutil.rmtree(directory)
    job = in_child("--out", directory)
    wait_for(directory)
    begin = time.perf_counter()
    assert exit_code(job) == 0
    return dealib.open(directory), time.perf_counter() - begin


def assert_same_history(run, other, rows=None):
    a, b = run.history, other.history
    assert list(a.columns) == list(b.columns)
    b = b if rows is None else b.iloc[:rows]
    assert len(a) == len(b)
    for name in b.columns:
        if b[name].dtype.kind in "fi":
            scale = float(other.history[name].abs().max())
            np.testing.assert_allclose(a[name], b[name], rtol=0, atol=1e-10 * scale, err_msg=name)
        else:
            assert a[name].tolist() == b[name].tolist()
    assert a["newton_iterations"].tolist() == b["newton_iterations"].tolist()


def assert_readable(directory, whole):
    """Everything that converged can be read; returns the number of rows."""
    import pyvista as pv

    if not (directory / INFO).exists():
        assert not (directory / HISTORY).exists()
        return 0
    run = dealib.open(directory)
    assert run.status in ("done", "killed")
    if not (directory / HISTORY).exists():
        return 0
    assert (directory / HISTORY).read_bytes().endswith(b"\n")
    rows = len(run.history)
    assert_same_history(run, whole, rows)
    stored = run.stored_steps
    assert stored == list(range(len(stored)))
    assert rows - 1 <= len(stored) <= rows + 1
    for index in range(len(stored)):
        np.testing.assert_allclose(run.state(index), whole.state(index), atol=1e-9)
    with h5py.File(directory / store.STATES, "r") as file:
        assert len(file["history"].get("step", ())) == len(stored)
    reader = pv.get_reader(directory / xdmf.FIELDS)
    assert len(reader.time_values) >= rows
    reader.set_active_time_value(reader.time_values[-1])
    assert np.isfinite(reader.read().point_data["cauchy_stress"]).all()
    return rows


def kill_at_random(tmp_path, whole, times, seed):
    """Half of the kills at any time, half after any row: steps take little of a run.

    Half of the runs write by themselves: a process beside writes all that it has been given.
    """
    whole, seconds = whole
    rng, found = random.Random(seed), []
    while len(found) < times:
        directory = tmp_path / f"killed_{len(found)}"
        job = in_child("--out", directory, "--overwrite", alone=len(found) % 4 in (1, 2))
        if len(found) % 2:
            wait_for(directory / HISTORY, 1 + rng.randrange(STEPS))
            delay = rng.uniform(0, 0.02)
        else:
            wait_for(directory)
            delay = rng.uniform(0, seconds)
        time.sleep(delay)
        job.kill()
        if exit_code(job) == 0:  # it was done: not a kill
            seconds = min(seconds, max(delay, 0.02))
            shutil.rmtree(directory)
            continue
        found.append(assert_readable(directory, whole))
        after = dealib.simulate(small(), directory, resume=True)
        assert after.status == "done"
        assert_same_history(after, whole)
        assert after.stored_steps == list(range(STEPS + 1))
        assert assert_readable(directory, whole) == STEPS + 1
        assert not list(directory.rglob("*.tmp*"))
    return found


@pytest.mark.once
def test_killed_at_random(tmp_path, whole):
    found = kill_at_random(tmp_path, whole, 8, seed=1)
    assert len(set(found)) > 2  # the kills fell on different steps


@pytest.mark.slow
def test_killed_at_random_a_hundred_times(tmp_path, whole):
    found = kill_at_random(tmp_path, whole, 100, seed=2)
    print(f"\nrows after each of 100 kills: {sorted(found)}")
    assert len(set(found)) > 15


@pytest.mark.once
@pytest.mark.parametrize("wanted", ["every", "stage", "none"])
def test_killed_between_any_two_writes(tmp_path, whole, wanted, monkeypatch):
    """Stopped right after the history, the state or the fields of a step were written."""
    case = small(f"output.fields={wanted}")

    class Stopped(BaseException):
        pass

    for point, count in ((store.HistoryFile, 5), (store.StateFile, 10), (xdmf.FieldFile, 2)):
        if point is xdmf.FieldFile and wanted == "none":
            continue
        directory = tmp_path / point.__name__
        with monkeypatch.context() as patch:
            calls, add = [], point.add

            def stopping(self, *given, add=add, calls=calls, count=count):
                add(self, *given)
                calls.append(1)
                if len(calls) == count:
                    raise Stopped

            patch.setattr(point, "add", stopping)
            patch.setattr(store.StateFile, "close", lambda self: None)
            with pytest.raises(Stopped):
                dealib.simulate(case, directory)
        resumed = dealib.simulate(case, directory, resume=True)
        assert_same_history(resumed, whole[0])
        expected = {"every": list(range(STEPS + 1)), "stage": [0, 8, 24], "none": []}[wanted]
        assert resumed.stored_steps == expected


@pytest.mark.once
def test_killed_while_gathering(tmp_path, whole, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(store.shutil, "rmtree", lambda path: (path / "00003.h5").unlink())
        dealib.simulate(small(), tmp_path / "run")
    info = json.loads((tmp_path / "run/run.json").read_text())
    (tmp_path / "run/run.json").write_text(json.dumps(info | {"status": "failed"}))
    resumed = dealib.simulate(small(), tmp_path / "run", resume=True)
    assert resumed.stored_steps == list(range(STEPS + 1))
    assert_same_history(resumed, whole[0])


# --- signals --------------------------------------------------------------------------------------


# Open MPI leaves marks in the environment of this process, which confuse an mpirun below it
CLEAN = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PMI_"))}


def command(*arguments):
    return [sys.executable, "-m", "dealib", "run", str(SMALL), *map(str, arguments)]


def slowed(seconds, *arguments):
    """The command with a pause after each step from the third: a signal then falls into a step."""
    code = (
        "import time, dealib.program.run as r\n"
        "see = r.Recorder.see\n"
        f"wait = lambda s: time.sleep({seconds} * (s.row['step'] > 2))\n"
        "r.Recorder.see = lambda self, s: (see(self, s), wait(s))\n"
        "from dealib.__main__ import main; main()"
    )
    return [sys.executable, "-c", code, *command(*arguments)[3:]]


def when_converged(directory, steps):
    """Wait until a run has so many steps."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            if (directory / HISTORY).read_text().count("\n") > steps + 1:
                return
        except FileNotFoundError:
            pass
        time.sleep(0.005)
    raise TimeoutError(f"{directory}: step {steps} did not come")


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_finishes_the_step_and_says_how_to_go_on(tmp_path, whole, sent, code):
    directory = tmp_path / "run"
    slow = slowed(0.5, "--out", directory)
    job = subprocess.Popen(slow, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    when_converged(directory, 3)
    job.send_signal(sent)
    _, errors = job.communicate(timeout=PATIENCE)
    assert job.returncode == code
    assert "Traceback" not in errors
    assert f"stopped by {sent.name}; what converged is in {directory}" in errors
    go_on = f"dealib run {SMALL} --out {directory} --resume"
    assert f"Go on with: {go_on}" in errors
    run = dealib.open(directory)
    assert run.status == "interrupted"
    assert 4 <= len(run.history) < STEPS
    from dealib.tasks.info import describe

    assert describe(run).splitlines()[0] == "run (small): interrupted"
    again = f"dealib.simulate('{SMALL}', '{directory}', resume=True)"
    assert f"go on with: {again}" in describe(run)
    resumed = dealib.simulate(small(), directory, resume=True)
    assert_same_history(resumed, whole[0])
    session = resumed.info["earlier_sessions"]
    assert [s["status"] for s in session] == ["interrupted"]
    assert (directory / "run.log").read_text().count("resumed after step") == 1


def test_second_signal_stops_at_once(tmp_path):
    directory = tmp_path / "run"
    slow = slowed(2 * PATIENCE, "--out", directory)
    job = subprocess.Popen(slow, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    when_converged(directory, 3)
    job.send_signal(signal.SIGINT)
    told = "dealib: finishing the step; once more to stop at once\n"
    assert told in iter(job.stderr.readline, "")
    assert job.poll() is None  # it finishes its step
    job.send_signal(signal.SIGINT)
    job.communicate(timeout=PATIENCE)  # it would take twice as long
    assert job.returncode == -signal.SIGINT  # a shell says 130
    run = dealib.open(directory)
    assert run.status == "killed"
    assert len(run.history) == 4


def test_usr1_checkpoints_and_goes_on(tmp_path, whole):
    ask = At(5, lambda: os.kill(os.getpid(), signal.SIGUSR1))
    run = dealib.simulate(small(), tmp_path / "run", observers=[ask])
    assert run.status == "done"
    assert_same_history(run, whole[0])
    log = (run.directory / "run.log").read_text()
    assert log.count("SIGUSR1: the checkpoint is at step 5") == 1


@pytest.mark.mpi
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_signal_under_mpirun(tmp_path, whole, sent):
    directory = tmp_path / "run"
    job = subprocess.Popen(
        command("--out", directory, "--mpi", 2),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=CLEAN,
    )
    when_converged(directory, 3)
    job.send_signal(sent)
    _, errors = job.communicate(timeout=PATIENCE)
    assert job.returncode == 128 + sent
    assert "Traceback" not in errors
    run = dealib.open(directory)
    assert run.status == "interrupted"
    resumed = dealib.simulate(small(), directory, resume=True)  # on one rank
    assert resumed.info["steps"] == STEPS
    assert f"--out {directory} --resume --mpi 2" in errors
    a, b = resumed.history, whole[0].history
    for name in a.columns.drop("stage"):
        np.testing.assert_allclose(a[name], b[name], rtol=0, atol=1e-8 * b[name].abs().max())


# --- what resume refuses --------------------------------------------------------------------------


@pytest.fixture
def stopped(tmp_path):
    """A run that stopped after step 6."""
    stop = At(6, lambda: os.kill(os.getpid(), signal.SIGTERM))
    with pytest.raises(dealib.Interrupted, match="stopped by SIGTERM") as caught:
        dealib.simulate(small(), tmp_path / "run", observers=[stop])
    assert caught.value.exit_code == 143
    return tmp_path / "run"


@pytest.mark.once
def test_resume_refuses_other_physics_and_says_which(stopped):
    before = (stopped / HISTORY).read_bytes()
    changed = small(
        "materials.film.youngs_modulus=2 MPa",
        "geometry.outer_radius=13 mm",
        "program.1.terminal.voltage=[0 kV, 1 kV]",
    )
    with pytest.raises(ConfigError) as caught:
        dealib.simulate(changed, stopped, resume=True)
    message = str(caught.value)
    assert "geometry.outer_radius: was 12.0 mm, is 13.0 mm" in message
    assert "materials.film.shear_modulus: was 0.333" in message
    assert "program.1.terminal.voltage.1: was 2.0 kV, is 1.0 kV" in message
    assert "program.1.terminal.voltage.2: was 0.0 kV, is absent" in message
    assert "Only name, description, output, solver and mesh.file may change" in message
    assert (stopped / HISTORY).read_bytes() == before
    assert dealib.open(stopped).status == "interrupted"


def test_resume_allows_what_is_no_physics(stopped, whole):
    case = small("name=other", "description=x", "output.fields=stage", "solver.max_cuts=12")
    resumed = dealib.simulate(case, stopped, resume=True)
    assert_same_history(resumed, whole[0])
    assert resumed.stored_steps == [*range(7), 8, 24]


def test_resume_refuses_another_mesh(stopped):
    values = stopped / "checkpoint/program.json"
    saved = json.loads(values.read_text()) | {"mesh": "of another geometry"}
    values.write_text(json.dumps(saved))
    with pytest.raises(ConfigError, match="the checkpoint belongs to another mesh"):
        dealib.simulate(small(), stopped, resume=True)


@pytest.mark.once
def test_resume_refuses_damage_and_what_goes_on_elsewhere(stopped, tmp_path):
    with pytest.raises(ConfigError, match="nothing to resume"):
        dealib.simulate(small(), tmp_path / "nowhere", resume=True)
    info = dealib.open(stopped).info
    (stopped / "run.json").write_text(json.dumps(info | {"status": "running", "pid": os.getppid()}))
    with (
        Lock(stopped),
        pytest.raises(ConfigError, match=f"still going on \\(process {os.getppid()}"),
    ):
        dealib.simulate(small(), stopped, resume=True)
    (stopped / "run.json").write_text(json.dumps(info))
    (stopped / "checkpoint/state_00006.npy").write_bytes(b"no array")
    with pytest.raises(ConfigError, match=r"checkpoint: damaged checkpoint"):
        dealib.simulate(small(), stopped, resume=True)


@pytest.mark.once
def test_a_killed_run_whose_process_number_lives_on_is_resumed(stopped, whole):
    info = dealib.open(stopped).info | {"status": "running", "pid": os.getppid()}
    (stopped / "run.json").write_text(json.dumps(info))
    assert dealib.open(stopped).status == "running"
    assert_same_history(dealib.simulate(small(), stopped, resume=True), whole[0])


@pytest.mark.once
@pytest.mark.parametrize("name", [HISTORY, "config.resolved.yaml"])
def test_what_the_results_hold_too_is_taken_from_there(stopped, whole, name, caplog):
    (stopped / name).unlink()
    assert_same_history(dealib.simulate(small(), stopped, resume=True), whole[0])
    assert f"{stopped / name}: " in caplog.text
    assert "is that in results.h5" in caplog.text
    assert (stopped / name).is_file()


@pytest.mark.once
def test_resume_says_what_a_damaged_run_lacks(stopped):
    (stopped / store.STATES).unlink()
    with pytest.raises(ConfigError, match=r"cannot resume, .*results.h5: missing") as caught:
        dealib.simulate(small(), stopped, resume=True)
    assert str(caught.value).endswith(
        "still readable: run.json, history.csv, config.resolved.yaml; "
        "start anew with overwrite=True"
    )
    (stopped / "run.json").write_text("{")
    (stopped / "mine.txt").write_text("kept")
    again = dealib.simulate(small("program=[{stage: prestrain}]"), stopped, overwrite=True)
    assert again.status == "done"
    assert len(again.history) == len(again.stored_steps) == 1
    assert (stopped / "mine.txt").read_text() == "kept"


@pytest.mark.once
def test_resume_of_a_finished_run_of_another_config_is_refused(whole):
    run, _ = whole
    before = (run.directory / HISTORY).read_bytes()
    with pytest.raises(ConfigError, match=r"outer_radius: was 12\.0 mm, is 13\.0 mm"):
        dealib.simulate(small("geometry.outer_radius=13 mm"), run.directory, resume=True)
    assert (run.directory / HISTORY).read_bytes() == before


def test_resuming_a_finished_run_changes_nothing(whole, caplog):
    run, _ = whole
    before = {p: p.stat().st_mtime_ns for p in run.directory.rglob("*")}
    again = dealib.simulate(small(), run.directory, resume=True)
    assert "this run is finished; it is left as it is" in caplog.text
    assert_same_history(again, run)
    assert {p: p.stat().st_mtime_ns for p in run.directory.rglob("*")} == before


# --- disks that refuse ----------------------------------------------------------------------------


@pytest.mark.once
@pytest.mark.parametrize("kilobytes", [1, 2, 8, 20])
def test_a_limit_on_file_size_stops_it_cleanly(tmp_path, whole, kilobytes):
    directory = tmp_path / "run"
    job = in_child("--out", directory, limit=1024 * kilobytes)
    _, message = job.communicate(timeout=PATIENCE)
    assert job.returncode == 4
    assert "cannot write " in message
    assert "File too large" in message or "limit on file size" in message
    assert not list(directory.rglob("*.tmp*"))
    resumed = dealib.simulate(small(), directory, resume=True)
    assert_same_history(resumed, whole[0])


@pytest.mark.once
@pytest.mark.skipif(not ROOT, reason="needs to mount a small file system")
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.mpi)])
def test_a_full_disk_keeps_what_is_there(tmp_path, whole, ranks):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", disk], capture_output=True
    )
    if mount.returncode:
        pytest.skip("may not mount")
    try:
        job = subprocess.run(
            command("--out", disk / "run", "--mpi", ranks),
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            env=CLEAN,
        )
        assert job.returncode == 4, job.stderr
        assert "Traceback" not in job.stderr
        assert "No space left on device" in job.stderr
        run = dealib.open(disk / "run")
        rows = len(run.history)
        assert 1 < rows < STEPS
        stored = run.stored_steps
        assert len(stored) >= rows - 1
        assert np.isfinite(run.state(-1)).all()
        subprocess.run(["mount", "-o", "remount,size=20m", disk], check=True)
        resumed = dealib.simulate(small(), disk / "run", resume=True)
        assert resumed.info["steps"] == STEPS
        b = whole[0].history["force_N"]
        assert np.abs(resumed.history["force_N"] - b).max() < 1e-8 * b.abs().max()
    finally:
        subprocess.run(["umount", "-l", disk], check=True)


@pytest.mark.once
def test_history_is_cut_back_to_whole_lines(tmp_path, monkeypatch):
    history = store.HistoryFile(tmp_path)
    history.add({"step": 0, "x": 1.5})
    before = history.path.read_bytes()
    opened = Path.open

    class Full:
        def __init__(self, file):
            self.file = file

        def __enter__(self):
            return self

        def __exit__(self, *error):
            self.file.close()

        def write(self, data):
            return self.file.write(data[: len(data) // 2])

        def __getattr__(self, name):
            return getattr(self.file, name)

    monkeypatch.setattr(Path, "open", lambda self, *a, **k: Full(opened(self, *a, **k)))
    with pytest.raises(PlatformError, match=r"history\.csv: No space left on device"):
        history.add({"step": 1, "x": 2.5})
    monkeypatch.undo()
    assert history.path.read_bytes() == before == b"step,x\n0,1.5\n"


@pytest.mark.once
def test_unwritable_places(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PlatformError, match=r"cannot make .*: Not a directory"):
        dealib.simulate(small(), tmp_path / "file/run")
    with pytest.raises(PlatformError, match=r"cannot write /proc/x: No such file"):
        files.write_text(Path("/proc/x"), "y")


# --- logs -----------------------------------------------------------------------------------------


def test_log_and_record(whole, commit):
    run, _ = whole
    lines = (run.directory / "run.log").read_text().splitlines()
    assert all(pd.notna(pd.to_datetime(line[:19], errors="coerce")) for line in lines)
    assert "dolfinx" in lines[1]
    assert sum("step " in line for line in lines) == STEPS + 1
    assert lines[-1].endswith("done")
    info = run.info
    assert info["status"] == "done"
    assert info["warnings"] == []
    assert info["git"] == commit
    assert info["config"] == str(SMALL)
    assert info["timings"]["output"] < info["timings"]["total"]
    assert 0 < info["timings"]["writing"] < info["timings"]["total"]


@pytest.mark.once
def test_a_busy_machine_keeps_the_commit(tmp_path, monkeypatch):
    if (expected := git_hash()) is None:
        pytest.skip("needs git and a checkout")
    slow = tmp_path / "git"
    slow.write_text(f'#!/bin/sh\nsleep 6\nexec {shutil.which("git")} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert git_hash() == expected


@pytest.mark.once
def test_quiet_unless_verbose(tmp_path):
    quiet = subprocess.run(command("--out", tmp_path / "a"), capture_output=True, text=True)
    assert quiet.returncode == 0
    assert said(quiet.stderr) == ""
    loud = subprocess.run(command("--out", tmp_path / "b", "-v"), capture_output=True, text=True)
    assert loud.returncode == 0
    assert loud.stderr.count("  displacement ") > STEPS  # residuals by field and iteration
    assert "potential" in loud.stderr
    assert "of the stage, next" in loud.stderr


@pytest.mark.once
def test_versions_that_changed_are_a_warning(stopped, monkeypatch):
    now = program_run.versions()
    monkeypatch.setattr(program_run, "versions", lambda: now | {"gmsh": "5.0"})
    resumed = dealib.simulate(small(), stopped, resume=True)
    assert resumed.info["warnings"] == [f"resumed with gmsh 5.0, begun with {now['gmsh']}"]
