"""Mesh files come from others: they are read as meshes only, and only if they are sound."""

import random
import re

import gmsh
import numpy as np
import pytest
from conftest import CONFIGS, case

import dealib
from dealib.device import msh, sound
from dealib.device.gmsh_model import gmsh_model
from dealib.errors import ConfigError

pytestmark = pytest.mark.once  # read by Gmsh alone
FILM = (CONFIGS.parent / "meshes" / "film.msh").read_text()
SCRIPT = 'SystemCall "touch made_by_a_mesh";\n'
SMALL = {"mesh__columns": 4, "mesh__film_rows": 1, "program": '[{"stage": "prestrain"}]'}


def own(path):
    """The config of the film alone on a mesh file."""
    bare = {"geometry__electrode_thickness": "0 um", "geometry__air_height": "0 mm"}
    return case("benchmark_strip", mesh__file=str(path), program=SMALL["program"], **bare)


def refused(path):
    with pytest.raises(ConfigError) as caught, gmsh_model(own(path).config):
        pass
    assert caught.value.exit_code == 2
    return str(caught.value).removeprefix(f"{path}: ")


# (what, name, text, message)
SCRIPTS = [
    ("script", "m.geo", SCRIPT, "no mesh of Gmsh's, which begins with $MeshFormat"),
    ("script that is called a mesh", "m.msh", SCRIPT,
     "no mesh of Gmsh's, which begins with $MeshFormat"),
    ("script behind a header", "m.msh",
     f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{SCRIPT}",
     "unexpected text 'SystemCall \"touch made_by_a_mesh\";' between its sections"),
    ("script behind a mesh", "m.msh", FILM + SCRIPT,
     "unexpected text 'SystemCall \"touch made_by_a_mesh\";' between its sections"),
    ("script among nodes", "m.msh", FILM.replace("$Nodes\n", f"$Nodes\n{SCRIPT}"),
     "$Nodes holds something that is not a number"),
]  # fmt: skip


@pytest.mark.parametrize("command", ["mesh", "run", "check"])
@pytest.mark.parametrize(("name", "text", "said"), [s[1:] for s in SCRIPTS],
                         ids=[s[0] for s in SCRIPTS])  # fmt: skip
def test_a_mesh_file_runs_nothing(program, tmp_path, command, name, text, said):
    (tmp_path / name).write_text(text)
    config = CONFIGS / "benchmark_strip.yaml"
    done = program(command, config, "--set", f"mesh.file={tmp_path / name}", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"dealib: {tmp_path / name}: {said}\n"
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_an_option_file_beside_a_mesh_is_no_concern_of_ours(tmp_path, monkeypatch):
    """Gmsh reads NAME.msh.opt as a script when it opens NAME.msh."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.msh").write_text(FILM)
    (tmp_path / "m.msh.opt").write_text(SCRIPT)
    with gmsh_model(own("m.msh").config):
        pass
    from dealib.plots.mesh import draw_mesh

    draw_mesh(tmp_path / "m.msh")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.msh", "m.msh.opt"]


def test_the_mesh_of_a_run_that_is_looked_at_runs_nothing(tmp_path, monkeypatch):
    from dealib.plots.mesh import draw_mesh

    monkeypatch.chdir(tmp_path)
    (tmp_path / "mesh.msh").write_text(SCRIPT)
    with pytest.raises(ConfigError, match="no mesh of Gmsh's"):
        draw_mesh(tmp_path / "mesh.msh")
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.msh"]


def written(tmp_path, order=1, **options):
    """The film's mesh as Gmsh writes it with some options."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        msh.read(CONFIGS.parent / "meshes" / "film.msh").into(gmsh.model)
        gmsh.model.mesh.setOrder(order)
        for option, value in options.items():
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(tmp_path / "w.msh"))
    finally:
        gmsh.finalize()
    return tmp_path / "w.msh"


@pytest.mark.parametrize("version", [4.1, 2.2])
def test_both_formats_of_text_give_the_same_device(tmp_path, version):
    found = msh.read(written(tmp_path, MshFileVersion=version))
    whole = msh.read(CONFIGS.parent / "meshes" / "film.msh")
    assert sorted(found.names.values()) == ["film", "film_bottom", "film_top", "inner", "outer"]
    (cells,), (wanted,) = found.cells(2)["film"], whole.cells(2)["film"]
    assert np.array_equal(cells, wanted)
    (last,) = dealib.Simulation(own(tmp_path / "w.msh"))
    (also,) = dealib.Simulation(own(CONFIGS.parent / "meshes" / "film.msh"))
    assert last.row["capacitance_pF"] == pytest.approx(also.row["capacitance_pF"], rel=1e-12)


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({"Binary": 1, "MshFileVersion": 4.1}, "4.1, binary"),
        ({"Binary": 1, "MshFileVersion": 2.2}, "2.2, binary"),
        ({"MshFileVersion": 4.0}, "4"),
    ],
)
def test_other_formats_are_named_with_the_way_to_convert_them(tmp_path, options, kind):
    assert refused(written(tmp_path, **options)) == (
        f"Gmsh's format {kind}: dealib reads 4.1 and 2.2 as text; "
        "'gmsh OLD.msh -save -format msh41 -o NEW.msh' converts it"
    )


