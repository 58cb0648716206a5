"""Every notebook runs from top to bottom, and its committed outputs are small and whole."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parent.parent
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def texts(notebook):
    """What the code cells print."""
    outputs = [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]
    return "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stdout")


def parts(text):
    """Words and numbers of a text, apart."""
    return NUMBER.sub("#", text).split(), [float(n) for n in NUMBER.findall(text)]


def test_there_are_five():
    numbers = [path.name[:2] for path in NOTEBOOKS]
    assert numbers == ["01", "02", "03", "04", "05"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_and_prints_what_is_committed(path, monkeypatch):
    assert path.stat().st_size < 300_000
    committed = nbformat.read(path, as_version=4)
    fresh = nbformat.read(path, as_version=4)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    here = {"metadata": {"path": str(path.parent)}}
    NotebookClient(fresh, timeout=300, kernel_name="python3", resources=here).execute()
    words, numbers = parts(texts(fresh))
    expected_words, expected_numbers = parts(texts(committed))
    assert words
    assert words == expected_words
    assert numbers == pytest.approx(expected_numbers, rel=2e-3, abs=2e-3)
    outputs = [o for c in committed.cells for o in c.get("outputs", [])]
    assert any("image/png" in o.get("data", {}) for o in outputs)
    assert not any(o.output_type == "error" for o in outputs)
