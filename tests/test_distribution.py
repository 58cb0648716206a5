"""The container file and the wheel: what can be checked without a container engine."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.once  # what is packed
ROOT = Path(__file__).parent.parent
INSTRUCTIONS = {"FROM", "WORKDIR", "COPY", "RUN", "ENV", "ENTRYPOINT"}


def instructions():
    text = (ROOT / "setup" / "Containerfile").read_text(encoding="utf-8")
    lines = re.sub(r"\\\n", " ", text).splitlines()
    return [line.split(maxsplit=1) for line in lines if line and not line.startswith("#")]


def test_the_container_is_debian_with_what_setup_installs():
    found = instructions()
    assert {name for name, _ in found} == INSTRUCTIONS
    stages = []
    for name, rest in found:
        if name == "FROM":
            base, *named = rest.split(" AS ")
            assert base in stages or re.fullmatch(r"docker\.io/library/debian:1[23]", base)
            stages += named
    assert stages == ["dealib", "tests"]
    runs = [shlex.split(rest.split(" && ")[0]) for name, rest in found if name == "RUN"]
    assert runs == [["setup/setup.sh"], ["./test"]]
    for (script,) in runs:
        assert (ROOT / script).stat().st_mode & 0o111
        subprocess.run(["bash", "-n", script], cwd=ROOT, check=True)
    assert ("ENTRYPOINT", '[".venv/bin/dealib"]') in [tuple(i) for i in found]


def test_what_is_built_comes_from_apt_and_pypi():
    """No other source in what the container runs; what it needs is not left out of it."""
    for script in ("setup/Containerfile", "setup/setup.sh", "setup/tools.sh", "test", "run"):
        text = (ROOT / script).read_text(encoding="utf-8")
        assert not re.search(r"\b(curl|wget|git clone|ADD)\b|index-url|https?://", text), script
    left_out = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    needed = (
        "pyproject.toml",
        "README.md",
        "dealib",
        "setup",
        "tests",
        "configs",
        "meshes",
        "test",
    )
    assert not set(needed) & set(left_out)
    assert ".venv*" in left_out


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source)
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "dealib", source / "dealib", ignore=ignored)
    options = ("--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir")
    command = [sys.executable, "-m", "pip", "wheel", *options, str(out), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    (found,) = out.glob("dealib-*.whl")
    return found


def test_the_wheel_has_every_file_of_the_package(wheel):
    inside = set(zipfile.ZipFile(wheel).namelist())
    files = [
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "dealib").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    assert {"dealib/export/device.c", "dealib/materials/published.yaml"} <= set(files)
    assert [file for file in files if file not in inside] == []


def test_the_wheel_runs_where_it_is_unpacked(wheel, tmp_path):
    """With the packages of this installation, Debian's dolfinx among them."""
    zipfile.ZipFile(wheel).extractall(tmp_path)
    code = (
        "import dealib, sys; assert dealib.__file__.startswith(sys.argv[1]), dealib.__file__\n"
        "case = dealib.load(sys.argv[2]); state = next(iter(dealib.Simulation(case)))\n"
        "print(state.row['capacitance_pF'], len(dealib.known_materials()))"
    )
    small = ROOT / "tests" / "small.yaml"
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path), str(small)],
        env=environment, cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    capacitance, materials = map(float, done.stdout.split())
    assert capacitance > 10
    assert materials >= 7
