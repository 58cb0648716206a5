"""Whatever ends a command is one message and a documented exit code."""

import importlib
import inspect
import os
import pickle
import pkgutil
import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import dealib
from dealib.errors import ConfigError, DealibError, Interrupted, NotConverged, PlatformError

HERE = Path(__file__).parent
ROOT = HERE.parent
SMALL = HERE / "small.yaml"


def command(*arguments, cwd, code=None, **environment):
    """Run the program, or a text that starts it; returns exit code, output and errors."""
    start = ["-m", "dealib"] if code is None else ["-c", code]
    done = subprocess.run(
        [sys.executable, *start, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
    )
    return done.returncode, done.stdout, done.stderr


# --- what nobody foresaw --------------------------------------------------------------------------

BROKEN = """
import dealib.results.summary as summary
def broken(run):
    raise KeyError("no such column")
summary.actuations = broken
from dealib.__main__ import main
main()
"""


@pytest.mark.once
def test_an_unforeseen_error_is_one_message_with_a_file_to_report(strip_run, tmp_path):
    code, out, err = command("info", strip_run.directory, cwd=tmp_path, code=BROKEN)
    assert (code, out) == (70, "")
    lines = err.splitlines()
    assert lines[:2] == [
        f"dealib: a fault of dealib itself in: dealib info {strip_run.directory}",
        "    KeyError: 'no such column'",
    ]
    log = Path(re.search(r"The traceback and the versions are in (\S+) \(-v shows", err)[1])
    text = log.read_text()
    log.unlink()
    assert text.startswith(f"dealib info {strip_run.directory}\n")
    assert "in broken" in text
    assert "KeyError: 'no such column'" in text
    assert "dolfinx" in text
    assert "Traceback" not in err
    assert "Please report it" in lines[3]
    assert len(lines) == 4


@pytest.mark.once
@pytest.mark.parametrize("how", ["-v", "--verbose", "DEALIB_VERBOSE"])
def test_the_traceback_is_shown_if_asked_for(strip_run, tmp_path, how):
    more, environment = ([how], {}) if how.startswith("-") else ([], {how: "1"})
    given = ["info", strip_run.directory, *more]
    code, _, err = command(*given, cwd=tmp_path, code=BROKEN, TMPDIR=str(tmp_path), **environment)
    assert code == 70
    assert "Traceback (most recent call last)" in err
    assert "in broken" in err


@pytest.mark.once
def test_a_runs_log_has_the_traceback_too(tmp_path):
    code = """
from dealib.program.history import History
def broken(*given):
    raise ZeroDivisionError("in the middle")
History._met = broken
from dealib.__main__ import main
main()
"""
    given = ["run", SMALL, "--out", "run"]
    code, _, err = command(*given, cwd=tmp_path, code=code, TMPDIR=str(tmp_path))
    assert code == 70
    assert "    the run's log is run/run.log\n" in err
    assert "Traceback" not in err
    log = (tmp_path / "run" / "run.log").read_text()
    assert "ZeroDivisionError: in the middle" in log
    assert "in broken" in log
    assert dealib.open(tmp_path / "run").status == "failed"


def test_memory_that_does_not_suffice_is_the_machines(tmp_path):
    code = """
import dealib.config
def load(*given):
    raise MemoryError("Unable to allocate 8 PiB")
dealib.config.load = load
from dealib.__main__ import main
main()
"""
    code, _, err = command("check", SMALL, cwd=tmp_path, code=code)
    assert (code, err) == (4, "dealib: not enough memory: Unable to allocate 8 PiB\n")


# --- exceptions -----------------------------------------------------------------------------------


def own_exceptions():
    found = set()
    for module in pkgutil.walk_packages(dealib.__path__, "dealib."):
        if module.name == "dealib.__main__":
            continue
        for _, kind in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if issubclass(kind, BaseException) and kind.__module__.startswith("dealib."):
                found.add(kind)
    return sorted(found, key=lambda kind: kind.__name__)


def test_exceptions_survive_pickling():
    """They go from rank to rank, and from process to process."""
    kinds = own_exceptions()
    assert {ConfigError, NotConverged, PlatformError, Interrupted, DealibError} <= set(kinds)
    for kind in kinds:
        names = inspect.signature(kind).parameters if inspect.isfunction(kind.__init__) else ["x"]
        given = {"where": ("a", 1), "signal": 15, "everywhere": True, "share": 2.0}
        given |= {"context_mark": None, "problem_mark": None}  # of YAML's
        error = kind(*(given.get(name, "text") for name in names))
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is kind
        assert str(again) == str(error)
        assert vars(again) == vars(error)
        for name in ("exit_code", "everywhere"):
            assert getattr(again, name, None) == getattr(error, name, None)


def test_an_interrupt_is_a_keyboard_interrupt_and_no_error():
    stop = dealib.Interrupted("stopped by SIGINT", signal.SIGINT)
    assert isinstance(stop, KeyboardInterrupt)
    assert not isinstance(stop, Exception)
    assert (str(stop), stop.exit_code) == ("stopped by SIGINT", 130)


def test_ctrl_c_ends_a_loop_over_simulations(tmp_path):
    code = f"""
import os, signal, dealib

class Stop:
    def start(self, simulation): pass
    def see(self, state): os.kill(os.getpid(), signal.SIGINT)
    def stop(self, error): pass

case = dealib.load({str(SMALL)!r})
try:
    for k in range(3):
        try:
            dealib.simulate(case, f"run{{k}}", observers=[Stop()])
        except dealib.DealibError:
            pass
except KeyboardInterrupt as stop:
    print(type(stop).__name__, stop)
"""
    done, out, err = command(cwd=tmp_path, code=code)
    assert (done, out) == (0, "Interrupted stopped by SIGINT\n"), err
    assert [path.name for path in tmp_path.iterdir()] == ["run0"]
    assert dealib.open(tmp_path / "run0").status == "interrupted"


# --- signals --------------------------------------------------------------------------------------

TABLES = SMALL.read_text() + "tables: {displacement: [0 mm, -1 mm], voltage: [0 V, 1 kV]}\n"
STUDY = f"""\
name: heights
title: Many thicknesses
base: {SMALL}
vary: {{t: {{geometry.film_thickness: [{", ".join(f"{k} um" for k in range(50, 90))}]}}}}
quantities: {{force: min(force_N)}}
"""
FIT = f"""\
name: fit
base: {SMALL}
parameters: {{materials.film.youngs_modulus: {{start: 1 MPa, min: 0.2 MPa, max: 5 MPa}}}}
data: [{{file: data.csv}}]
"""
COMMANDS = {
    "run": ["run", SMALL],
    "export": ["export", "tables.yaml"],
    "study": ["study", "study.yaml"],
    "sweep": ["sweep", "study.yaml"],
    "calibrate": ["calibrate", "fit.yaml"],
}


@pytest.fixture
def folder(tmp_path):
    for name, text in {"tables.yaml": TABLES, "study.yaml": STUDY, "fit.yaml": FIT}.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "data.csv").write_text("displacement [mm],force [N]\n-0.2,-0.02\n-0.9,-0.13\n")
    return tmp_path


