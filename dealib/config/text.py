"""Reading and writing YAML with limits: by aliases, a few lines could expand to millions."""

from __future__ import annotations

import copy
import functools
import io
from typing import Any, Literal

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.events import AliasEvent

_DEEPEST = 50  # levels of nesting
_LONG = 50_000  # characters; longer texts are not cached
_COPIES = 100_000  # values that aliases may add


class TooLarge(ComposerError):
    """The text is nested too deeply, or its aliases expand to too many values."""


class _Limited(Composer):
    """Counts the values of each node, those that aliases repeat included."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self._sizes: dict[int, int] = {}  # of the nodes, by their identity
        self._open = [0]  # sizes of the enclosing nodes, counted so far
        self._copies = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.parser.peek_event().start_mark
        if self.parser.check_event(AliasEvent):
            node = super().compose_node(parent, index)
            size = self._sizes.get(id(node))
            if size is None:
                raise TooLarge(problem="a value that contains itself", problem_mark=mark)
            self._copies += size
        else:
            self._open.append(1)
            if len(self._open) > _DEEPEST + 2:
                problem = f"more than {_DEEPEST} levels of nesting"
                raise TooLarge(problem=problem, problem_mark=mark)
            node = super().compose_node(parent, index)
            size = self._sizes[id(node)] = self._open.pop()
        self._open[-1] += size
        if self._copies > _COPIES:
            problem = f"the aliases up to here stand for more than {_COPIES} values"
            raise TooLarge(problem=problem, problem_mark=mark)
        return node


def load(text: str, typ: Literal["rt", "safe"] = "safe") -> Any:
    """Read YAML.

    Args:
        text: The text.
        typ: 'rt' keeps positions and comments, 'safe' gives plain values.

    Raises:
        YAMLError, ValueError: If it is not valid, or too large (`TooLarge`).
    """
    if len(text) > _LONG:
        return _load(text, typ)
    return copy.deepcopy(_cached(text, typ))  # ten times as fast as reading


def _load(text: str, typ: Literal["rt", "safe"]) -> Any:
    yaml = YAML(typ=typ, pure=True)
    yaml.Composer = _Limited
    return yaml.load(text)


_cached = functools.lru_cache(maxsize=16)(_load)  # a sweep reads its base for each case


def dump(tree: Any) -> str:
    """The text of a tree that was read as 'rt', with its comments."""
    yaml = YAML(typ="rt")
    yaml.width = 100
    yaml.preserve_quotes = True
    out = io.StringIO()
    yaml.dump(tree, out)
    return out.getvalue()
