"""Shared helpers: configs by name, histories computed once a session."""

from __future__ import annotations

import fcntl
import functools
import os
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import dealib  # before numpy, so that all processes compute with the same kernels

# isort: split
import pandas as pd
import pytest

from dealib import patience
from dealib.__main__ import main
from dealib.config import Config
from dealib.device.gmsh_model import gmsh_model
from dealib.results import local
from dealib.results.margins import Film, mounted_fresh

os.environ.setdefault("MPLBACKEND", "Agg")
CONFIGS = Path(__file__).parent.parent / "configs"
QUEUE = os.environ.get("DEALIB_TEST_QUEUE")  # a folder that suites side by side share


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What one suite of several runs comes last: whichever is ready takes the next file of it.

    The last are files of which only a part runs once: they are short, so that both end together.
    """
    if QUEUE:
        mixed = {item.path for item in items if not _once(item)}
        items.sort(key=lambda item: _once(item) * (1 + (item.path in mixed)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """A test on several ranks runs while the suite beside this one waits.

    Ranks that wait for each other beside it on two cores take three times the processor time.
    """
    if not QUEUE:
        return (yield)
    mode = fcntl.LOCK_EX if item.get_closest_marker("mpi") else fcntl.LOCK_SH
    with Path(QUEUE, "door").open("w") as door, Path(QUEUE, "room").open("w") as room:
        fcntl.flock(door, fcntl.LOCK_EX)  # who waits for an empty room lets nobody else in
        fcntl.flock(room, mode)
        fcntl.flock(door, fcntl.LOCK_UN)
        try:
            return (yield)
        finally:
            fcntl.flock(room, fcntl.LOCK_UN)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if QUEUE and _once(item) and not _taken(item.path.stem):
        pytest.skip("runs in the suite beside this one")


def _once(item: pytest.Item) -> bool:
    return item.get_closest_marker("once") is not None


@functools.cache
def _taken(name: str) -> bool:
    """Whether this suite is the first to ask for a file."""
    try:
        Path(str(QUEUE), name).mkdir()
    except FileExistsError:
        return False
    return True


def case(name: str, **changes: object) -> dealib.Case:
    """A shipped config with changes; `__` stands for the dot of a key."""
    return dealib.load(
        CONFIGS / f"{name}.yaml", set={k.replace("__", "."): v for k, v in changes.items()}
    )


@functools.cache
def _history(name: str, changes: tuple[tuple[str, object], ...]) -> pd.DataFrame:
    rows = [state.row for state in dealib.Simulation(case(name, **dict(changes)))]
    return pd.DataFrame(rows)


def history(name: str, **changes: object) -> pd.DataFrame:
    """The history of a shipped config with changes, computed once."""
    return _history(name, tuple(sorted(changes.items())))


def film_of(config: Config) -> Film:
    """What margins need of the film of a config."""
    material, (region, *_) = local.film_groups(config)["film"]
    return Film.of(material, mounted_fresh(config, region))


@functools.cache
def _said_by_mpi() -> frozenset[str]:
    command = [sys.executable, "-c", "from mpi4py import MPI"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return frozenset(done.stderr.splitlines())


def said(errors: str) -> str:
    """Standard error without what MPI itself says on this machine, such as hwloc without /sys."""
    kept = [line for line in errors.splitlines(True) if line.rstrip("\n") not in _said_by_mpi()]
    return "".join(kept)


def thinned(given: dealib.Case, path: Path, thickness: Callable[[float], float]) -> Path:
    """Write a case's mesh with heights scaled by a function of the share of the way outwards."""
    g = given.config.geometry
    with gmsh_model(given.config) as session:
        mesh = session.model.mesh
        tags, nodes, _ = mesh.getNodes()
        for tag, (R, Z, _) in zip(tags, nodes.reshape(-1, 3), strict=True):
            share = (R - g.inner_radius) / (g.outer_radius - g.inner_radius)
            mesh.setNode(tag, [R, Z * thickness(share), 0], [])
        session.write(str(path))
    return path


@pytest.fixture
def program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs the program in a folder, and in this process, whose libraries are loaded."""

    def run(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
        words = ["dealib", *map(str, arguments)]
        capsys.readouterr()
        with monkeypatch.context() as there:
            there.chdir(cwd)
            there.setattr(sys, "argv", words)
            there.setattr(patience, "_MOMENT", 1e9)  # a busy machine would be told that it meshes
            with pytest.raises(SystemExit) as stop:
                main()
        code = stop.value.code or 0
        assert isinstance(code, int)
        return subprocess.CompletedProcess(words, code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def strip_run(tmp_path_factory: pytest.TempPathFactory) -> dealib.Run:
    """The run directory of benchmark_strip, made once."""
    return dealib.simulate(case("benchmark_strip"), tmp_path_factory.mktemp("run") / "strip")
