"""How little a change needs: a law, a base and columns are each added in one place of one file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import CONFIGS

pytestmark = pytest.mark.once  # where code stands
LAW = '''\
class Quadratic(Law):
    """W = G/2 (I1 - 3) (1 + b (I1 - 3)) + kappa/2 (J - 1)^2."""

    law: Literal["quadratic"]
    shear_modulus: Stress = Field(gt=0, description="shear modulus G")
    b: float = Field(ge=0, description="stiffening")
    bulk_modulus: Stress = Field(gt=0, description="bulk modulus kappa")
    besides: ClassVar[tuple[str, ...]] = ("b",)

    @staticmethod
    def from_youngs_modulus(modulus, given):
        return {"shear_modulus": modulus / 3, "bulk_modulus": 50 / 3 * modulus}

    @staticmethod
    def energy(i, p):
        w = i.I1 - 3
        return p.shear_modulus / 2 * w * (1 + p.b * w) + p.bulk_modulus / 2 * (i.J - 1) ** 2
'''
BASE = '''\
class Beam(Base):
    """Strip in plane strain that is held at both ends."""

    along: ClassVar[str] = "X"
    ends: ClassVar[tuple[str | None, ...]] = ("left", "right")
    holds: ClassVar[tuple[Held, ...]] = (("left", ("X", "Z")), ("right", ("X", "Z")))

    kind: Literal["beam"]
    length: Length = Field(gt=0, description="along X")
    width: Length = Field(gt=0, description="out of the plane, along Y")

    @property
    def kinematics(self) -> Kinematics:
        """See `Base`."""
        return PLANE_STRAIN.times(self.width)

    @property
    def limits(self) -> tuple[float, float]:
        """See `Base`."""
        return 0.0, self.length

    @property
    def area(self) -> float:
        """See `Base`."""
        return self.length * self.width

    @property
    def girth(self) -> float:
        """See `Base`."""
        return self.width
'''
COLUMN = (
    '    Q("stored_mJ", "mJ", "stored", lambda s: s.energy("elastic") + s.energy("electric")),\n'
)
OF_PORT = (
    '    Q("push_mJ", "mJ", "p times V", lambda s, p: 1e-3 * _primal(s, p) * _dual(s, p), '
    "kind=CHAMBER),\n"
)
CONFIG = """\
name: drill
geometry:
  shape: laminate
  base: {kind: beam, length: 10 mm, width: 5 mm}
  layers: [{name: film, thickness: 0.2 mm}]
mesh: {columns: 12, film_rows: 1}
materials:
  film: {law: quadratic, shear_modulus: 0.3 MPa, b: 0.5, bulk_modulus: 30 MPa,
         relative_permittivity: 3.0, prestretch: 1.2}
chambers: {pump: {on: film.bottom}}
program:
  - {stage: inflate, chamber: {pressure: 0.5 kPa}, steps: 2}
  - {stage: on, terminal: {voltage: 2 kV}}
"""


def insert(path: Path, before: str, text: str) -> None:
    """Put a text before a line that stands once in a file."""
    given = path.read_text()
    assert given.count(before) == 1
    path.write_text(given.replace(before, text + before))


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program with all four changes."""
    root = tmp_path_factory.mktemp("drill")
    package = shutil.copytree(
        CONFIGS.parent / "dealib", root / "dealib", ignore=shutil.ignore_patterns("__pycache__")
    )
    insert(package / "materials" / "laws.py", "LAWS: dict", LAW + "\n\n")
    insert(package / "device" / "bases.py", "class Rectangle(Base):", BASE + "\n\n")
    insert(package / "observe" / "quantities.py", '    Q("newton_iterations"', COLUMN + OF_PORT)
    (root / "drill.yaml").write_text(CONFIG)
    return root


def dealib(root: Path, *arguments: str) -> str:
    """Standard output of a command of the copy."""
    done = subprocess.run(
        [sys.executable, "-m", "dealib", *arguments],
        cwd=root,
        env=os.environ | {"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_changes_are_small():
    code = [x for x in LAW.splitlines() if x.strip() and '"""' not in x]
    assert len(code) < 15
    assert len(BASE.splitlines()) < 60
    assert COLUMN.count("\n") == OF_PORT.count("\n") == 1


def test_a_law_a_base_and_columns_are_each_added_in_one_place(changed):
    """All of the program knows them: commands, checks, forms, the history."""
    assert "quadratic" in dealib(changed, "materials")
    schema = dealib(changed, "schema")
    assert '"beam"' in schema
    assert '"quadratic"' in schema
    dealib(changed, "run", "drill.yaml", "--out", "run")
    h = pd.read_csv(changed / "run" / "history.csv")
    stored = h["elastic_energy_mJ"] + h["electric_energy_mJ"]
    assert h["stored_mJ"].to_numpy() == pytest.approx(stored, rel=1e-12)
    p, V = h["pressure_kPa"], h["volume_mm3"]
    assert h["push_mJ"].to_numpy() == pytest.approx(1e-3 * p * V, rel=1e-12)
    # a shallow cap between two edges: p L^2/8 = T w, its volume 2/3 L w times the width
    l3 = 1 / 1.2**2
    w = 2 * 1.2**2 + l3**2 - 3
    tension = 0.3 * (1.2**2 - l3**2) * (1 + 2 * 0.5 * w) * 0.2
    height = 0.25e-3 * 10**2 / 8 / tension
    assert V.iloc[1] == pytest.approx(2 / 3 * 10 * height * 5, rel=0.05)
    assert np.all(np.diff(V) > 0)
