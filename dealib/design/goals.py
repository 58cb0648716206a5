"""Objectives and limits of a design, by quantities that every evaluation computes."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

from dealib.design.plan import DesignPlan
from dealib.errors import Place
from dealib.study.expressions import OF_A_HISTORY, Expression

_SIGNS = {ast.LtE: 1, ast.Lt: 1, ast.GtE: -1, ast.Gt: -1}


@dataclass(frozen=True)
class Aim:
    """An objective.

    Attributes:
        name: Name of its quantity.
        sign: 1 to minimise it, -1 to maximise it.
    """

    name: str
    sign: int


@dataclass(frozen=True)
class Limit:
    """A limit of a quantity.

    Attributes:
        text: The text in the file.
        name: Name of its quantity.
        sign: 1 for an upper limit, -1 for a lower one.
        bound: The limiting value.
    """

    text: str
    name: str
    sign: int
    bound: float

    def slack(self, values: Mapping[str, float]) -> float:
        """Distance of the quantity from the limit; negative beyond it."""
        return self.sign * (self.bound - values[self.name])


@dataclass(frozen=True)
class Goals:
    """Objectives and limits of a design.

    Attributes:
        asked: Quantities to evaluate, as expressions by name.
        aims: The objectives.
        limits: The limits.
    """

    asked: dict[str, str]
    aims: tuple[Aim, ...]
    limits: tuple[Limit, ...]

    def slack(self, values: Mapping[str, float]) -> float:
        """The smallest slack of all limits."""
        return min((limit.slack(values) for limit in self.limits), default=0.0)


def goals(plan: DesignPlan, searched: bool = True) -> Goals:
    """The goals of a design.

    Args:
        plan: The design.
        searched: Whether an optimum is searched for, which needs objectives, and bounds instead
            of distributions.

    Raises:
        ConfigError: If a goal is wrong, with its place in the file.
    """
    design, asked = plan.design, dict(plan.quantities)

    def ask(text: str, where: Place) -> str:
        """Name of the quantity of an expression, which is added to `asked`."""
        if text not in asked:
            asked[text] = plan.expression(text, where)
        return text

    def given(key: str) -> list[tuple[Place, str]]:
        """Place and text of the values of a key, which may be one or a list."""
        listed = isinstance(plan.source.tree.get(key), list)
        return [((key, k) if listed else (key,), x) for k, x in enumerate(getattr(design, key))]

    aims = [
        Aim(ask(text.strip(), where), sign)
        for key, sign in (("maximise", -1), ("minimise", 1))
        for where, text in given(key)
    ]
    for name, variable in design.variables.items() if searched else ():
        if variable.scatters:
            said = "a distribution is for `dealib uncertainty`; give min and max, or choices"
            raise plan.fault(("variables", name), said, "key")
    if searched and not 1 <= len(aims) <= 2:
        raise plan.fault(
            ("maximise",) if design.maximise else (),
            "one or two objectives are needed, in maximise and minimise",
        )
    limits: list[Limit] = []
    for here, text in given("subject_to"):
        for left, sign, right in _comparisons(plan, text, here):
            low, high = (_constant(plan, side, here) for side in (left, right))
            if low is not None and high is not None:
                raise plan.fault(here, f"{text!r} compares constants; name a quantity")
            if high is not None:
                limits.append(Limit(text, ask(left, here), sign, high))
            elif low is not None:
                limits.append(Limit(text, ask(right, here), -sign, low))
            else:
                limits.append(Limit(text, ask(f"{left} - ({right})", here), sign, 0.0))
    return Goals(asked, tuple(aims), tuple(limits))


def _comparisons(plan: DesignPlan, text: str, where: Place) -> list[tuple[str, int, str]]:
    """Left side, sign and right side of each comparison; the sign is 1 for <=, -1 for >=."""
    try:
        node = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError):
        node = None
    if not (isinstance(node, ast.Compare) and {type(op) for op in node.ops} <= _SIGNS.keys()):
        example = "'used <= 0.8' or '0 <= max(force_N) <= 2'"
        raise plan.fault(where, f"{text!r} is not an inequality such as {example}")
    sides = [ast.unparse(side) for side in (node.left, *node.comparators)]
    signs = [_SIGNS[type(op)] for op in node.ops]
    return list(zip(sides[:-1], signs, sides[1:], strict=True))


def _constant(plan: DesignPlan, text: str, where: Place) -> float | None:
    """Value of an expression that is equal for all designs; None for other expressions."""
    found = Expression(plan.expression(text, where), OF_A_HISTORY)
    try:
        return found.constant()
    except ValueError as error:
        raise plan.fault(where, str(error)) from None
