"""Headers of columns: the quantity and the unit in them, in all common notations."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence

from dealib.units import factor

Header = tuple[str, str]  # name, unit

_BRACKETS = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\}|<([^<>]*)>")
_APART = re.compile(r"^(?:in\s+|(.*?[^\s/,])(\s*[/,]\s*|\s+in\s+|\s+))(\S+)$")  # U / kV, U in kV
_NO_UNITS = {"min", "max", "step", "steps", "in"}  # words that end names of columns
_NONE = {"", "-", "--", "1", "[]", "none", "dimensionless", "n/a", "unitless", "./."}
_CLOCK = re.compile(r"(hh?:)?(mm?|min):ss?([.,]\w+)?|hh?:(mm?|min)", re.IGNORECASE)
_LABEL = re.compile(r"(long name|short name|units?|comments?|f\(x\)=?)[:=]?", re.IGNORECASE)
_SPELT = {  # notation in data files -> notation of `dealib.units`
    "Âµ": "u", "µ": "u", "\u03bc": "u", "²": "^2", "³": "^3", "·": "*", "⋅": "*", "\u03a9": "ohm",
    "\u2126": "ohm", "Â°": "°", "℃": "°C", "−": "-", "⁻¹": "^-1",
}  # fmt: skip
# units that are also recognised with other capitals: kv, MPA, Ohm
_UNCASED = re.findall(
    r"\S+",
    "nm um mm cm m us ms s min h mN N kN gf kgf lbf mg g kg Pa kPa MPa GPa N/mm N/m N/mm^2 mV V kV "
    "V/um kV/mm MV/m V/m pF nF uF pC nC uC mC nJ uJ mJ J mW W Hz kHz MHz ohm kohm Mohm Gohm "
    "degC percent % inch volt second sec newton pascal meter millimeter",
)


def split_unit(name: str) -> Header:
    """Quantity and unit of a column: 'Force [mN]' -> force, mN; 'field_max_MV_per_m' -> MV/m."""
    quantity, unit = parted(name)
    return plain(quantity), unit


def plain(name: str) -> str:
    """A name in the style of `history.csv`: 'Field max' -> field_max."""
    return re.sub(r"[\s_-]+", "_", name.strip()).lower()


def parted(name: str) -> Header:
    """Name and unit of a header, as written: 'U / kV' -> U, kV; the unit is empty if there is none.

    A unit may stand in brackets (the last brackets that contain a unit count), after a slash, a
    comma or 'in', or at the end after a blank or an underscore.
    """
    name = " ".join(name.replace('"', " ").split())
    brackets = [(b, next(g for g in b.groups() if g is not None)) for b in _BRACKETS.finditer(name)]
    for found, text in reversed(brackets):
        if is_unit(text) or _CLOCK.fullmatch(text.strip()):
            return " ".join((name[: found.start()] + name[found.end() :]).split()), text.strip()
    if brackets and brackets[-1][0].group().startswith("[") and name.endswith("]"):
        return name[: brackets[-1][0].start()].strip(), brackets[-1][1].strip()
    apart = _APART.match(name)
    if apart and _ends(apart[3]) and not (apart[2] == " " and re.fullmatch("[^NVsm]", apart[3])):
        return apart[1] or "", apart[3]  # 'Channel A' is no ampere
    parts = name.split("_")
    for k in range(1, len(parts)):
        unit = "_".join(parts[k:]).replace("_per_", "/")
        if _ends(unit):
            return "_".join(parts[:k]), unit
    return name, ""


def _ends(text: str) -> bool:
    """Whether the end of a header, which has no brackets, is a unit."""
    return (
        text not in _NO_UNITS
        and not re.search(r"[][(){}]", text)
        and bool(spelt(text))
        and is_unit(text)
    )


def spelt(unit: str) -> str:
    """A unit in the notation of `dealib.units`: 'N/mm²' -> N/mm^2; empty for '[-]'."""
    unit = unit.strip().strip("[](){}<>").strip()
    for written, meant in _SPELT.items():
        unit = unit.replace(written, meant)
    unit = re.sub(r"(?<=[A-Za-z])([23])\b", r"^\1", unit)
    return "" if unit.lower() in _NONE else unit


@functools.cache
def is_unit(text: str) -> bool:
    """Whether a text is a unit, or says that there is none; 'ch 1' is not."""
    unit = spelt(text)
    words = re.findall(r"[^\W\d_]+", unit)
    if re.search(r"\s|_|[^\W\d]\d|^\d(?!/)", unit) or any(len(w) > 12 for w in words):
        return False
    return (not unit and bool(text.strip())) or any(map(_is_known, _readings(unit)))


def _readings(unit: str) -> list[str]:
    """Units that a text may mean, first with its capitals as written."""
    return [unit, *(u for u in _UNCASED if u.casefold() == unit.casefold() and u != unit)]


@functools.cache
def _is_known(unit: str) -> bool:
    try:
        factor(unit, unit)
    except ValueError:
        return False
    return True


def scale(header: Header, unit: str) -> float:
    """Factor from the unit of a header to another one.

    In a header in capitals the unit may be in capitals too: 'TIME [S]', 'FORCE [N]'.

    Raises:
        ValueError: If the unit is missing, of another kind, or ambiguous as in 'FORCE [MN]'.
    """
    given = spelt(header[1])
    factors, fault = {}, ValueError()
    for reading in _readings(given or "dimensionless"):
        try:
            factors[reading] = factor(reading, unit or "dimensionless")
        except ValueError as error:
            fault = fault if fault.args else error
    if not factors:
        raise fault
    if len(set(factors.values())) > 1 and header[0].isupper() and given.isupper():
        raise ValueError(f"in capitals, the unit may be {' or '.join(factors)}; say which")
    return next(iter(factors.values()))


def headers(rows: Sequence[Sequence[str]], columns: int) -> list[Header]:
    """Names and units of columns from the rows of text above them.

    The row of units is the lowest row that contains only units and stands under a row of names. If
    there is none, the lowest row has the names, each with its unit. Further rows distinguish
    columns of equal names, such as those of curves side by side. A column without a name is called
    'column 3', for example.
    """
    table = [[*(c.strip() for c in row), *[""] * columns][:columns] for row in rows]
    table = [["" if _LABEL.fullmatch(row[0]) else row[0], *row[1:]] for row in table if any(row)]
    table = [row for row in table if any(row)]
    units = next((i for i in range(len(table) - 1, 0, -1) if _are_units(table, i)), None)
    at = len(table) - 1 if units is None else units - 1
    found = [parted(c) for c in table[at]] if table else [("", "")] * columns
    if units is not None:
        bare = [u.strip("[](){}<> ") for u in table[units]]
        found = [
            (old[0] if not u or "[" in cell or "(" in cell else cell, u or old[1])
            for old, u, cell in zip(found, bare, table[at], strict=True)
        ]
    others = [r for i, r in enumerate(table) if i not in (at, units)]
    for row in reversed(others):
        names = [name for name, _ in found if name]
        if len(set(names)) == len(names):
            break
        filled, last = [], ""
        for cell in row:  # a name over several columns stands over the first of them
            last = cell or last
            filled.append(last)
        found = [
            (f"{f} {name}".strip() if names.count(name) > 1 else name, unit)
            for f, (name, unit) in zip(filled, found, strict=True)
        ]
    return _distinct([(name or f"column {i + 1}", u) for i, (name, u) in enumerate(found)])


def _are_units(table: Sequence[Sequence[str]], row: int) -> bool:
    """Whether a row holds the units of the names above it, which then differ from each other."""
    units, names = table[row], table[row - 1]
    named = [n for n, u in zip(names, units, strict=True) if u]
    if not named or "" in named or len(set(named)) < len(named):
        return False
    return all(not u or is_unit(u) or bool(_CLOCK.fullmatch(u.strip("[]()"))) for u in units)


def _distinct(found: list[Header]) -> list[Header]:
    seen: dict[Header, int] = {}
    for i, header in enumerate(found):
        seen[header] = seen.get(header, 0) + 1
        if seen[header] > 1:
            found[i] = (f"{header[0]} ({seen[header]})", header[1])
    return found
