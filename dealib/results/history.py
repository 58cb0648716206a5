"""Reading `history.csv`."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dealib.config.columns import COLUMNS

if TYPE_CHECKING:
    import pandas

HISTORY = "history.csv"
STAGE = "stage"  # the one column that is text


def parse(path: Path) -> pandas.DataFrame:
    """The whole rows of a file; the last one may be cut short by a kill.

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
        )
    )


def from_columns(columns: Mapping[str, Any]) -> pandas.DataFrame:
    """A history from its columns, such as those of `results.h5`.

    Raises:
        ValueError: If they are none.
    """
    import pandas as pd

    order = dict.fromkeys(["step", "time_s", STAGE, *COLUMNS, *columns])
    return checked(pd.DataFrame({name: columns[name] for name in order if name in columns}))


def checked(history: pandas.DataFrame) -> pandas.DataFrame:
    """A history, if it is one.

    Raises:
        ValueError: If a column lacks, or holds what it cannot.
    """
    lacking = [name for name in ("step", "time_s", STAGE) if name not in history]
    if lacking:
        raise ValueError(f"without the column {lacking[0]}")
    for name, values in history.items():
        if name != STAGE and (name not in COLUMNS or values.dtype.kind not in "fi"):
            raise ValueError(f"the column {str(name)[:40]!r} is none of numbers")
    steps = history["step"]
    if steps.dtype.kind != "i" or (steps.diff()[1:] != 1).any() or (len(steps) and steps[0] != 0):
        raise ValueError("the steps do not count up from 0")
    return history
