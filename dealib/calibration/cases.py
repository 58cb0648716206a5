"""Histories of cases, solved in parallel and kept in the same cache as those of studies."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dealib.cases.cache import DONE, FAILED, Cache, key
from dealib.cases.job import Job, Spectrum
from dealib.cases.workers import Pool
from dealib.config import Case
from dealib.design import slopes
from dealib.errors import ConfigError, NotConverged, PlatformError
from dealib.results.history import STAGE
from dealib.results.spectra import RESPONSE, read

History = dict[str, np.ndarray]
_FIELDS = "none"


@dataclass(frozen=True)
class CaseRequest:
    """What a case computes besides its history.

    Attributes:
        spectrum: A spectrum, in place of the history.
        slopes: Keys with respect to whose logarithms the history is differentiated.
    """

    spectrum: Spectrum | None = None
    slopes: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Text that identifies this in the cache."""
        told = [_FIELDS, *(repr(x) for x in (self.spectrum, self.slopes) if x)]
        return ", ".join(told)


class Cases:
    """Solves cases; a case that has been solved is read from the cache.

    Args:
        cache: Cache of solved cases.
        pool: Pool of processes that solve them.
    """

    def __init__(self, cache: Cache, pool: Pool) -> None:
        self.cache, self.pool, self.solved = cache, pool, 0

    def histories(
        self, cases: Sequence[Case], wanted: Sequence[CaseRequest]
    ) -> list[History | NotConverged]:
        """Histories of cases, or their spectra; `NotConverged` for those that do not converge.

        Raises:
            ConfigError: If a case is invalid.
            PlatformError: If a case failed in another way, or its process died.
        """
        keys = [key(case.config, of.key) for case, of in zip(cases, wanted, strict=True)]
        jobs = {}
        for known, case, of in zip(keys, cases, wanted, strict=True):
            if known not in jobs and not self.cache.settled(known):
                changes = (*case.overrides, f"output.fields={_FIELDS}")
                watch = functools.partial(slopes.Slopes, of.slopes) if of.slopes else None
                given = case.config.name, known, case.path, changes, self.cache.folder
                jobs[known] = Job(*given, of.spectrum, watch)
        for ended in self.pool.solve(list(jobs.values())):
            self.solved += 1
            if ended.status not in (DONE, FAILED):
                kind = ConfigError if ended.exit_code == 2 else PlatformError
                raise kind(f"a case of the fit {ended.status}: {ended.error}")
        return [self._history(*one) for one in zip(keys, wanted, strict=True)]

    def slopes(self, case: Case, wanted: CaseRequest) -> dict[str, History]:
        """Derivatives of a solved case's history by the logarithms of keys, as far as known."""
        return slopes.read(self.cache.run(key(case.config, wanted.key)).directory)

    def _history(self, known: str, wanted: CaseRequest) -> History | NotConverged:
        run = self.cache.run(known)
        if run.status == FAILED:
            return NotConverged(run.info["error"])
        table = run.history
        if wanted.spectrum is not None:
            table = read(run.directory / RESPONSE).assign(**{STAGE: ""})
        return {str(name): values.to_numpy() for name, values in table.items()}
