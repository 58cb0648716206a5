"""The YAML config: its schema, how it is loaded, and messages about mistakes in it."""

from dealib.config.case import Case, load, read, resolved
from dealib.config.schema import Config

__all__ = ["Case", "Config", "load", "read", "resolved"]
