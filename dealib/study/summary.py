"""`summary.csv` of a sweep: one row for each case, written again after each case that ends."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from dealib.cases.cache import DONE, FAILED, Cache
from dealib.cases.job import Ended
from dealib.files import write_text
from dealib.study.evaluate import Results
from dealib.study.plan import Planned, StudyPlan
from dealib.study.sweep import CaseStatus, status


class Summary:
    """The table of all cases of some studies.

    Args:
        plans: The studies.
        cache: Folder of solved cases.
        path: The file.
    """

    def __init__(self, plans: Sequence[StudyPlan], cache: Cache, path: Path) -> None:
        self.plans, self.cache, self.path = plans, cache, path

    @cached_property
    def rows(self) -> dict[tuple[str, str], dict[str, Any]]:
        """The rows by study and case, read once the workers have started."""
        return {(p.study.name, c.label): self._row(p, c) for p in self.plans for c in p.cases}

    def update(self, ended: Ended) -> None:
        """Enter a job that has ended, and write the file."""
        for plan in self.plans:
            for case in plan.cases:
                if case.key == ended.job.key:
                    row = self._row(plan, case, ended) | {"seconds": ended.seconds}
                    self.rows[plan.study.name, case.label] = row
        self.write()

    def _row(self, plan: StudyPlan, case: Planned, ended: Ended | None = None) -> dict[str, Any]:
        failed = {} if ended is None else {ended.job.key: ended}
        found = status(case, self.cache, failed)
        if ended is None and found.status not in (DONE, FAILED):  # a worker may be solving it
            found = CaseStatus(case, "missing")
        results = Results(plan, self.cache, [found])
        return dict(results.table.iloc[0])

    def write(self) -> None:
        """Write the file."""
        import pandas as pd

        write_text(self.path, pd.DataFrame(list(self.rows.values())).to_csv(index=False))
