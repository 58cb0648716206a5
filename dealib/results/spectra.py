"""Further tables of a run: modes, frequencies, responses, sensitivities, uncertainties."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dealib.errors import ConfigError, first_line
from dealib.files import write_text
from dealib.results import xdmf
from dealib.results.history import STAGE

if TYPE_CHECKING:
    import pandas

    from dealib.results.reader import Run

MODES, FREQUENCIES, RESPONSE = "modes.csv", "frequencies.csv", "response.csv"
SENSITIVITY = "sensitivity.csv"
SAMPLES, SUMMARY, SOBOL = "samples.csv", "summary.csv", "sobol.csv"
SHAPES, CIRCUIT = "modes.xdmf", "circuit.csv"


def write(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, with the columns of all of them.

    Raises:
        PlatformError: If the disk refuses.
    """
    text = io.StringIO()
    columns = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(text, columns, restval="nan", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def read(path: Path, *needed: str) -> pandas.DataFrame:
    """Read a table; all its columns but the names of stages are numbers.

    Args:
        path: The file.
        needed: Columns that it must have.

    Raises:
        ConfigError: If it is missing or damaged.
    """
    import pandas as pd

    try:
        found = pd.read_csv(path, dtype={STAGE: str}, float_precision="round_trip")
        numbers = found.drop(columns=STAGE, errors="ignore").select_dtypes("number")
        numbers = numbers.dropna(axis="columns")
        if lacking := [name for name in needed if name not in numbers]:
            raise ValueError(f"without numbers in the column {lacking[0]}")
    except FileNotFoundError:
        raise ConfigError(f"{path}: missing") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: damaged ({first_line(error)})") from None
    return found


def write_shapes(run: Run) -> None:
    """Write `modes.xdmf` for ParaView, with one time step for each mode of each stored state.

    Its fields are `u`, the displacement of the state, and `mode`, whose largest displacement is 1.

    Raises:
        PlatformError: If the disk refuses.
    """
    from dealib.results.fields import named

    file, axes, count = xdmf.FieldFile(run.directory, run.mesh, name=SHAPES), run.mesh.points, 0
    for index in range(len(run.stored_steps)):
        modes = run.modes(index)
        if modes is None:
            continue
        u = named(run.state(index)[None, :, : axes.shape[1]])["mode"]
        for shape in modes:
            count += 1
            file.add(count, float(count), {"u": u, **named(shape[None])})
