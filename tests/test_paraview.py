"""Fields in ParaView: all its XDMF readers, and the script of each run directory."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib.image import imread

from dealib.results import paraview

PVPYTHON, XVFB = shutil.which("pvpython"), shutil.which("xvfb-run")

READ = """
import json, sys
from paraview.simple import XDMFReader, Xdmf3ReaderS, Xdmf3ReaderT
found = {}
for reader in (XDMFReader, Xdmf3ReaderS, Xdmf3ReaderT):
    key = "FileNames" if reader is XDMFReader else "FileName"
    fields = reader(**{key: [sys.argv[1]]})
    fields.UpdatePipelineInformation()
    times = list(fields.TimestepValues)
    fields.UpdatePipeline(times[-1])
    arrays = fields.PointData
    found[reader.__name__] = {
        "times": times,
        "points": fields.GetDataInformation().GetNumberOfPoints(),
        "u_Z": arrays["u"].GetRange(1),
        "phi": arrays["phi"].GetRange(),
        "components": arrays["second_pk_stress"].GetNumberOfComponents(),
        "regions": fields.CellData["region"].GetRange(),
    }
print(json.dumps(found))
"""


@pytest.mark.skipif(PVPYTHON is None, reason="no pvpython (Debian: apt install paraview)")
def test_all_readers_of_paraview_see_the_last_step(strip_run, tmp_path):
    script = tmp_path / "read.py"
    script.write_text(READ)
    done = subprocess.run(
        [PVPYTHON, script, strip_run.directory / "fields.xdmf"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert len(found) == 3
    for seen in found.values():
        assert seen["times"] == pytest.approx(list(range(18)))
        assert seen["points"] == len(strip_run.mesh.points)
        assert seen["u_Z"][0] == pytest.approx(-3, abs=1e-6)  # the inner end
        assert seen["phi"] == pytest.approx([0, 2.5], abs=1e-6)
        assert seen["components"] == 9
        assert seen["regions"] == [0, 2]


def test_every_run_directory_has_a_script(strip_run):
    text = (strip_run.directory / paraview.SCRIPT).read_text(encoding="utf-8")
    compile(text, paraview.SCRIPT, "exec")
    assert (
        "FIRST, LAST = 0, 2  # regions to show: 0 bottom_electrode, 1 film, 2 top_electrode" in text
    )


@pytest.mark.slow  # renders in an X server of its own, which may fail on a crowded machine
@pytest.mark.skipif(
    PVPYTHON is None or XVFB is None, reason="no pvpython or xvfb-run (apt install paraview xvfb)"
)
def test_the_script_draws_the_standard_view(strip_run, tmp_path):
    picture = tmp_path / "view.png"
    subprocess.run(
        [XVFB, "-a", PVPYTHON, strip_run.directory / paraview.SCRIPT, picture],
        capture_output=True,
        timeout=180,
        check=True,
        cwd=tmp_path,
    )
    image = imread(picture)[..., :3]
    assert image.shape[:2] == (900, 1600)
    strip = image[:, 200:1200]  # between the axes and the colour bar
    rows, columns = np.nonzero(np.ptp(strip, axis=-1) > 0.25)
    assert np.ptp(columns) > 500
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(4 / 3.05, rel=0.03)  # 3 mm down