def test_the_way_to_convert_works(tmp_path):
    path = written(tmp_path, Binary=1, MshFileVersion=4.1)
    gmsh.initialize(["gmsh", "-format", "msh41"], interruptible=False)
    try:  # what the command does
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(str(path))
        gmsh.write(str(tmp_path / "n.msh"))
    finally:
        gmsh.finalize()
    assert len(msh.read(tmp_path / "n.msh").points) == 123


def lines(change):
    """The film's mesh with a change of the nodes of its elements, (n, 5): number and nodes."""
    head, tail = FILM.split("2 1 3 80\n")
    rows = np.array([line.split() for line in tail.splitlines()[:80]], dtype=int)
    change(rows)
    text = "\n".join(" ".join(map(str, row)) for row in rows)
    return f"{head}2 1 3 80\n{text}\n$EndElements\n"


def twice(rows):
    rows[10, 1:] = rows[40, 1:]


def folded(rows):
    rows[10, [1, 2]] = rows[10, [2, 1]]


def lost(rows):
    rows[10, 1] = 9999


def moved(number, x, z):
    """The film's mesh with one node elsewhere."""
    tags = FILM[FILM.index("2 1 0 39") :].split("\n")
    node = tags[1 + 39 + number]
    return FILM.replace(node, f"{x} {z} 0")


def torn():
    """The film's mesh with its upper row of cells on nodes of their own."""

    def change(rows):
        rows[0, 1:] = [9001, 9002, 9003, 9004]

    corners = {n: FILM_POINTS[n - 1] for n in FIRST}
    text = lines(change)
    block = "".join(f"{9000 + i}\n" for i in range(1, 5))
    block += "".join(f"{x} {y} 0\n" for x, y in (corners[n] for n in FIRST))
    text = text.replace("9 123 1 123\n", "10 127 1 9004\n")
    return text.replace("$EndNodes", f"2 1 0 4\n{block}$EndNodes")


FIRST = [int(n) for n in FILM.split("2 1 3 80\n")[1].split("\n")[0].split()[1:]]
FILM_POINTS = msh.read(CONFIGS.parent / "meshes" / "film.msh").points[:, :2]

# (what, text, message)
UNSOUND = [
    ("cut off", FILM[: FILM.index("$EndNodes")], r"the file is cut off: it ends within \$Nodes"),
    ("fewer nodes than it says", FILM.replace("9 123 1 123", "99 123 1 123"),
     r"\$Nodes holds fewer numbers than it announces"),
    ("a cell twice", lines(twice), r"cells overlap at \(10\.50\d+, -0\.015\) mm"),
    ("a cell folded", lines(folded), r"the cell at \(\d.*, .*\) mm is flat or folded"),
    ("no such node", lines(lost), "an element refers to a node that does not exist"),
    ("a crack", torn(), r"several nodes are at \(8\.35, .*\) mm: the cells there are not "
     "connected; merge the nodes"),
    ("infinite", moved(5, "1e999", 0),
     "the coordinates of a node are not finite, or beyond 1e9 mm"),
    ("a node far away", moved(5, 11.0, 0), r"the cell at \(.*\) mm is flat or folded"),
    ("cells of another size", FILM.replace("2 1 3 80", "2 1 9 80"),
     r"\$Elements holds fewer numbers than it announces"),
    ("cells of another kind", FILM.replace("2 1 3 80", "2 1 7 80"),
     "cells must be triangles, quadrilaterals, tetrahedra and hexahedra of first or second order, "
     "not Gmsh's type 7"),
    ("no name in UTF-8", FILM.encode().replace(b'"film"', b'"f\xff\xfe"').decode("latin-1"),
     "no physical group named film; "),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), [u[1:] for u in UNSOUND], ids=[u[0] for u in UNSOUND])
def test_what_is_not_sound_is_refused(tmp_path, text, said):
    (tmp_path / "m.msh").write_text(text, encoding="latin-1")
    assert re.match(said, refused(tmp_path / "m.msh"))


def test_strips_take_no_cells_of_second_order(tmp_path):
    path = written(tmp_path, order=2)
    assert refused(path) == "all cells must be 4-node quadrilaterals, or all 3-node triangles"


def test_the_shipped_meshes_are_sound():
    for path in (CONFIGS.parent / "meshes").glob("*.msh"):
        mesh = msh.read(path)
        assert sound.fault(mesh, max(dim for dim, *_ in mesh.elements)) == "", path


@pytest.mark.parametrize("version", [4.1, 2.2])
def test_wrong_numbers_neither_crash_nor_escape(tmp_path, version):
    """Gmsh's own reader crashes on one of fifty of these."""
    good = written(tmp_path, MshFileVersion=version).read_text()
    head = len(good[: good.index("$Elements")].split()) // 2
    numbers = list(re.finditer(r"-?\d[\d.e-]*", good))
    chance, refusals = random.Random(1), 0
    for _ in range(300):
        at = chance.choice(numbers if chance.random() < 0.5 else numbers[:head])
        new = chance.choice(("-1", "0", "99999999999", "1e300", "2147483648", "7", "nan", "x", ""))
        (tmp_path / "f.msh").write_text(good[: at.start()] + new + good[at.end() :])
        try:
            found = msh.read(tmp_path / "f.msh")
            refusals += bool(sound.fault(found))
        except ConfigError:
            refusals += 1
    assert refusals > 150


def test_the_users_options_of_gmsh_do_not_change_the_mesh(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".gmsh-options").write_text("Mesh.ElementOrder = 2;\n")
    with gmsh_model(case("benchmark_strip", **SMALL).config) as session:
        assert list(session.model.mesh.getElementTypes(2)) == [3]
