"""Results of a study: the table of its cases, its curves, windows and sentence of comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dealib.arrays import Array
from dealib.cases.cache import DONE, FAILED, Cache
from dealib.config.schema import Config
from dealib.errors import ConfigError, Place, did_you_mean
from dealib.study.expressions import OF_A_CASE, OF_ALL_CASES, Expression
from dealib.study.outcome import Outcome
from dealib.study.plan import StudyPlan, fill, selected
from dealib.study.schema import INSERT, Curves, Points, Where
from dealib.study.scope import setting
from dealib.study.sweep import CaseStatus
from dealib.study.windows import Verdict, axis_window, between, judge

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Curve:
    """A labelled curve.

    Attributes:
        label: Label in the legend.
        x: Abscissae, (n,).
        y: Ordinates, (n,).
    """

    label: str
    x: Array
    y: Array

    def __post_init__(self) -> None:
        """Raise ValueError if x and y differ in their number of values."""
        if self.x.shape != self.y.shape:
            raise ValueError(f"x has {self.x.size} values, y has {self.y.size}")


class Results:
    """A study with the results of its cases.

    Attributes:
        values: Values of each quantity, (cases,), by name; NaN where a case has none.
        outcomes: Results of solved cases and of partly solved ones, by label.

    Args:
        plan: The study.
        cache: Folder of the solved cases.
        statuses: Status of each case.

    Raises:
        ConfigError: If an expression needs something that the results do not have.
    """

    def __init__(self, plan: StudyPlan, cache: Cache, statuses: Sequence[CaseStatus]) -> None:
        self.plan, self.study, self.statuses = plan, plan.study, tuple(statuses)
        self.cache = cache
        self.outcomes: dict[str, Outcome] = {}
        self._faults: dict[Place, list[str]] = {}
        for s in statuses:
            if not isinstance(s.case.work, Config):
                self.outcomes[s.case.label] = Outcome(s.case, None)
            elif s.status in (DONE, FAILED):
                self.outcomes[s.case.label] = Outcome(s.case, cache.run(s.case.key))
        self.values = {name: self._quantity(name) for name in self.study.quantities}

    def __repr__(self) -> str:
        return f"<Results {self.study.name}: {len(self.statuses)} cases>"

    def _quantity(self, name: str) -> Array:
        """One number for each case; NaN if the case is not solved, or has no such value."""
        values = np.full(len(self.statuses), np.nan)
        known = Expression(self.study.quantities[name], OF_A_CASE)
        for i, s in enumerate(self.statuses):
            if s.status != DONE:
                continue
            try:
                found = _one(self.outcomes[s.case.label].evaluate(known))
                values[i] = found if np.isnan(found) and known.may_lack else known.finite(found)
            except (ValueError, ConfigError) as error:
                self._fault(("quantities", name), s.case.label, error)
        return values

    def _fault(self, where: Place, label: str, error: Exception) -> None:
        self._faults.setdefault(where, []).append(f"case {label!r}: {error}")

    @property
    def faults(self) -> list[str]:
        """A message for each expression that gives no number."""
        found = []
        for where, (first, *others) in self._faults.items():
            more = f" (and {len(others)} more)" if others else ""
            found.append(str(self.plan.fault(where, first + more)))
        return found

    # --- the table -------------------------------------------------------------------------------

    @property
    def table(self) -> pandas.DataFrame:
        """One row for each case: axes, status, quantities, early end, directory and error."""
        import pandas as pd

        rows = []
        for i, s in enumerate(self.statuses):
            is_run = isinstance(s.case.work, Config)
            row: dict[str, Any] = {"study": self.study.name, "case": s.case.label, **s.case.axes}
            row |= {"status": s.status, **{n: v[i] for n, v in self.values.items()}}
            outcome = self.outcomes.get(s.case.label)
            row["ended_by"] = "" if outcome is None else outcome.ended_by
            row |= {"run": self.cache.folder / s.case.key if is_run else "", "error": s.error}
            rows.append(row)
        return pd.DataFrame(rows)

    def where(self, where: Where) -> list[int]:
        """Indices of the selected cases."""
        return [i for i, s in enumerate(self.statuses) if selected(s.case, where)]

    def over(self, text: str, rows: Sequence[int], solved: bool = False) -> Any:
        """Value of an expression over the quantities of some cases.

        Args:
            text: The expression.
            rows: Indices of the cases.
            solved: Whether only solved cases count.

        Raises:
            ValueError: If a case does not exist.
        """
        labels = [self.statuses[i].case.label for i in rows]
        over = [i for i in rows if not solved or self.statuses[i].status == DONE]
        chosen = {name: values[over] for name, values in self.values.items()}

        def of(values: Array, label: str) -> float:
            if label not in labels:
                raise ValueError(f"no case {label!r}{did_you_mean(label, labels)}")
            at = rows[labels.index(label)]
            return float(values[over.index(at)]) if at in over else float("nan")

        def settings(path: str) -> Array:
            return np.array([setting(self.statuses[i].case.work, path) for i in over])

        found = Expression(text, OF_ALL_CASES)(chosen, {"of": of, "setting": settings})
        if np.isinf(found).any():
            raise ValueError(f"{text!r} is infinite")
        return found

    @property
    def windows(self) -> list[Verdict]:
        """The windows of the study, and those of its axes with limits."""
        found = []
        for i, window in enumerate(self.study.windows):
            try:
                values = np.atleast_1d(self.over(window.value, self.where(window.where)))
            except ValueError as error:
                raise self.plan.fault(("windows", i, "value"), str(error)) from None
            found.append(judge(window, values.astype(float)))
        for i, panel in enumerate(self.study.panels):
            if not isinstance(panel, (Curves, Points)):
                continue
            curves = self.curves(i)  # those without limits too, since their faults are told
            if panel.y.limits is not None:
                window = axis_window(panel.title, panel.y, self.study.source)
                inside = [between(c.x, c.y, panel.x.limits) for c in curves]
                found.append(judge(window, np.concatenate([np.empty(0), *inside])))
        return found

    # --- curves ----------------------------------------------------------------------------------

    def curves(self, index: int) -> list[Curve]:
        """The curves of a panel.

        Raises:
            ConfigError: If an expression fails.
        """
        panel = self.study.panels[index]
        rows = self.where(panel.where)
        try:
            if isinstance(panel, Points):
                return self._points(panel, rows)
            assert isinstance(panel, Curves)
            return [c for row in rows if (c := self._curve(index, panel, row)) is not None]
        except ValueError as error:
            raise self.plan.fault(("panels", index), str(error)) from None

    def _curve(self, index: int, panel: Curves, row: int) -> Curve | None:
        status = self.statuses[row]
        outcome = self.outcomes.get(status.case.label)
        if outcome is None:
            return None
        try:
            x, y = (
                np.atleast_1d(outcome.evaluate(Expression(a.value, OF_A_CASE)))
                for a in (panel.x, panel.y)
            )
        except (ValueError, ConfigError):
            if status.status == DONE:
                raise
            return None
        if status.status == DONE and not (np.isfinite(x).any() and np.isfinite(y).any()):
            error = ValueError(f"no value of {panel.x.value!r} or of {panel.y.value!r} is finite")
            self._fault(("panels", index), status.case.label, error)
            return None
        label = fill(panel.label, status.case.axes) if panel.label else status.case.label
        return Curve(label, x, y)

    def _points(self, panel: Points, rows: list[int]) -> list[Curve]:
        groups: dict[str, list[int]] = {}
        for row in rows:
            axes = self.statuses[row].case.axes
            groups.setdefault(axes[panel.group] if panel.group else "", []).append(row)
        return [
            Curve(
                label,
                np.atleast_1d(self.over(panel.x.value, rows)),
                np.atleast_1d(self.over(panel.y.value, rows)),
            )
            for label, rows in groups.items()
        ]

    def chosen(self, index: int) -> Outcome | None:
        """The case of a panel that shows fields; None if it is not solved."""
        (row,) = self.where(self.study.panels[index].where)
        status = self.statuses[row]
        return self.outcomes[status.case.label] if status.status == DONE else None

    # --- words -----------------------------------------------------------------------------------

    @property
    def comparison(self) -> str:
        """The sentence with its numbers, over the solved cases; it tells if some are not solved."""
        everything = range(len(self.statuses))
        solved = sum(s.status == DONE for s in self.statuses)
        if not self.study.comparison or not solved:
            return "No case is solved." if self.study.comparison else ""
        some = "" if solved == len(everything) else f" ({solved} of {len(everything)} cases.)"

        def insert(match: Any) -> str:
            try:
                return format(_one(self.over(match[1], everything, solved=True)), match[2] or ".4g")
            except (ValueError, TypeError) as error:
                raise self.plan.fault(("comparison",), f"{match[0]}: {error}") from None

        return INSERT.sub(insert, self.study.comparison) + some


def _one(value: Any) -> float:
    """A value that must be one number."""
    found = np.asarray(value, float)
    if found.size != 1:
        raise ValueError(f"this gives {found.size} numbers, not one")
    return float(found.reshape(()))
