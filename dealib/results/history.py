"""Reading `history.csv`."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas

HISTORY = "history.csv"
STAGE = "stage"  # the one column that is text


def parse(path: Path, known: Collection[str] = ()) -> pandas.DataFrame:
    """The complete rows of a file; a kill may have cut the last one short.

    Args:
        path: The file.
        known: Columns that the device can have; empty if unknown.

    Raises:
        ValueError: If it is damaged.
        OSError: If it cannot be read.
    """
    import pandas as pd

    text = path.read_bytes().decode("utf-8")
    whole = text[: text.rfind("\n") + 1]
    try:
        header, *rows = csv.reader(io.StringIO(whole), strict=True)
        if any(len(row) != len(header) for row in rows):
            raise ValueError("rows of different lengths")
    except (csv.Error, ValueError) as error:
        raise ValueError(str(error) if whole else "empty") from None
    return checked(
        pd.read_csv(
            io.StringIO(whole),
            dtype={STAGE: str},
            keep_default_na=False,  # a stage may be named NA
            na_values={name: ["nan"] for name in header if name != STAGE},
            float_precision="round_trip",
        ),
        known,
    )


def from_columns(columns: Mapping[str, Any]) -> pandas.DataFrame:
    """A history from its columns, such as those of `results.h5`.

    Raises:
        ValueError: If these are not the columns of a history.
    """
    import pandas as pd

    return checked(pd.DataFrame(columns))


def checked(history: pandas.DataFrame, known: Collection[str] = ()) -> pandas.DataFrame:
    """The given history, once its columns are checked.

    Raises:
        ValueError: If a column is missing, unknown or not numeric, or the steps do not count up.
    """
    lacking = [name for name in ("step", "time_s", STAGE) if name not in history]
    if lacking:
        raise ValueError(f"without the column {lacking[0]}")
    for name, values in history.items():
        if name == STAGE:
            continue
        if (known and name not in known) or values.dtype.kind not in "fi":
            raise ValueError(f"the column {str(name)[:40]!r} is none of numbers")
    steps = history["step"]
    if steps.dtype.kind != "i" or (steps.diff()[1:] != 1).any() or (len(steps) and steps[0] != 0):
        raise ValueError("the steps do not count up from 0")
    return history
