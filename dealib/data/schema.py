"""How a data file is read and prepared: keys of a fit's `data`, and options of `compare`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from dealib.config.names import FilePath
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Time, split

if TYPE_CHECKING:
    Amount: TypeAlias = tuple[float, str]
else:
    _WRITTEN = {"anyOf": [{"type": "number"}, {"type": "string"}]}
    Amount = Annotated[tuple[float, str], BeforeValidator(split), WithJsonSchema(_WRITTEN)]


class Format(Section):
    """What a data file does not tell by itself."""

    encoding: str | None = Field(
        None, description="such as utf-8 or cp1252; default: recognised from the bytes"
    )
    delimiter: str | None = Field(
        None, min_length=1, max_length=1, description="separator of columns; ' ' for any blanks"
    )
    decimal: Literal[".", ","] | None = Field(
        None, description="the decimal mark; the other one then parts thousands"
    )
    sheet: str | None = Field(None, description="sheet of a spreadsheet, or variable of a MAT file")
    table: int | None = Field(
        None, ge=1, description="number of the table, where there are several"
    )


class Preparation(Section):
    """What is done to a column, in this order, in the units of the config."""

    outliers: float | None = Field(
        None, gt=0, description="leave out what is further from the running median of 11 rows than "
        "so many standard deviations of such differences, such as 5",
    )  # fmt: skip
    smooth: int | None = Field(
        None, ge=3, description="rows of the window of a Savitzky-Golay filter of second order"
    )
    sign: Literal[1, -1] = Field(1, description="-1 turns the sign of the values")
    factor: float = Field(1.0, description="factor on the values")
    offset: Amount | None = Field(None, description="added to the values, such as '-0.1 N'")
    zero: Literal["start"] | int | None = Field(
        None, description="start: the first value is 0; a number: the mean of so many first rows is"
    )
    shift: Time | None = Field(
        None, description="moves the column to later times; needs a column of times"
    )
    range: tuple[Amount, Amount] | None = Field(
        None, description="least and largest value; rows outside are left out"
    )


class Plateaus(Section):
    """Averages over the plateaus of a quantity that is switched, such as a voltage."""

    of: str = Field(description="the quantity that is switched")
    settle: float = Field(
        0.5, ge=0, lt=1, description="share of each plateau, at its start, that is left out"
    )


class Reading(Section):
    """Which columns of a file are read, and what is done to them."""

    file: FilePath = Field(
        min_length=1, description="text, spreadsheet or MAT file, beside this one"
    )
    columns: dict[str, str] | None = Field(
        None,
        description="header in the file by quantity, such as force: 'Load cell [mN]', with its "
        "unit where the file has none; 'column 3' without headers",
    )
    ignore: tuple[str, ...] = Field((), description="headers of columns that are left out")
    format: Format = Format()
    prepare: dict[str, Preparation] = Field({}, description="by quantity")

    @model_validator(mode="after")
    def _one_header_each(self) -> Reading:
        taken: dict[str, str] = {}
        for quantity, header in (self.columns or {}).items():
            if header in taken:
                problem = f"{header!r} is {taken[header]} already; a column is one quantity"
                raise ValueAt(("columns", quantity), problem)
            taken[header] = quantity
        return self


class Selection(Reading):
    """Measured curves in a file, and the part of a run that they belong to."""

    stage: str | None = Field(None, description="stage of the program; default the whole run")
    x: str | None = Field(None, description="quantity of the abscissa; default the first column")
    plateaus: Plateaus | None = None
    resample: int | None = Field(
        None, ge=2, description="about this number of points: means of consecutive rows"
    )
    turn: Amount | None = Field(
        None,
        description="least way back of the abscissa that begins a new branch, such as '0.1 mm'; "
        "default 5 % of its range, and more than its noise",
    )

    @classmethod
    def of(cls, reading: Reading) -> Selection:
        """All curves of a file that is read in a certain way."""
        same = {name: getattr(reading, name) for name in Reading.model_fields}
        return cls.model_construct(**same)