def start(folder, arguments, code=None):
    command = ["-m", "dealib"] if code is None else ["-c", code]
    return subprocess.Popen(
        [sys.executable, *command, *map(str, arguments)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def once(*values):
    """A case that no library of the solver's answers in its own way."""
    return pytest.param(*values, marks=pytest.mark.once)


DURING_IMPORT = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.{sent})

sys.meta_path.insert(0, Finder())
from dealib.__main__ import main
main()
"""


@pytest.mark.parametrize("sent", ["SIGTERM", "SIGINT"])
@pytest.mark.parametrize(
    ("name", "module"),
    [
        once("run", "dealib.cli.app"),
        once("run", "dealib.config.schema"),
        ("run", "numpy"),
        ("run", "mpi4py.MPI"),
        ("run", "dolfinx"),
        ("run", "gmsh"),
        once("export", "dealib.program.tables"),
        once("study", "dealib.study.plan"),
        once("study", "rich.console"),
        once("sweep", "pandas"),
        once("calibrate", "lmfit"),
    ],
)
def test_a_signal_in_the_first_second_is_answered(folder, name, module, sent):
    code = DURING_IMPORT.format(module=module, sent=sent)
    job = start(folder, COMMANDS[name], code)
    _, errors = job.communicate(timeout=300)
    assert job.returncode == 128 + getattr(signal, sent)
    assert re.fullmatch(rf"dealib: stopped by {sent}.*\n", errors)
    assert not list(folder.rglob("*.tmp*"))


def test_gmsh_takes_no_signal_away(folder):
    code = """
import os, signal
from dealib.device.grid import Grid
Grid.build = lambda *given: os.kill(os.getpid(), signal.SIGTERM)
from dealib.__main__ import main
main()
"""
    for arguments in (["mesh", SMALL], ["run", SMALL]):
        job = start(folder, arguments, code)
        _, errors = job.communicate(timeout=300)
        assert job.returncode == 143
        assert errors.startswith("dealib: stopped by SIGTERM")


def test_a_signal_during_a_finaliser_is_answered(folder):
    """Python prints and drops what a finaliser raises; the interrupt comes again after it."""
    code = """
import os, signal, time
import dealib.__main__ as program

class Finalised:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.1)

