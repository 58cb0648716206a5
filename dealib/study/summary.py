"""`summary.csv` of a sweep: one row for each case, written again after each case that ends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from dealib.cases.cache import Cache
from dealib.cases.job import Ended
from dealib.files import write_text
from dealib.study.evaluate import Results
from dealib.study.plan import Plan, Planned
from dealib.study.sweep import status


class Summary:
    """The table of all cases of some studies.

    Args:
        plans: The studies.
        cache: Folder of solved cases.
        path: The file.
    """

    def __init__(self, plans: Sequence[Plan], cache: Cache, path: Path) -> None:
        self.plans, self.cache, self.path = plans, cache, path
        self.rows: dict[tuple[str, str], dict[str, Any]] = {}
        for plan in plans:
            for case in plan.cases:
                self._set(plan, case)

    def update(self, ended: Ended) -> None:
        """Enter a job that has ended, and write the file."""
        for plan in self.plans:
            for case in plan.cases:
                if case.key == ended.job.key:
                    self._set(plan, case, ended)["seconds"] = ended.seconds
        self.write()

    def _set(self, plan: Plan, case: Planned, ended: Ended | None = None) -> dict[str, Any]:
        failed = {} if ended is None else {ended.job.key: ended}
        results = Results(plan, self.cache, [status(case, self.cache, failed)])
        row: dict[str, Any] = dict(results.table.iloc[0])
        self.rows[plan.study.name, case.label] = row
        return row

    def write(self) -> None:
        """Write the file."""
        write_text(self.path, pd.DataFrame(list(self.rows.values())).to_csv(index=False))
