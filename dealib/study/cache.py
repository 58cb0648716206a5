"""Solved cases on disk, found again by the key of their physics."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dealib.results.store import INFO

DONE, FAILED = "done", "not converged"


@dataclass(frozen=True)
class Cache:
    """A folder of run directories, one a key, each with a log beside it.

    Attributes:
        folder: The folder.
    """

    folder: Path

    def directory(self, key: str) -> Path:
        """Run directory of a case."""
        return self.folder / key

    def log(self, key: str) -> Path:
        """What the case printed, and the traceback of a crash."""
        return self.folder / f"{key}.log"

    def info(self, key: str) -> dict[str, Any]:
        """`run.json` of a case, empty if there is none that can be read."""
        try:
            return dict(json.loads((self.directory(key) / INFO).read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return {}

    def status(self, key: str) -> str:
        """'done', 'not converged', or what else stands in `run.json`; 'missing' if nothing."""
        return str(self.info(key).get("status", "missing"))
