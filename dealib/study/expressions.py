"""Expressions of a study: arithmetic over named arrays and a fixed vocabulary of functions.

The text is parsed, never executed: numbers, names, texts, + - * / ** and calls of the functions
that the scope offers are all there is.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dealib.config.source import did_you_mean

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_LONGEST = 500  # characters; keeps the parser's recursion shallow

Function = Callable[..., Any]
# name -> (function, smallest and largest number of arguments)
COMMON: dict[str, tuple[Function, int, int]] = {
    "abs": (np.abs, 1, 1),
    "sqrt": (np.sqrt, 1, 1),
    "exp": (np.exp, 1, 1),
    "log": (np.log, 1, 1),
    "min": (np.min, 1, 1),
    "max": (np.max, 1, 1),
    "mean": (np.mean, 1, 1),
    "sum": (np.sum, 1, 1),
    "diff": (np.diff, 1, 1),
    "first": (lambda x: np.atleast_1d(x)[0], 1, 1),
    "last": (lambda x: np.atleast_1d(x)[-1], 1, 1),
}
# functions that a case offers on top (see `dealib.study.outcome`)
OF_A_CASE = {
    "end": 2,  # end(x, "stage"): x at the end of a stage
    "start": 2,  # start(x, "stage"): x where a stage begins
    "during": 2,  # during(x, "stage"): x from there to its end
    "at": 3,  # at(x, y, 2): x where y first reaches 2
    "setting": 1,  # setting("geometry.film_thickness"): number of the config, in mm, N, MPa, kV
    "timing": 1,  # timing("solve"): seconds, from run.json
    "field": 5,  # field("S_RR", "film", along, across, "stage"): value at a point
    "along": 4,  # along("S_RR", "film", across, "stage"): values along a region
    "across": 4,  # across("S_RR", "film", along, "stage"): values through its thickness
}
# functions that the table of all cases offers on top (see `dealib.study.evaluate`)
OF_ALL_CASES = {"of": 2}  # of(x, "label"): x of one case


class Expression:
    """A parsed expression.

    Args:
        text: What the user wrote.
        extra: Functions of the scope besides the common ones, with their number of arguments.

    Raises:
        ValueError: If it is more than arithmetic, or calls an unknown function.
    """

    def __init__(self, text: str, extra: Mapping[str, int]) -> None:
        self.text = text
        if len(text) > _LONGEST:
            raise ValueError(f"an expression has at most {_LONGEST} characters")
        try:
            self._tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError):
            raise ValueError(f"{text!r} is no arithmetic expression") from None
        self._extra = dict(extra)
        self.names = self._check(self._tree)

    def _check(self, node: ast.AST) -> frozenset[str]:
        """The names that an expression reads; raises on anything that is not in the language."""
        if isinstance(node, ast.Constant) and type(node.value) in (int, float, str):
            return frozenset()
        if isinstance(node, ast.Name):
            return frozenset({node.id})
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            return self._check(node.operand)
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            return self._check(node.left) | self._check(node.right)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            self._check_call(node.func.id, len(node.args))
            return frozenset().union(*(self._check(a) for a in node.args))
        part = ast.get_source_segment(self.text.strip(), node) or self.text
        raise ValueError(f"{part!r}: only numbers, names, + - * / ** and functions are allowed")

    def _check_call(self, name: str, given: int) -> None:
        if name in COMMON:
            _, low, high = COMMON[name]
        elif name in self._extra:
            low = high = self._extra[name]
        else:
            raise ValueError(f"unknown function {name!r}{did_you_mean(name, self.functions)}")
        if not low <= given <= high:
            raise ValueError(f"{name}() takes {low} argument{'s' * (low > 1)}, not {given}")

    @property
    def functions(self) -> list[str]:
        """Names of all functions that may be called."""
        return [*COMMON, *self._extra]

    def __call__(self, names: Mapping[str, Any], functions: Mapping[str, Function]) -> Any:
        """Evaluate.

        Args:
            names: Values of names, arrays mostly.
            functions: The functions of the scope.

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
        if isinstance(node, ast.Name):
            if node.id not in names:
                raise ValueError(f"unknown name {node.id!r}{did_you_mean(node.id, list(names))}")
            return names[node.id]
        if isinstance(node, ast.UnaryOp):
            value = self._value(node.operand, names, functions)
            return -value if isinstance(node.op, ast.USub) else +value
        if isinstance(node, ast.BinOp):
            left, right = (self._value(n, names, functions) for n in (node.left, node.right))
            return _BINARY[type(node.op)](np.asarray(left, float), np.asarray(right, float))
        name = node.func.id
        function = COMMON[name][0] if name in COMMON else functions[name]
        return function(*(self._value(a, names, functions) for a in node.args))
