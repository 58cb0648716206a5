"""Standard streams that are closed, full or read in part cost nothing that is solved."""

import os
import subprocess
import sys

import pytest
from conftest import CONFIGS

pytestmark = pytest.mark.once
SMALL = CONFIGS.parent / "tests" / "small.yaml"
SHORT = ["--set", "program.0.steps=2", "--set", "program.1.steps=2"]
LOST = "dealib: cannot write to standard output: No space left on device\n"


def run(shell, cwd, **more):
    """A shell line in which $dealib is the program."""
    program = f'dealib() {{ "{sys.executable}" -m dealib "$@"; }}\n'
    environment = os.environ | {"PYTHONPATH": str(CONFIGS.parent)}
    return subprocess.run(
        ["bash", "-c", program + shell],
        cwd=cwd, env=environment, capture_output=True, text=True, timeout=300, check=False, **more,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("line", "code", "out", "err"),
    [
        (f"dealib check {SMALL} >&-", 0, "", ""),
        (f"dealib check {SMALL} >/dev/full", 4, "", LOST),
        ("dealib check none.yaml >/dev/full", 2, "",
         "dealib: none.yaml: cannot read the config: No such file or directory\n"),
        ("dealib check none.yaml 2>&-", 2, "", ""),
        ("dealib check none.yaml 2>/dev/full", 2, "", ""),
        ("dealib check none.yaml <&- >&- 2>&-", 2, "", ""),
        ("dealib --help >/dev/full", 4, "", LOST),
        ("dealib schema | head -1; exit ${PIPESTATUS[0]}", 0, "{\n", ""),
    ],
)  # fmt: skip
def test_commands(tmp_path, line, code, out, err):
    done = run(line, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (code, out, err)


@pytest.mark.parametrize(
    ("streams", "code", "err"),
    [
        (">/dev/full", 4, LOST),
        ("<&- >&- 2>&-", 0, ""),
        ("-v >/dev/null 2>/dev/full", 0, ""),
        ("| head -1; exit ${PIPESTATUS[0]}", 0, ""),
    ],
)
def test_a_run_ends_well_without_them(tmp_path, streams, code, err):
    line = f"dealib run {SMALL} {' '.join(SHORT)} --out run {streams}"
    done = run(line, tmp_path)
    assert (done.returncode, done.stderr) == (code, err)
    rows = (tmp_path / "run" / "history.csv").read_text().splitlines()
    assert rows[0].startswith("step,time_s,stage,")  # and nothing that was printed
    assert [row.split(",")[0] for row in rows[1:]] == ["0", "1", "2", "3", "4"]
    assert '"status": "done"' in (tmp_path / "run" / "run.json").read_text()
