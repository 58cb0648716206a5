"""A YAML text with its positions, so that a message can point at a key."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from dealib.errors import ConfigError

Path_ = tuple[str | int, ...]


class Source:
    """The parsed text of one file, its overrides, and where each key stands.

    Args:
        path: The file.

    Raises:
        ConfigError: If the file cannot be read or is no YAML mapping.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.overridden: dict[Path_, str] = {}
        try:
            self.text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{path}: cannot read the config: {error.strerror}") from None
        except UnicodeDecodeError:
            raise ConfigError(f"{path}: not a text file in UTF-8") from None
        try:
            self.tree = YAML(typ="rt", pure=True).load(self.text)
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            problem = (error.problem or str(error)).strip().splitlines()[0]
            raise ConfigError(self._at(mark.line, mark.column, f"YAML: {problem}")) from None
        except YAMLError as error:
            raise ConfigError(f"{path}: YAML: {error}") from None
        if not isinstance(self.tree, CommentedMap):
            raise ConfigError(f"{path}: expected a mapping of keys such as 'geometry:'")

    def override(self, assignment: str) -> None:
        """Apply one `key.sub.0.key=value`; the value is read as YAML.

        Raises:
            ConfigError: If the assignment is malformed or its path does not exist.
        """
        key, sign, text = assignment.partition("=")
        parts = [int(p) if p.isdigit() else p for p in key.strip().split(".")]
        if not sign or "" in parts:
            raise ConfigError(f"--set {assignment}: expected KEY=VALUE, such as mesh.columns=80")
        try:
            value = YAML(typ="safe", pure=True).load(text)
        except YAMLError:
            value = text.strip()
        node: Any = self.tree
        for depth, part in enumerate(parts[:-1]):
            done = ".".join(map(str, parts[: depth + 1]))
            if isinstance(node, CommentedMap) and isinstance(part, str):
                if node.get(part) is None:
                    node[part] = CommentedMap()
                node = node[part]
            elif isinstance(node, CommentedSeq) and isinstance(part, int) and part < len(node):
                node = node[part]
            else:
                raise ConfigError(f"--set {assignment}: there is no {done!r} in {self.path}")
        last = parts[-1]
        fits = isinstance(node, CommentedMap) and isinstance(last, str)
        if not fits and not (
            isinstance(node, CommentedSeq) and isinstance(last, int) and last < len(node)
        ):
            raise ConfigError(f"--set {assignment}: there is no {key.strip()!r} in {self.path}")
        node[last] = value
        self.overridden[tuple(parts)] = assignment

    def message(self, where: Path_, problem: str) -> str:
        """The problem, headed by `file:line:col` or the `--set` it came from, with a caret."""
        for depth in range(len(where), 0, -1):
            if where[:depth] in self.overridden:
                key = ".".join(map(str, where))
                return f"--set {self.overridden[where[:depth]]}: {key}: {problem}"
        node, line, column = self.tree, 0, 0
        for part in where:
            try:
                if isinstance(node, CommentedMap):
                    line, column = node.lc.key(part)
                else:
                    line, column = node.lc.item(part)
                node = node[part]
            except (KeyError, TypeError, AttributeError, IndexError):
                break
        return self._at(line, column, f"{'.'.join(map(str, where))}: {problem}".lstrip(": "))

    def _at(self, line: int, column: int, problem: str) -> str:
        lines = self.text.splitlines()
        head = f"{self.path}:{line + 1}:{column + 1}: {problem}"
        if line >= len(lines) or not lines[line].strip():
            return head
        return f"{head}\n    {lines[line]}\n    {' ' * column}^"


def did_you_mean(word: object, known: Sequence[str] | Mapping[str, Any]) -> str:
    """A hint at the nearest known word, or at all of them."""
    near = difflib.get_close_matches(str(word), list(known), n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(known)}" if known else ""
