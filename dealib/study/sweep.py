"""The status of the cases of studies, and the jobs of those that are missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dealib.cases.cache import DONE, Cache
from dealib.cases.job import Ended, Job
from dealib.config.schema import Config
from dealib.study.plan import Planned, StudyPlan


@dataclass(frozen=True)
class CaseStatus:
    """The status of a case.

    Attributes:
        case: The case.
        status: 'done', 'not converged', 'failed', 'crashed', 'damaged' or 'missing'.
        error: What went wrong; empty if nothing did.
    """

    case: Planned
    status: str
    error: str = ""


def missing(plans: Sequence[StudyPlan], cache: Cache, retry: bool = False) -> list[Job]:
    """The jobs of cases that are not solved, one for each key.

    Args:
        plans: The studies.
        cache: Folder of solved cases.
        retry: Solve cases again that did not converge.
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


def status(case: Planned, cache: Cache, ended: Mapping[str, Ended]) -> CaseStatus:
    """The present status of a case.

    Args:
        case: The case.
        cache: Folder of solved cases.
        ended: Jobs that have just failed, by key.
    """
    if not isinstance(case.work, Config):
        return CaseStatus(case, DONE)
    if case.key in ended:
        return CaseStatus(case, ended[case.key].status, ended[case.key].error)
    return CaseStatus(case, *cache.status(case.key))


def statuses(plan: StudyPlan, cache: Cache, ended: Mapping[str, Ended]) -> list[CaseStatus]:
    """The present status of each case of a study; arguments are those of `status`."""
    return [status(case, cache, ended) for case in plan.cases]
