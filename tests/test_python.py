"""The Python interface: its page is whole and runs, and its errors speak of arguments."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import dealib
from dealib.cli.app import app
from dealib.errors import by_caller, on_command_line

ROOT = Path(dealib.__file__).parent
PAGE = (ROOT.parent / "notebooks" / "guide" / "python.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
# named in the text
WITHOUT = {
    "show",
    "doctor",
    "validate",
    "NotConverged",
    "Interrupted",
    "PlatformError",
}  # named in the text
OPTION = re.compile(r"(?<![\w-])--[a-z]{2}")
SMALL = Path(__file__).with_name("small.yaml")


@pytest.mark.once
def test_the_page_has_every_name_and_every_command():
    used = set(re.findall(r"\bdealib\.(\w+)", "\n".join(EXAMPLES)))
    told = set(re.findall(r"\bdealib\.(\w+)", PAGE))
    assert set(dealib.__all__) - WITHOUT <= used
    assert set(dealib.__all__) <= told <= {*dir(dealib)}
    table = PAGE.partition("\n## Commands and functions\n")[2]
    rows = re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE)
    commands = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert sorted(commands) == sorted(typer.main.get_command(app).commands)


@pytest.mark.once
def test_the_examples_of_the_page_run(tmp_path):
    script = "\n".join(EXAMPLES)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, f"{done.stdout[-1500:]}\n{done.stderr[-3000:]}"
    assert (tmp_path / "runs" / "strip" / "report.html").is_file()
    assert (tmp_path / "force.png").stat().st_size > 5_000
    said = done.stdout
    assert "R2" not in said or "nan" not in said
    assert "set mesh.colums=8: unknown key; did you mean 'columns'?" in said
    assert "runs/strip exists and is not empty; choose another directory, overwrite=True" in said


def test_all_names_are_functions_and_classes_whatever_is_imported():
    code = "import dealib.report, dealib.study, dealib.export, dealib.data, dealib.app, dealib\n"
    code += "assert all(callable(getattr(dealib, n)) for n in dealib.__all__)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.once
def test_options_stand_in_messages_only_beside_their_arguments():
    """Outside of the command line's modules, in calls of `by_caller` alone."""
    found = []
    for path in ROOT.rglob("*.py"):
        if path.parent.name == "cli" or path.name in ("__main__.py", "paraview.py"):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
        given = {
            id(part)
            for call in calls
            if getattr(call.func, "id", "") == "by_caller"
            for part in ast.walk(call)
        }
        documents = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
            and node.body
            and isinstance(node.body[0], ast.Expr)
        }
        for node in ast.walk(tree):
            text = getattr(node, "value", None) if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and OPTION.search(text) and id(node) not in given | documents:
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {text[:60]}")
    assert [f for f in found if not f.startswith(MADE_WITH)] == []


MADE_WITH = (  # how files are made again, tables of options, arguments of processes
    "tasks/files.py",
    "tasks/doctor.py",
    "tasks/info.py",
    "observe/reference.py",
    "config/reference.py",
    "config/templates.py",
    "study/reference.py",
    "study/expressions.py",
)


def test_errors_name_arguments_in_python_and_options_on_the_command_line(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "mine.txt").write_text("kept")
    case = dealib.load(SMALL)
    for context, ways in (
        (None, "choose another directory, overwrite=True, or resume=True if it is"),
        (on_command_line(), "choose another --out, --overwrite it, or --resume it if it is"),
    ):
        if context is not None:
            context.__enter__()
        with pytest.raises(dealib.ConfigError, match=re.escape(ways)):
            dealib.simulate(case, tmp_path / "there")
        if context is not None:
            context.__exit__(None, None, None)
    assert by_caller("command", "python") == "python"
    with pytest.raises(dealib.ConfigError, match=r"^give one of: x and y \(curves\), field"):
        dealib.plot([], "time_s", "force_N", field="E")
    with pytest.raises(dealib.ConfigError, match=r"^low and high: expected two frequencies"):
        dealib.respond(case, "3 Hz", "1 Hz")
    with pytest.raises(dealib.ConfigError, match=r"^of history: it has no schema"):
        dealib.schema("history")
    with pytest.raises(dealib.ConfigError, match=r"^overwrite and resume exclude each other$"):
        dealib.export_tables(case, overwrite=True, resume=True)
    with pytest.raises(dealib.ConfigError, match=r"^j_limm: unknown parameter; did you mean 'j_"):
        dealib.law("gent", j_limm=3)


def test_representations_are_short():
    case = dealib.load(SMALL, set={"mesh.columns": 4})
    simulation = dealib.Simulation(case)
    state = next(iter(simulation))
    assert repr(case) == f"<Case small: {SMALL}, mesh.columns=4>"
    assert re.fullmatch(r"<Simulation small: \d+ unknowns, step 0 of 24>", repr(simulation))
    assert repr(state) == "<State 0: prestrain, t = 0 s>"
    assert set(dealib.__all__) <= set(dir(dealib))
