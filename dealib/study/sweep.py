"""Where the cases of studies stand, and which are to be solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dealib.cases.cache import DONE, Cache
from dealib.cases.job import Ended, Job
from dealib.config.schema import Config
from dealib.study.plan import Plan, Planned


@dataclass(frozen=True)
class CaseStatus:
    """Where a case stands.

    Attributes:
        case: The case.
        status: 'done', 'not converged', 'failed', 'crashed', 'damaged' or 'missing'.
        error: What went wrong.
    """

    case: Planned
    status: str
    error: str = ""


def missing(plans: Sequence[Plan], cache: Cache, retry: bool = False) -> list[Job]:
    """The jobs that remain: one a key, those that did not converge only if told.

    Args:
        plans: The studies.
        cache: Where solved cases are.
        retry: Solve again what did not converge.
    """
    jobs: dict[str, Job] = {}
    for plan in plans:
        for case in plan.cases:
            if not isinstance(case.work, Config) or case.key in jobs:
                continue
            if not cache.settled(case.key, retry):
                label = f"{plan.study.name}: {case.label}"
                given = (case.base, case.overrides, cache.folder)
                jobs[case.key] = Job(label, case.key, *given, work=case.solve)
    return list(jobs.values())


def standing(case: Planned, cache: Cache, ended: Mapping[str, Ended]) -> CaseStatus:
    """Where a case stands now.

    Args:
        case: The case.
        cache: Where solved cases are.
        ended: What has ended just now without being done, by key.
    """
    if not isinstance(case.work, Config):
        return CaseStatus(case, DONE)
    if case.key in ended:
        return CaseStatus(case, ended[case.key].status, ended[case.key].error)
    return CaseStatus(case, *cache.standing(case.key))


def statuses(plan: Plan, cache: Cache, ended: Mapping[str, Ended]) -> list[CaseStatus]:
    """Where each case of a study stands now (see `standing`)."""
    return [standing(case, cache, ended) for case in plan.cases]
