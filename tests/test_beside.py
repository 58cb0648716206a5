"""Results that a process of its own writes are those that the run itself would write."""

import os
import signal
import socket
import threading
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from watch import At

import dealib
from dealib.errors import ConfigError, PlatformError
from dealib.program import directory as run_directory
from dealib.program import run as program_run
from dealib.results import store, xdmf
from dealib.results.beside import Beside
from dealib.results.history import HISTORY
from dealib.results.lock import Lock

HERE = Path(__file__).parent


def contents(path):
    """All datasets of an HDF5 file."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            found[name] = item[()]

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


@pytest.mark.parametrize("name", ["small", "viscous"])
def test_it_writes_the_same(tmp_path, name):
    case = dealib.load(HERE / f"{name}.yaml")
    dealib.simulate(case, tmp_path / "step")
    with Beside() as beside:
        run = dealib.simulate(case, tmp_path / "beside", beside=beside)
    assert run.info["timings"]["writing"] > 0
    files = sorted(p.relative_to(run.directory) for p in run.directory.rglob("*") if p.is_file())
    other = tmp_path / "step"
    assert files == sorted(p.relative_to(other) for p in other.rglob("*") if p.is_file())
    assert Path(store.STATES) in files
    for file in files:
        mine, its = run.directory / file, other / file
        if file.suffix == ".h5":
            a, b = contents(mine), contents(its)
            assert a.keys() == b.keys()
            for key in a:
                np.testing.assert_array_equal(a[key], b[key], err_msg=f"{file}: {key}")
        elif file.name not in ("run.json", "run.log", "program.json", "view_in_paraview.py"):
            assert mine.read_bytes() == its.read_bytes(), file


def test_its_death_is_reported_and_the_run_goes_on_from_there(tmp_path):
    case = dealib.load(HERE / "small.yaml")
    with Beside() as beside:
        written = At(4, beside.wait)
        kill = At(9, lambda: os.kill(beside._process.pid, signal.SIGKILL))
        with pytest.raises(PlatformError, match="the process that writes results died"):
            dealib.simulate(case, tmp_path / "run", beside=beside, observers=[written, kill])
    stopped = dealib.open(tmp_path / "run")
    assert stopped.status == "failed"
    assert 4 <= len(stopped.history) <= 11
    resumed = dealib.simulate(case, tmp_path / "run", resume=True)
    whole = dealib.simulate(case, tmp_path / "whole")
    np.testing.assert_allclose(resumed.history["force_N"], whole.history["force_N"], atol=1e-9)
    assert resumed.stored_steps == whole.stored_steps


def test_its_failure_is_the_runs(tmp_path):
    case = dealib.load(HERE / "small.yaml")
    fields = tmp_path / "run" / xdmf.FIELD_DATA
    with Beside() as beside:
        written, away = At(5, beside.wait), At(6, lambda: fields.rename(tmp_path / "away"))
        with pytest.raises(PlatformError, match=r"cannot write .*No such file or directory"):
            dealib.simulate(case, tmp_path / "run", beside=beside, observers=[written, away])
    assert dealib.open(tmp_path / "run").status == "failed"


def test_a_killed_runs_records_are_written_before_the_directory_is_free(tmp_path, monkeypatch):
    """The run vanishes while its writer is behind."""
    path = tmp_path / "run"
    case = dealib.load(HERE / "small.yaml", set={"program.1.steps": 4})
    beside = Beside()

    class Vanished(BaseException):
        pass

    def hang():
        beside.wait()
        os.kill(beside._process.pid, signal.SIGSTOP)

    def vanish():
        beside._socket.shutdown(socket.SHUT_WR)
        raise Vanished

    monkeypatch.setattr(program_run.Recorder, "stop", lambda self, error: None)
    watches = [At(1, hang), At(3, vanish)]
    with pytest.raises(Vanished):
        dealib.simulate(case, path, beside=beside, observers=watches)
    with pytest.raises(ConfigError, match="another run is writing there"):
        Lock(path)
    assert len(dealib.open(path).history) == 2
    os.kill(beside._process.pid, signal.SIGCONT)
    with Lock(path, patience=20):
        assert len(dealib.open(path).history) == 4
        assert dealib.open(path).stored_steps == [0, 1, 2, 3]
    beside.__exit__(None, None, None)


def test_signals_are_the_runs_alone(tmp_path):
    """As from a batch system, which signals all processes of a job."""
    case = dealib.load(HERE / "small.yaml")
    with Beside() as beside:

        def stop():
            for number in (signal.SIGUSR1, signal.SIGHUP, signal.SIGTERM):
                os.kill(beside._process.pid, number)
            os.kill(os.getpid(), signal.SIGTERM)

        with pytest.raises(dealib.Interrupted, match="stopped by SIGTERM"):
            dealib.simulate(case, tmp_path / "run", beside=beside, observers=[At(7, stop)])
    run = dealib.open(tmp_path / "run")
    assert run.status == "interrupted"
    assert len(run.history) == 8
    assert run.stored_steps == list(range(8))


def test_a_message_that_cannot_be_read_is_reported(tmp_path):
    case = dealib.load(HERE / "small.yaml")
    with Beside() as beside:
        broken = At(5, lambda: beside._link.send_bytes(b"no pickle"))
        with pytest.raises(PlatformError, match="writing results failed"):
            dealib.simulate(case, tmp_path / "run", beside=beside, observers=[broken])


def test_a_lock_is_that_of_the_directory_which_is_there_now(tmp_path):
    path = tmp_path / "run"
    path.mkdir()
    first = Lock(path)
    taken = []
    waiting = threading.Thread(target=lambda: taken.append(Lock(path, patience=20)))
    waiting.start()
    path.rename(tmp_path / "old")
    path.mkdir()
    with first:
        time.sleep(0.1)
    waiting.join()
    assert os.path.samestat(os.fstat(taken[0].descriptors[0]), path.stat())
    taken[0].__exit__()


def test_a_directory_in_use_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(run_directory, "_PATIENCE", 0.1)
    case = dealib.load(HERE / "small.yaml", set={"program": "[{stage: prestrain}]"})
    dealib.simulate(case, tmp_path / "run")
    before = (tmp_path / "run" / HISTORY).read_bytes()
    with (
        Lock(tmp_path / "run"),
        pytest.raises(ConfigError, match="another run is writing there"),
    ):
        dealib.simulate(case, tmp_path / "run", overwrite=True)
    assert (tmp_path / "run" / HISTORY).read_bytes() == before
    dealib.simulate(case, tmp_path / "run", overwrite=True)
