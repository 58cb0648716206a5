"""Solved cases on disk, found by the key of all that their results depend on."""

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
        config: Its config; names, descriptions and output do not count.
        fields: Which fields are stored, as `output.fields`.
        also: Further results that are computed with the run.
    """
    left_out: Any = {"name": True, "description": True, "output": True, "mesh": {"file"}}
    tree = config.model_dump(mode="json", exclude=left_out)
    file = config.mesh.file
    mesh = file and hashlib.sha256(read_bytes(Path(file), "mesh", 10**9)).hexdigest()
    parts = [tree, fields, mesh, also, versions.source(), versions.installed()]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Cache:
    """A folder of run directories, one for each key, each with a log beside it.

    Attributes:
        folder: The folder.
    """

    folder: Path

    def run(self, key: str) -> Run:
        """The run of a solved case."""
        return Run(self.folder / key)

    def status(self, key: str) -> tuple[str, str]:
        """Status of a case and its error.

        The status is that of its run, 'missing' without a run directory, or 'damaged' if the run
        cannot be read.
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
        """Whether a case need not be solved: it is done, or did not converge and not `retry`."""
        return self.status(key)[0] in ((DONE,) if retry else (DONE, FAILED))
