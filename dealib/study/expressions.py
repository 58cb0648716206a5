"""Expressions of a study: arithmetic over named arrays and a fixed vocabulary of functions.

The text is parsed and never executed. It may contain numbers, names, texts, + - * / ** and calls of
functions of the scope.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.errors import did_you_mean

_LONGEST = 500  # characters; limits the depth of the parser's recursion
_EXPONENT = 64  # largest exponent; 9 ** 9 ** 9 would take forever


def _power(base: Any, exponent: Any) -> Any:
    if np.abs(exponent).max(initial=0.0) > _EXPONENT:
        raise ArithmeticError(f"an exponent is beyond {_EXPONENT}")
    return base**exponent


_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: _power,
}

_OF_ENDS = ("abs", "sqrt", "exp", "log", "end", "start", "setting")  # see `Expression.ends_only`

Function = Callable[..., Any]


@dataclass(frozen=True)
class Signature:
    """A function of the scope.

    Attributes:
        arguments: Kinds of its arguments, which `KINDS` explains.
        meaning: Its value, for the reference page.
    """

    arguments: tuple[str, ...]
    meaning: str


KINDS = {
    "values": "an expression: columns of the history, or in a table of cases, quantities",
    "number": "a number",
    "stage": "name of a stage",
    "key": "dotted key of the config, such as `geometry.film_thickness` or `program.1.duration`",
    "timing": "name of a part in `timings` of run.json, such as `solve`",
    "field": "name of a field, such as `S_RR`, `E` or `phi`, as in `dealib plot --field`, "
    "but in mm, kV, MV/m, C/m², MPa",
    "profile": "a field, or `D_n` (charge density on the film's face, C/m²), or `length` (mm)",
    "region": "`film`, `top_electrode`, `bottom_electrode`, `air`, `mount_block`, `frame_block`",
    "along": "from 0, the inner end, to 1, the outer end",
    "across": "from 0, the bottom, to 1, the top",
    "case": "label of a case",
}
# name -> function of one argument, and its meaning
COMMON: dict[str, tuple[Function, str]] = {
    "abs": (np.abs, "absolute values"),
    "sqrt": (np.sqrt, "square roots"),
    "exp": (np.exp, "exponentials"),
    "log": (np.log, "natural logarithms"),
    "min": (np.min, "the smallest value"),
    "max": (np.max, "the largest value"),
    "mean": (np.mean, "the mean value"),
    "sum": (np.sum, "the sum"),
    "diff": (np.diff, "differences of neighbours"),
    "first": (lambda x: np.atleast_1d(x)[0], "the first value"),
    "last": (lambda x: np.atleast_1d(x)[-1], "the last value"),
}
_SETTING = Signature(("key",), "a number of the config, in mm, s, N, kg, MPa, kV, uC")
# functions over a history (see `dealib.study.rows`)
OF_A_HISTORY = {
    "end": Signature(("values", "stage"), "the value at the end of a stage"),
    "start": Signature(("values", "stage"), "the value at the start of a stage"),
    "during": Signature(("values", "stage"), "the values from the start of a stage to its end"),
    "at": Signature(
        ("values", "values", "number"),
        "the value of the first argument where the second one first reaches the number",
    ),
    "stroke": Signature(
        ("stage",), "the displacement of the (first) mount under voltage in a stage, mm"
    ),
    "setting": _SETTING,
}
# functions over a solved case (see `dealib.study.outcome`)
OF_A_CASE = {
    **OF_A_HISTORY,
    "timing": Signature(("timing",), "time that a part of the run took, s; see run.json"),
    "field": Signature(
        ("profile", "region", "along", "across", "stage"),
        "a field at a point, at the end of a stage",
    ),
    "along": Signature(
        ("profile", "region", "across", "stage"), "values of a field at the nodes along a region"
    ),
    "across": Signature(
        ("field", "region", "along", "stage"),
        "41 values of a field through the thickness of a region",
    ),
}
# functions over the table of all cases (see `dealib.study.evaluate`)
OF_ALL_CASES = {
    "of": Signature(("values", "case"), "the value of one case, by its label"),
    "setting": _SETTING,
}


def _name(node: ast.AST) -> str | None:
    """A name such as 'force_N', or 'force_N.plate' of a port; None if a node is not a name."""
    if isinstance(node, ast.Attribute) and (of := _name(node.value)) is not None:
        return f"{of}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else None


class _Inliner(ast.NodeTransformer):
    """Replaces names by expressions."""

    def __init__(self, known: Mapping[str, str]) -> None:
        self._known = known

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return _parsed(self._known[node.id]) if node.id in self._known else node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        return node  # a column of a port, such as force_N.plate

    def visit_Call(self, node: ast.Call) -> ast.AST:
        node.args = [self.visit(argument) for argument in node.args]
        return node


def inlined(text: str, known: Mapping[str, str]) -> str:
    """Replace names in an expression by expressions.

    Args:
        text: The expression.
        known: Expressions by name.

    Raises:
        ValueError: If a text is not an expression.
    """
    return ast.unparse(_Inliner(known).visit(_parsed(text)))


def _parsed(text: str) -> ast.expr:
    if len(text) > _LONGEST:
        raise ValueError(f"an expression has at most {_LONGEST} characters")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError):
        raise ValueError(f"{text!r} is not an arithmetic expression") from None


class Expression:
    """A parsed expression.

    Args:
        text: The text of the user.
        extra: Functions of the scope besides the common ones.

    Attributes:
        names: The names that it reads.
        calls: The functions of `extra` that it calls, with their arguments; None stands for an
            argument that is known only when it is evaluated.
        ends_only: Whether it needs only the states at the ends of stages, if its value is a number.

    Raises:
        ValueError: If it contains anything else, or calls an unknown function.
    """

    def __init__(self, text: str, extra: Mapping[str, Signature]) -> None:
        self.text = text
        self._tree = _parsed(text)
        self._extra = dict(extra)
        self.calls: list[tuple[str, tuple[Any, ...]]] = []
        self.ends_only = True
        self.names = self._check(self._tree)

    def _check(self, node: ast.AST) -> frozenset[str]:
        """The names that an expression reads; raises ValueError if it is not allowed."""
        if isinstance(node, ast.Constant) and type(node.value) in (int, float, str):
            return frozenset()
        if (name := _name(node)) is not None:
            return frozenset({name})
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            return self._check(node.operand)
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            return self._check(node.left) | self._check(node.right)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            self._check_call(node.func.id, len(node.args))
            found = frozenset[str]().union(*(self._check(a) for a in node.args))
            if node.func.id in self._extra:
                self.calls.append((node.func.id, tuple(map(self._literal, node.args))))
            return found
        part = ast.get_source_segment(self.text.strip(), node) or self.text
        raise ValueError(f"{part!r}: only numbers, names, + - * / ** and functions are allowed")

    def _check_call(self, name: str, given: int) -> None:
        self.ends_only &= name in _OF_ENDS
        if name in COMMON:
            needed = 1
        elif name in self._extra:
            needed = len(self._extra[name].arguments)
        else:
            raise ValueError(f"unknown function {name!r}{did_you_mean(name, self.functions)}")
        if given != needed:
            raise ValueError(f"{name}() takes {needed} argument{'s' * (needed > 1)}, not {given}")

    def _literal(self, node: ast.AST) -> Any:
        """Value of an argument without names; None if it has names."""
        try:
            return self._value(node, {}, {})
        except (ValueError, TypeError, ArithmeticError, KeyError, IndexError):
            return None

    @property
    def may_lack(self) -> bool:
        """Whether it may have no value, since `at` has none if its number is not reached."""
        return any(name == "at" for name, _ in self.calls)

    def finite(self, value: float) -> float:
        """Return a value of this expression if it is finite.

        Raises:
            ValueError: If it is infinite or NaN.
        """
        if not np.isfinite(value):
            kind = "infinite" if np.isinf(value) else "undefined"
            raise ValueError(f"{self.text!r} is {kind}")
        return value

    def constant(self) -> float | None:
        """Its value if it is the same for all cases; otherwise None."""
        known = not self.names and not self.calls
        return float(self({}, {})) if known else None

    @property
    def functions(self) -> list[str]:
        """Names of all functions that may be called."""
        return [*COMMON, *self._extra]

    def __call__(self, names: Mapping[str, Any], functions: Mapping[str, Function]) -> Any:
        """Evaluate.

        Args:
            names: Values by name, mostly arrays.
            functions: The functions of the scope, by name.

        Raises:
            ValueError: If a name is unknown or the arithmetic fails.
        """
        try:
            with np.errstate(all="ignore"):
                return self._value(self._tree, names, functions)
        except (TypeError, ArithmeticError, IndexError) as error:
            raise ValueError(f"{self.text!r}: {error}") from None

    def _value(self, node: Any, names: Mapping[str, Any], functions: Mapping[str, Function]) -> Any:
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else float(node.value)  # type: ignore[arg-type]
        if (known := _name(node)) is not None:
            if known not in names:
                raise ValueError(f"unknown name {known!r}{did_you_mean(known, list(names))}")
            return names[known]
        if isinstance(node, ast.UnaryOp):
            value = self._value(node.operand, names, functions)
            return -value if isinstance(node.op, ast.USub) else +value
        if isinstance(node, ast.BinOp):
            left, right = (self._value(n, names, functions) for n in (node.left, node.right))
            return _BINARY[type(node.op)](np.asarray(left, float), np.asarray(right, float))
        name = node.func.id
        function = COMMON[name][0] if name in COMMON else functions[name]
        return function(*(self._value(a, names, functions) for a in node.args))
