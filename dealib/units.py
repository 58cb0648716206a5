"""Quantities with units in files; plain floats in mm, N, MPa, kV, s inside the program.

With these base units energy is in mJ, charge in uC, capacitance in nF and the electric field in
kV/mm = MV/m.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import GroupedMetadata
from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema

from dealib.errors import did_you_mean
from dealib.reading import shown

if TYPE_CHECKING:
    import pint

EPSILON_0 = 8.8541878128e-6  # vacuum permittivity, N/kV^2 (CODATA 2018)
GRAVITY = 9.80665  # standard gravity, m/s^2; times kg gives N

# dimension -> (internal unit, example for messages)
DIMENSIONS = {
    "length": ("mm", "30 um"),
    "time": ("s", "10 s"),
    "force": ("N", "-0.3 N"),
    "mass": ("kg", "20 g"),
    "density": ("t/mm^3", "1000 kg/m^3"),
    "stress": ("MPa", "1 MPa"),
    "stiffness": ("N/mm", "0.1 N/mm"),
    "voltage": ("kV", "2.5 kV"),
    "charge": ("uC", "0.5 uC"),
    "volume": ("mm^3", "5 ml"),
    "electric field": ("kV/mm", "80 V/um"),
    "resistance": ("Gohm", "10 kohm"),
    "flow conductance": ("mm^3/s/MPa", "10 mm^3/s/kPa"),
    "inductance": ("GH", "1 mH"),
    "rate": ("1/s", "0.01 1/s"),
    "frequency": ("Hz", "100 Hz"),
    "angle": ("rad", "10 deg"),
    "moment": ("Nmm", "5 N mm"),
}

# internal unit -> factors of the usual units; others need pint, whose import takes 0.3 s
USUAL = {
    "mm": {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "nm": 1e-6},
    "s": {"s": 1.0, "ms": 1e-3},
    "N": {"kN": 1e3, "N": 1.0, "mN": 1e-3},
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    "t/mm^3": {"kg/m^3": 1e-12, "kg/m3": 1e-12, "g/cm^3": 1e-9, "g/cm3": 1e-9},
    "MPa": {"GPa": 1e3, "MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6},
    "N/mm": {"N/mm": 1.0, "N/m": 1e-3},
    "kV": {"kV": 1.0, "V": 1e-3},
    "uC": {"mC": 1e3, "uC": 1.0, "nC": 1e-3},
    "mm^3": {"l": 1e6, "cm^3": 1e3, "cm3": 1e3, "ml": 1e3, "mm^3": 1.0, "mm3": 1.0, "ul": 1.0},
    "Gohm": {"Gohm": 1.0, "Mohm": 1e-3, "kohm": 1e-6, "ohm": 1e-9},
    "GH": {"H": 1e-9, "mH": 1e-12, "uH": 1e-15},
    "kV/mm": {"kV/mm": 1.0, "V/um": 1.0, "MV/m": 1.0},
    "1/s": {"1/s": 1.0},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
    "deg": {"deg": 1.0, "°": 1.0, "rad": 180 / math.pi},
    "Nmm": {"N m": 1e3, "Nm": 1e3, "Nmm": 1.0, "N mm": 1.0, "mN m": 1.0, "mN mm": 1e-3},
}

# symbols with exponents of one digit, multiplied and divided
_SYMBOL = r"[µμ]?[A-Za-zΩ°%][A-Za-zµμΩ_]*(?:(?:\^|\*\*)?-?\d|[²³])?"
_UNIT = re.compile(rf"(?:1|{_SYMBOL})(?:\s*[ */·]\s*{_SYMBOL})*")
_LEAST = 1e-50  # smallest magnitude in internal units: squares of smaller ones vanish

_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint

    # without pint's cache on disk, which fails after its installation has moved
    found: pint.UnitRegistry = pint.UnitRegistry()
    found.define("Nmm = newton * millimeter")
    found.define("Nm = newton * meter")  # in pint, Nm counts the fineness of fibres
    return found


def parse(text: object, dimension: str) -> float:
    """Read a quantity such as '30 um'.

    Args:
        text: A number followed by a unit.
        dimension: A key of `DIMENSIONS`.

    Returns:
        The value in dealib's internal unit of that dimension.

    Raises:
        ValueError: If there is no unit, or one of another dimension.
    """
    unit, example = DIMENSIONS[dimension]
    article = "an" if dimension[0] in "aeiou" else "a"
    wanted = f"expected {article} {dimension} with its unit, such as '{example}'"
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        kinds = {type(None): "nothing", dict: "a mapping", list: "a list", bool: str(text).lower()}
        raise ValueError(f"{wanted}, not {kinds.get(type(text), type(text).__name__)}")
    number = _NUMBER.match(_ascii(text))
    if number is None:
        raise ValueError(f"{wanted}; {shown(text)!r} does not start with a number")
    given = str(text)[number.end() :].strip()
    if not given:
        raise ValueError(f"{wanted}; {shown(str(text).strip())!r} has no unit")
    value = float(number.group()) * _factor(given, unit, wanted)
    if not math.isfinite(value):
        raise ValueError(f"{wanted}; {shown(str(text).strip())!r} is too large")
    return value


def sensible(text: object, dimension: str) -> float:
    """Read a quantity of a config, as `parse` does.

    Raises:
        ValueError: Also if the value is so small or so large that its square is out of range.
    """
    value = parse(text, dimension)
    if value and not _LEAST <= abs(value) <= 1 / _LEAST:
        size = "small" if abs(value) < 1 else "large"
        raise ValueError(f"{shown(str(text).strip())!r} is too {size} for a {dimension}")
    return value


@functools.cache
def _factor(given: str, unit: str, wanted: str) -> float:
    """Factor from a user's unit to another one; `wanted` begins the message of the error."""
    usual = USUAL.get(unit, {}).get(given)
    if usual is not None:
        return usual
    import pint

    problem = "is no unit"
    if _UNIT.fullmatch(given):  # pint would evaluate any expression
        try:
            return float(_registry().Quantity(1.0, given).to(unit).magnitude)
        except pint.DimensionalityError:
            problem = "is not a unit of that kind"
        except Exception:  # pint lets all errors of its parser and tokenizer through
            pass
    raise ValueError(f"{wanted}; {shown(given)!r} {problem}{_near(given, unit)}")


