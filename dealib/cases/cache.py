"""Solved cases on disk, found again by the key of all that their results depend on."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dealib import versions
from dealib.config.schema import Config
from dealib.errors import ConfigError
from dealib.reading import read_bytes
from dealib.results.reader import Run

DONE, FAILED = "done", "not converged"


def key(config: Config, fields: str, also: str = "") -> str:
    """Key of a case: equal for equal physics, mesh file, code and versions of libraries.

    Args:
        config: Its config; what it is called and where its results go does not count.
        fields: Which fields are kept.
        also: What is computed beside the run.
    """
    left_out: Any = {"name": True, "description": True, "output": True, "mesh": {"file"}}
    tree = config.model_dump(mode="json", exclude=left_out)
    file = config.mesh.file
    mesh = file and hashlib.sha256(read_bytes(Path(file), "mesh", 10**9)).hexdigest()
    parts = [tree, fields, mesh, also, versions.source(), versions.installed()]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Cache:
    """A folder of run directories, one a key, each with a log beside it.

    Attributes:
        folder: The folder.
    """

    folder: Path

    def run(self, key: str) -> Run:
        """The run of a case that has one."""
        return Run(self.folder / key)

    def standing(self, key: str) -> tuple[str, str]:
        """Status of a case, and what went wrong.

        'missing' if there is nothing, 'damaged' if it cannot be read; both are to be solved.
        """
        directory = self.folder / key
        if not directory.is_dir():
            return "missing", ""
        try:
            run = Run(directory)
            run.check()
        except ConfigError as error:
            return "damaged", str(error)
        return run.status, str(run.info.get("error", ""))

    def settled(self, key: str, retry: bool = False) -> bool:
        """Whether nothing is to be solved: it is done, or did not converge and is not retried."""
        return self.standing(key)[0] in ((DONE,) if retry else (DONE, FAILED))