def command():
    held = [Finalised()]
    del held
    time.sleep(60)

program._command = command
program.main()
"""
    job = start(folder, [], code)
    _, errors = job.communicate(timeout=50)
    assert job.returncode == 143
    assert errors == "dealib: stopped by SIGTERM\n"


@pytest.mark.parametrize("name", [once("export"), "study", once("sweep"), once("calibrate")])
def test_sigterm_while_cases_are_solved(folder, name):
    """It ends with how to go on, leaves no process behind, and what is solved is kept."""
    job = start(folder, COMMANDS[name])
    began = {"export": "step    3", "calibrate": "sum of squares"}.get(name, "2/40")
    for line in job.stdout:
        if line.startswith(began):
            job.send_signal(signal.SIGTERM)
            break
    _, errors = job.communicate(timeout=300)
    assert job.returncode == 143, errors
    assert "Traceback" not in errors
    assert "\ndealib: stopped by SIGTERM" in f"\n{errors}"
    told = {
        "export": "; what converged is in runs/small-tables\nGo on with: dealib export tables.yaml",
        "calibrate": r" cases solved now are kept, --resume goes on with them",
    }.get(name, r" of 40 cases, which are kept; the same command goes on with the others")
    assert told in errors
    kept = folder / "runs" / ("small-tables" if name == "export" else "studies/cases")
    if name != "export":
        begun = [p.parent for p in kept.glob("*/run.json")]  # a folder without has just been made
        done = [p for p in begun if dealib.open(p).status == "done"]
        assert len(done) >= (1 if name == "calibrate" else 2)
    mine = [p for p in psutil.process_iter(["cmdline"]) if str(folder) in str(p.info["cmdline"])]
    assert mine == []


# --- threads --------------------------------------------------------------------------------------


@pytest.mark.once
def test_threads_take_turns(tmp_path):
    code = f"""
import threading, dealib

def run(k):
    dealib.simulate({str(SMALL)!r}, f"run{{k}}")

def states(k):
    case = dealib.load({str(HERE / "viscous.yaml")!r})
    found[k] = [(s.nodal().shape, s.internal().shape) for s in dealib.Simulation(case)]

found = {{}}
threads = [threading.Thread(target=f, args=(k,)) for k, f in enumerate([run, states] * 2)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert found[1] == found[3] and len(found[1]) > 3
print("done")
"""
    done, out, err = command(cwd=tmp_path, code=code)
    assert (done, out) == (0, "done\n"), err
    a, b = (dealib.open(tmp_path / f"run{k}").history for k in (0, 2))
    assert a.equals(b)
    assert len(a) == 25
