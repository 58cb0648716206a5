"""Checks of a study's expressions against its configs, before a case is solved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dealib.config.schema import Config
from dealib.device.kinematics import AXISYMMETRIC
from dealib.errors import Place, did_you_mean
from dealib.observe import columns as history
from dealib.results.quantities import quantities as local_fields
from dealib.study import sample
from dealib.study.expressions import OF_A_CASE, OF_A_HISTORY, OF_ALL_CASES, Expression, Signature
from dealib.study.schema import Contour, Curves, MaterialTest, Points, Shapes, Where

if TYPE_CHECKING:
    from dealib.study.plan import Planned, StudyPlan

Work = Config | MaterialTest


def check(plan: StudyPlan) -> None:
    """Check that the cases of a study will have all that its expressions use.

    Raises:
        ConfigError: With the place in the study's file.
    """
    for where, text, functions, cases in _expressions(plan):
        try:
            expression = Expression(text, functions)
            if functions is OF_ALL_CASES:
                _check_quantities(expression, plan.study.quantities)
            _check(expression, functions, cases)
        except ValueError as error:
            raise plan.fault(where, str(error)) from None
    for i, panel in enumerate(plan.study.panels):
        _check_labels(plan, ("panels", i), panel.where)
        count = len(plan.chosen(panel.where))
        if isinstance(panel, (Contour, Shapes)) and count != 1:
            raise plan.fault(("panels", i), f"'where' must choose one case, not {count}")
        if not isinstance(panel, Contour):
            continue
        for key in ("field", "stage"):
            try:
                for case in plan.chosen(panel.where):
                    _argument(key, getattr(panel, key), case.work, ())
            except ValueError as error:
                raise plan.fault(("panels", i, key), str(error)) from None
    for i, window in enumerate(plan.study.windows):
        _check_labels(plan, ("windows", i), window.where)


def _check_labels(plan: StudyPlan, part: Place, where: Where) -> None:
    """Raise `ConfigError` if a selection names a label that its axis does not have."""
    for axis, given in where.items():
        known = list(dict.fromkeys(case.axes[axis] for case in plan.cases))
        for label in (given,) if isinstance(given, str) else given:
            if label not in known:
                problem = f"there is no {label!r} on this axis{did_you_mean(label, known)}"
                raise plan.fault((*part, "where", axis), problem)


Found = tuple[Place, str, Mapping[str, Signature], "list[Planned]"]


def _expressions(plan: StudyPlan) -> Iterable[Found]:
    """Place, text, functions and cases of each expression."""
    study = plan.study
    for name, text in study.quantities.items():
        yield ("quantities", name), text, OF_A_CASE, list(plan.cases)
    for i, panel in enumerate(study.panels):
        if isinstance(panel, (Curves, Points)):
            functions = OF_A_CASE if isinstance(panel, Curves) else OF_ALL_CASES
            for key, axis in (("x", panel.x), ("y", panel.y)):
                where = ("panels", i, key, "value")
                yield where, axis.value, functions, plan.chosen(panel.where)
    for i, window in enumerate(study.windows):
        yield ("windows", i, "value"), window.value, OF_ALL_CASES, plan.chosen(window.where)
    for text in study.inserts():
        yield ("comparison",), text, OF_ALL_CASES, list(plan.cases)


def _check_quantities(expression: Expression, known: Mapping[str, str]) -> None:
    for name in sorted(expression.names - {*known}):
        hint = did_you_mean(name, known)
        raise ValueError(f"{expression.text!r}: no quantity named {name}{hint}")


def _check(
    expression: Expression, functions: Mapping[str, Signature], cases: Sequence[Planned]
) -> None:
    labels = [case.label for case in cases]
    if (value := expression.constant()) is not None:
        expression.finite(value)
    for case in cases:
        known = columns(case.work)
        for name in sorted(expression.names) if functions is OF_A_CASE else ():
            if name in stages(case.work):
                raise ValueError(f"{name!r} is a stage; put it in double quotes")
            if name not in known and not case.table:
                raise ValueError(f"unknown name {name!r}{did_you_mean(name, known)}")
        for function, arguments in expression.calls:
            for kind, value in zip(functions[function].arguments, arguments, strict=True):
                if value is not None:
                    _argument(kind, value, case.work, labels)
            here = "region" in functions[function].arguments
            if here and isinstance(case.work, Config):
                sample.check(case.work, *map(str, arguments[:2]))


def _argument(kind: str, value: Any, work: Work, labels: Sequence[str]) -> None:
    """Raise `ValueError` if an argument of a function is wrong, as far as that is known."""
    if kind in ("along", "across"):
        sample.fraction(kind, value)
    elif kind == "key":
        setting(work, str(value))
    space = work.device.kinematics if isinstance(work, Config) else AXISYMMETRIC
    known = {
        "field": list(local_fields(space)),
        "profile": sample.fields(space),
        "region": regions(work),
        "stage": stages(work),
        "case": labels,
    }.get(kind)
    if kind == "stage" and stages(work).count(value) > 1:
        raise ValueError(f"several stages are named {value!r}; give each a name of its own")
    if known is not None and value not in known:
        what = "field" if kind == "profile" else kind
        raise ValueError(f"there is no {what} {value!r}{did_you_mean(value, known)}")


def traced(column: str) -> bool:
    """Whether a column of a history sums over its states, such as a work."""
    return column.partition(".")[0].endswith(("work_mJ", "residual_mJ"))


def of_the_state(config: Config) -> list[str]:
    """Columns of a config's history that are functions of the state alone."""
    found = (column.name for column in history.measured(config))
    return [name for name in found if name not in ("newton_iterations", "step")]


