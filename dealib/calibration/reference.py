"""The reference page of fits, from their schema."""

from __future__ import annotations

from dealib.calibration.schema import Fit
from dealib.config.reference import sections

_HEAD = """\
# All keys of a fit

Made by `dealib schema --of fit --reference` from the schema that `dealib calibrate` applies.
The keys of the config that is fitted are in [configs](../REFERENCE.md)."""


def reference() -> str:
    """The page of all keys, in Markdown."""
    return "\n".join([_HEAD, *sections(Fit)]) + "\n"
