"""Histories of cases: solved in parallel, and kept with those of studies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dealib.cases.cache import DONE, FAILED, Cache, key
from dealib.cases.job import Job, Wanted
from dealib.cases.workers import Pool
from dealib.config import Case
from dealib.errors import ConfigError, NotConverged, PlatformError
from dealib.results.history import STAGE
from dealib.results.spectra import RESPONSE, read

History = dict[str, np.ndarray]
_FIELDS = "none"


class Cases:
    """Solves cases; what is solved once is read from then on.

    Args:
        cache: Where solved cases are.
        pool: Who solves them.
    """

    def __init__(self, cache: Cache, pool: Pool) -> None:
        self.cache, self.pool, self.solved = cache, pool, 0

    def histories(
        self, cases: Sequence[Case], spectra: Sequence[Wanted | None]
    ) -> list[History | NotConverged]:
        """Histories of cases, or the spectra that are wanted of them, or why there is none.

        Raises:
            ConfigError: If a case cannot be.
            PlatformError: If a case failed in another way, or its process died.
        """
        keys = [
            key(case.config, _FIELDS if wanted is None else f"{_FIELDS}, {wanted!r}")
            for case, wanted in zip(cases, spectra, strict=True)
        ]
        jobs = {}
        for known, case, wanted in zip(keys, cases, spectra, strict=True):
            if known not in jobs and not self.cache.settled(known):
                changes = (*case.overrides, f"output.fields={_FIELDS}")
                folder = self.cache.folder
                jobs[known] = Job(case.config.name, known, case.path, changes, folder, wanted)
        for ended in self.pool.solve(list(jobs.values())):
            self.solved += 1
            if ended.status not in (DONE, FAILED):
                kind = ConfigError if ended.exit_code == 2 else PlatformError
                raise kind(f"a case of the fit {ended.status}: {ended.error}")
        return [self._history(*one) for one in zip(keys, spectra, strict=True)]

    def _history(self, known: str, wanted: Wanted | None) -> History | NotConverged:
        run = self.cache.run(known)
        if run.status == FAILED:
            return NotConverged(run.info["error"])
        table = run.history
        if wanted is not None:
            table = read(run.directory / RESPONSE).assign(**{STAGE: ""})
        return {str(name): values.to_numpy() for name, values in table.items()}
