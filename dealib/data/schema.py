"""How a data file is read and prepared: keys of a fit's `data`, and options of `compare`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dealib.config.section import Section


class Format(Section):
    """What a data file does not tell by itself."""

    encoding: str | None = Field(None, description="such as utf-8 or cp1252; default told by bytes")
    delimiter: str | None = Field(
        None, min_length=1, max_length=1, description="between columns; ' ' for any blanks"
    )
    decimal: Literal[".", ","] | None = Field(
        None, description="the decimal mark; the other one then parts thousands"
    )
    sheet: str | None = Field(None, description="of a spreadsheet, or variable of a MAT file")
    table: int | None = Field(
        None, ge=1, description="number of the table, where there are several"
    )
