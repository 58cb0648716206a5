"""A YAML file with the positions of its keys, so that a message can point at them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.reader import ReaderError

from dealib.config.text import TooLarge, load
from dealib.errors import ConfigError, Place, by_caller
from dealib.reading import no_file, read_text, shown

_MOST = 1_000_000  # largest size of a file, bytes; reading 50,000 bytes takes a second


class Source:
    """The parsed text of one file, its overrides, and where each key stands.

    Args:
        path: The file.
        most: Largest size, bytes.
        within: Key of the section to use; empty: the whole file.

    Raises:
        ConfigError: If the file cannot be read or is not a YAML mapping.
    """

    def __init__(self, path: Path, most: int = _MOST, within: str = "") -> None:
        self.path = path
        self.overridden: dict[Place, str] = {}
        self.text = read_text(path, "config", most)
        try:
            self.tree = load(self.text, "rt")
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            problem = _yaml_problem(error, self.text.splitlines()[mark.line : mark.line + 1])
            raise ConfigError(self._at(mark.line, mark.column, problem)) from None
        except ReaderError as error:
            line = self.text.count("\n", 0, error.position)
            column = error.position - (self.text.rfind("\n", 0, error.position) + 1)
            problem = "a control character, which YAML does not allow"
            raise ConfigError(self._at(line, column, problem)) from None
        except (YAMLError, ValueError) as error:
            raise ConfigError(f"{path}: invalid YAML: {str(error).splitlines()[0]}") from None
        if self.tree is None:
            raise ConfigError(f"{path}: the file is empty{_start()}")
        if not isinstance(self.tree, CommentedMap):
            kind = "a list" if isinstance(self.tree, CommentedSeq) else "plain text"
            raise ConfigError(self._at(0, 0, f"expected keys such as 'geometry:', not {kind}"))
        self._refuse(self.tree, ())
        if within:
            if not isinstance(self.tree.get(within), CommentedMap):
                problem = "expected a config here, with keys such as 'geometry:'"
                raise ConfigError(self.message((within,), problem))
            self.tree = self.tree[within]

    def _refuse(self, node: Any, where: Place) -> None:
        """Refuse tags such as '!x', and expressions that an unquoted comma cuts in two."""
        tag = getattr(getattr(node, "tag", None), "value", None)
        if tag is not None:
            raise ConfigError(self.message(where, f"unknown tag {tag!r}; write the value alone"))
        if not isinstance(node, (CommentedMap, CommentedSeq)):
            return
        keys = list(node) if isinstance(node, CommentedMap) else list(range(len(node)))
        for i, key in enumerate(keys):
            rest = (keys if isinstance(node, CommentedMap) else node)[i + 1 : i + 20]
            if node.fa.flow_style() and _is_cut(node[key], rest):
                line, column = self._position((*where, key), "value")
                found = _CALL.match(self.text.splitlines()[line][column:])
                problem = f"{_QUOTE}: '{found[0]}'" if found else _QUOTE
                raise ConfigError(self.message((*where, key), problem))
            self._refuse(node[key], (*where, key))

    def override(self, assignment: str) -> None:
        """Change one value.

        Args:
            assignment: Such as `key.sub.0.key=value`; the value is read as YAML.

        Raises:
            ConfigError: If the assignment is malformed or its path does not exist.
        """
        key, sign, text = assignment.partition("=")
        parts = [int(p) if p.isdigit() else p for p in key.strip().split(".")]
        if not sign or "" in parts:
            raise ConfigError(
                f"{_set()}{shown(assignment)}: expected KEY=VALUE, such as mesh.columns=80"
            )
        try:
            value = load(text)
        except TooLarge as error:
            raise ConfigError(f"{_set()}{shown(assignment)}: {error.problem}") from None
        except (YAMLError, ValueError):
            value = text.strip()
        node: Any = self.tree
        for depth, part in enumerate(parts):
            if problem := _no_step(node, part, ".".join(map(str, parts[:depth]))):
                raise ConfigError(f"{_set()}{shown(assignment)}: {problem}")
            if depth == len(parts) - 1:
                node[part] = value
            elif isinstance(node, dict) and node.get(part) is None:
                node[part] = CommentedMap()
            node = node[part]
        self.overridden[tuple(parts)] = assignment

    def file(self, where: Place, given: str) -> Path:
        """A file that a key names: beside this one, or in the present folder.

        Raises:
            ConfigError: If there is none.
        """
        path = Path(given).expanduser()
        beside = self.path.parent / path
        if not (beside.exists() or path.exists()):
            raise ConfigError(self.message(where, no_file(given, beside.parent)))
        return beside if beside.exists() else path

    def message(self, where: Place, problem: str, at: Literal["key", "value"] = "value") -> str:
        """A message about a key: its place as `file:line:col` with a caret, or its override.

        Where the place is in the file, the overrides are named too: one of them may be the cause.

        Args:
            where: Path of keys and list positions; of a path that is not in the file, the deepest
                part that is there is shown.
            problem: What is wrong.
            at: Whether the caret points at the key or at its value.
        """
        dotted = ".".join(map(str, where))
        for path, assignment in self.overridden.items():
            n = min(len(path), len(where))
            if path[:n] == where[:n] and (len(where) >= len(path) or not self._in_text(where)):
                key = "" if ".".join(map(str, path)) == dotted else f"{dotted}: "
                return f"{_set()}{shown(assignment)}: {key}{problem}"
        if self.overridden:
            changes = f", {_set()}".join(map(shown, self.overridden.values()))
            problem += f" (with {_set()}{changes})"
        line, column = self._position(where, at)
        return self._at(line, column, f"{dotted}: {problem}" if dotted else problem)

    def _in_text(self, where: Place) -> bool:
        """Whether the deepest key of a path stands in the file."""
        node = self.tree
        for part in where:
            if isinstance(node, CommentedMap) and part not in (node.lc.data or {}):
                return False
            node = node[part]
        return True

    def _position(self, where: Place, at: str) -> tuple[int, int]:
        """Line and column, from 0, of the deepest part of a path that is in the file."""
        node, found = self.tree, (0, 0)
        for depth, part in enumerate(where):
            try:
                if isinstance(node, CommentedSeq):
                    found = node.lc.item(part)
                elif at == "value" and depth == len(where) - 1 and node[part] is not None:
                    found = node.lc.value(part)
                else:
                    found = node.lc.key(part)
                node = node[part]
            except (KeyError, TypeError, AttributeError, IndexError):
                break
        return found

    def _at(self, line: int, column: int, problem: str) -> str:
        lines = self.text.splitlines()
        head = f"{self.path}:{line + 1}:{column + 1}: {problem}"
        if line >= len(lines) or not lines[line].strip():
            return head
        start = max(0, column - _WIDE // 2) if len(lines[line]) > _WIDE else 0
        part = lines[line][start : start + _WIDE]
        part = "".join(c if c.isprintable() else " " for c in part)  # tabs would shift the caret
        return f"{head}\n    {part}\n    {' ' * (column - start)}^"


_WIDE = 200  # characters of a line that are shown
_QUOTE = "a comma ends the value here; quote the expression"
_CALL = re.compile(r"[^{}\[\]]*?\([^()]*\)")


def _set() -> str:
    """What stands before an override in messages."""
    return by_caller("--set ", "set ")


def _start() -> str:
    return "; " + by_caller(
        "'dealib init' writes a config to start from", "dealib.template() is one to start from"
    )


_YAML_PROBLEMS = {  # pattern of the parser's message -> our message
    r"duplicate key \"(.*?)\"": "the key '{0}' is given twice",
    r"character '\\t'": "a tab; YAML takes spaces only",
    r"character '(.)' that cannot start": "text that starts with '{0}' needs quotes",
    r"mapping values are not allowed": "a ':' in the wrong place; check the indentation, or put "
    "the text in quotes",
    r"expected the node content": "a value is missing before this",
    r"expected <block end>": "the indentation of this line matches no line above",
    r"expected ',' or '([]}])'": "a ',' or the closing '{0}' is missing before this",
    r"unexpected end of stream": "a closing quote is missing",
    r"undefined alias '(.*?)'": "'*{0}' refers to no anchor '&{0}'",
    r"another document": "a second document begins here; a file holds one",
    r"could not find expected ':'": "expected 'key: value'",
}


def _yaml_problem(error: MarkedYAMLError, line: list[str]) -> str:
    said = str(error.problem or error.context)
    if isinstance(error, TooLarge):
        return said
    for pattern, problem in _YAML_PROBLEMS.items():
        if found := re.search(pattern, said):
            hint = "; an expression with commas needs quotes, such as 'end(force_N, \"push\")'"
            within = pattern.startswith("expected ','") and re.search(r"\w\([^)]*,", "".join(line))
            return problem.format(*found.groups()) + (hint if within else "")
    return f"invalid YAML: {said.strip().splitlines()[0]}"


def _is_cut(value: Any, rest: list[Any]) -> bool:
    """Whether a value is an expression that continues after a comma, in the values after it."""
    parts = [str(part) for part in (value, *rest)]
    missing = [part.count("(") - part.count(")") for part in parts]
    return isinstance(value, str) and missing[0] > 0 > min(missing)


def _no_step(node: Any, part: str | int, above: str) -> str:
    """Why a node of an override's path has no such part; empty if it has or may get it."""
    if isinstance(node, dict):
        return "" if isinstance(part, str) else f"{above or 'the file'} is not a list"
    if not isinstance(node, list):
        return f"{above} is a single value without a key {part!r}"
    if isinstance(part, int) and part < len(node):
        return ""
    return f"{above} is a list with items 0 to {len(node) - 1}, it has no {part!r}"
