"""The reference pages of fits, from their schemas."""

from __future__ import annotations

from dealib.calibration.coupon_schema import Coupon
from dealib.calibration.schema import Fit
from dealib.config.reference import sections

_HEAD = """\
# All keys of a fit

Made by `dealib schema --of fit --reference` from the schema that `dealib calibrate` applies.
The keys of the config that is fitted are in [configs](../REFERENCE.md), those of fits to tests of a
material alone in [COUPONS.md](COUPONS.md)."""


_COUPON = """\
# All keys of a coupon fit

Made by `dealib schema --of coupon --reference` from the schema that `dealib calibrate` applies to
files with `tests`. The laws and their parameters are those of [configs](../REFERENCE.md)."""


def reference() -> str:
    """The page of all keys of a fit, in Markdown."""
    return "\n".join([_HEAD, *sections(Fit)]) + "\n"


def coupon_reference() -> str:
    """The page of all keys of a coupon fit, in Markdown."""
    return "\n".join([_COUPON, *sections(Coupon)]) + "\n"
