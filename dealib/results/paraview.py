"""A ParaView script for each run directory: deformed strips in the colours of the field."""

from __future__ import annotations

from pathlib import Path

from dealib.device.records import AIR
from dealib.files import write_text
from dealib.results.history import HISTORY
from dealib.results.mesh import ResultMesh
from dealib.results.xdmf import FIELDS

SCRIPT = "view_in_paraview.py"  # paraview.py would hide the package of that name

_TEXT = '''\
"""The standard view of this run in ParaView 5.11 or newer.

    paraview --script=view_in_paraview.py       in a window
    pvpython view_in_paraview.py view.png       a picture (on a machine without a screen: xvfb-run)

Change the names below, or everything in ParaView itself.
"""

import csv
import os
import sys

from paraview.simple import *  # noqa: F403

COLOUR, COMPONENT = "E", "Magnitude"  # or "phi", ""; "second_pk_stress", "XX": X is R, Y is Z
TITLE = "|E| (MV/m)"
MAGNIFICATION = 1.0  # of the displacement
FIRST, LAST = {low}, {high}  # regions to show: {regions}
TIME = None  # s; None: the one of the largest voltage

here = os.path.dirname(os.path.abspath(globals().get("__file__", {path!r})))
fields = XDMFReader(registrationName="run", FileNames=[os.path.join(here, {fields!r})])
fields.UpdatePipelineInformation()
with open(os.path.join(here, {history!r})) as file:
    rows = list(csv.DictReader(file))
volts = {{
    float(row["time_s"]): max(
        (abs(float(v)) for k, v in row.items() if k.partition(".")[0] == "voltage_kV"), default=0.0
    )
    for row in rows
}}
times = fields.TimestepValues
now = TIME if TIME is not None else max(times, key=lambda t: volts.get(t, 0.0))

shown = Threshold(registrationName="strips", Input=fields, Scalars=["CELLS", "region"])
shown.LowerThreshold, shown.UpperThreshold = FIRST, LAST
deformed = WarpByVector(registrationName="deformed", Input=shown, Vectors=["POINTS", "u"])
deformed.ScaleFactor = MAGNIFICATION

scene = GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
scene.AnimationTime = now

view = GetActiveViewOrCreate("RenderView")
view.InteractionMode = "2D"
view.ViewTime = now
display = Show(deformed, view)
display.NonlinearSubdivisionLevel = 3  # second-order cells are curved
ColorBy(display, ("POINTS", COLOUR, COMPONENT) if COMPONENT else ("POINTS", COLOUR))
display.RescaleTransferFunctionToDataRange(False, True)
display.SetScalarBarVisibility(view, True)
bar = GetScalarBar(GetColorTransferFunction(COLOUR), view)
bar.Title, bar.ComponentTitle = TITLE, ""
bar.TitleFontSize = bar.LabelFontSize = 12
bar.TitleColor = bar.LabelColor = [0.1, 0.1, 0.1]
bar.WindowLocation = "Lower Right Corner"
view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]
ResetCamera()
Render()
if len(sys.argv) > 1 and sys.argv[1].endswith(".png"):
    SaveScreenshot(sys.argv[1], view, ImageResolution=[1600, 900])
'''


def write(directory: Path, mesh: ResultMesh) -> None:
    """Write the script into a run directory.

    Raises:
        PlatformError: If the disk refuses.
    """
    shown = [i for i, name in enumerate(mesh.names) if name != AIR]
    text = _TEXT.format(
        regions=", ".join(f"{i} {name}" for i, name in enumerate(mesh.names)),
        path=str(directory.resolve() / SCRIPT),
        fields=FIELDS,
        history=HISTORY,
        low=min(shown),
        high=max(shown),
    )
    write_text(directory / SCRIPT, text)
