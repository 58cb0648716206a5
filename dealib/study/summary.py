"""`summary.csv` of a sweep: one row a case, rewritten whole as cases end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from dealib.results.store import write_text
from dealib.study.cache import Cache
from dealib.study.evaluate import Results
from dealib.study.job import Outcome
from dealib.study.plan import Plan
from dealib.study.sweep import CaseStatus, statuses


class Summary:
    """The table of all cases of some studies.

    Args:
        plans: The studies.
        cache: Where solved cases are.
        path: The file.
    """

    def __init__(self, plans: Sequence[Plan], cache: Cache, path: Path) -> None:
        self.plans, self.cache, self.path = plans, cache, path
        path.parent.mkdir(parents=True, exist_ok=True)
        self.rows: dict[tuple[str, str], dict[str, Any]] = {}
        for plan in plans:
            for status in statuses(plan, cache, {}):
                self._set(plan, status)

    def update(self, outcome: Outcome) -> None:
        """Enter what has just ended, and write the file."""
        for plan in self.plans:
            for status in statuses(plan, self.cache, {outcome.job.key: outcome}):
                if status.case.key == outcome.job.key:
                    self._set(plan, status)
                    self.rows[plan.study.name, status.case.label]["seconds"] = outcome.seconds
        self.write()

    def _set(self, plan: Plan, status: CaseStatus) -> None:
        results = Results(plan, self.cache, [status])
        self.rows[plan.study.name, status.case.label] = dict(results.table.iloc[0])

    def write(self) -> None:
        """Write the file."""
        write_text(self.path, pd.DataFrame(list(self.rows.values())).to_csv(index=False))
