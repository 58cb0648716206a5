"""Files are written whole or not at all, whatever writes them."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dealib import files
from dealib.errors import PlatformError

pytestmark = pytest.mark.once  # how files are written
HERE = Path(__file__).parent
ROOT = HERE.parent
SMALL = HERE / "small.yaml"

# where else files are opened to be written: logs, the lock of the compiler, a line of the history,
# the null device in place of a closed stream
ELSEWHERE = {
    "dealib/files.py",
    "dealib/cases/job.py",
    "dealib/cli/streams.py",
    "dealib/fem/compat.py",
    "dealib/results/store.py",
}
WRITES = re.compile(
    r"\.(?:write_text|write_bytes)\(|open\([^)]*[\"'][wax]b?\+?[\"']|to_csv\([^i)]|savefig\([a-z]*path"
)


def test_one_helper_writes():
    found = set()
    for path in (ROOT / "dealib").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if WRITES.search(text):
            found.add(str(path.relative_to(ROOT)))
    assert found - {"dealib/plots/animation.py"} == ELSEWHERE


def test_an_earlier_file_outlives_what_fails(tmp_path):
    path = tmp_path / "a.txt"
    files.write_text(path, "before")

    def fail(error):
        with files.whole(path) as temporary:
            temporary.write_text("half")
            raise error

    for error in (KeyboardInterrupt(), ValueError(), SystemExit()):
        with pytest.raises(type(error)):
            fail(error)
    with pytest.raises(PlatformError, match=r"cannot write .*a\.txt: no room"):
        fail(OSError("no room"))
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a.txt": "before"}


def test_a_new_file_takes_no_name_that_is_used(tmp_path):
    path = tmp_path / "a.txt"
    assert files.write_new(path, "first")
    assert not files.write_new(path, "second")
    assert path.read_text() == "first"
    with pytest.raises(PlatformError, match=r"cannot write .*nowhere/a\.txt: No such file"):
        files.write_new(tmp_path / "nowhere" / "a.txt", "text")
    with pytest.raises(UnicodeEncodeError):
        files.write_new(tmp_path / "b.txt", "half \ud800")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


LIMITED = """
import resource, sys
limit = int(sys.argv.pop(1))
import dealib.program  # MPI and compilers write files as well
import matplotlib.pyplot as plt
plt.figure().savefig("/dev/null", format="svg")  # so does its cache of fonts
from dealib.__main__ import main
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
main()
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, strip_run):
    """A place with a run, and with what makes tables and pictures quickly."""
    path = tmp_path_factory.mktemp("files")
    shutil.copytree(strip_run.directory, path / "run")
    tables = SMALL.read_text() + "tables: {displacement: [0 mm, -1 mm], voltage: [0 V, 1 kV]}\n"
    (path / "tables.yaml").write_text(tables)
    (path / "fig.yaml").write_text(
        "name: law\ntitle: A law\nmaterial_test: {material: {law: neo_hookean, "
        "youngs_modulus: 1 MPa}}\npanels: [{kind: curves, x: {value: stretch, label: l}, "
        "y: {value: stress_MPa, label: s}}]\n"
    )
    (path / "data.csv").write_text("displacement [mm],force [N]\n-0.5,-0.02\n-2.5,-0.13\n")
    return path


@pytest.mark.parametrize(
    ("arguments", "limit", "file"),
    [
        (["plot", "run", "--out", "a.png"], 9000, "a.png"),
        (["plot", "run", "--out", "a.svg"], 9000, "a.svg"),
        (["plot", "run", "--out", "a.pdf"], 5000, "a.pdf"),
        (["plot", "run", "--field", "E", "--out", "b.svg"], 9000, "b.svg"),
        (["animate", "run", "--seconds", "0.5", "--out", "a.mp4"], 4000, "a.mp4"),
        (["animate", "run", "--seconds", "0.5", "--out", "a.gif"], 4000, "a.gif"),
        (["compare", "run", "data.csv", "--out", "c.png"], 9000, "c.png"),
        (["materials", "gent", "--out", "g.png"], 9000, "g.png"),
        (["mesh", SMALL, "--out", "m.msh", "--view", "m.png"], 3000, "m.png"),
        (["mesh", ROOT / "configs/membrane.yaml", "--out", "n.msh"], 3000, "n.msh"),
        (["schema", "--out", "s.json"], 3000, "s.json"),
        (["init", "--out", "i.yaml"], 100, "i.yaml"),
        (["study", "fig.yaml", "--out", "out"], 20, "law.csv"),
        (["study", "fig.yaml", "--out", "out"], 6000, "law.svg"),
    ],
)
def test_a_limit_on_file_size_leaves_no_half_file(folder, arguments, limit, file):
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(limit), *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 4, done.stderr
    assert re.search(rf"dealib: cannot write \S*{file}: \S.*; what was written before", done.stderr)
    assert "Traceback" not in done.stderr
    assert not list(folder.rglob(file))
    assert not list(folder.rglob("*.tmp*"))
