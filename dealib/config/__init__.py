"""The YAML config: schema, loading, messages."""

from dealib.config.case import Case, load, read, resolved
from dealib.config.schema import Config

__all__ = ["Case", "Config", "load", "read", "resolved"]