def _near(given: str, unit: str) -> str:
    """A hint at the unit that may be meant: with a '^', other capitals or a similar name."""
    power = re.sub(r"(?<=[A-Za-z])(?=\d$)", "^", given)
    if power != given:
        with suppress(ValueError):
            return f"; did you mean {power!r}?" * bool(_factor(power, unit, ""))
    usual = USUAL.get(unit, {})
    same = [known for known in usual if known.lower() == given.replace("µ", "u").lower()]
    hint = f"; did you mean {same[0]!r}?" if same else did_you_mean(given, usual)
    return hint if "did you mean" in hint else ""


def factor(given: str, unit: str) -> float:
    """Factor from one unit to another.

    Raises:
        ValueError: If one is no unit, or their dimensions differ.
    """
    return _factor(given, unit, f"expected a unit such as '{unit}'")


def convert(amount: tuple[float, str], unit: str) -> float:
    """Convert an amount to another unit.

    Args:
        amount: Number and unit, as of `split`.
        unit: The other unit; empty for plain numbers.

    Raises:
        ValueError: If the unit of the amount is missing or of another dimension.
    """
    value, given = amount
    if given == unit:
        return value
    if not given:
        raise ValueError(f"expected a unit such as '{unit}'; '{value:g}' has no unit")
    if not unit and given == "%":
        return value / 100
    if not unit:
        raise ValueError(f"expected a plain number; '{value:g} {given}' has a unit")
    return value * factor(given, unit)


def _ascii(text: object) -> str:
    """The text with plain minus signs instead of typographic ones; its length is unchanged."""
    return str(text).replace("\u2212", "-")


def split(text: object) -> tuple[float, str]:
    """Number and unit of a quantity of any dimension; the unit is empty if there is none.

    Raises:
        ValueError: If it does not start with a number.
    """
    number = _NUMBER.match(_ascii(text))
    if isinstance(text, bool) or number is None:
        raise ValueError(f"expected a number, with its unit if it has one, not {text!r}")
    return float(number.group()), str(text)[number.end() :].strip()


def write(value: float, dimension: str) -> str:
    """Inverse of `parse`: a text that reads back as the same float."""
    return f"{value!r} {DIMENSIONS[dimension][0]}"


def neat(value: float, digits: int = 5) -> str:
    """A number for display; magnitudes below 1e-9, which are rounding, become '0'."""
    return f"{0.0 if abs(value) < 1e-9 else value:.{digits}g}"


def counted(number: int, noun: str) -> str:
    """A number with its noun, such as '1 study', '2 studies' or '3 cases'."""
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"


@dataclass(frozen=True)
class Dimension(GroupedMetadata):
    """What is known of a number that files give with a unit, for pydantic.

    Attributes:
        name: Key of `DIMENSIONS`.
    """

    name: str

    def __iter__(self) -> Iterator[Any]:
        yield BeforeValidator(functools.partial(sensible, dimension=self.name))
        yield PlainSerializer(functools.partial(write, dimension=self.name), return_type=str)
        yield WithJsonSchema(self.json_schema)

    @property
    def json_schema(self) -> dict[str, Any]:
        """Schema of its texts."""
        return {
            "type": "string",
            "pattern": r"^\s*[-−+]?(\d+\.?\d*|\.\d+)([eE][-−+]?\d+)?\s*\S+",
            "dimension": self.name,
            "examples": [DIMENSIONS[self.name][1]],
        }


def list_of(kind: Any) -> Any:
    """A type for a list of values of a kind; a single value is read as a list of one."""
    listed = BeforeValidator(
        lambda value: list(value) if isinstance(value, (list, tuple)) else [value],
        json_schema_input_type=kind | tuple[kind, ...],
    )
    return Annotated[tuple[kind, ...], Field(min_length=1), listed]


Length = Annotated[float, Dimension("length")]
Time = Annotated[float, Dimension("time")]
Force = Annotated[float, Dimension("force")]
Mass = Annotated[float, Dimension("mass")]
Stress = Annotated[float, Dimension("stress")]
Stiffness = Annotated[float, Dimension("stiffness")]
Voltage = Annotated[float, Dimension("voltage")]
Charge = Annotated[float, Dimension("charge")]
Volume = Annotated[float, Dimension("volume")]
ElectricField = Annotated[float, Dimension("electric field")]
Resistance = Annotated[float, Dimension("resistance")]
Rate = Annotated[float, Dimension("rate")]
Angle = Annotated[float, Dimension("angle")]
Moment = Annotated[float, Dimension("moment")]
Density = Annotated[float, Dimension("density")]
Frequency = Annotated[float, Dimension("frequency")]
FlowConductance = Annotated[float, Dimension("flow conductance")]
