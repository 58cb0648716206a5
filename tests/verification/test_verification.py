"""Every row of the verification table; the long cases are marked slow."""

import pytest

from verification import mesh_convergence, space
from verification.cases import CASES
from verification.table import BEGIN, END, Row, markdown, write_into


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, id=c.name, marks=[pytest.mark.slow] if c.slow else []) for c in CASES],
)
def test_within_tolerance(case):
    rows = list(case.rows())
    assert rows
    assert all(row.passed for row in rows), markdown([row for row in rows if not row.passed])


def test_a_wrong_or_missing_number_fails():
    right = Row("case", "force, N", 2.0, 2.001, 1e-3, "theory")
    assert right.error == pytest.approx(5e-4)
    assert right.passed
    for wrong in (2.01, -2.0, float("nan")):
        assert not Row("case", "force, N", 2.0, wrong, 1e-3, "theory").passed
    assert not Row("case", "order", 3.0, 2.8, 0.15, "theory", "absolute").passed


def test_the_table_replaces_the_one_before(tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write_into(readme, "| new |")
    assert readme.read_text() == f"before\n{BEGIN}\n| new |\n{END}\nafter\n"
    readme.write_text("no markers")
    with pytest.raises(ValueError, match="no lines"):
        write_into(readme, "| new |")
    assert readme.read_text() == "no markers"


@pytest.mark.slow
def test_graded_meshes_converge_and_uniform_ones_lag(tmp_path):
    """As Figs. 12 and 13 say: 30 graded columns beat 180 uniform ones, and at a higher rate."""
    picture = tmp_path / "convergence.png"
    table = mesh_convergence.study(picture)
    assert picture.stat().st_size > 10_000
    assert table.count("\n") == 18
    (_, uniform), (_, graded) = (mesh_convergence.errors(g) for g in ("uniform", "ends"))
    assert all(graded[2] < uniform[-1])
    slow, fast = mesh_convergence.rates("uniform"), mesh_convergence.rates("ends")
    assert all(f > s for f, s in zip(fast, slow, strict=True))


@pytest.mark.slow
def test_few_graded_unknowns_of_a_film_in_space_are_worth_many_uniform_ones(tmp_path):
    picture = tmp_path / "space.png"
    lines = [line.split(" | ") for line in space.study(picture).splitlines()[2:]]
    assert picture.stat().st_size > 10_000
    few = next(line for line in lines if line[1] == "12 x 4 x 1")
    many = lines[-1]
    assert int(many[2]) > 10 * int(few[2])
    for small, large in zip(few[3:6], many[3:6], strict=True):
        assert float(small) < 0.5 * float(large)