def of_history(text: str, config: Config, others: Iterable[str] = ()) -> Expression:
    """Parse an expression over the history of a config, without fields and timings.

    Args:
        text: The expression.
        config: The config.
        others: Further names that a message may propose.

    Raises:
        ValueError: If it uses an unknown name, function, stage or key.
    """
    there = [name for name in history.columns(config) if traced(name)]
    there = [*others, "time_s", *of_the_state(config), *there]
    found = Expression(text, OF_A_HISTORY)
    for name in sorted(found.names - {*there}):
        raise ValueError(f"unknown name {name!r}{did_you_mean(name, there)}")
    for name, given in found.calls:
        for kind, value in zip(OF_A_HISTORY[name].arguments, given, strict=True):
            if kind == "stage" or (kind == "key" and value is not None):
                _argument(kind, value, config, ())
    return found


def columns(work: Work) -> list[str]:
    """Names that an expression over one case may use."""
    if not isinstance(work, Config):
        return ["stretch", "strain", "stress_MPa"]
    return list(history.columns(work))


def stages(work: Work) -> list[str]:
    """Names of the stages in the results; every run begins with the stage `prestrain`."""
    if not isinstance(work, Config):
        return [work.mode]
    given = [stage.stage for stage in work.program]
    return given if given[0] == "prestrain" else ["prestrain", *given]


def regions(work: Work) -> list[str]:
    """Names of the regions of the mesh."""
    if not isinstance(work, Config):
        return []
    return [region.name for region in work.device.regions]


def setting(work: Work, path: str) -> float:
    """A number of the config, in internal units.

    Args:
        work: The config or the material test.
        path: Dotted key; items of lists are counted from 0.

    Raises:
        ValueError: If there is no such number.
    """
    node: Any = work
    for part in path.split("."):
        try:
            node = node[int(part)] if part.isdigit() else getattr(node, part)
        except (AttributeError, IndexError, TypeError):
            raise ValueError(f"the config has no {path!r}") from None
    if isinstance(node, tuple) and len(node) == 1:
        node = node[0]
    if isinstance(node, bool) or not isinstance(node, (int, float)):
        raise ValueError(f"{path!r} is not a number")
    return float(node)
