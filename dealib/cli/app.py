"""All commands; a new one goes into one of these modules."""

from dealib.cli import designing, looking, solving  # noqa: F401 - they register themselves
from dealib.cli.root import app

__all__ = ["app"]
