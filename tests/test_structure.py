"""The code's structure: imports point one way, between modules and between folders."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import dealib

pytestmark = pytest.mark.once  # where code stands
ROOT = Path(dealib.__file__).parent


def imports() -> Iterator[tuple[str, str]]:
    """Modules and what each imports of dealib, also within functions; not for types alone."""
    for path in ROOT.rglob("*.py"):
        module = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
        tree = ast.parse(path.read_text())
        guards = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        ]
        typed = {id(n) for guard in guards for part in guard.body for n in ast.walk(part)}
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom) or id(node) in typed:
                continue
            if (node.module or "").split(".")[0] == "dealib":
                yield module.removesuffix(".__init__"), str(node.module)
                for name in node.names:
                    if (
                        ROOT.parent / str(node.module).replace(".", "/") / f"{name.name}.py"
                    ).is_file():
                        yield module.removesuffix(".__init__"), f"{node.module}.{name.name}"


def circles(pairs: set[tuple[str, str]]) -> list[list[str]]:
    """Groups of names that import each other."""
    names = sorted({name for pair in pairs for name in pair})
    a, b = np.array([[names.index(x), names.index(y)] for x, y in pairs]).T
    graph = coo_matrix((np.ones(len(a)), (a, b)), (len(names), len(names)))
    count, label = connected_components(graph, connection="strong")
    groups = [np.flatnonzero(label == k) for k in range(count)]
    return [[names[i] for i in group] for group in groups if len(group) > 1]


@pytest.mark.parametrize("what", ["modules", "folders"])
def test_imports_have_no_circles(what):
    found = set(imports())
    if what == "folders":
        found = {
            (a.split(".")[1], b.split(".")[1]) for a, b in found if a.count(".") and b.count(".")
        }
    assert len(found) > 50
    assert circles({(a, b) for a, b in found if a != b}) == []


def test_pictures_import_no_dolfinx():
    free = ("dealib.plots", "dealib.report", "dealib.results", "dealib.study", "dealib.data")
    assert not [a for a, b in imports() if a.startswith(free) and b.startswith("dealib.fem")]


def test_no_class_name_stands_twice():
    """So that a name in a traceback or a search tells which class it is."""
    trees = [ast.parse(path.read_text()) for path in sorted(ROOT.rglob("*.py"))]
    names = [n.name for tree in trees for n in ast.walk(tree) if isinstance(n, ast.ClassDef)]
    public = Counter(name for name in names if not name.startswith("_"))
    assert len(public) > 200
    assert [name for name, count in public.items() if count > 1] == []
