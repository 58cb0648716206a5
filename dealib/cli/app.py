"""All commands; a new command goes into one of these modules."""

from dealib.cli import designing, looking, measuring, solving  # noqa: F401 - they register
from dealib.cli.root import app

__all__ = ["app"]
