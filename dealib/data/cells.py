"""Cells of a table: numbers with either decimal mark, overloads, clock times, or text."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.data.names import is_unit, spelt
from dealib.units import factor

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["number", "time", "missing", "text"]

_EXPONENT = r"(?:[eEdD][+-]?\d+)?"
_EITHER = rf"[+-]?(?:\d{{1,3}}(?:[\s'’]\d{{3}})+(?:[.,]\d*)?|\d+(?:[.,]\d+)*\.?|[.,]\d+){_EXPONENT}"
_NUMBER = re.compile(_EITHER)
_WITH_UNIT = re.compile(rf"({_EITHER})\s*([^\W\d_%°µμ]*[a-zA-Z%°µμΩ][\w/%°^²*]*)")
_PARTS = re.compile(
    r"(?P<date>(?P<a>\d{1,4})(?P<by>[./-])(?P<b>\d{1,2})[./-](?P<c>\d{1,4}))?(?:T|,?\s*)"
    r"(?:(?P<h>\d{1,3}):(?P<m>\d\d)(?::(?P<s>\d\d))?(?P<rest>[.,]\d+|:\d{3})?"
    r"\s?(?:(?P<half>[AaPp])\.?[Mm]\.?)?(?:\s?Z|\s?[+-]\d\d:?\d\d)?)?"
)
_CLOCK = r"\d{1,3}:\d{2}(?::\d{2})?(?:[.,]\d+|:\d{3})?(?:\s?[AaPp]\.?[Mm]\.?)?"
_DATE = r"\d{1,4}[./-]\d{1,2}[./-]\d{1,4}"
_TIME = re.compile(rf"(?:{_DATE}(?:T|,?\s))?{_CLOCK}(?:\s?Z|\s?[+-]\d\d:?\d\d)?|{_DATE}")
_MISSING = re.compile(
    r"|[-–—.]+|\*+|\?|[+-]?nan(\(\w*\))?|n/?a|n\.a\.?|<na>|null|none|nil|nd|n\.d\.|"
    r"missing|invalid|no data|#(n/a|nv|na|div/0!|value!|wert!|ref!|num!|zahl!)|-?1[.,]#(ind|qnan)",
    re.IGNORECASE,
)
_OVERLOAD = re.compile(
    r"[+-]?(o\.?l|0l|ovl|ovf|ovld|ovrld|ovrflw|over|overload|overflow|over[ -]?range|out of range|"
    r"inf|infinity|∞|1[.,]#inf|f{4,}|#{2,}|>+|<+)\.?",
    re.IGNORECASE,
)
_LARGEST = 9.9e18  # instruments write 9.9E37, 9.99999E19, 1E38 for what they cannot measure


def kind(text: str) -> Kind:
    """What a cell may contain, with either decimal mark."""
    text = text.strip()
    if _MISSING.fullmatch(text) or _OVERLOAD.fullmatch(text):
        return "missing"
    if _TIME.fullmatch(text):
        return "time"
    if _NUMBER.fullmatch(text):
        return "number"
    found = _WITH_UNIT.fullmatch(text)
    return "number" if found and is_unit(found[2]) else "text"


class Ambiguous(ValueError):
    """A cell can be read in two ways."""


def decimal_mark(columns: Iterable[Sequence[str]]) -> str | None:
    """The decimal mark of a table, from all its cells; None if no cell has a mark.

    Args:
        columns: Cells of each column, which may include text.

    Raises:
        Ambiguous: If cells such as 1.000 may be one or a thousand, or both marks are decimal.
    """
    sure: dict[str, str] = {}
    unclear = ""
    for column in columns:
        cells = [c.strip() for c in column if "." in c or "," in c]
        cells = [c for c in cells if kind(c) == "number"]
        doubtful = []
        for cell in cells:
            marks = re.sub(r"[^.,]", "", cell)
            if len(set(marks)) == 2:
                sure.setdefault(marks[-1], cell)
            elif len(marks) > 1:
                sure.setdefault(",."[marks[0] == ","], cell)  # 1.000.000
            elif (
                re.fullmatch(r"[+-]?[1-9]\d{0,2}[.,]\d{3}(\D.*)?", cell) and "e" not in cell.lower()
            ):
                doubtful.append(cell)
            else:
                sure.setdefault(marks, cell)
        if doubtful and any(re.fullmatch(r"[+-]?[1-9]\d{3,}", c.strip()) for c in column):
            sure.setdefault(doubtful[0].strip("+-0123456789")[0], doubtful[0])  # 1500 has no mark
        elif doubtful:
            unclear = unclear or doubtful[0]
    if len(sure) == 2:
        raise Ambiguous(f"both {' and '.join(map(repr, sure.values()))} have decimals")
    if not sure and unclear:
        number = re.sub(r"[^\d+-]", "", unclear)
        raise Ambiguous(
            f"{unclear!r} is {_plain(unclear)} with decimals or {number} with a thousands mark"
        )
    return next(iter(sure), None)


def _plain(text: str) -> str:
    return f"{float(text.replace(',', '.')):g}"


@dataclass(frozen=True)
class Cells:
    """The values of a column, and how its cells were read.

    Attributes:
        values: Numbers, (rows,), NaN where there is none.
        empty: Number of empty cells.
        overload: Number of cells that say that the instrument was overloaded.
        faults: Rows and texts of cells that could not be read.
        unit: Unit written in the cells; empty if there is none.
        note: Note on how the cells were read; empty if there is none.
        text: Whether it is a column of text.
    """

    values: Array
    empty: int = 0
    overload: int = 0
    faults: tuple[tuple[int, str], ...] = ()
    unit: str = ""
    note: str = ""
    text: bool = False


def convert(cells: pd.Series[Any], decimal: str, unit: str = "") -> Cells:
    """Convert the cells of a column to numbers.

    Args:
        cells: Numbers, texts, or both.
        decimal: The decimal mark.
        unit: Unit in the header, such as mm:ss.

    Raises:
        Ambiguous: If times can be read in two ways, or units of cells differ in kind.
    """
    import pandas as pd

    empty = np.asarray(cells.isna())
    values, faults, units = np.full(len(cells), np.nan), [], dict[str, float]()
    plain, grouped, other = np.ones(len(cells), dtype=bool), False, ",."[decimal == ","]
    if cells.dtype.kind in "fiub":
        values = cells.to_numpy(float, copy=True)
    else:
        given = cells.to_numpy(object)
        if decimal == ".":
            values = pd.to_numeric(cells, errors="coerce").to_numpy(float, copy=True)
        rest = np.flatnonzero(np.isnan(values) & ~empty)
        sample = [kind(str(given[i])) for i in rest[:: max(len(rest) // 200, 1)]]
        if len(rest) > len(cells) / 2 and sample.count("text") > 0.9 * len(sample) > 9:
            return Cells(values, text=True)
        if len(rest) > len(cells) / 2 and sample.count("time") > len(sample) / 2:
            return _times(given, rest, unit)
        strict = _strict(decimal)
        for row in rest.tolist():
            if isinstance(given[row], int | float):
                values[row] = given[row]
                continue
            text = str(given[row]).strip(' "')
            found = strict.fullmatch(text)
            if found and (not found[2] or is_unit(found[2])):
                values[row] = float(_normal(found[1], decimal))
                grouped = grouped or bool(re.search(rf"\d[{other}\s'’]\d", found[1]))
                if found[2]:
                    plain[row] = False
                    suffix = spelt(found[2])
                    units.setdefault(suffix, 1.0)
                    values[row] *= _to(suffix, next(iter(units)))
            elif _MISSING.fullmatch(text):
                empty[row] = True
            elif _OVERLOAD.fullmatch(text):
                values[row] = np.inf
            else:
                faults.append((row, text))
    over = np.abs(values) >= _LARGEST
    values[over] = np.nan
    filled = int((~empty).sum())
    # a column with few filled cells has notes on single rows
    words = len(faults) > filled / (2 if filled > len(cells) / 2 else 5)
    counts = int(empty.sum()), int(over.sum())
    if units and (values[plain][np.isfinite(values[plain])] != 0).any():
        raise Ambiguous("some cells have a unit, others have none")
    note = "thousands marks taken out" if grouped else ""
    return Cells(values, *counts, tuple(faults), next(iter(units), ""), note, words)


def _strict(decimal: str) -> re.Pattern[str]:
    other = "," if decimal == "." else "."
    groups = rf"[1-9]\d{{0,2}}(?:[{other}\s'’]\d{{3}})+|\d+"
    body = rf"[+-]?(?=\d|{re.escape(decimal)}\d)(?:{groups})?(?:{re.escape(decimal)}\d*)?"
    return re.compile(rf"({body}{_EXPONENT})\s*([^\W\d_]*[a-zA-Z%°µμΩ][\w/%°^²*]*)?")


def _normal(text: str, decimal: str) -> str:
    """A number as Python writes it."""
    other = "," if decimal == "." else "."
    text = re.sub(rf"[{other}\s'’]", "", text).replace(decimal, ".")
    return re.sub("[dD]", "e", text)


def _to(unit: str, wanted: str) -> float:
    try:
        return 1.0 if unit == wanted else factor(unit, wanted)
    except ValueError:
        raise Ambiguous(f"cells in {wanted} and in {unit} in one column") from None


def _times(given: npt.NDArray[np.object_], rows: npt.NDArray[np.intp], unit: str) -> Cells:
    """Clock times or dates in seconds: of a stop watch as written, others since the first row."""
    parts, half, good = np.zeros((len(rows), 4)), np.zeros(len(rows), dtype=int), []
    faults, dates, known = [], [], dict[str, tuple[int | None, int | None]]()
    fields, dated = 3, bool(re.match(_DATE, str(given[rows[0]]).strip(' "')))
    for k, row in enumerate(rows.tolist()):
        text = str(given[row]).strip(' "')
        found = _PARTS.fullmatch(text)
        if found is None:
            if kind(text) != "missing":
                faults.append((row, text))
            continue
        date, a, by, b, c, h, m, s, rest, am = found.groups()
        if bool(date) != dated:
            faults.append((row, text))
            continue
        if date and date not in known:
            known[date] = _days(a, by, b, c)
        if h:
            fields = 3 if s else 2
            parts[k] = int(h), int(m), int(s or 0), float("." + rest[1:]) if rest else 0
            half[k] = 0 if am is None else 1 + (am in "Pp")
        dates.append(date)
        good.append(k)
    rows, parts, half = rows[good], parts[good], half[good]
    if fields == 2 and (rest or re.match("m+(in)?:s", unit.strip("[]()"), re.IGNORECASE)):
        unit = "mm:ss"
    clock = _clock(parts, half, fields, unit)
    first, values = str(given[rows[0]]).strip(), np.full(len(given), np.nan)
    if known:
        orders = [o for o in (0, 1) if None not in [d[o] for d in known.values()]]
        readings = [np.array([known[d][o] or 0 for d in dates]) * 86400.0 for o in orders]
        since = [day - day[0] for day in readings]
        if not since or (len(since) > 1 and not np.array_equal(*since)):
            raise Ambiguous(f"{first!r} may begin with the day or the month")
        seconds = since[0] + clock
    else:
        seconds = clock + 86400 * np.cumsum(np.diff(clock, prepend=clock[0]) < -43200)  # midnight
    watch = not known and seconds[0] < 60
    values[rows] = seconds if watch else seconds - seconds[0]
    note = "times in s" if watch else f"times in s from {first} on"
    return Cells(values, len(given) - len(good) - len(faults), 0, tuple(faults), "s", note)


def _days(a: str, by: str, b: str, c: str) -> tuple[int | None, int | None]:
    """A date as a number of days, read as day/month and as month/day; None if invalid."""
    orders = [(c, b, a), (c, a, b)]  # 31/12/2024, 12/31/2024
    if len(a) == 4:
        orders = [(a, b, c)] * 2
    elif by == ".":
        orders = [(c, b, a)] * 2
    days: list[int | None] = []
    for year, month, day in orders:
        try:
            century = 2000 * (len(year) < 3)
            date = datetime.date(int(year) + century, int(month), int(day))
        except ValueError:
            days.append(None)
        else:
            days.append(date.toordinal())
    return days[0], days[1]


def _clock(parts: Array, half: npt.NDArray[np.int_], fields: int, unit: str) -> Array:
    """Seconds of h:min:s, or of two fields, which the unit or their size identifies."""
    h, m, s, fraction = parts.T
    if fields == 3 or half.any():
        h = np.where(half > 0, h % 12 + 12 * (half > 1), h)
        return np.asarray(3600 * h + 60 * m + s + fraction)
    pattern = unit.strip("[]()").lower()
    of_minutes = h.max() > 23 or pattern == "mm:ss"
    if not of_minutes and not re.match("h+:m", pattern):
        first = f"{h[0]:02.0f}:{m[0]:02.0f}"
        raise Ambiguous(f"{first!r} may be min:s or h:min; write the unit as [mm:ss] or [hh:mm]")
    return np.asarray(60 * h + m + fraction if of_minutes else 3600 * h + 60 * m)
