"""Every notebook runs from top to bottom, and its committed outputs are small and whole.

All run in one kernel, so that dolfinx and Matplotlib are imported once. Names are cleared before
each.
"""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.once  # pages; what they call has tests of its own
ROOT = Path(__file__).parent.parent
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LESSONS = [path for path in NOTEBOOKS if "thesis" not in path.stem]
CLEAR = f"import os\nos.chdir({str(ROOT / 'notebooks')!r})\n%reset_selective -f ^[^_]"


def texts(notebook):
    """What the code cells print."""
    outputs = [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]
    return "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stdout")


def parts(text):
    """Words and numbers of a text, apart."""
    return NUMBER.sub("#", text).split(), [float(n) for n in NUMBER.findall(text)]


@pytest.fixture(scope="module")
def client():
    """A client of a kernel in the notebooks' folder."""
    here = {"metadata": {"path": str(ROOT / "notebooks")}}
    empty = nbformat.v4.new_notebook()
    client = NotebookClient(empty, timeout=300, kernel_name="python3", resources=here)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        with client.setup_kernel():
            yield client


def execute(client, notebook):
    """Run a notebook as if its kernel were fresh."""
    client.nb = notebook
    clear = nbformat.v4.new_code_cell(CLEAR)
    notebook.cells.insert(0, clear)
    client.reset_execution_trackers()
    for k, cell in enumerate(notebook.cells):
        client.execute_cell(cell, k)
    notebook.cells.remove(clear)


def test_there_are_eight_lessons_and_two_of_the_thesis():
    assert [path.name[:2] for path in NOTEBOOKS] == [f"{k:02d}" for k in range(1, 11)]
    assert len(LESSONS) == 8


@pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)
def test_a_lesson_is_short_and_fits_a_narrow_page(path):
    cells = nbformat.read(path, as_version=4).cells
    assert len(cells) <= 16
    code = "\n".join(c.source for c in cells if c.cell_type == "code")
    assert max(map(len, code.splitlines())) <= 74
    private = r"dolfinx|dealib\.(?!load|open|simulate|sensit|optim|uncert|tables)\w"
    assert not re.search(private, code)
    assert "## Exercises" in cells[-1].source


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_and_prints_what_is_committed(path, client):
    assert path.stat().st_size < 300_000
    committed = nbformat.read(path, as_version=4)
    fresh = nbformat.read(path, as_version=4)
    execute(client, fresh)
    words, numbers = parts(texts(fresh))
    expected_words, expected_numbers = parts(texts(committed))
    assert words
    assert words == expected_words
    assert numbers == pytest.approx(expected_numbers, rel=2e-3, abs=2e-3)
    outputs = [o for c in committed.cells for o in c.get("outputs", [])]
    assert any("image/png" in o.get("data", {}) for o in outputs)
    assert not any(o.output_type == "error" for o in outputs)
